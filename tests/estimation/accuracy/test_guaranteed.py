"""Guaranteed bounds by linear programming, with the dual as a check."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, LinearProblem, Prior, White
from nebosvod.estimation.accuracy import guaranteed
from nebosvod.estimation.solvers import batch


def test_the_textbook_square_gives_one_and_a_half():
    found = guaranteed.extreme(guaranteed.polytope([[1.0, 1.0], [1.0, -1.0]], [1.0, 2.0]), np.eye(2))
    np.testing.assert_allclose(found.upper, [1.5, 1.5], rtol=1e-9)
    np.testing.assert_allclose(found.lower, [-1.5, -1.5], rtol=1e-9)
    assert found.duality_gap < 1e-9
    assert found.consistent
    assert found.inflation == 1.0


def test_primal_and_dual_agree_and_no_admissible_error_leaves_the_bounds(make_problem):
    problem = make_problem(seed=2, n=10, treatments={"c": "considered"}, state_prior="none")
    problem = replace(problem, residual=np.zeros((10, 2)))
    names = ("x", "y", "c1")
    found = guaranteed.bound(problem, np.eye(3), names)
    assert found.consistent
    assert found.duality_gap < 1e-7
    np.testing.assert_allclose(found.upper, -found.lower, rtol=1e-7)
    # The least-squares estimate of any admissible data must differ from its truth by a feasible point's width.
    sigma = np.array([batch.solve(problem).sigma(name) for name in names])
    assert np.all(found.half_width[:2] > sigma[:2])


def test_bounds_do_not_depend_on_the_units_of_a_parameter(make_problem):
    problem = make_problem(seed=2, n=10, z="none")
    block = problem.blocks[0]
    scaled = replace(problem, blocks=(replace(block, H=block.H * 1e9), *problem.blocks[1:]))
    problem, scaled = (replace(p, residual=np.zeros((10, 2))) for p in (problem, scaled))
    one = guaranteed.bound(problem, np.eye(1), ("x",)).upper
    two = guaranteed.bound(scaled, np.eye(1), ("x",)).upper
    np.testing.assert_allclose(two * 1e9, one, rtol=1e-6)


def constant(values, sigma=1.0):
    n = len(values)
    block = Block(name="x", names=("x",), H=np.ones((n, 1, 1)))
    return LinearProblem(residual=np.array(values, dtype=float)[:, None], R=[[sigma**2]], blocks=(block,))


def test_the_set_of_a_repeated_measurement_is_the_intersection_of_intervals():
    found = guaranteed.bound(constant([0.0, 2.0, 1.0]), np.eye(1))
    assert found.lower[0] == pytest.approx(-1.0, abs=1e-7)
    assert found.upper[0] == pytest.approx(3.0, abs=1e-7)


def test_inconsistent_bounds_report_the_smallest_common_inflation():
    found = guaranteed.bound(constant([0.0, 9.0]), np.eye(1))
    assert not found.consistent
    assert found.inflation == pytest.approx(1.5, rel=1e-7)
    assert found.upper[0] == pytest.approx(4.5, abs=1e-6)


def test_an_undetermined_quantity_is_said_to_be_so():
    block = Block(name="x", names=("x", "y"), H=np.ones((3, 1, 2)))
    problem = LinearProblem(residual=np.zeros((3, 1)), R=[[1.0]], blocks=(block,))
    with pytest.raises(GeometryError, match="not bounded"):
        guaranteed.bound(problem, [[1.0, 0.0]])
    assert guaranteed.bound(problem, [[1.0, 1.0]]).upper[0] == pytest.approx(3.0, rel=1e-7)


def test_time_correlated_nuisances_are_refused(make_problem):
    with pytest.raises(InputError, match="time-correlated"):
        guaranteed.bound(make_problem(z="markov"), np.eye(1), ("x",))


def test_priors_and_nuisances_are_boxes_of_the_stated_level():
    """A prior of sigma 2 alone bounds x by 2 level; a nuisance of sigma 5 widens a measurement by 5 level."""
    n = 2
    block = Block(name="x", names=("x",), H=np.ones((n, 1, 1)))
    prior = Prior(name="x", names=("x",), covariance=[[4.0]])
    weak = LinearProblem(residual=np.zeros((n, 1)), R=[[1e6]], blocks=(block,), priors=(prior,))
    for level in (1.0, 3.0):
        assert guaranteed.bound(weak, np.eye(1), level=level).upper[0] == pytest.approx(2.0 * level, rel=1e-7)
    white = White(name="z", H=np.ones((n, 1, 1)), Q=[[25.0]], rows=np.arange(n))
    free = LinearProblem(residual=np.zeros((n, 1)), R=[[1.0]], blocks=(block,), white=(white,))
    assert guaranteed.bound(free, np.eye(1), level=2.0).upper[0] == pytest.approx(12.0, rel=1e-7)


def test_largest_error_of_a_mean_is_its_box_and_a_bias_adds_its_own():
    n = 9
    blocks = (
        Block(name="x", names=("x",), H=np.ones((n, 1, 1))),
        Block(name="bias", names=("b",), H=np.ones((n, 1, 1)), treatment="considered"),
    )
    prior = Prior(name="bias", names=("b",), covariance=[[4.0]], mean=[7.0])
    problem = LinearProblem(residual=np.full((n, 1), 7.0), R=[[0.25]], blocks=blocks, priors=(prior,))
    # three sigmas of noise and of bias: 3 (0.5 + 2), whatever the measurements say and however many they are
    assert guaranteed.largest_error(problem, [[1.0]], ("x",))[0] == pytest.approx(7.5, rel=1e-7)
    assert guaranteed.largest_error(problem, [[1.0]], ("x",), level=1.0)[0] == pytest.approx(2.5, rel=1e-7)


def test_largest_error_is_the_half_width_without_residuals(make_problem):
    problem = make_problem(seed=2, n=10, treatments={"c": "considered"}, state_prior="none")
    silent = replace(problem, residual=np.zeros((10, 2)))
    names = ("x", "y", "c1")
    found = guaranteed.largest_error(problem, np.eye(3), names)
    np.testing.assert_allclose(found, guaranteed.bound(silent, np.eye(3), names).half_width, rtol=1e-6)
