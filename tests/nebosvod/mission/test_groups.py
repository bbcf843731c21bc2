"""A treatment of a group that a mission does not have: what there is, and a line that makes it."""

import pytest

from nebosvod.errors import InputError
from nebosvod.mission import load_mission_text
from nebosvod.mission.reading.rules import HOW_TO_ADD

CERTAIN = """schema_version: 1
name: certain
reference_epoch: 2028-03-20T00:00:00 TDB
object:
  name: Example
  orbit: {kind: keplerian, frame: ecliptic_j2000, epoch: 2028-03-20T00:00:00 TDB, a: 1.3 au, e: 0.2, i: 8 deg, node: 0 deg, peri: 180 deg, M: 0 deg}
  #object
telescopes:
  - name: ahead
    orbit: {kind: heliocentric, lead: 10 deg}
    noise: {sigma: 0.1 arcsec}
    #telescope
schedule:
  - {start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 1 d}
estimators:
  - {name: one, method: batch_qr, treatment: {GROUP: fixed}}
"""  # noqa: E501
BODY = {
    "radius": "radius: {value: 10 m}",
    "mass": "mass: {value: 8e6 kg}",
    "albedo": "albedo: {value: 0.15}",
}


def with_line(group: str) -> str:
    """The mission with the line that the message proposes at the place it proposes."""
    line, block = HOW_TO_ADD[group]
    if block == "a telescope":
        return CERTAIN.replace("#telescope", line)
    if block == "object.nongrav":
        return CERTAIN.replace("#object", f"nongrav: {{{line}}}")
    rest = [text for name, text in BODY.items() if name != group] if group in BODY else []
    return CERTAIN.replace("#object", "\n  ".join([line, *rest]))


@pytest.mark.parametrize("group", HOW_TO_ADD)
def test_without_any_group_the_line_to_add_is_said_and_right(group: str) -> None:
    with pytest.raises(InputError) as error:
        load_mission_text(CERTAIN.replace("GROUP", group))
    said = str(error.value)
    line, block = HOW_TO_ADD[group]
    assert f'this mission has no groups: nothing in it is uncertain (got "{group}"); add {line} to {block}' in said
    assert "treatment" in said
    assert "allowed: )" not in said
    mission = load_mission_text(with_line(group).replace("GROUP", group))
    assert mission.estimators[0].treatment == {group: "fixed"}


def test_a_word_that_is_none_is_answered_by_the_nearest() -> None:
    with pytest.raises(InputError, match=r"this mission has no groups.*add timing: "):
        load_mission_text(CERTAIN.replace("GROUP", "timming"))


def test_beside_other_groups_the_missing_one_is_said_how_to_have() -> None:
    text = with_line("bias").replace("GROUP", "timing")
    with pytest.raises(
        InputError, match=r'unknown group \(got "timing"; allowed: bias.*to have it, add timing: \{sigma'
    ):
        load_mission_text(text)


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (
            "{sigma: 1e-5, field: 11 deg, treatment: considered}",
            "field: is out of range .allowed up to 10 deg",
        ),
        ("{field: 1 deg, treatment: considered}", "plate_scale.sigma: is missing"),
        ("{sigma: -1e-5, field: 1 deg, treatment: considered}", "plate_scale.sigma: is out of range"),
        ("{sigma: 1e-5, field: 1, treatment: considered}", "plate_scale.field: needs .*unit"),
    ],
)
def test_a_plate_scale_is_a_number_over_a_field(block: str, words: str) -> None:
    text = CERTAIN.replace("#telescope", f"plate_scale: {block}").replace(", treatment: {GROUP: fixed}", "")
    with pytest.raises(InputError, match=words):
        load_mission_text(text)
