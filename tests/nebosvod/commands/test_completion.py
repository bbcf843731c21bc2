"""Tab completion in a real bash: what the function that `nebosvod` gives to it offers."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BASH = shutil.which("bash")
SCRIPT = """
nebosvod() { "$PYTHON" -m nebosvod "$@"; }
export -f nebosvod
eval "$(_NEBOSVOD_COMPLETE=bash_source nebosvod)"
complete -p nebosvod
try() {
  COMP_WORDS=("$@"); COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 )); COMPREPLY=()
  _nebosvod_completion "$FOLDER/nebosvod" 2>/dev/null
  printf '%s|' "${COMPREPLY[@]}"; echo
}
"""


@pytest.mark.skipif(BASH is None, reason="no bash is installed")
def test_bash_is_offered_missions_predictions_and_run_folders(tmp_path: Path) -> None:
    for run in ("first-run", "second-run"):
        (tmp_path / run).mkdir()
        for name in ("manifest.json", "summary.json"):
            (tmp_path / run / name).write_text("{}")
    (tmp_path / "first-notes").mkdir()
    (tmp_path / "minute.yaml").write_text(
        "predictions:\n  - {name: near the Moon, wrong: 1}\nestimators: [{name: a b}]\n"
    )
    program = tmp_path / "nebosvod"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nebosvod "$@"\n')
    program.chmod(0o755)
    lines = [
        ("nebosvod che", "check|"),
        ("nebosvod run apophis-2", "apophis-2029|"),
        ("nebosvod check min", "minimal|minute.yaml|"),
        ("nebosvod report fir", "first-run|"),
        ("nebosvod compare first-run ''", "second-run|"),
        ("nebosvod plan minimal -p ''", r"ten\ days\ later|"),
        ("nebosvod plan minute.yaml --prediction near", r"near\ the\ Moon|"),
        ("nebosvod plan minute.yaml --estimator ''", r"a\ b|"),
        ("nebosvod init my.yaml --from soda", "soda-like|"),
    ]
    script = SCRIPT + "".join(f"try {words}\n" for words, _ in lines)
    done = subprocess.run(
        [str(BASH), "--norc", "--noprofile", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120,
        env=os.environ | {"PYTHON": sys.executable, "FOLDER": str(tmp_path)}, check=False,
    )  # fmt: skip
    registered, *offered = done.stdout.splitlines()
    assert registered == "complete -o nosort -F _nebosvod_completion nebosvod", done.stderr
    assert dict(zip((words for words, _ in lines), offered)) == dict(lines)


def test_a_copy_of_a_built_in_mission_is_right_and_keeps_its_comments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from nebosvod.cli import main
    from nebosvod.mission import load_mission
    from nebosvod.mission.reading.builtin import builtin_names

    monkeypatch.chdir(tmp_path)
    for name in builtin_names():
        assert main(["init", f"mine {name}.yaml", "--from", name]) == 0
        copy, whole = load_mission(f"mine {name}.yaml"), load_mission(name)
        assert copy.name == f"mine {name}"
        assert [line for line in copy.text.splitlines() if not line.startswith("name:")] == [
            line for line in whole.text.splitlines() if not line.startswith(("name:", "# yaml-language-server"))
        ]
    assert main(["init", "again.yaml", "--from", "mine minimal.yaml"]) == 0
    assert main(["init", "no.yaml", "--from", "apofis"]) == 2
    assert not Path("no.yaml").exists()
    assert "apofis" in capsys.readouterr().err
