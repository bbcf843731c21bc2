"""What a text gives, message by message: a mission's answer is a study's, a fit's what it would read; edits."""

from pathlib import Path
from typing import Any

import pytest

from nebosvod.mission import load_mission
from nebosvod.studies.point import evaluate
from nebosvod.workbench.look import opened
from tests.nebosvod.workbench.conftest import MISSION

EVERYTHING = Path(__file__).parents[1] / "everything"


@pytest.fixture(scope="module")
def serve() -> Any:
    return opened()


def looked(serve: Any, text: str, folder: Path) -> list[Any]:
    return list(serve({"verb": "look", "text": text, "name": "x.yaml", "folder": str(folder)}))


def test_a_mission_is_checked_then_answered_part_by_part(serve: Any, tmp_path: Path) -> None:
    checked, *found, done = looked(serve, MISSION, tmp_path)
    assert (checked["step"], checked["problems"], checked["slug"], checked["fit"]) == ("checked", [], "desk", False)
    assert checked["tree"]["telescopes"][0]["noise"] == {"sigma": "0.1 arcsec"}
    assert [one["part"] for one in found] == ["visibility", "answer", "target"]
    assert done["step"] == "done"
    (tmp_path / "desk.yaml").write_text(MISSION, "utf-8")
    point = evaluate(load_mission(str(tmp_path / "desk.yaml")), frozenset())
    assert f'value="{point.state_sigma(0, formal=False)!r}"' in found[1]["html"]


def test_a_fit_is_read_and_its_records_counted(serve: Any) -> None:
    text = (EVERYTHING / "fit.yaml").read_text("utf-8")
    checked, found, done = looked(serve, text, EVERYTHING)
    assert (checked["fit"], checked["problems"], done["step"]) == (True, [], "done")
    rows = [line for line in (EVERYTHING / "made.obs80").read_text("utf-8").split("\n") if line.strip()]
    assert found["part"] == "answer"
    assert "press Run" in found["html"]
    assert "record" in found["html"]
    assert len(rows) > 3
    gone, *_ = looked(serve, text.replace("made.obs80", "none.obs80"), EVERYTHING)
    assert any("none.obs80" in one["text"] and one["line"] for one in gone["problems"])


def test_what_only_flying_tells_is_told_at_its_line(serve: Any, tmp_path: Path) -> None:
    text = MISSION.replace("longitude: 0 deg}", "longitude: 0 deg}\n    exclusion: {sun: 179 deg}")
    checked, failed = looked(serve, text, tmp_path)
    assert (checked["problems"], failed["step"]) == ([], "failed")
    assert "no epoch is visible" in failed["problems"][0]["text"]
    line = text.split("\n").index(next(one for one in text.split("\n") if one.startswith("schedule"))) + 1
    assert failed["problems"][0]["line"] == line


@pytest.mark.parametrize("path", [[], ["name", "x"], [True], [None], ["telescopes", 10**30], ["telescopes", -1]])
def test_no_edit_ends_the_process(serve: Any, path: list[Any]) -> None:
    (told,) = serve({"verb": "edit", "text": MISSION, "name": "x.yaml", "path": path, "value": None})
    assert told["step"] in ("edited", "refused")
