"""docs/first-hour.md does what it says: its tracklet is saved, its command run, its numbers compared."""

import re
import shlex
from pathlib import Path

import pytest

from nebosvod.cli import main

PAGE = Path(__file__).resolve().parents[3] / "docs" / "first-hour.md"
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]\d+)?")


def test_the_worked_tracklet_gives_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Words are the same, and the first lines' numbers are within a tenth: libraries differ in the last draws."""
    text = PAGE.read_text("utf-8")
    tracklet, shown = re.findall(r"```(?:text|console)\n(.*?)```", text, re.DOTALL)[:2]
    monkeypatch.chdir(tmp_path)
    Path("la.obs80").write_text(tracklet)
    command, *lines = shown.splitlines()
    assert command.startswith("$ nebosvod alert la.obs80")
    assert main(shlex.split(command)[2:]) == 0
    said = capsys.readouterr().out.splitlines()
    for expected, found in zip(lines[:4], said[:4], strict=True):
        assert NUMBER.sub("#", expected) == NUMBER.sub("#", found)
        for a, b in zip(NUMBER.findall(expected), NUMBER.findall(found), strict=True):
            assert float(a) == pytest.approx(float(b), rel=0.1)
