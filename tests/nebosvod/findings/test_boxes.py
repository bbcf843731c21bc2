"""`report: {show: [bounds, imitation]}`: what boxes allow after the measurements, and what errors imitate."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from nebosvod.cli import main
from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import fit
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.findings.boxes import imitations, realised
from nebosvod.mission import load_mission_text
from nebosvod.results.folder import read_folder
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene


def rows_of(problem: LinearProblem) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], list[str]]:
    """Dense rows over [parameters | white draws], each in units of three sigmas, and the residuals."""
    live = [block for block in problem.blocks if block.treatment != "fixed"]
    names = [name for block in live for name in block.names]
    H = np.concatenate([block.H for block in live], axis=2)
    sigma = 3.0 * np.sqrt(np.einsum("npp->np", np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p))))
    draws = [(row, white.H[k] @ np.linalg.cholesky(white.Q[k if len(white.Q) > 1 else 0]))
             for white in problem.white for k, row in enumerate(white.rows)]  # fmt: skip
    width = sum(part.shape[1] for _, part in draws)
    top = np.zeros((problem.n, problem.p, len(names) + width))
    top[:, :, : len(names)] = H
    first = len(names)
    for row, part in draws:
        top[row, :, first : first + part.shape[1]] = part
        first += part.shape[1]
    boxes = np.zeros((width, len(names) + width))
    boxes[:, len(names) :] = np.eye(width) / 3.0
    A, right = (
        [(top / sigma[:, :, None]).reshape(-1, len(names) + width), boxes],
        [problem.residual / sigma, np.zeros(width)],
    )
    for prior in problem.priors:
        whiten = np.linalg.solve(3.0 * np.linalg.cholesky(prior.covariance), np.eye(len(prior.names)))
        box = np.zeros((len(prior.names), len(names) + width))
        box[:, [names.index(name) for name in prior.names]] = whiten
        A.append(box)
        right.append(whiten @ np.asarray(prior.mean))
    return np.vstack(A), np.concatenate([part.reshape(-1) for part in right]), names


def made(text: str, louder: float = 1.0) -> Any:
    mission = load_mission_text(text)
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    nominal = nominal_view(scene)
    rng = np.random.default_rng(5)
    problem = linear_problem(scene, mission.estimators[0], nominal, computed_psi(nominal), priors, about=nominal.point)
    sigma = np.sqrt(np.einsum("npp->np", np.broadcast_to(problem.R, (problem.n, 2, 2))))
    psi = computed_psi(nominal) + louder * sigma * rng.normal(size=(problem.n, 2))
    return scene, fit(scene, mission.estimators[0], nominal, psi, priors)


@pytest.fixture(scope="module")
def fitted(minimal_text: str) -> Any:
    return made(minimal_text)


def test_realised_bounds_are_those_of_a_dense_programme_about_the_estimate(fitted: Any) -> None:
    scene, found = fitted
    asked = quantity(scene, found.trajectory, scene.mission.predictions[0])
    (row,) = realised(found, [asked])
    assert row.inflation == 1.0
    A, right, names = rows_of(recentred(found.problem, found.deviation))
    unit = np.abs(A).max(axis=0)
    for k, partials in enumerate(asked.partials):
        p = np.zeros(A.shape[1])
        for name, value in zip(asked.names, partials):
            if name in names:
                p[names.index(name)] = value
        p = p / unit
        size = np.abs(p).max()
        ends = []
        for sign in (1.0, -1.0):
            limits = np.concatenate([1.0 + right, 1.0 - right])
            best = linprog(sign * p / size, A_ub=np.vstack([A, -A]) / unit, b_ub=limits, bounds=(None, None))
            ends.append(sign * best.fun * size)
        assert row.lower is not None
        assert row.upper is not None
        width = ends[1] - ends[0]
        # the estimate has converged: it stands at the linearisation point
        assert row.lower[k] == pytest.approx(ends[0], abs=1e-3 * width)
        assert row.upper[k] == pytest.approx(ends[1], abs=1e-3 * width)
        assert row.lower[k] < 0.0 < row.upper[k]


def test_a_bias_imitates_the_motion_that_a_dense_projection_loses_most(fitted: Any) -> None:
    _, found = fitted
    problem = found.problem
    rows = imitations(found)
    assert {row.group for row in rows} == {block.name for block in problem.blocks[1:] if block.treatment != "fixed"}
    L = np.linalg.cholesky(np.broadcast_to(problem.R, (problem.n, 2, 2)))
    U, *others = (np.linalg.solve(L, block.H).reshape(2 * problem.n, -1) for block in problem.blocks)
    U = U / np.linalg.norm(U, axis=0)
    for row, S in zip(rows, others):
        left = U - S @ np.linalg.lstsq(S, U)[0]
        _, values, vectors = np.linalg.svd(left)
        weights = vectors[-1] / vectors[-1][np.argmax(np.abs(vectors[-1]))]
        np.testing.assert_allclose(list(row.direction.values()), weights, atol=1e-5)
        assert row.condition_number == pytest.approx(values[0] / values[-1], rel=1e-4)


def test_noise_ten_times_louder_than_its_box_is_told_by_the_inflation(minimal_text: str) -> None:
    scene, found = made(minimal_text, 10.0)
    (row,) = realised(found, [quantity(scene, found.trajectory, scene.mission.predictions[0])])
    assert 3.0 < row.inflation < 10.0
    assert row.lower is not None
    assert row.upper is not None
    assert np.all(row.lower < row.upper)


def test_page_and_summary_show_them(minimal_text: str, tmp_path: Path) -> None:
    """Noise five times larger than believed: boxes of three believed sigmas are empty."""
    text = minimal_text.replace("predictions:", "report: {show: [bounds, imitation]}\npredictions:", 1)
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    assert main(["run", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "out"), "--seed", "1"]) in (0, 1)
    inside = read_folder(tmp_path / "out").summary["inside"]
    (bounds,) = inside["bounds"]
    lower, upper = (next(value for key, value in bounds.items() if key.startswith(end)) for end in ("lower", "upper"))
    assert all(a < b for a, b in zip(lower, upper))
    assert inside["imitations"][0]["direction"]
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "errors within 3 sigma" in page
    assert "imitates" in page
