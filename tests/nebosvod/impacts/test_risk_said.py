"""What a risk says: bounds, notices, budgets that do not exist, and wrong input."""

import json
from pathlib import Path

import numpy as np
import pytest

from nebosvod import read_orbit
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris
from nebosvod.impacts.cloud import draw
from nebosvod.impacts.flight import Course
from nebosvod.impacts.left_out import left_out_words
from nebosvod.impacts.yarkovsky import with_yarkovsky
from nebosvod.timescale import Epoch

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


@needs_data
def test_an_end_amid_an_encounter_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the hits of 2024 YR4 on the Moon are later; where no orbit is drawn nothing knows of it."""
    asked = ["risk", str(DATA / "neocc" / "2024YR4.ke0"), "--until", "2032-12-22T15:18:00", "--draws", "20"]
    assert main([*asked, "--bodies", "moon"]) == 0
    said = capsys.readouterr()
    assert "notice: the Moon on 2032-12-22: --until is amid the encounter" in said.err
    assert "linear target plane disagrees" in said.out


def test_a_force_model_that_decides_is_told_and_one_that_does_not_is_not() -> None:
    """By sigmas times sigmas, the change of ln P: 0.1 of them at one sigma is nothing, at four and a half it is 1.6."""
    assert left_out_words(None, 4.5) == ""
    assert left_out_words(0.1, 0.4) == ""
    assert "may move it by 0.1 sigmas along the line" in left_out_words(0.1, -4.5)
    assert "many sigmas" in left_out_words(float("inf"), None)


@needs_data
def test_no_hit_is_a_bound_and_never_zero(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["risk", str(DATA / "sbdb" / "433_phys.json"), "--until", "2025-01-01", "--draws", "100"]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert (
        "no virtual impactor of the Earth or the Moon until 2025-01-01: none of 100 drawn orbits hits, P < 0.03" in said
    )
    assert "the line of variations from -5 to 5 sigmas and the target planes of the estimate to 7 sigmas" in said


@needs_data
def test_one_matrix_of_others_has_no_budget_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["risk", str(DATA / "neocc" / "2024YR4.ke0"), "--until", "2033-01-01", "--draws", "50", "--bodies", "moon"]
    assert main([*asked, "-o", str(tmp_path / "yr4")]) == 0
    said = capsys.readouterr().out
    assert "what it hangs on: the sources of the covariance are not known: " in said
    assert "2024YR4.ke0 tells one matrix" in said
    (one,) = json.loads((tmp_path / "yr4" / "summary.json").read_text("utf-8"))["virtual_impactors"]
    assert one["budget"] is None
    assert "one matrix" in one["no_budget"]
    assert one["bend"]["matters"] is False
    page = (tmp_path / "yr4" / "report.html").read_text("utf-8")
    assert "The sources of the covariance are not known" in page


@needs_data
def test_a_satellite_of_mars_below_its_surface_is_no_safe_orbit(capsys: pytest.CaptureFixture[str]) -> None:
    """The OEM of CCSDS starts 2993 km from the centre of Mars: no orbit flies, which is no answer and no bound."""
    path = DATA.parent / "formats" / "ccsds" / "CovarianceExample.oem"
    assert main(["risk", str(path), "--until", "2021-01-01", "--draws", "20"]) == 1
    said = capsys.readouterr()
    assert "no drawn orbit can be flown" in said.err
    assert "P <" not in said.out


@needs_data
@pytest.mark.parametrize(
    "asked",
    [
        ["risk", "--until", "2026-01-01", "--draws", "20"],
        ["approaches", "--from", "2026-01-01", "--to", "2027-01-01"],
        ["ephemeris", "--from", "2026-01-01", "--to", "2026-01-02", "--step", "1 d"],
    ],
    ids=lambda asked: str(asked[0]),
)
def test_a_region_as_large_as_the_orbit_is_not_believed(asked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """ESA's 2001 VB, 24 years after its six days of observations: 3e8 km, twice an au."""
    assert main([asked[0], str(DATA / "neocc" / "2001VB.ke1"), *asked[1:]]) == 0
    assert "approach or probability from it is to be believed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until", "1990-01-01"], "--until: 1990-01-01T00:00:00 UTC is not after the epoch of the orbit"),
        (["--until", "2030-13-01"], "--until: "),
        (["--until", "2030-01-01", "--bodies", "vulcan"], '--bodies: "vulcan" is no target'),
        (["--until", "2030-01-01", "--bodies", "earth,earth"], "each once"),
        (["--until", "2030-01-01", "--draws", "0"], "--draws: 0"),
        (["--until", "2030-01-01", "--density", "1"], "--density: 1 kg/m3"),
        (["--until", "2030-01-01", "--diameter", "0 m"], "--diameter: 0 m"),
        (["--until", "2930-01-01"], "the ephemeris"),
    ],
)
@needs_data
def test_wrong_input_is_said(options: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["risk", str(DATA / "sbdb" / "433_phys.json"), *options]) in (2, 3)
    assert said in capsys.readouterr().err


@needs_data
def test_an_orbit_without_a_covariance_or_with_an_indefinite_one_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = json.loads((DATA / "sbdb" / "433_phys.json").read_text("utf-8"))
    bare = tmp_path / "bare.json"
    bare.write_text(json.dumps(whole | {"orbit": {k: v for k, v in whole["orbit"].items() if k != "covariance"}}))
    assert main(["risk", str(bare), "--until", "2030-01-01"]) == 2
    assert "cov=mat" in capsys.readouterr().err
    whole["orbit"]["covariance"]["data"][0][0] = "-1e-12"
    bare.write_text(json.dumps(whole))
    assert main(["risk", str(bare), "--until", "2030-01-01"]) == 2
    assert "not positive definite" in capsys.readouterr().err


@needs_data
def test_an_a2_that_nobody_estimated_is_drawn_by_size_more_than_twenty_years_ahead(bodies: Ephemeris) -> None:
    orbit = read_orbit(DATA / "neocc" / "2023DZ2.ke0")
    near, far = (with_yarkovsky(orbit, Epoch.parse(f"{year}-01-01 UTC"), 0.05) for year in (2040, 2060))
    assert near is orbit
    assert far.parameter_names == ("a2_au_d2",)
    assert far.sigma[6] == pytest.approx(1e-14 / 0.05)
    assert far.covariance[:6, :6] == pytest.approx(orbit.covariance, rel=1e-12)
    assert "A2 is not estimated" in far.notices[-1]
    flown = Course(orbit=far, ephemeris=bodies, last=Epoch.parse("2024-01-01 UTC"), bodies=("earth",))
    assert len(flown.fly(draw(far, 5, np.random.default_rng(1)))) == 5
    known = read_orbit(DATA / "sbdb" / "99942_phys.json")
    assert with_yarkovsky(known, Epoch.parse("2100-01-01 UTC"), 0.34) is known


@needs_data
def test_years_count_from_the_last_observation_where_a_file_tells_it() -> None:
    assert read_orbit(DATA / "sbdb" / "2024YR4_phys.json").last_observation == Epoch.parse("2025-05-11 UTC")
