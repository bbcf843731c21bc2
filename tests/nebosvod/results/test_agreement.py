"""chi2 against its degrees of freedom, on both sides of what chance leaves."""

import numpy as np
import pytest
from scipy import stats

from nebosvod.results.agreement import agreement


@pytest.mark.parametrize("dof", [1, 7, 240, 8600])
def test_the_interval_is_that_of_the_distribution(dof: int) -> None:
    low, high = stats.chi2.ppf([0.005, 0.995], dof)
    for chi2, where in (
        (0.999 * low, "below"),
        (1.001 * low, "inside"),
        (0.999 * high, "inside"),
        (1.001 * high, "above"),
    ):
        found = agreement(chi2, dof)
        assert found is not None
        assert found.where == where


def test_a_fit_that_rejects_outliers_has_smaller_squares_than_chi_square() -> None:
    """Simulated: 20,000 measurements of two components, those above 8 rejected, the weights right."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        each = rng.chisquare(2, 20000)
        kept = each[each < 8.0]
        found = agreement(float(kept.sum()), 2 * len(kept), rejected=20000 - len(kept))
        assert found is not None
        assert found.where == "inside"
        assert agreement(float(kept.sum()), 2 * len(kept)).where == "below"  # type: ignore[union-attr]


def test_noise_twice_too_large_or_too_small_is_told_with_its_size() -> None:
    small, large, right = agreement(60.0, 240), agreement(960.0, 240), agreement(200.0, 240)
    assert small is not None
    assert large is not None
    assert right is not None
    assert (small.where, small.usable, large.where, large.usable) == ("below", False, "above", False)
    assert (small.factor, large.factor) == pytest.approx((0.5, 2.0))
    assert right.usable
    assert agreement(0.93 * 20000, 20000).usable  # type: ignore[union-attr] # told, but no sigma changes by a tenth
    assert agreement(3.0, 0) is None
    assert agreement(None, 5) is None
