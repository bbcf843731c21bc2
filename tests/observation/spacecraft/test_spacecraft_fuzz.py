"""Damaged SPK and OEM files, and a damaged ephemeris: states or a sentence, within 1 GB and 20 s, never anything else.

NEBOSVOD_FUZZ_CASES raises the number of cases (500 of each format by default; a twentieth of it of the ephemeris).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("spacecraft_mutants.py")
CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "500"))
AT_ONCE = 5000


@pytest.mark.parametrize(("kind", "cases"), [("spk", CASES), ("oem", CASES), ("ephemeris", CASES // 20)])
def test_damaged_files_of_orbits_always_get_states_or_a_sentence(kind: str, cases: int, tmp_path: Path) -> None:
    results: dict[str, int] = {}
    for first in range(0, cases, AT_ONCE):
        count = min(AT_ONCE, cases - first)
        command = [sys.executable, "-W", "error", str(SCRIPT), kind, str(tmp_path), str(first), str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        found = json.loads(done.stdout)
        assert found["wrong"] == []
        for name, number in found["codes"].items():
            results[name] = results.get(name, 0) + number
    assert sum(results.values()) == cases
    assert min(results["read"], results["refused"]) > cases // 20, results
