"""Damaged files of orbits with a covariance: an orbit or a sentence, within 1 GB and 20 s, never anything else.

NEBOSVOD_FUZZ_CASES raises the number of cases (500 of each kind of file by default; a tenth of it of folders).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("orbit_mutants.py")
CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "500"))
AT_ONCE = 5000
SHARES = {"oef": 1.0, "sbdb": 1.0, "mpc_orb": 1.0, "oem": 1.0, "folder": 0.1}


@pytest.mark.parametrize("kind", SHARES)
def test_damaged_files_of_orbits_always_give_an_orbit_or_a_sentence(
    kind: str, minimal_folder: Path, tmp_path: Path
) -> None:
    results: dict[str, int] = {}
    cases, folder = int(CASES * SHARES[kind]), [str(minimal_folder)] if kind == "folder" else []
    for first in range(0, cases, AT_ONCE):
        count = min(AT_ONCE, cases - first)
        command = [sys.executable, "-W", "error", str(SCRIPT), kind, str(tmp_path), str(first), str(count), *folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        found = json.loads(done.stdout)
        assert found["wrong"] == []
        for name, number in found["codes"].items():
            results[name] = results.get(name, 0) + number
    assert sum(results.values()) == cases
    assert min(results["read"], results["refused"]) > cases // 20, results
