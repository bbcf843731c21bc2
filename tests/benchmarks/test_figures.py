"""The figures that `make bench` watches: noise below the factor is no verdict, what is slower is told and fails."""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    spec = importlib.util.spec_from_file_location("figures", FOLDER / "figures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def stored(figures: ModuleType) -> dict[str, object]:
    found: dict[str, object] = json.loads(figures.BASELINE.read_text("utf-8"))
    return found


def test_the_baseline_has_every_figure_with_date_machine_and_versions(
    figures: ModuleType, stored: dict[str, object]
) -> None:
    known = stored["figures"]
    assert isinstance(known, dict)
    assert known.keys() == {*figures.FIGURES, *figures.COMMANDS}, "run `make bench-baseline`"
    assert all(row["ms"] > 0.0 and row["ratio"] > 0.0 for row in known.values())
    assert stored.keys() >= {"date", "machine", "load", "versions", "yardstick_ms"}


@pytest.mark.parametrize(("times", "word"), [(1.0, ""), (1.59, ""), (0.64, ""), (1.61, "SLOWER"), (0.61, "faster")])
def test_a_verdict_needs_more_than_the_factor(figures: ModuleType, times: float, word: str) -> None:
    assert figures.verdict(3.0 * times, 3.0, 1.6) == word


@pytest.mark.parametrize(("second", "slower"), [(1.2, []), (2.0, ["call"])])
def test_a_figure_is_slower_only_if_it_is_so_twice(
    figures: ModuleType, monkeypatch: pytest.MonkeyPatch, second: float, slower: list[str]
) -> None:
    seen: Iterator[float] = iter([2.0, second])
    monkeypatch.setattr(figures, "measured", lambda name: {"ms": 1.0, "ratio": next(seen)})
    baseline = {**figures.machine(), "figures": {"call": {"ms": 1.0, "ratio": 1.0}}}
    assert figures.compared(["call"], baseline, 1.6) == slower


def test_one_figure_is_measured_and_printed_beside_its_baseline() -> None:
    """The script itself, in the environment of one thread that it makes; no time is asserted."""
    command = [sys.executable, str(FOLDER / "figures.py"), "--factor", "1000", "call"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (row,) = (line for line in done.stdout.splitlines() if line.startswith("call "))
    ms, ratio, then, before, times = (float(word) for word in row.split()[1:6])
    assert times == pytest.approx(ratio / before, rel=0.05, abs=0.006)
    assert 0.0 < ms < 1000.0
    assert then > 0.0
