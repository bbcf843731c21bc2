"""Conditional sigmas and regression lines, against blocks of K and of K^-1."""

import numpy as np
import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy.conditional import conditional_sigmas, regress
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief


def inverse(matrix):
    return np.linalg.solve(matrix, np.eye(len(matrix)))


def spd(seed, size):
    A = np.random.default_rng(seed).normal(size=(size, size))
    return A @ A.T + 0.1 * np.eye(size)


def test_regression_is_the_block_formula_and_the_conditional_covariance_the_inverse_of_a_block_of_the_inverse():
    K, mean = spd(0, 5), np.arange(5.0)
    found = regress(Belief.of(mean, K), [3, 0], [1, 4])
    a, b = np.ix_([3, 0], [1, 4]), np.ix_([1, 4], [1, 4])
    np.testing.assert_allclose(found.slope, K[a] @ inverse(K[b]), rtol=1e-10)
    given = found.at([2.0, 3.0])
    np.testing.assert_allclose(given.mean, mean[[3, 0]] + found.slope @ [1.0, -1.0], rtol=1e-10)
    # conditional on 1 and 4, marginal over 2: invert the block of K without 2
    information = inverse(K[np.ix_([3, 0, 1, 4], [3, 0, 1, 4])])[:2, :2]
    np.testing.assert_allclose(given.covariance, inverse(information), rtol=1e-9)


def test_a_given_component_is_one_measured_without_error():
    belief = Belief.of([1.0, -1.0, 0.5], spd(1, 3))
    sharp, _ = kalman.update(belief, [2.0 - 0.5], np.array([[0.0, 0.0, 1.0]]), np.array([[1e-16]]))
    found = regress(belief, [0, 1], [2]).at(2.0)
    np.testing.assert_allclose(found.mean, sharp.mean[:2], rtol=1e-7)
    np.testing.assert_allclose(found.covariance, sharp.covariance[:2, :2], rtol=1e-6, atol=1e-9)


def test_two_numbers_have_two_regression_lines():
    """Slopes r sy/sx and r sx/sy: their product is r^2, and they meet only where r is 1."""
    sx, sy, r = 2.0, 0.5, 0.6
    belief = Belief.of([0.0, 0.0], [[sx**2, r * sx * sy], [r * sx * sy, sy**2]])
    y_on_x, x_on_y = regress(belief, [1], [0]), regress(belief, [0], [1])
    assert y_on_x.slope[0, 0] == pytest.approx(r * sy / sx)
    assert x_on_y.slope[0, 0] == pytest.approx(r * sx / sy)
    assert y_on_x.factor[0, 0] == pytest.approx(sy * np.sqrt(1.0 - r**2))
    np.testing.assert_allclose(conditional_sigmas(belief.factor), np.array([sx, sy]) * np.sqrt(1.0 - r**2))


def test_conditional_sigmas_are_those_of_the_inverse():
    K = spd(2, 6)
    found = conditional_sigmas(np.linalg.cholesky(K))
    np.testing.assert_allclose(found, 1.0 / np.sqrt(np.diag(inverse(K))), rtol=1e-9)
    assert np.all(found < np.sqrt(np.diag(K)))


def test_what_cannot_be_given_is_refused():
    belief = Belief(mean=np.zeros(3), factor=np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]))
    with pytest.raises(GeometryError, match="depend on each other"):
        regress(belief, [2], [0, 1])
    with pytest.raises(InputError, match="both sides"):
        regress(belief, [0], [0, 1])
    with pytest.raises(InputError, match="needs 1 values"):
        regress(belief, [2], [0]).at([1.0, 2.0])
