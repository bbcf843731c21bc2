"""Patterns of residuals: independent numbers in a right model, tests that hold their level, rhythms against astropy."""

import numpy as np
import pytest
from astropy.timeseries import LombScargle
from scipy import stats

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy import consistency
from nebosvod.estimation.accuracy.periodogram import power, rhythm_at, strongest_rhythm, strongest_rhythms
from nebosvod.estimation.accuracy.recursive_residuals import nothing_left_out, recursive_residuals
from nebosvod.estimation.solvers import batch, recursive


@pytest.mark.parametrize("z", ["none", "both"])
@pytest.mark.parametrize("state_prior", ["none", "own"])
def test_recursive_residuals_are_the_innovations_of_the_batch_so_far(make_problem, z, state_prior):
    """Each is (y - h x) / sqrt(1 + h K h^T) with x and K of the measurements before, and their squares are chi2."""
    problem = make_problem(seed=4, z=z, state_prior=state_prior)
    found = recursive_residuals(problem)
    assert np.isnan(found).sum() == (4 if state_prior == "none" else 0)
    assert np.nansum(found**2) == pytest.approx(batch.solve(problem).chi2, rel=1e-9)
    if z == "none":
        from nebosvod.estimation.problem.subset import subset

        for k in (6, 15, 23):
            before = batch.solve(subset(problem, np.arange(problem.n) < k))
            H = np.concatenate([block.H for block in problem.blocks], axis=2)[k]
            V = H @ before.K_formal @ H.T + problem.R[k]
            wanted = np.linalg.solve(np.linalg.cholesky(V), problem.residual[k] - H @ before.mean)
            np.testing.assert_allclose(found[k], wanted, rtol=1e-8)


def test_in_a_right_model_they_are_independent_normal_numbers(make_problem):
    """300 worlds of a model that an estimator does not have whole: what it leaves out is in that of the test."""
    blind = make_problem(seed=6, z="white", state_prior="own", treatments={"c": "considered", "z": "ignored"})
    whole = nothing_left_out(blind)
    rng = np.random.default_rng(8)
    R = np.broadcast_to(whole.R, (whole.n, 2, 2)).copy()
    for white in whole.white:
        R[white.rows] += white.H @ np.broadcast_to(white.Q, (len(white.rows), 3, 3)) @ white.H.transpose(0, 2, 1)
    roots = np.linalg.cholesky(R)
    told = []
    for _ in range(300):
        y = (roots @ rng.standard_normal((whole.n, 2, 1)))[:, :, 0]
        for block in whole.blocks:
            prior = next(p for p in whole.priors if set(block.names) <= set(p.names))
            draw = np.linalg.cholesky(prior.covariance) @ rng.standard_normal(len(prior.names))
            y += block.H @ draw[[prior.names.index(name) for name in block.names]]
        told.append(recursive_residuals(_with_residual(whole, y)).ravel())
    rows = np.array(told)
    assert stats.kstest(rows.ravel(), "norm").pvalue > 1e-3
    C = rows.T @ rows / len(rows)
    assert np.abs(C - np.eye(len(C))).max() < 5.0 * np.sqrt(2.0 / len(rows))


def _with_residual(problem, y):
    from dataclasses import replace

    return replace(problem, residual=y)


def test_the_chances_of_a_pattern_hold_at_small_levels():
    """Among many tests each has a small level: 20 values of the worst of ten lags, and runs, at one in a thousand."""
    rng, runs = np.random.default_rng(3), 4000
    found = [consistency.residual_pattern(rng.standard_normal(30)) for _ in range(runs)]
    for chances in ([one.lag_p for one in found], [one.runs_p for one in found]):
        few = int(np.sum(np.array(chances) < 1e-3))
        assert stats.binomtest(few, runs, 1e-3, alternative="greater").pvalue > 1e-3
    slow = np.convolve(rng.standard_normal(400), np.ones(4), mode="valid")
    told = consistency.residual_pattern(slow)
    assert told.lag == 1
    assert told.lag_p < 1e-6
    assert told.correlation == pytest.approx(0.75, abs=0.15)  # of a sum of four


def test_the_periodogram_and_its_chance_are_those_of_astropy():
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0.0, 50.0, 80))
    y = rng.standard_normal((80, 2)) + 0.9 * np.sin(2.0 * np.pi * t / 3.3)[:, None] * np.array([1.0, 0.0])
    step = 1.0 / 200.0
    found = power(t, y, step, 300)
    for column, told in enumerate(strongest_rhythms(t, y)):
        other = LombScargle(t, y[:, column], fit_mean=True)
        wanted = other.power(step * np.arange(1, 301), method="chi2")
        np.testing.assert_allclose(found[:, column], wanted, atol=1e-9)
        chance = other.false_alarm_probability(
            told.power, method="baluev", minimum_frequency=0.0, maximum_frequency=1.0 / told.shortest
        )
        assert told.chance == pytest.approx(chance, rel=1e-3)
    first = strongest_rhythm(t, y[:, 0])
    assert first.period == pytest.approx(3.3, rel=0.02)
    assert first.amplitude == pytest.approx(0.9, abs=0.35)
    assert rhythm_at(t, y[:, 0], 3.3).chance < 1e-3 < rhythm_at(t, y[:, 1], 3.3).chance
    with pytest.raises(InputError, match="8 values"):
        strongest_rhythm(t[:5], y[:5, 0])


def test_noise_has_a_rhythm_no_more_often_than_stated():
    rng, runs, level = np.random.default_rng(4), 400, 0.05
    t = np.cumsum(rng.uniform(0.5, 1.5, 60))
    alarms = sum(strongest_rhythm(t, rng.standard_normal(60)).chance < level for _ in range(runs))
    assert stats.binomtest(alarms, runs, level, alternative="greater").pvalue > 1e-3


def test_the_filters_pass_is_not_disturbed(make_problem):
    """The rotation that both share: a history is what it was."""
    problem = make_problem(seed=4, state_prior="own")
    history = recursive.solve(problem).history
    assert history is not None
    np.testing.assert_allclose(history.sigma_formal[-1], np.sqrt(np.diag(batch.solve(problem).K_formal)), rtol=1e-9)
