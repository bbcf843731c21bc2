"""Ellipses and ellipsoids: the printed probabilities, axes and angle."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Ellipse, Ellipsoid
from nebosvod.estimation.accuracy import ellipse


@pytest.mark.parametrize(("level", "wanted"), [(1, 0.3935), (2, 0.8647), (3, 0.9889)])
def test_probability_inside_the_plane_ellipse(level, wanted):
    assert ellipse.probability(level) == pytest.approx(wanted, abs=5e-5)


@pytest.mark.parametrize(("dimension", "wanted"), [(1, 0.9973), (2, 0.9889), (3, 0.9707), (6, 0.8264)])
def test_probability_inside_three_sigma_by_dimension(dimension, wanted):
    assert ellipse.probability(3.0, dimension) == pytest.approx(wanted, abs=5e-5)


@pytest.mark.parametrize(("inside", "wanted", "digit"), [(0.5, 1.1774, 5e-5), (0.997, 3.409, 5e-4)])
def test_level_of_a_probability(inside, wanted, digit):
    assert ellipse.level_of(inside) == pytest.approx(wanted, abs=digit)
    assert ellipse.probability(ellipse.level_of(inside)) == pytest.approx(inside, rel=1e-12)


def test_semi_axes_and_angle_by_the_textbook_formula():
    rng = np.random.default_rng(3)
    for _ in range(50):
        sx, sy, r = rng.uniform(0.1, 5), rng.uniform(0.1, 5), rng.uniform(-0.99, 0.99)
        K = np.array([[sx**2, r * sx * sy], [r * sx * sy, sy**2]])
        found = Ellipse.of_covariance(K, level=2.0)
        np.testing.assert_allclose(found.semi_axes, 2 * np.sqrt(np.linalg.eigvalsh(K)[::-1]), rtol=1e-9)
        angle = 0.5 * np.arctan2(2 * r * sx * sy, sx**2 - sy**2)
        assert np.cos(2 * (found.angle_rad - angle)) == pytest.approx(1.0, abs=1e-12)


def test_outline_lies_on_the_level():
    L = np.array([[3.0, 0.0], [1.0, 0.2]])
    for x in Ellipse.of_factor(L, level=3.0).points(17):
        assert ellipse.normalized_distance(L, x) == pytest.approx(3.0, rel=1e-10)


def test_axes_of_a_factor_survive_where_the_formed_covariance_loses_them():
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    factor = turn @ np.diag([1.0, 1e-10])  # condition number of the covariance: 1e20
    found = Ellipse.of_factor(factor)
    np.testing.assert_allclose(found.semi_axes, [1.0, 1e-10], rtol=1e-5)
    assert found.angle_rad == pytest.approx(0.3, abs=1e-12)


def test_ellipsoid_of_six_dimensions():
    rng = np.random.default_rng(0)
    S = rng.normal(size=(6, 6))
    found = Ellipsoid.of_factor(S, level=3.0)
    np.testing.assert_allclose(found.semi_axes**2, 9 * np.linalg.eigvalsh(S @ S.T)[::-1], rtol=1e-9)
    assert found.probability == pytest.approx(0.8264, abs=5e-5)
    for axis, direction in zip(found.semi_axes, found.directions.T):
        assert 3.0 * ellipse.sigma_along(S, direction) == pytest.approx(axis, rel=1e-9)


def test_maximum_deviation_adds_three_sigma_to_the_mean():
    np.testing.assert_allclose(ellipse.maximum_deviation([-1.0, 2.0], [0.5, 1.0]), [2.5, 5.0])


def test_a_line_is_an_ellipse_with_no_minor_axis_and_nonsense_is_refused():
    assert Ellipse.of_covariance([[1.0, 1.0], [1.0, 1.0]]).semi_axes[1] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InputError):
        Ellipse.of_factor(np.eye(3))
    with pytest.raises(InputError):
        ellipse.sigma_along(np.eye(2), [0.0, 0.0])
