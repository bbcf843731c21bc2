"""Judges of covariances and residuals: they accept the right and refuse the wrong."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy import consistency


def test_the_interval_of_mean_nees_is_the_known_one():
    """Mean NEES/6 of N = 2000 runs lies in [0.967, 1.034] with 99 %."""
    verdict = consistency.judge(np.random.default_rng(0).normal(size=(2000, 6)), np.eye(6), level=0.02)
    assert verdict.interval == pytest.approx((0.967, 1.034), abs=1e-3)
    assert verdict.consistent


def test_twelve_percent_optimism_in_one_direction_is_caught_by_its_variance():
    errors = np.random.default_rng(1).normal(size=(2000, 6))
    errors[:, 2] *= 1.12
    verdict = consistency.judge(errors, np.eye(6))
    assert not verdict.consistent
    assert int(np.argmax(verdict.variances)) == 2


def test_false_alarms_are_as_rare_as_promised():
    rng = np.random.default_rng(2)
    S = np.array([[2.0, 0.0], [1.0, 0.1]])
    alarms = sum(not consistency.judge(rng.normal(size=(50, 2)) @ S.T, S, 0.05).consistent for _ in range(400))
    assert alarms <= 32  # 20 expected at most


def test_one_factor_for_each_run_and_coverage():
    rng = np.random.default_rng(3)
    factors = np.eye(2) * rng.uniform(0.1, 10, size=4000)[:, None, None]
    errors = (factors @ rng.normal(size=(4000, 2, 1)))[:, :, 0]
    assert consistency.judge(errors, factors).consistent
    low, high = consistency.binomial_interval(round(4000 * consistency.coverage(errors, factors, 2.0)), 4000)
    assert low < 0.8647 < high


def test_random_residuals_pass_and_slow_ones_do_not():
    rng = np.random.default_rng(4)
    white = rng.normal(size=500)
    assert consistency.residual_pattern(white).random()
    slow = np.convolve(rng.normal(size=520), np.ones(8), "valid")[:500]
    assert not consistency.residual_pattern(slow).random()
    passed = sum(consistency.residual_pattern(rng.normal(size=200)).random(0.05) for _ in range(300))
    assert passed > 270
    with pytest.raises(InputError, match="at least 30"):
        consistency.residual_pattern(white[:10])
