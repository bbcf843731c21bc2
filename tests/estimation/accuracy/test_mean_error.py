"""Means of errors shift the estimate and every prediction: dense algebra, Monte Carlo, filters of their own gain."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy import mean_error
from nebosvod.estimation.solvers import batch, recursive, sequential

MEANS = {"c1": 0.7, "c2": -0.4, "bias A 0": 1.3, "bias B 1": -0.6}


def columns(problem, names):
    """Dense partials (np, k)."""
    found = {name: block.H[:, :, k].ravel() for block in problem.blocks for k, name in enumerate(block.names)}
    return np.stack([found[name] for name in names], axis=1)


@pytest.mark.parametrize("c", ["ignored", "considered", "estimated"])
@pytest.mark.parametrize("bias", ["ignored", "considered", "estimated"])
@pytest.mark.parametrize("z", ["white", "markov"])
@pytest.mark.parametrize("state_prior", ["none", "own"])
def test_a_mean_error_of_any_group_shifts_the_estimate_by_its_gain(c, bias, z, state_prior, make_problem, dense):
    problem = make_problem(seed=7, z=z, treatments={"c": c, "bias": bias}, state_prior=state_prior)
    expected = dense(problem)
    wanted = sum(
        expected.gains[prior.name] @ np.array([MEANS.get(name, 0.0) for name in prior.names])
        for prior in problem.priors
    )
    estimate = batch.solve(problem)
    assert estimate.mean_shift(MEANS) == pytest.approx(wanted, rel=1e-9, abs=1e-11)
    slow = mean_error.shift(problem, MEANS)
    assert [slow[name] for name in expected.names] == pytest.approx(wanted, rel=1e-9, abs=1e-11)
    for name in expected.left_out:  # the estimate of a parameter left out is its assumed value
        assert estimate.mean_shift(MEANS, (name,))[0] == slow[name] == -MEANS.get(name, 0.0)


@pytest.mark.parametrize("treatment", ["ignored", "considered", "estimated"])
def test_means_of_noise_and_of_fresh_nuisances_shift_by_the_gain_of_the_measurements(treatment, make_problem, dense):
    problem = make_problem(seed=3, z="both", treatments={"z": treatment})
    rng = np.random.default_rng(5)
    white, slow = problem.white[0], problem.markov[1]
    of_z, of_slow = rng.normal(size=(len(white.rows), 3)), rng.normal(size=3)
    expected, caused = dense(problem), np.zeros((problem.n, problem.p))
    caused[problem.noise_label == 1] += [0.3, -0.8]
    for i, k in enumerate(white.rows):
        caused[k] += white.H[i] @ of_z[i]
    for i, k in enumerate(slow.rows):
        caused[k] += slow.H[i] @ of_slow
    found = mean_error.shift(problem, {"noise B": [0.3, -0.8], white.name: of_z, slow.name: of_slow})
    assert [found[name] for name in expected.names] == pytest.approx(expected.M_v @ caused.ravel(), rel=1e-8)


def test_monte_carlo_finds_the_same_mean_error_of_the_state_and_of_a_prediction(make_problem, dense):
    problem = make_problem(
        seed=11, n=40, z="white", treatments={"c": "ignored", "bias": "considered"}, state_prior="own"
    )
    means: dict[str, Any] = {"c1": 0.7, "bias A 0": 1.3, "x": -0.5, "z A": np.array([0.4, 0.0, -0.2])}
    rng = np.random.default_rng(20)
    expected = dense(problem)
    names = [*expected.names, *expected.left_out]
    runs, errors = 4000, []
    mu = np.array([float(means.get(name, 0.0)) for name in names])
    M, H = expected.M_v, columns(problem, names)
    draws = {prior.name: np.linalg.cholesky(prior.truth) for prior in problem.priors}
    R = np.linalg.cholesky(problem.R)
    for _ in range(runs):
        truth = mu.copy()
        for prior in problem.priors:
            truth[[names.index(name) for name in prior.names]] += draws[prior.name] @ rng.normal(size=len(prior.names))
        v = np.einsum("npq,nq->np", R, rng.normal(size=(problem.n, problem.p)))
        for white in problem.white:
            z = rng.normal(size=(len(white.rows), 3)) @ np.linalg.cholesky(white.Q[0]).T + means.get(white.name, 0.0)
            v[white.rows] += np.einsum("npq,nq->np", white.H, z)
        errors.append(np.concatenate([M @ (H @ truth + v.ravel()), np.zeros(len(expected.left_out))]) - truth)
    seen, spread = np.mean(errors, axis=0), np.std(errors, axis=0) / np.sqrt(runs)
    found = mean_error.shift(problem, means)
    away = (seen - [found[name] for name in names]) / spread
    assert np.abs(away).max() < 4.0
    assert max(abs(found[name]) / spread[i] for i, name in enumerate(names[:4])) > 20.0  # not a mean of nothing
    # a prediction that holds a considered parameter itself
    common = {name: value for name, value in means.items() if name != "z A"}
    estimate = batch.solve(problem)
    W = np.array([2.0, -1.0, 0.5])
    of = ("x", "vx", "c1")
    parts = mean_error.shift(problem, {"z A": means["z A"]})
    predicted = W @ estimate.mean_shift(common, of) + W[:2] @ [parts["x"], parts["vx"]]
    sample = np.array(errors)[:, [names.index(name) for name in of]] @ W
    assert abs(sample.mean() - predicted) < 4.0 * sample.std() / np.sqrt(runs)


@pytest.mark.parametrize("gain", ["formal", "schmidt"])
def test_a_filter_shifts_by_its_own_gain(gain, make_problem):
    problem = make_problem(seed=2, treatments={"c": "considered", "bias": "ignored"}, state_prior="own")
    solve = partial(sequential.solve, gain=gain)
    estimate, slow = solve(problem), mean_error.shift(problem, MEANS, solve)
    assert estimate.mean_shift(MEANS) == pytest.approx([slow[name] for name in estimate.names], rel=1e-9, abs=1e-11)


def test_the_recursive_filter_shifts_as_the_batch(make_problem):
    problem = make_problem(seed=2, z="markov", treatments={"bias": "ignored"})
    wanted = batch.solve(problem).mean_shift(MEANS)
    assert recursive.solve(problem).mean_shift(MEANS) == pytest.approx(wanted, rel=1e-9)


def test_a_mean_of_what_has_no_error_is_refused(make_problem):
    problem = make_problem(seed=2, treatments={"bias": "fixed"})
    estimate = batch.solve(problem)
    with pytest.raises(InputError, match="'bias A 0' has no assumed value"):
        estimate.mean_shift({"bias A 0": 1.0})
    with pytest.raises(InputError, match="'x' has no assumed value"):
        estimate.mean_shift({"x": 1.0})
    with pytest.raises(InputError, match="'bias A 0' is neither"):
        mean_error.shift(problem, {"bias A 0": 1.0})
    with pytest.raises(InputError, match="needs shape"):
        mean_error.shift(problem, {"z A": [1.0, 2.0]})
