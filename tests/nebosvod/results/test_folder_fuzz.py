"""Cut, changed and hostile run folders and campaigns: a page or a sentence, within 1 GB and 20 s, never anything else.

NEBOSVOD_FUZZ_CASES raises the number of cases (500 run folders and as many campaigns by default).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from nebosvod.cli import main

SCRIPT = Path(__file__).with_name("folder_mutants.py")
CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "500"))
AT_ONCE = 5000
SHARES = {"summary": 0.4, "manifest": 0.15, "arrays": 0.35, "visibility": 0.1, "campaign": 1.0}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished campaign of two chunks."""
    folder = tmp_path_factory.mktemp("campaign") / "validation"
    assert main(["validate", "minimal", "--runs", "60", "--workers", "1", "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def ahead(tmp_path_factory: pytest.TempPathFactory, minimal_folder: Path) -> dict[str, Path]:
    """An ephemeris and approaches of the orbit of a run."""
    folder = tmp_path_factory.mktemp("ahead")
    dates = ["--from", "2028-05-01", "--to", "2029-05-01"]
    for command, more in (("ephemeris", ["--step", "30 d"]), ("approaches", ["--within", "3 au"])):
        assert main([command, str(minimal_folder), *dates, *more, "-o", str(folder / command)]) == 0
    return {command: folder / command for command in ("ephemeris", "approaches")}


@pytest.mark.parametrize("kind", SHARES)
def test_damaged_folders_always_get_a_page_or_a_sentence(
    kind: str, minimal_folder: Path, campaign: Path, tmp_path: Path
) -> None:
    damage(kind, campaign if kind == "campaign" else minimal_folder, int(CASES * SHARES[kind]), tmp_path)


@pytest.mark.parametrize("command", ["ephemeris", "approaches"])
def test_damaged_folders_of_an_orbit_ahead_do_too(command: str, ahead: dict[str, Path], tmp_path: Path) -> None:
    damage("summary", ahead[command], CASES // 5, tmp_path)


def damage(kind: str, folder: Path, cases: int, tmp_path: Path) -> None:
    """Try so many mutants of one file of a folder."""
    codes: dict[str, int] = {}
    for first in range(0, cases, AT_ONCE):
        count = min(AT_ONCE, cases - first)
        command = [sys.executable, str(SCRIPT), kind, str(folder), str(tmp_path), str(first), str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        found = json.loads(done.stdout)
        assert found["wrong"] == []
        for name, number in found["codes"].items():
            codes[name] = codes.get(name, 0) + number
    assert sum(codes.values()) >= cases
    assert sum(number for name, number in codes.items() if not name.endswith(" 0")) > cases // 20, codes
    assert sum(number for name, number in codes.items() if name.endswith(" 0")) > cases // 20, codes
