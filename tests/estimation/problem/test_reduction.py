"""Rows reduced in one pass, against numpy's QR of rows whitened by numpy."""

import math

import numpy as np
import pytest

from nebosvod.estimation.problem.reduction import PART, reduced, solved

Array = np.ndarray


def problem(n: int, s: int, seed: int = 1) -> tuple[Array, Array, Array, Array]:
    """H, residuals, whiteners of correlated noise, and which pairs count."""
    rng = np.random.default_rng(seed)
    H = rng.standard_normal((n, 2, s)) * 10.0 ** rng.uniform(-8.0, 8.0, s)
    root = np.tril(rng.standard_normal((n, 2, 2))) + 2.0 * np.eye(2)
    return H, rng.standard_normal((n, 2)), root, rng.random(n) < 0.7


def whitened(H: Array, residual: Array, W: Array, chosen: Array) -> Array:
    """The chosen whitened rows [H | residual] by numpy."""
    rows = np.concatenate([H, residual[:, :, None]], axis=2)
    return (W @ rows)[chosen].reshape(-1, rows.shape[2])


@pytest.mark.parametrize("n", [1, 3, 200, PART // 2, PART // 2 + 1, 3000])
def test_triangle_and_cost_are_those_of_the_rows(n: int) -> None:
    """1e-12 of each column: R^T R = A^T A by an orthogonal reduction of other making."""
    H, residual, W, chosen = problem(n, 6)
    chosen[0] = True
    triangle, cost = reduced(H, residual, W, chosen, np.zeros((0, 7)))
    rows = whitened(H, residual, W, chosen)
    own = np.zeros((7, 7))
    own[: min(len(rows), 7)] = np.linalg.qr(rows, mode="r")
    assert np.array_equal(triangle, np.triu(triangle))
    if len(rows) > 7:
        length = np.linalg.norm(rows, axis=0)
        assert (np.abs(np.abs(triangle) - np.abs(own)) <= 1e-12 * length).all()
    assert cost == pytest.approx(float(rows[:, -1] @ rows[:, -1]), rel=1e-12)


def test_what_was_known_before_is_kept() -> None:
    """The triangle of prior rows and measurements is that of all of them stacked."""
    H, residual, W, chosen = problem(40, 4)
    known = np.triu(np.random.default_rng(3).standard_normal((3, 5)))
    triangle, cost = reduced(H, residual, W, chosen, known)
    rows = whitened(H, residual, W, chosen)
    own = np.linalg.qr(np.vstack([known, rows]), mode="r")
    assert np.abs(np.abs(triangle) - np.abs(own)).max() < 1e-12 * np.abs(own).max()
    assert cost == pytest.approx(float(rows[:, -1] @ rows[:, -1]), rel=1e-12)


def test_the_solution_is_that_of_least_squares() -> None:
    """1e-9 of a sigma, with columns of sizes 1e-8 to 1e8."""
    H, residual, W, chosen = problem(100, 6, 5)
    triangle, _ = reduced(H, residual, W, chosen, np.zeros((0, 7)))
    x, length = solved(triangle, 1e-13)
    rows = whitened(H, residual, W, chosen)
    unit = np.linalg.norm(rows[:, :6], axis=0)
    own = np.linalg.lstsq(rows[:, :6] / unit, rows[:, 6], rcond=None)[0]
    assert np.abs(x * unit - own).max() < 1e-9
    left = rows[:, 6] - rows[:, :6] @ x
    assert length**2 == pytest.approx(float(rows[:, 6] @ rows[:, 6] - left @ left), rel=1e-9)


def test_directions_that_nothing_determines_have_no_solution() -> None:
    """A column of zeros, and two columns that are one: no length, and no step."""
    H, residual, W, chosen = problem(50, 5)
    for damaged in (np.where(np.arange(5) == 2, 0.0, H), np.where(np.arange(5) == 3, 4.0 * H[:, :, 1:2], H)):
        x, length = solved(reduced(damaged, residual, W, chosen, np.zeros((0, 6)))[0], 1e-13)
        assert math.isnan(length)
        assert not x.any()


def test_a_number_that_is_none_is_told() -> None:
    """nan among the partials comes out as a step without a length, not as a number."""
    H, residual, W, chosen = problem(50, 5)
    H[7, 1, 3], chosen[7] = np.nan, True
    assert math.isnan(solved(reduced(H, residual, W, chosen, np.zeros((0, 6)))[0], 1e-13)[1])
