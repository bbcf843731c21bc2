"""Intervals of probabilities from weighed draws, against probabilities that are known."""

import numpy as np
import pytest
from scipy.stats import norm

from nebosvod.impacts.interval import of_weights


def drawn(rng, threshold, mean, width, count=2000):
    """Draws of a normal number from a mixture of another normal and a tenth of its own: weights, which are above."""
    x = np.where(rng.random(count) < 0.1, rng.standard_normal(count), mean + width * rng.standard_normal(count))
    density = 0.1 * norm.pdf(x) + 0.9 * norm.pdf(x, mean, width)
    return norm.pdf(x) / density, x > threshold


@pytest.mark.parametrize(
    ("threshold", "mean", "width"), [(4.0, 4.2, 0.5), (0.5, 0.8, 1.0), (-1.0, 0.3, 0.9), (-2.5, 0.0, 1.0)]
)
def test_intervals_of_weighed_draws_hold_the_truth_as_often_as_they_say(threshold, mean, width):
    rng, truth, held = np.random.default_rng(5), float(norm.sf(threshold)), 0
    for _ in range(400):
        value, low, high = of_weights(*drawn(rng, threshold, mean, width))
        assert 0.0 < low < value < high < 1.0
        held += low <= truth <= high
    assert 0.91 <= held / 400 <= 0.985  # 95 %, and 4 sigmas of the count


def test_without_a_miss_an_interval_goes_down_to_the_rule_of_three():
    value, low, high = of_weights(np.full(1000, 1.01), np.ones(1000, dtype=bool))  # their mean is above 1 by chance
    assert value == high == 1.0
    assert low == pytest.approx(1.0 - 3.0 / 1000, abs=1e-5)


def test_without_a_hit_nothing_is_known():
    assert of_weights(np.ones(10), np.zeros(10, dtype=bool)) == (0.0, 0.0, 1.0)
