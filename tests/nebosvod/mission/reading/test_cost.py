"""What `check` says a mission will cost: predictions, Monte Carlo and curves counted, against what runs took."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nebosvod.mission import estimate_cost, load_mission, load_mission_text
from nebosvod.mission.reading.builtin import builtin_names


def cpu_s(text: str, folder: Path) -> float:
    """Processor time of `nebosvod run` on a mission, which other work on the machine hardly moves."""
    folder.mkdir()
    (folder / "m.yaml").write_text(text, "utf-8")
    before = os.times()
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "nebosvod", "run", "m.yaml", "-o", "r"]
    done = subprocess.run(command, cwd=folder, capture_output=True, env=os.environ | one_thread)
    assert done.returncode in (0, 1), done.stderr
    after = os.times()
    return (after.children_user - before.children_user) + (after.children_system - before.children_system)


def with_runs(name: str, runs: int) -> str:
    """A built-in mission with Monte Carlo; without for 0."""
    text = load_mission(name).text
    return text + f"\nmonte_carlo: {{runs: {runs}}}\n" if runs else text


def assert_within_a_factor_of_two(cases: list[tuple[str, int]], folder: Path) -> None:
    """The estimates are seconds of one machine: this one is compared with it by the smallest mission."""
    known = load_mission("minimal")
    pace = cpu_s(known.text, folder / "minimal") / estimate_cost(known).time_s
    for name, runs in cases:
        text = with_runs(name, runs)
        taken = cpu_s(text, folder / f"{name}-{runs}") / pace
        assert 0.5 < taken / estimate_cost(load_mission_text(text)).time_s < 2.0, (name, runs, taken)


def test_the_estimate_of_a_mission_with_predictions_and_monte_carlo_is_good_to_a_factor_of_two(tmp_path: Path) -> None:
    assert_within_a_factor_of_two([("surveyor-venus", 150)], tmp_path)


@pytest.mark.long
def test_the_estimates_of_all_built_in_missions_are_good_to_a_factor_of_two(tmp_path: Path) -> None:
    assert_within_a_factor_of_two([(name, runs) for name in builtin_names() for runs in (0, 200)], tmp_path)


def test_every_prediction_estimator_and_run_counts() -> None:
    """Compared with a mission that asks for less of one thing."""
    few, many = (estimate_cost(load_mission_text(with_runs("neomir-like", runs))) for runs in (0, 500))
    assert many.time_s > few.time_s + 500 * 0.02  # an orbit that comes down, and what is predicted on it
    assert many.time_iterated_s > many.time_s
    text = load_mission("neomir-like").text
    without = text[: text.index("predictions:")] + "predictions: []\n"
    assert estimate_cost(load_mission_text(without)).time_s < few.time_s - 1.0


def test_the_words_of_check_say_both_times_where_monte_carlo_is_asked_for() -> None:
    plain, drawn = (str(estimate_cost(load_mission_text(with_runs("minimal", runs)))) for runs in (0, 500))
    assert "where one linear step would not do" not in plain
    assert "500 Monte Carlo runs" in drawn
    assert drawn.endswith("where one linear step would not do)")
