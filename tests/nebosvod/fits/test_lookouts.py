"""Predictions for places that have not observed, a reference at its own epoch, notices whatever comes of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.observation import read_oem
from nebosvod.timescale import Epoch

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="the folder of reference observations is not here")
HEAD = "schema_version: 1\nname: a5\nfit:\n  observations: [a5.obs]\n"
WHEN = "2024-02-29T10:00:00 UTC"


def run(folder: Path, more: str, code: int = 0) -> dict[str, Any]:
    for name in ("a5.obs", "multi.oem"):
        (folder / name).write_bytes((SHARED / "cases" / name).read_bytes())
    (folder / "a5.yaml").write_text(HEAD + more, "utf-8")
    assert main(["fit", str(folder / "a5.yaml"), "-o", str(folder / "run"), "--overwrite"]) == code
    return json.loads((folder / "run" / "summary.json").read_text("utf-8")) if code < 2 else {}


def vector(row: dict[str, Any]) -> np.ndarray:
    """Where a prediction sees the object, km."""
    ra, dec = np.radians([row["ra_deg"], row["dec_deg"]])
    return row["distance_km"] * np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def test_a_spacecraft_that_has_not_observed_sees_from_its_trajectory(tmp_path):
    """From the Earth's centre and from the spacecraft: the two directions differ by the place in the file."""
    asked = f"""  spacecraft: {{C51: {{kind: oem, file: multi.oem}}}}
predictions:
  - {{name: far, plane: sky, from: C51, at: {WHEN}}}
  - {{name: centre, plane: sky, from: "500", at: {WHEN}}}
"""
    far, centre = run(tmp_path, asked)["predictions"]
    orbit = read_oem(tmp_path / "multi.oem").orbit
    place = orbit.segments[1].evaluate(np.array([Epoch.parse(WHEN) - orbit.epoch]))[0, :3]
    assert np.linalg.norm(place) > 2e4
    # the light takes 0.1 s more or less on its way: the object moves by 3 km
    np.testing.assert_allclose(vector(centre) - vector(far), place, rtol=0.0, atol=5.0)


@pytest.mark.parametrize(
    ("code", "name"), [("C51", "WISE"), ("250", "Hubble"), ("247", "Roving"), ("275", "occultation")]
)
def test_an_observer_without_a_place_is_refused_by_name_before_anything_runs(tmp_path, capsys, code, name):
    run(tmp_path, f'predictions:\n  - {{name: s, plane: sky, from: "{code}", at: {WHEN}}}\n', 2)
    said = capsys.readouterr().err
    assert "a5.yaml:6:" in said
    assert f"predictions[0].from: {code} (" in said
    assert name.lower() in said.lower()
    assert main(["check", str(tmp_path / "a5.yaml")]) == 2
    assert f"predictions[0].from: {code}" in capsys.readouterr().err


def test_a_prediction_beyond_the_earth_rotation_table_says_so(tmp_path, capsys):
    """By a site that has observed (568) and one that has not (G96); not by the Earth's centre within the table."""
    asked = "predictions:\n" + "".join(
        f'  - {{name: p{code}{year}, plane: sky, from: "{code}", at: {year}-03-01 UTC}}\n'
        for code, year in (("568", 2040), ("G96", 2040), ("G96", 2023))
    )
    notices = [text for text in run(tmp_path, asked)["fit"]["notices"] if "end of the Earth-orientation table" in text]
    assert [text.partition(":")[0] for text in notices] == [
        "prediction p5682040 from 568",
        "prediction pG962040 from G96",
    ]
    assert "p5682040 from 568: 1 time up to" in capsys.readouterr().out


def test_notices_are_said_although_no_orbit_is_found(tmp_path, capsys):
    """One observation is no orbit; the version, the station of the header and the catalogue are told all the same."""
    text = "# version=2017\n# observatory\n! mpcCode 703\nprovID|stn|obsTime|ra|dec|astCat\n"
    (tmp_path / "one.psv").write_text(text + "2024 AA|G96|2024-01-09T20:00:00Z|20.0|5.0|UNK\n", "ascii")
    assert main(["fit", str(tmp_path / "one.psv"), "-o", str(tmp_path / "run")]) in (1, 2)
    said = capsys.readouterr().err
    assert "one.psv is ADES 2017" in said
    assert "the header names observatory 703, and 1 record from line 5 on G96" in said
    assert "1 observation names no star catalogue" in said


def test_notices_are_said_of_files_with_several_objects(tmp_path, capsys):
    text = (
        "provID|stn|obsTime|ra|dec\n2024 AA|G96|2024-01-09T20:00:00Z|20.0|5.0\n2024 BB|G96|2024-01-09T20:01:00Z|2|5\n"
    )
    (tmp_path / "two.psv").write_text("# version=2017\n" + text, "ascii")
    assert main(["fit", str(tmp_path / "two.psv"), "-o", str(tmp_path / "run")]) == 2
    assert "notice: " in capsys.readouterr().err


def test_a_reference_is_compared_at_its_own_epoch_by_its_own_numbers(tmp_path):
    """A made-up reference years away: its state as it stands, this orbit's state from the table of further epochs."""
    away = "2024-06-01T00:00:00 TDB"
    position, velocity = [1.5e8, 2e7, 1e6], [-3.0, 28.0, 2.0]
    state = (
        f"position: [{', '.join(f'{x} km' for x in position)}], velocity: [{', '.join(f'{v} km/s' for v in velocity)}]"
    )
    reference = f"  reference: {{name: far, orbit: {{kind: state, frame: icrf, epoch: {away}, {state}}}}}\n"
    summary = run(tmp_path, f"  epochs: [{away}]\n{reference}")
    row, (own,) = summary["reference_orbit"], summary["further"]
    assert row["epoch_tdb"].startswith("2024-06-01T00:00:00.000")
    difference = np.array(own["state_km_km_s"]) - [*position, *velocity]
    np.testing.assert_allclose(row["difference_km_km_s"], difference, rtol=1e-9)
    whitened = np.linalg.solve(np.array(own["factor_km_km_s"]), difference)
    assert row["chi2"] == pytest.approx(float(whitened @ whitened), rel=1e-6)
