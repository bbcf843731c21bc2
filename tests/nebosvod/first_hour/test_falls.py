"""The interval of a probability to hit, from the least to what is nearly certain, and how it is told."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.alert import Question, alert
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.falls import chance, fall, interval
from nebosvod.first_hour.grid import grid_of
from nebosvod.first_hour.region import Region
from nebosvod.impacts.chance import digits
from nebosvod.results.alert_folder import summarise
from nebosvod.results.alert_words import headline

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hour_cases import CASES, Case, made  # type: ignore[import-not-found]
from impactors import impactor  # type: ignore[import-not-found]


@pytest.mark.parametrize(("hits", "draws"), [(40, 400), (200, 400), (360, 400), (950, 1000)])
def test_the_interval_of_plain_draws_is_clopper_and_pearsons(hits: int, draws: int) -> None:
    p = hits / draws
    judge = binomtest(hits, draws).proportion_ci(0.95, "exact")
    low, high = interval(p, p * (1.0 - p) / draws, draws)
    assert low == pytest.approx(judge.low, abs=2e-3)
    assert high == pytest.approx(judge.high, abs=2e-3)


def test_misses_near_one_are_counted_as_hits_near_nothing() -> None:
    for p, variance, draws in ((0.2, 1e-4, 500.0), (1e-3, 1e-6, 300.0), (0.0, 0.0, 120.0), (1e-4, 0.0, 200.0)):
        low, high = interval(p, variance, draws)
        above, below = interval(1.0 - p, variance, draws)[::-1]
        assert (1.0 - above, 1.0 - below) == pytest.approx((low, high), abs=1e-12)


def test_where_all_hit_effective_draws_decide_how_certain_it_is() -> None:
    """Of 120 draws that all hit the probability is above 1 - 3/120 at 95 %: 0.05^(1/120)."""
    assert interval(1.0, 0.0, 120.0)[0] == pytest.approx(0.05 ** (1.0 / 120.0))


@pytest.mark.parametrize("p", [0.9, 0.98, 0.995])
def test_the_interval_holds_the_truth_as_often_as_it_says(p: float) -> None:
    """Plain draws of a known probability, a thousand times."""
    draws, found = 300, 0
    for hits in np.random.default_rng(5).binomial(draws, p, 1000).tolist():
        share = hits / draws
        low, high = interval(share, share * (1.0 - share) / draws, draws)
        found += low <= p <= high
    assert found >= 945


def test_an_interval_near_one_is_told_with_the_digits_it_needs() -> None:
    row = {"within_d": 100.0, "bound": False, "probability": 0.9991, "low": 0.9987, "high": 0.9994}
    assert "0.9991 (0.9987 to 0.9994)" in headline(row)
    assert [digits(low) for low in (0.0, 0.15, 0.9, 0.9987, 1.0)] == [3, 3, 3, 4, 3]


@pytest.mark.long
def test_probabilities_by_other_seeds_lie_in_the_interval_of_each() -> None:
    """Twenty-four seeds on one grid, of an impactor at 0.985: weights within cells vary too."""
    tracklet = impactor(Ephemeris.load(), np.random.default_rng(3)).tracklet
    grid = grid_of(Conditional(tracklet), Region())
    found = [chance(grid, fall(grid, 100.0, np.random.default_rng(seed))) for seed in range(24)]
    p = np.array([one.probability for one in found])
    assert 0.9 < p.mean() < 0.999
    inside = sum(one.low <= p.mean() <= one.high for one in found)
    assert inside >= 20  # 23 are expected, 19 and fewer have a probability of 0.6 %
    stated = np.mean([one.high - one.low for one in found]) / 3.92
    assert 0.2 < p.std(ddof=1) / stated < 1.2  # 0.34: cells that all agree are taken for open


def test_what_circles_the_earth_is_told_to_be_perhaps_artificial() -> None:
    """200,000 km away below the speed of escape, 2 km/s; what passes at 0.05 au is not told so."""
    satellite = Case(
        name="satellite", observers=("F51",), minutes=180, each=6, rho_au=0.0013, rate_km_s=0.3, across_km_s=(0.8, 0.3)
    )
    ephemeris, said = Ephemeris.load(), []
    for case in (satellite, CASES[1]):
        one = made(case, ephemeris)
        said.append(" ".join(summarise(alert(one.tracklet, Question(region=one.region, within_d=3.0)))["warnings"]))
    assert "bound to the Earth" in said[0]
    assert "bound to the Earth" not in said[1]
