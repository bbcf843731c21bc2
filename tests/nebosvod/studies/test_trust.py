"""The judge: lets the right covariance pass, names the direction and the percentage of a wrong one."""

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from nebosvod.studies import trust
from nebosvod.studies.outcomes import CramerVonMises, Direction, MeanSquare
from nebosvod.studies.trust import Claim, Judgement, amount, judge

Array = npt.NDArray[np.float64]
RUNS, LEVEL = 2000, 0.01
AXES = ("radially", "along the track", "normal to the orbit plane")
TELESCOPES = ("A", "B")


def factor_of(seed: int) -> Array:
    """A square root of a covariance of six parameters whose sigmas span nine orders of magnitude."""
    rng = np.random.default_rng(seed)
    return (
        np.logspace(3, -6, 6)[:, None]
        * np.linalg.cholesky(0.3 * np.ones((6, 6)) + 0.7 * np.eye(6))
        @ np.linalg.qr(rng.normal(size=(6, 6)))[0]
    )


def directions() -> list[Direction]:
    unit = np.eye(6)
    groups = [("position", AXES[k], unit[k]) for k in range(3)] + [("velocity", AXES[k], unit[3 + k]) for k in range(3)]
    groups += [("plane", "xi", unit[0] + 1e3 * unit[4]), ("plane", "zeta", unit[1] - unit[2])]
    return [Direction(group=group, name=name, unit="km", weights=row) for group, name, row in groups]


def judged(errors: Array, factor: Array, nis: Array, independent: bool = True) -> Judgement:
    claim = Claim(factor=factor, nis=nis, nis_components=np.array([50.0, 40.0]), independent=independent)
    return judge(errors, claim, directions(), np.eye(6), TELESCOPES, LEVEL)


def draws(seed: int, factor: Array, runs: int = RUNS) -> tuple[Array, Array]:
    """Errors of that covariance, and mean innovations of both telescopes."""
    rng = np.random.default_rng(seed)
    nis = np.stack([rng.chisquare(50, runs) / 50, rng.chisquare(40, runs) / 40], axis=1)
    return rng.normal(size=(runs, 6)) @ factor.T, nis


def test_the_family_of_tests_rejects_a_right_covariance_as_rarely_as_it_says() -> None:
    """60 campaigns of 200 runs at a family level of 5 %: the number rejected is binomial (0.1 % tail)."""
    factor = factor_of(0)
    rejected = 0
    for seed in range(60):
        errors, nis = draws(1000 + seed, factor, 200)
        claim = Claim(factor=factor, nis=nis, nis_components=np.array([50.0, 40.0]), independent=True)
        rejected += not judge(errors, claim, directions(), np.eye(6), TELESCOPES, 0.05).consistent
    assert rejected <= stats.binom.ppf(0.999, 60, 0.05)


def test_a_sigma_12_percent_too_small_in_one_direction_is_named() -> None:
    """The mean NEES moves to 1.04 only; the direction's own variance gives it away."""
    factor = factor_of(1)
    errors, nis = draws(2, factor)
    errors[:, 1] *= 1.12
    found = judged(errors, factor, nis)
    assert not found.consistent
    assert "along the track (position)" in found.verdict
    assert "optimistic" in found.verdict
    rows = found.directions
    (row,) = (row for row in rows if row.direction.name == AXES[1] and row.direction.group == "position")
    assert row.rejected
    assert abs(row.optimism_percent - 12.0) < 5.0  # 3 sigma of a sigma from 2000 runs


def test_a_pessimistic_covariance_is_called_so() -> None:
    factor = factor_of(3)
    errors, nis = draws(4, factor)
    assert "pessimistic by" in judged(errors / 1.5, factor, nis).verdict


def test_a_wrong_correlation_is_seen_where_every_sigma_is_right() -> None:
    factor = np.linalg.cholesky(0.3 * np.ones((6, 6)) + 0.7 * np.eye(6))
    errors, nis = draws(5, np.eye(6))
    found = judged(errors, factor, nis)
    assert not found.consistent
    assert any(row.rejected for row in found.whitened)


def test_wrong_innovations_of_one_telescope_are_laid_at_its_door() -> None:
    factor = factor_of(6)
    errors, nis = draws(7, factor)
    nis[:, 1] *= 1.05
    for independent in (True, False):
        found = judged(errors, factor, nis, independent)
        assert not found.consistent
        assert [row.rejected for row in found.nis] == [False, True]


def test_missing_innovations_are_not_judged() -> None:
    factor = factor_of(8)
    errors, nis = draws(9, factor)
    assert judged(errors, factor, np.full_like(nis, np.nan)).nis == ()


def test_runs_with_a_factor_each_are_judged_as_runs_with_one() -> None:
    factor = factor_of(10)
    errors, nis = draws(11, factor)
    scale = np.random.default_rng(12).uniform(0.5, 2.0, RUNS)
    one = judged(errors, factor, nis)
    each = judged(errors * scale[:, None], factor * scale[:, None, None], nis)
    assert each.consistent
    assert one.nees.value == pytest.approx(each.nees.value, rel=1e-9)


def test_intervals_are_where_the_tests_reject() -> None:
    factor = factor_of(13)
    errors, nis = draws(14, factor)
    found = judged(errors, factor, nis)
    assert len(found.outcomes) == 1 + 6 + 8 + 1 + 3 + 1 + 2
    for row in found.outcomes:
        low, high = row.interval
        assert low <= row.value <= high


def test_the_limit_of_cramer_von_mises_is_that_of_its_exact_law() -> None:
    """Published 1 % point of the statistic for many runs: 0.743 (Anderson, Darling 1952); one term gives 1 % less."""
    assert CramerVonMises().interval(0.01)[1] == pytest.approx(0.743, abs=0.01)


def test_a_value_at_the_end_of_its_interval_has_the_p_value_of_the_interval() -> None:
    """Both ends, 1 in 1000: the tests are two-sided."""
    for end in (0, 1):
        bound = MeanSquare(freedom=400).interval(0.001)[end]
        assert trust._variance(np.full(400, bound), 400)["p"] == pytest.approx(0.001, rel=1e-6)


@pytest.mark.parametrize(
    ("percent", "words"),
    [(12.3, "optimistic by 12 %"), (-20.0, "pessimistic by 20 %"), (350.0, "optimistic by a factor of 4.5")],
)
def test_amounts_are_said_plainly(percent: float, words: str) -> None:
    assert amount(percent) == words


def test_a_failure_in_no_single_direction_is_named_with_its_number() -> None:
    """Every variance is right, but errors come in bursts: half of them 0.2, half 1.4 times as large as they should."""
    factor = factor_of(4)
    errors, nis = draws(5, factor, 1000)
    size = np.where(np.random.default_rng(6).random(1000) < 0.5, 0.2, np.sqrt(2.0 - 0.04))
    found = judged(errors * size[:, None], factor, nis)
    assert not found.consistent
    assert "none of them in a single direction: " in found.verdict
    shares = [row for row in found.coverage if row.rejected]
    assert shares
    assert f"share of errors inside their ellipsoid {shares[0].value:.3g}" in found.verdict
