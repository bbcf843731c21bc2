"""Risk: every way finds what is published or known by a formula, and no hit is a bound."""

import json
from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
DATA = SHARED / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")


@needs_data
def test_2024_yr4_may_hit_the_moon_and_not_the_earth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """4.3 % by JPL, 4 % by ESA, at 2032-12-22 15:17 to 15:21 UTC; the Earth is excluded."""
    folder = tmp_path / "yr4"
    asked = ["risk", str(DATA / "neocc" / "2024YR4.ke0"), "--until", "2033-01-01", "--draws", "400", "-o", str(folder)]
    assert main([*asked, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((folder / "summary.json").read_text("utf-8"))
    one = next(row for row in summary["virtual_impactors"] if row["body"] == "moon")
    assert one["probability"] == pytest.approx(0.04, abs=0.006)
    assert one["low"] < one["probability"] < one["high"]
    assert one["epoch_utc"].startswith("2032-12-22T15:1")
    with np.load(folder / "arrays.npz") as arrays:
        assert arrays["deviations"].shape == (400, 6)
        hits = np.count_nonzero(arrays["hit_body"] == "moon")
    assert hits == next(way["hits"] for way in one["ways"] if way["way"] == "sampling")
    assert not any(row["body"] == "earth" and row["probability"] for row in summary["virtual_impactors"])


@needs_data
def test_no_hit_is_a_bound_and_never_zero(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["risk", str(DATA / "sbdb" / "433_phys.json"), "--until", "2025-01-01", "--draws", "100"]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert "none of 100 drawn orbits hits, P < 0.03 (95 %)" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until", "1990-01-01"], "--until: 1990-01-01T00:00:00 UTC is not after the epoch of the orbit"),
        (["--until", "2030-13-01"], "--until: "),
        (["--until", "2030-01-01", "--bodies", "vulcan"], '--bodies: "vulcan" is no target'),
        (["--until", "2030-01-01", "--draws", "0"], "--draws: 0"),
    ],
)
@needs_data
def test_wrong_input_is_said(options: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["risk", str(DATA / "sbdb" / "433_phys.json"), *options]) == 2
    assert said in capsys.readouterr().err
