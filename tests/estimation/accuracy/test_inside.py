"""Probability inside a disc or an ellipse that is not the distribution's own."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.ellipse import Ellipse, probability
from nebosvod.estimation.accuracy.inside import inside_disc, inside_ellipse


@pytest.mark.parametrize("level", [0.1, 1.0, 1.1774, 3.0, 6.0])
def test_a_centred_round_distribution_has_the_closed_formula(level):
    assert inside_disc([0.0, 0.0], 2.0 * np.eye(2), 2.0 * level) == pytest.approx(-np.expm1(-(level**2) / 2), rel=1e-10)


def test_an_offset_round_distribution_is_a_noncentral_chi_square():
    from scipy.stats import ncx2

    for offset, radius, sigma in [
        (3.0, 2.0, 1.0),
        (10.0, 3.0, 1.0),
        (0.5, 5.0, 1.0),
        (1.0, 1.0, 0.01),
        (1.0, 1.0, 50.0),
    ]:
        wanted = ncx2.cdf((radius / sigma) ** 2, 2, (offset / sigma) ** 2)
        for angle in (0.0, 0.7, np.pi / 2):
            mean = offset * np.array([np.cos(angle), np.sin(angle)])
            assert inside_disc(mean, sigma * np.eye(2), radius) == pytest.approx(wanted, rel=1e-8)


def test_a_needle_through_the_disc_is_the_chord_of_a_line():
    from scipy.special import ndtr

    height, sigma = 0.6, 3.0  # half chord 0.8
    needle = np.array([[sigma, 0.0], [0.0, 1e-13]])
    assert inside_disc([0.5, height], needle, 1.0) == pytest.approx(ndtr(0.1) - ndtr(-1.3 / 3.0), rel=1e-7)
    assert inside_disc([0.5, height], needle[:, :1], 1.0) == pytest.approx(ndtr(0.1) - ndtr(-1.3 / 3.0), rel=1e-7)
    assert inside_disc([0.5, 1.1], needle, 1.0) == 0.0


def test_a_tilted_distribution_agrees_with_two_million_draws():
    rng = np.random.default_rng(5)
    factor = np.array([[4.0, 0.0], [2.5, 0.6]])
    mean = np.array([3.0, 1.0])
    draws = mean + rng.standard_normal((2_000_000, 2)) @ factor.T
    for shape, centre in [
        (Ellipse(semi_axes=np.array([5.0, 1.5]), angle_rad=0.9, level=1.0), [1.0, -1.0]),
        (Ellipse(semi_axes=np.array([2.0, 2.0]), angle_rad=0.0, level=1.0), [0.0, 0.0]),
    ]:
        c, s = np.cos(shape.angle_rad), np.sin(shape.angle_rad)
        local = (draws - centre) @ np.array([[c, -s], [s, c]]) / shape.semi_axes
        share = np.mean(np.sum(local**2, axis=1) <= 1.0)
        # four sigmas of a binomial share
        assert inside_ellipse(mean, factor, shape, centre) == pytest.approx(share, abs=4 * np.sqrt(share / 2e6))


def test_its_own_ellipse_holds_the_probability_of_its_level():
    factor = np.array([[389.6, 0.0], [100.0, 16.4]])
    for level in (0.5, 1.0, 3.0):
        own = Ellipse.of_factor(factor, level)
        assert inside_ellipse([7.0, 8.0], factor, own, [7.0, 8.0]) == pytest.approx(probability(level), rel=1e-9)


def test_tails_keep_their_digits_and_nonsense_is_refused():
    from scipy.stats import ncx2

    far = inside_disc([9.0, 0.0], np.eye(2), 1.0)
    assert far == pytest.approx(ncx2.cdf(1.0, 2, 81.0), rel=1e-6)
    assert 0.0 < far < 1e-14
    assert inside_disc([0.0, 0.0], np.eye(2), 0.0) == 0.0
    for mean, factor, radius in [
        ([np.nan, 0.0], np.eye(2), 1.0),
        ([0.0], np.eye(2), 1.0),
        ([0.0, 0.0], np.eye(2), -1.0),
    ]:
        with pytest.raises(InputError):
            inside_disc(mean, factor, radius)
