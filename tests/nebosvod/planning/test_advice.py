"""What stands in place of a mission, and what is no JSON, said in words of our own; every error line alike."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import nebosvod
from nebosvod import pipeline
from nebosvod.cli import main
from nebosvod.errors import InputError
from nebosvod.mission import load_mission
from nebosvod.planning.planner import plan
from nebosvod.planning.wish import Wish
from nebosvod.studies.validation import validate

Capture = pytest.CaptureFixture[str]


def said(arguments: list[str], code: int, capsys: Capture) -> str:
    """What a command says on stderr."""
    assert main(arguments) == code
    return capsys.readouterr().err


def test_a_run_folder_in_place_of_a_mission_is_named_with_the_command_for_it(
    minimal_folder: Path, capsys: Capture
) -> None:
    for command in ("run", "check", "plan"):
        err = said([command, str(minimal_folder)], 2, capsys)
        assert err == (
            f"error: {minimal_folder}: is the folder of a run, not a mission; make its page again with: "
            f"nebosvod report {minimal_folder}\n"
        )


def test_any_other_folder_is_named_with_a_mission_in_it(tmp_path: Path, capsys: Capture) -> None:
    assert "is a directory, and holds no .yaml; give a mission file" in said(["run", str(tmp_path)], 2, capsys)
    (tmp_path / "m.yaml").write_text("")
    err = said(["run", str(tmp_path)], 2, capsys)
    assert err == f"error: {tmp_path}: is a directory; give a mission file in it, as {tmp_path / 'm.yaml'}\n"


@pytest.mark.parametrize("value", [5, None, b"minimal", ["minimal"]])
def test_a_mission_is_loaded_from_a_path(value: Any) -> None:
    with pytest.raises(InputError, match=rf"text or pathlib.Path \(got {type(value).__name__}\)"):
        nebosvod.load_mission(value)


@pytest.mark.parametrize("value", ["minimal", 5, None])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("run", pipeline.run),
        ("plan", lambda mission: plan(mission, Wish(prediction="encounter"))),
        ("validate", lambda mission: validate(mission, Path("nowhere"), runs=50)),
    ],
)
def test_functions_that_want_a_mission_say_how_to_get_one(name: str, call: Callable[[Any], Any], value: Any) -> None:
    got = "load_mission('minimal')" if value == "minimal" else "load_mission"
    with pytest.raises(InputError) as caught:
        call(value)
    assert str(caught.value) == f"{name}: needs a mission, as {got} gives it (got {type(value).__name__})"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'{"a": 1,\n "b" 2}', "summary.json:2:6: is no JSON from here on; damaged or cut short"),
        (b'{"a": [1, 2', "summary.json:1:12: is no JSON from here on"),
        (b"", "summary.json:1:1: is no JSON"),
        (b'{"a": "\xff"}', "summary.json: byte 0xFF at place 7 is not text in UTF-8; damaged"),
    ],
)
def test_damaged_json_of_a_run_is_named_by_its_place(
    content: bytes, words: str, minimal_folder: Path, tmp_path: Path, capsys: Capture
) -> None:
    folder = shutil.copytree(minimal_folder, tmp_path / "run")
    (folder / "summary.json").write_bytes(content)
    err = said(["report", str(folder)], 2, capsys)
    assert words in err
    assert not any(word in err for word in ("Expecting", "delimiter", "codec", "Unterminated"))


def test_every_line_of_several_errors_begins_as_a_single_one_does(tmp_path: Path, capsys: Capture) -> None:
    text = load_mission("minimal").text
    path = tmp_path / "m.yaml"
    for wrong, count in (
        (text.replace("e: 0.2", "e: -1"), 1),
        (text.replace("e: 0.2", "e: -1").replace("1 d", "1"), 2),
    ):
        path.write_text(wrong, "utf-8")
        lines = said(["check", str(path)], 2, capsys).splitlines()
        assert len(lines) == count
        assert all(line.startswith(f"error: {path}:") for line in lines)
