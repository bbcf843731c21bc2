"""Exact parabolic descent: the law sqrt(Psi) = sqrt(Psi0) - s, and where it ends."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from nebosvod.errors import InputError
from nebosvod.estimation.solvers import parabolic


def rosenbrock(x):
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def test_the_root_of_the_cost_falls_at_a_steady_rate_to_zero():
    path = parabolic.descend(rosenbrock, [-1.2, 1.0])
    assert path.status == "converged"
    np.testing.assert_allclose(np.sqrt(path.psi), np.sqrt(path.psi[0]) - path.s, atol=2e-5)
    np.testing.assert_allclose(path.x[-1], [1.0, 1.0], atol=1e-6)


def test_the_curve_is_the_one_of_the_differential_equation():
    """A square system keeps the direction of v: J dx/ds = -v0 / |v0|, integrated by scipy."""
    start = np.array([-1.2, 1.0])
    v0 = rosenbrock(start)[0]
    there = solve_ivp(lambda s, x: np.linalg.solve(rosenbrock(x)[1], -v0 / np.linalg.norm(v0)), (0.0, 4.0), start,
                      rtol=1e-10, atol=1e-12, dense_output=True)  # fmt: skip
    path = parabolic.descend(rosenbrock, start)
    for s, x in zip(path.s, path.x):
        if s < 4.0:
            np.testing.assert_allclose(x, there.sol(s), atol=1e-4)


def test_it_comes_down_from_where_a_full_step_flies_away():
    def arctan(x):
        return np.arctan(x), np.array([[1.0 / (1.0 + x[0] ** 2)]])

    path = parabolic.descend(arctan, [3.0])
    assert path.status == "converged"
    assert path.x[-1, 0] == pytest.approx(0.0, abs=1e-7)
    np.testing.assert_allclose(path.x[:, 0], np.tan(np.arctan(3.0) - path.s), atol=1e-4)  # the closed form


def test_a_problem_with_residuals_left_ends_at_the_minimum_of_scipy():
    rng = np.random.default_rng(3)
    beacons = rng.normal(size=(6, 2)) * 3.0
    ranges = np.linalg.norm(beacons - [0.7, -0.4], axis=1) + 0.1 * rng.normal(size=6)

    def whitened(x):
        away = x - beacons
        r = np.linalg.norm(away, axis=1)
        return (r - ranges) / 0.1, away / r[:, None] / 0.1

    path = parabolic.descend(whitened, [2.0, 2.0], tolerance=1e-6)
    wanted = least_squares(lambda x: whitened(x)[0], [2.0, 2.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert path.status == "converged"
    np.testing.assert_allclose(path.x[-1], wanted, atol=1e-6)
    assert np.all(np.diff(path.psi) < 0.0)


def test_other_endings():
    def flat(x):
        return np.array([1.0 + x[0], 2.0]), np.array([[1.0, 0.0], [0.0, 0.0]])

    assert parabolic.descend(flat, [0.0, 0.0]).status == "not_observable"
    assert parabolic.descend(rosenbrock, [-1.2, 1.0], limit=3).status == "iteration_limit"
    with pytest.raises(InputError, match="not finite"):
        parabolic.descend(rosenbrock, [np.nan, 0.0])
