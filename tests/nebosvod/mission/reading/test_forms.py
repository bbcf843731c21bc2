"""Natural wrong forms are answered with the right one: what the message tells to write is then accepted."""

import re
from pathlib import Path

import pytest

from nebosvod.errors import InputError
from nebosvod.mission import load_mission_text
from nebosvod.units import ANGLE, DURATION, LENGTH, MASS, SPEED, Dimension, quantity

BASE = (Path(__file__).resolve().parents[4] / "scenarios" / "minimal.yaml").read_text("utf-8")


def said(text: str) -> str:
    """What is wrong with a mission."""
    with pytest.raises(InputError) as error:
        load_mission_text(text, "m.yaml")
    return str(error.value)


def mission(telescope: str, more: str = "") -> str:
    """The smallest mission, its telescopes replaced by one line."""
    head, _, tail = BASE.partition("telescopes:")
    schedule = "schedule:" + tail.partition("\nschedule:")[2]
    schedule = schedule.partition("\nestimators:")[0].partition("\npredictions:")[0]
    return f"{head.rstrip()}\n\ntelescopes:\n  - {{name: A, {telescope}}}\n{schedule}\n{more}\n"


GOOD = "orbit: {kind: geostationary, longitude: 0 deg}, noise: {sigma: 0.1 arcsec}"


def test_the_mission_around_the_wrong_forms_is_right() -> None:
    assert load_mission_text(mission(GOOD)).telescopes[0].name == "A"


@pytest.mark.parametrize(
    ("text", "dimension", "meant"),
    [
        ("3 days", DURATION, "3 d"),
        ("2 weeks", DURATION, "14 d"),
        ("10 Hours", DURATION, "10 h"),
        ("90 secs", DURATION, "90 s"),
        ("1 month", DURATION, "30.4375 d"),
        ('0.3"', ANGLE, "0.3 arcsec"),
        ("0.3''", ANGLE, "0.3 arcsec"),
        ("0.3 arcseconds", ANGLE, "0.3 arcsec"),
        ("100 microarcseconds", ANGLE, "0.1 mas"),
        ("5°", ANGLE, "5 deg"),
        ("5 kilometres", LENGTH, "5 km"),
        ("5 KM", LENGTH, "5 km"),
        ("1 astronomical unit", LENGTH, "1 au"),
        ("3 metres per second", SPEED, "3 m/s"),
        ("7.5 km/sec", SPEED, "7.5 km/s"),
        ("100 tonnes", MASS, "100000 kg"),
    ],
)
def test_other_spellings_of_units_are_answered_with_ours(text: str, dimension: Dimension, meant: str) -> None:
    with pytest.raises(InputError, match=re.escape(f'did you mean "{meant}"?')):
        quantity(text, dimension)
    assert quantity(meant, dimension) > 0.0


@pytest.mark.parametrize("text", ["1 h 30 min", "1d12h", "5 deg 30 arcmin"])
def test_two_numbers_are_told_to_be_one(text: str) -> None:
    with pytest.raises(InputError, match="one number with one unit"):
        quantity(text, ANGLE if "deg" in text else DURATION)


@pytest.mark.parametrize(
    ("key", "value", "form"),
    [
        ("noise", "0.3 arcsec", "{sigma: 0.3 arcsec}"),
        ("noise", "0.3", "{sigma: 0.3 arcsec}"),
        ("noise", "0.3''", "{sigma: 0.3 arcsec}"),
        ("noise", "300 milliarcseconds", "{sigma: 300 mas}"),
        ("bias", "50 mas", "{sigma: 50 mas, treatment: considered}"),
        ("position", "5 kilometres", "{sigma: 5 km, correlation: white, treatment: considered}"),
        ("timing", "10 ms", "{sigma: 10 ms, treatment: considered}"),
        ("exclusion", "40 deg", "{sun: 40 deg}"),
        ("orbit", "halo", "{kind: libration, point: L1, amplitude: 700000 km}"),
        ("orbit", "L2", "{kind: libration, point: L2, amplitude: 700000 km}"),
        ("orbit", "L-1", "{kind: libration, point: L1, amplitude: 700000 km}"),
        ("orbit", "GEO", "{kind: geostationary, longitude: 0 deg}"),
        ("orbit", "geocentre", "{kind: geostationary, longitude: 0 deg}"),
        ("orbit", "LEO", "{kind: sun_synchronous, altitude: 700 km, local_time: 6 h}"),
        ("orbit", "F51", "{kind: ground, code: F51}"),
        ("orbit", "flown.oem", "{kind: oem, file: flown.oem}"),
        ("orbit", "earth-trailing", "{kind: heliocentric, lead: -60 deg}"),
        ("orbit", "DRO", "{kind: distant_retrograde, size: 5e6 km}"),
    ],
)
def test_a_number_or_a_word_where_a_block_is_needed(key: str, value: str, form: str) -> None:
    """The form that the message tells is taken, where it names no file."""
    parts = {"orbit": "orbit: {kind: geostationary, longitude: 0 deg}", "noise": "noise: {sigma: 0.1 arcsec}"}
    wrong = ", ".join(parts[k] if k != key else f'{k}: "{value}"' for k in dict.fromkeys([*parts, key]))
    message = said(mission(wrong.replace('"0.3"', "0.3")))
    assert f"telescopes[0].{key}: needs a block of keys" in message
    assert message.partition("; write ")[2].startswith(f"{key}: {form}")
    if "file" not in form and "ground" not in form:  # of the ground, the year is beyond the tables of its rotation
        right = ", ".join(parts[k] if k != key else f"{k}: {form}" for k in dict.fromkeys([*parts, key]))
        assert load_mission_text(mission(right)).telescopes[0].name == "A"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("halo", "write orbit: {kind: libration, point: L1"),
        ("L1", "write orbit: {kind: libration, point: L1"),
        ("GEO", "write orbit: {kind: geostationary"),
        ("SSO", "write orbit: {kind: sun_synchronous"),
        ("geostationery", 'did you mean "geostationary"?'),
        ("sun-synchronous", 'did you mean "sun_synchronous"?'),
    ],
)
def test_a_kind_of_orbit_by_another_name(kind: str, words: str) -> None:
    assert words in said(mission(f"orbit: {{kind: {kind}}}, noise: {{sigma: 0.1 arcsec}}"))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("monte_carlo: 400", "write monte_carlo: {runs: 400}"),
        ("prior: 100 km", "write prior: {sigma: {position: 100 km, velocity: 0.1 m/s}}"),
        ("prior: first.oem", "write prior: {file: first.oem}"),
        ("estimators: [batch]", "write - {name: batch, method: batch_qr}"),
        ("predictions: [target plane]", "write - {name: encounter, plane: b_plane, near:"),
        ("predictions: {name: a, plane: rtn, at: 2028-05-01 TDB}", "write predictions: [{...}]"),
        ("predictions: [{name: a, plane: target plane, near: 2028-05-01 TDB}]", 'did you mean "b_plane"?'),
        ("estimators: [{name: a, method: kalman}]", 'did you mean "recursive"?'),
        ("estimators: [{name: a, method: batch_qr, treatment: {bias: consider}}]", 'did you mean "considered"?'),
    ],
)
def test_the_other_blocks_of_a_mission(more: str, words: str) -> None:
    assert words in said(mission(GOOD, more))


def test_a_value_with_its_spread_is_told_as_a_block() -> None:
    text = re.sub(r"radius: \{.*?\}", "radius: 170 +- 20 m", mission(GOOD))
    assert "write radius: {value: 170 m, sigma: 20 m, treatment: considered}" in said(text)
