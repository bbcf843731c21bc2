"""`nebosvod elements` against the elements that JPL prints at another epoch than that of its covariance."""

import json
from pathlib import Path

import pytest
from astropy.time import Time

from nebosvod.cli import main

SBDB = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "orbits" / "sbdb"
THEIRS = {"a_au": "a", "e": "e", "i_deg": "i", "node_deg": "om", "peri_deg": "w", "mean_anomaly_deg": "ma"}
needs_data = pytest.mark.skipif(not SBDB.is_dir(), reason="the folder of reference data is not here")


@needs_data
@pytest.mark.parametrize("name", ["99942_phys", "2023DZ2_phys", "433_phys"])
def test_elements_carried_to_the_epoch_of_jpl_have_its_values_and_sigmas(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the epoch of the covariance, years before."""
    path = SBDB / f"{name}.json"
    orbit = json.loads(path.read_text("utf-8"))["orbit"]
    assert orbit["epoch"] != orbit["covariance"]["epoch"]
    at = Time(float(orbit["epoch"]), format="jd", scale="tdb").isot
    assert main(["elements", str(path), "--at", f"{at} TDB", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["elements"]
    said = {row["name"]: row for row in orbit["elements"]}
    for ours, theirs in THEIRS.items():
        value, sigma = float(said[theirs]["value"]), float(said[theirs]["sigma"])
        assert found[ours]["value"] == pytest.approx(value, abs=0.3 * sigma), ours
        assert found[ours]["sigma"] == pytest.approx(sigma, rel=0.02), ours


@needs_data
def test_an_encounter_changes_the_elements_and_a_wrong_date_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """That of 13 April 2029 lifts Apophis from an Aten's 0.92 au to an Apollo's 1.10 au."""
    path = str(SBDB / "99942_phys.json")
    for date, a in (("2029-03-01", "0.92"), ("2029-06-01", "1.10")):
        assert main(["elements", path, "--at", date]) == 0
        line = next(line for line in capsys.readouterr().out.splitlines() if "a_au" in line)
        assert line.split()[1].startswith(a)
    assert main(["elements", path, "--at", "soon"]) == 2
    assert "--at: needs a date" in capsys.readouterr().err
