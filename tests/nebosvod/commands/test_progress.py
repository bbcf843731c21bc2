"""Progress on stderr: on a terminal no stage is silent for two seconds; elsewhere nothing is said; stdout is clean."""

import json
import os
import pty
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import pytest

import nebosvod
from nebosvod.commands.progress import QUIET_S, heard

SUMMARY = Path(nebosvod.__file__).parent / "results" / "summary.schema.json"


def test_a_stage_that_lasts_is_told_again_with_its_seconds_until_the_next() -> None:
    told: list[tuple[str, float]] = []
    with heard(lambda line, so_far_s: told.append((line, so_far_s)), quiet_s=0.1) as say:
        say("slow")
        time.sleep(0.55)
        say("fast")
    assert told[0] == ("slow", 0.0)
    assert told[-1] == ("fast", 0.0)
    again = [seconds for line, seconds in told[1:-1] if line == "slow"]
    assert 2 <= len(again) <= 5
    assert again == sorted(again)
    assert again[-1] <= 0.6
    count = len(told)
    time.sleep(0.25)
    assert len(told) == count  # silent after the end


def test_the_beat_leaves_no_two_seconds_of_silence() -> None:
    assert 1.25 * QUIET_S < 2.0


def on_a_terminal(words: list[str], folder: Path) -> tuple[int, bytes, str]:
    """Exit code, stdout (a file) and what a terminal saw on stderr."""
    master, slave = pty.openpty()
    with (folder / "stdout").open("wb") as out:
        process = subprocess.Popen([sys.executable, "-m", "nebosvod", *words], stdout=out, stderr=slave, cwd=folder)
        os.close(slave)
        seen = b""
        while True:
            try:
                piece = os.read(master, 4096)
            except OSError:  # Linux says so when the other end is closed
                break
            if not piece:
                break
            seen += piece
        process.wait()
    os.close(master)
    return process.returncode, (folder / "stdout").read_bytes(), seen.decode()


def test_a_run_on_a_terminal_tells_its_stages_on_stderr_and_nothing_in_the_json(
    minimal_text: str, tmp_path: Path
) -> None:
    (tmp_path / "m.yaml").write_text(minimal_text + "\nmonte_carlo: {runs: 30}\n", "utf-8")
    code, out, seen = on_a_terminal(["run", "m.yaml", "--json"], tmp_path)
    assert code == 0
    jsonschema.Draft202012Validator(json.loads(SUMMARY.read_text("utf-8"))).validate(json.loads(out))
    said = [line.strip().split(" (")[0] for line in seen.splitlines() if line.strip()]
    stages = list(dict.fromkeys(said))
    assert stages[0] == "reading the input"
    assert "Monte Carlo: 0 of 30 runs" in stages
    assert stages[-1] == "writing the run folder and its report"


def test_a_run_elsewhere_is_silent(minimal_text: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from nebosvod.cli import main

    (tmp_path / "m.yaml").write_text(minimal_text, "utf-8")
    assert main(["run", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "r"), "--json"]) == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert json.loads(said.out)["mission"] == "minimal"
