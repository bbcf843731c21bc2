"""What lies where a run folder was wanted is named, with the command that is for it."""

import json
from pathlib import Path

import pytest

from nebosvod.cli import main

Capture = pytest.CaptureFixture[str]


def made(folder: Path, **files: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(text, "utf-8")
    return folder


def refused(what: str, path: Path, capsys: Capture) -> str:
    assert main([what, str(path)] + ([str(path)] if what == "compare" else [])) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}: ")
    return said


@pytest.mark.parametrize("what", ["report", "compare"])
def test_a_validation_is_named_with_the_command_that_makes_its_page(what: str, tmp_path: Path, capsys: Capture) -> None:
    folder = tmp_path / "v"
    assert main(["validate", "minimal", "--runs", "50", "--seed", "3", "--workers", "1", "-o", str(folder)]) in (0, 1)
    capsys.readouterr()
    said = refused(what, folder, capsys)
    assert "is a validation, not a run folder; its page is validation.html" in said
    # the command that it names does what it says: it makes the page again
    words = said.split("nebosvod ")[1].split()
    (folder / "validation.html").unlink()
    assert words[-1] == str(folder)
    assert main(words) in (0, 1)
    assert (folder / "validation.html").is_file()


def test_an_unfinished_validation_is_said_to_be_so(tmp_path: Path, capsys: Capture) -> None:
    record = json.dumps({"mission": "m.yaml", "seed": 0, "mode": "full"})
    said = refused("report", made(tmp_path / "v", campaign__json=record), capsys)
    assert "it is not finished" in said
    assert f"nebosvod validate m.yaml --full -o {tmp_path / 'v'}" in said


def test_a_plan_is_named_by_its_contents(tmp_path: Path, capsys: Capture) -> None:
    plan = ["plan", "minimal", "--visits", "1", "-o", str(tmp_path / "a.json"), "--page", str(tmp_path / "a.html")]
    assert main(plan) == 0
    capsys.readouterr()
    assert "is a plan: its page is made together with it" in refused("report", tmp_path / "a.json", capsys)
    assert "is the page of nebosvod plan: open it in a browser" in refused("report", tmp_path / "a.html", capsys)
    assert "not a run folder; a.json in it is a plan" in refused("report", tmp_path, capsys)


def test_a_folder_of_run_folders_names_them(tmp_path: Path, capsys: Capture) -> None:
    whole = dict.fromkeys(("manifest__json", "summary__json", "arrays__npz"), "")
    for name in "dcba":
        made(tmp_path / name, **whole)
    said = refused("report", tmp_path, capsys)
    assert f"holds some (a, b, c, ...); name one, as {tmp_path / 'a'}" in said
    assert f"is a file of a run, not its folder; name {tmp_path / 'b'}" in refused(
        "report", tmp_path / "b" / "arrays.npz", capsys
    )


def test_nothing_and_an_empty_folder_lead_to_the_command_that_makes_a_run(tmp_path: Path, capsys: Capture) -> None:
    assert "there is no such folder" in refused("report", tmp_path / "no", capsys)
    said = refused("report", made(tmp_path / "empty"), capsys)
    assert "not a run folder: manifest.json, summary.json, arrays.npz missing" in said
    assert "nebosvod run MISSION" in said
    # damaged files are nobody's
    assert "not a run folder" in refused("report", made(tmp_path / "odd", plan__json="{", page__html="<"), capsys)
