"""Orbits of which little is known: priors that say nothing, arcs that do not tell the distance."""

import json
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main
from nebosvod.mission.reading.builtin import builtin_path

SHORT = "end: 2028-03-20T0{}:00:00 TDB, cadence: {} min"
BEHIND = "  - {name: behind, like: ahead, orbit: {lead: -10 deg}}\n"


def summary_of(folder: Path, text: str, *options: str) -> tuple[int, dict[str, Any]]:
    mission = folder / "m.yaml"
    mission.write_text(text, "utf-8")
    code = main(["run", str(mission), "-o", str(folder / "out"), "--overwrite", *options])
    return code, json.loads((folder / "out" / "summary.json").read_text("utf-8"))


@pytest.fixture
def minimal() -> str:
    return builtin_path("minimal").read_text("utf-8")


def alone(minimal: str, hours: int, minutes: int) -> str:
    """One telescope and one short arc."""
    return minimal.replace("end: 2028-04-19T00:00:00 TDB, cadence: 1 d", SHORT.format(hours, minutes)).replace(
        BEHIND, ""
    )


@pytest.mark.parametrize(
    ("position", "velocity"), [("1e9 km", "1 km/s"), ("1e12 km", "1e6 km/s"), ("1e8 km", "1 km/s")]
)
def test_a_prior_as_wide_as_the_orbit_is_no_prior(tmp_path, minimal, position, velocity):
    """No truth is drawn from it: most of its orbits are of no object that these telescopes see."""
    _, without = summary_of(tmp_path, minimal)
    code, found = summary_of(tmp_path, f"{minimal}prior: {{sigma: {{position: {position}, velocity: {velocity}}}}}\n")
    assert code == 0
    for key in ("sigma_position_km", "sigma_velocity_m_s"):
        assert found["estimators"][0][key] == pytest.approx(without["estimators"][0][key], rel=1e-4)
    assert any("as wide as the orbit itself" in warning for warning in found["warnings"])


@pytest.mark.parametrize("options", [[], ["--full"]], ids=["linear", "full"])
@pytest.mark.parametrize("prior", ["position: 20 km, velocity: 4 km/s", "position: 1e12 km, velocity: 0.1 m/s"])
def test_a_prior_of_which_a_part_says_nothing_is_right_about_the_rest(tmp_path, minimal, prior, options, capsys):
    """Two hours: what the narrow part of the prior says is most of what is known, so truths must err as it does."""
    arc = "end: 2028-04-19T00:00:00 TDB, cadence: 1 d"
    text = minimal.replace(arc, "end: 2028-03-20T02:00:00 TDB, cadence: 20 min")
    (tmp_path / "m.yaml").write_text(f"{text}prior: {{sigma: {{{prior}}}}}\n", "utf-8")
    runs = "60" if options else "400"
    code = main(
        ["validate", str(tmp_path / "m.yaml"), "-n", runs, "-o", str(tmp_path / "v"), "--workers", "1", *options]
    )
    assert code == 0, capsys.readouterr().out


def test_an_arc_that_does_not_tell_the_distance_is_no_answer(tmp_path, minimal, capsys):
    """An hour from one place: 0.19 au with a sigma of 12 au."""
    code, found = summary_of(tmp_path, alone(minimal, 1, 10))
    assert code == 1
    assert found["estimators"][0]["status"] == "not_observable"
    assert "do not tell how far the object is: 0." in capsys.readouterr().out


@pytest.mark.parametrize("seed", range(4))
def test_an_arc_that_does_converges_whatever_was_drawn(tmp_path, minimal, seed):
    """Six hours from one telescope about the Earth, whose error in place counts the more the nearer the object."""
    text = alone(minimal, 6, 30).replace("kind: heliocentric, lead: 10 deg", "kind: geostationary, longitude: 0 deg")
    code, found = summary_of(tmp_path, text, "--seed", str(seed))
    assert code == 0
    assert found["estimators"][0]["status"] == "converged"


def test_the_page_states_no_accuracy_where_there_is_none(tmp_path, minimal):
    code, _ = summary_of(tmp_path, alone(minimal, 1, 10))
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert code == 1
    assert "No accuracy can be stated: the measurements and priors do not determine" in page


def test_a_headline_of_an_ellipse_that_misleads_says_so(tmp_path, minimal):
    """Six hours from one place: the distance ten days later is linear no more."""
    text = alone(minimal, 6, 30).replace("kind: heliocentric, lead: 10 deg", "kind: geostationary, longitude: 0 deg")
    text = text.replace("sigma: 0.1 arcsec", "sigma: 5 arcsec")
    _, found = summary_of(tmp_path, text)
    misleads = found["predictions"][0]["nonlinearity"]["misleads"]
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    headline = page[page.index('<section id="verdict"') :].split("</h2>")[0]
    assert misleads == ("linear ellipse misleads here" in headline)
    assert misleads


def test_a_source_that_an_estimator_holds_fixed_is_told(tmp_path, minimal):
    """Its true sigma lacks the error of that source; the parameters of the orbit were told, those of telescopes not."""
    text = minimal + "estimators: [{name: blind, method: batch_qr, treatment: {bias: fixed}}]\n"
    _, found = summary_of(tmp_path, text)
    assert any(
        warning == "blind holds fixed bias: its accuracy leaves their errors out" for warning in found["warnings"]
    )


def test_several_that_hold_things_fixed_on_purpose_are_one_short_warning(tmp_path, minimal):
    text = (
        minimal
        + """estimators:
  - {name: all, method: batch_qr}
  - {name: blind, method: batch_qr, treatment: {bias: fixed}}
  - {name: bare, method: batch_qr, treatment: {bias: fixed, position: fixed}}
"""
    )
    _, found = summary_of(tmp_path, text)
    told = [warning for warning in found["warnings"] if "fixed" in warning]
    assert told == [
        "2 estimators (blind, bare) hold fixed bias; some of them telescope position: their accuracy leaves those "
        "errors out"
    ]
