"""What is optional may be left out: the rest of the answer comes."""

import json
from pathlib import Path

import pytest

from nebosvod.cli import main

ROOT = Path(__file__).resolve().parent.parent.parent
MINIMAL = (ROOT / "scenarios" / "minimal.yaml").read_text("utf-8")
WITHOUT_PREDICTIONS = MINIMAL[: MINIMAL.index("predictions:")]


@pytest.mark.parametrize("ending", ["", "predictions: []\n", "predictions: []\nmonte_carlo: {runs: 20}\n"])
def test_a_mission_without_predictions_gives_the_orbit_and_its_budget(
    tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mission, folder = tmp_path / "m.yaml", tmp_path / "run"
    mission.write_text(WITHOUT_PREDICTIONS + ending)
    assert main(["check", str(mission)]) == 0
    assert main(["run", str(mission), "-o", str(folder)]) == 0
    assert "What is to blame" in capsys.readouterr().out
    without = json.loads((folder / "summary.json").read_text("utf-8"))
    mission.write_text(MINIMAL)
    assert main(["run", str(mission), "-o", str(tmp_path / "with")]) == 0
    whole = json.loads((tmp_path / "with" / "summary.json").read_text("utf-8"))
    assert without["predictions"] == []
    assert without["curves"] == []
    for mine, theirs in zip(without["budget"], whole["budget"], strict=True):
        assert mine["source"] == theirs["source"]
        assert mine["sigma_position_km"] == pytest.approx(theirs["sigma_position_km"], rel=1e-6)
    page = (folder / "report.html").read_text("utf-8")
    assert "Predictions" not in page
    for command in (["report", str(folder)], ["compare", str(folder), str(tmp_path / "with")]):
        assert main(command) == 0
