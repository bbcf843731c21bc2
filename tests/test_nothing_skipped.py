"""Where nothing may be skipped (CI), a test skipped for want of a package fails the run; elsewhere it does not."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HOOK = Path(__file__).with_name("conftest.py")
ORACLE = """
import pytest

def test_with_an_oracle():
    pytest.importorskip("no_such_package")

def test_that_passes():
    pass
"""
DATA = """
import pytest

@pytest.mark.skipif(True, reason="the folder of reference data is not here")
def test_with_data():
    pass
"""


@pytest.mark.parametrize(
    ("source", "nothing_skipped", "shared", "wanted", "workers"),
    [
        (ORACLE, True, False, 1, "0"),
        (ORACLE, False, False, 0, "0"),
        (DATA, True, False, 0, "0"),  # a clone does not bring the data
        (DATA, True, True, 1, "0"),  # where the data lie, none of their tests is skipped
        (ORACLE, True, False, 1, "1"),  # as `make test` runs them: the workers' reports come to the one who counts
        (DATA, True, False, 0, "1"),
    ],
)
def test_a_skip_fails_the_run_where_nothing_may_be_skipped(
    source: str, nothing_skipped: bool, shared: bool, wanted: int, workers: str, tmp_path: Path
) -> None:
    tests = tmp_path / "project" / "tests"
    tests.mkdir(parents=True)
    shutil.copy(HOOK, tests)
    (tests / "test_it.py").write_text(source, "utf-8")
    if shared:
        (tmp_path / "shared").mkdir()
    environment = {k: v for k, v in os.environ.items() if k != "NEBOSVOD_NOTHING_SKIPPED"}
    environment |= {"NEBOSVOD_NOTHING_SKIPPED": "1"} if nothing_skipped else {}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", workers, str(tests)]
    done = subprocess.run(command, cwd=tests, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == wanted, done.stdout
    assert ("tests were skipped" in done.stdout) == bool(wanted)


def test_the_script_of_ci_skips_nothing() -> None:
    assert "export NEBOSVOD_NOTHING_SKIPPED=1" in (HOOK.parent.parent / ".ci" / "run").read_text("utf-8")
