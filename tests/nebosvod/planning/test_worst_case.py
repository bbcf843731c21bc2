"""`plan --criterion minimax` and `guaranteed`: bounds against dense programmes, choices against brute force."""

import itertools
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.optimize import linprog

import nebosvod
from nebosvod.cli import main
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import SOLVERS
from nebosvod.mission import load_mission_text
from nebosvod.planning.planner import Planner, plan
from nebosvod.planning.visits import candidates, grids
from nebosvod.planning.wish import Wish
from nebosvod.planning.worst_case import WorstCase
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene

NAME = "ten days later"
DAY = 86400.0
GRID = {"start_s": 5.25 * DAY, "end_s": 33.25 * DAY, "step_s": 7.0 * DAY}
SCHEMA = json.loads((Path(nebosvod.__file__).parent / "planning" / "plan.schema.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def planner(minimal_text: str) -> Planner:
    mission = load_mission_text(minimal_text)
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    starts, _ = grids(scene, GRID["start_s"], GRID["end_s"], GRID["step_s"])
    offered = candidates(scene, mission.estimators[0], priors, starts)
    asked = quantity(scene, scene.trajectory, mission.predictions[0])
    return Planner(offered, SOLVERS[mission.estimators[0].method], asked)


def dense_bound(planner: Planner, taken: tuple[int, ...], criterion: str) -> float:
    """Largest component of the prediction over all errors in their boxes, as one dense programme after another."""
    problem, names = planner.offered.with_one(taken), planner.belief.names
    H = np.concatenate([block.H for block in problem.blocks if block.treatment != "fixed"], axis=2)
    order = [name for block in problem.blocks if block.treatment != "fixed" for name in block.names]
    W = np.zeros((len(planner.W), len(order)))
    W[:, [order.index(name) for name in names]] = planner.W
    noise = np.array(np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p)))
    draws, level = [], 1.0 if criterion == "minimax" else 3.0
    for white in problem.white:
        for k, row in enumerate(white.rows):
            L = np.linalg.cholesky(white.Q[k if len(white.Q) > 1 else 0])
            if criterion == "minimax":
                noise[row] += white.H[k] @ L @ L.T @ white.H[k].T
            else:
                draws.append((row, white.H[k] @ L))
    sigma = np.sqrt(np.einsum("npp->np", noise))
    width = sum(part.shape[1] for _, part in draws)
    rows = [np.hstack([(H / sigma[:, :, None]).reshape(-1, len(order)), np.zeros((H.shape[0] * H.shape[1], width))])]
    first = len(order)
    for row, part in draws:
        rows[0][row * problem.p : (row + 1) * problem.p, first : first + part.shape[1]] = part / sigma[row][:, None]
        box = np.zeros((part.shape[1], len(order) + width))
        box[:, first : first + part.shape[1]] = np.eye(part.shape[1])
        rows.append(box)
        first += part.shape[1]
    for prior in problem.priors:
        box = np.zeros((len(prior.names), len(order) + width))
        columns = [order.index(name) for name in prior.names]
        box[:, columns] = np.linalg.solve(np.linalg.cholesky(prior.covariance), np.eye(len(columns)))
        rows.append(box)
    A = np.vstack(rows)
    unit = np.abs(A).max(axis=0)
    worst = []
    for p in np.hstack([W, np.zeros((len(W), width))]) / unit:
        size = np.abs(p).max()
        limits = np.full(2 * len(A), level)
        found = linprog(-p / size, A_ub=np.vstack([A, -A]) / unit, b_ub=limits, bounds=(None, None), method="highs")
        worst.append(-found.fun * size if found.status == 0 else np.inf)
    return float(max(worst))


@pytest.mark.parametrize("criterion", ["minimax", "guaranteed"])
def test_bounds_are_those_of_a_dense_programme(planner: Planner, criterion: str) -> None:
    worst = WorstCase(planner.offered, planner.W, planner.belief.names, criterion, planner.overlapping)  # type: ignore[arg-type]
    for taken in ((), (0,), (3, 7), (1, 4, 9)):
        assert worst.after(taken) == pytest.approx(dense_bound(planner, taken, criterion), rel=1e-5)
    np.testing.assert_allclose(worst.each([2])[5], worst.after([2, 5]))
    assert np.isinf(worst.each([2])[2])


@pytest.mark.parametrize("criterion", ["minimax", "guaranteed"])
def test_the_visits_chosen_are_the_best_of_all_subsets(planner: Planner, criterion: str) -> None:
    worst = WorstCase(planner.offered, planner.W, planner.belief.names, criterion, planner.overlapping)  # type: ignore[arg-type]
    hours = np.ones(worst.count)
    first = worst.each([])
    for visits in (1, 2, 3):
        chosen = worst.best(visits, hours, first)
        best = min(worst.after(taken) for taken in itertools.combinations(range(worst.count), visits))
        assert worst.after(chosen) == pytest.approx(best, rel=1e-9)
        assert worst.floor() <= best * (1.0 + 1e-9)


def test_a_sigma_whatever_the_correlation_is_never_below_the_one_of_independent_errors(minimal_text: str) -> None:
    found = plan(load_mission_text(minimal_text), Wish(prediction=NAME, visits=2, criterion="minimax", **GRID))  # type: ignore[arg-type]
    jsonschema.validate(found, SCHEMA)
    now = found["sigma_now"]
    assert now["minimax"] >= now["a"] / np.sqrt(3.0) - 1e-9  # the largest of three components
    assert found["greedy"]["minimax"][-1]["sigma_after"]["minimax"] >= found["sigma_of_all_candidates"] * (1.0 - 1e-9)
    steps = [now["minimax"], *(row["sigma_after"]["minimax"] for row in found["greedy"]["minimax"])]
    assert steps == sorted(steps, reverse=True)
    assert {"a", "d", "minimax"} == set(found["uniform"][0]["sigma_after"])
    plain = plan(load_mission_text(minimal_text), Wish(prediction=NAME, visits=2, **GRID))  # type: ignore[arg-type]
    jsonschema.validate(plain, SCHEMA)
    assert plain["greedy"] == {name: found["greedy"][name] and plain["greedy"][name] for name in ("a", "d")}
    assert "sigma_of_all_candidates" not in plain


def test_the_command_says_the_criterion_and_makes_its_page(
    minimal_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.yaml").write_text(minimal_text, "utf-8")
    page = tmp_path / "plan.html"
    arguments = ["plan", str(tmp_path / "m.yaml"), "--criterion", "guaranteed", "--visits", "1", "--page", str(page)]
    assert main(arguments) == 0
    assert "every error within 3 sigma" in capsys.readouterr().out
    assert "every error within 3 sigma" in page.read_text("utf-8")


def test_errors_correlated_in_time_have_no_box(
    minimal_text: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    white = "sigma: 3 km, correlation: white"
    assert white in minimal_text
    text = minimal_text.replace(white, "sigma: 3 km, correlation: gauss_markov, time: 5 d", 1)
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    assert main(["plan", str(tmp_path / "m.yaml"), "--criterion", "minimax", "--visits", "1"]) == 2
    assert "time-correlated" in capsys.readouterr().err
