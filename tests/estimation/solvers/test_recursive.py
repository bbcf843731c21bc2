"""The augmented filter: equal to the batch, honest at every epoch."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Prior, Status
from nebosvod.estimation.solvers import batch, recursive

TREATMENTS = [
    {},
    {"c": "considered", "bias": "ignored"},
    {"z": "considered"},
    {"z": "ignored", "c": "fixed"},
]


@pytest.mark.parametrize("z", ["white", "markov", "both"])
@pytest.mark.parametrize("treatments", TREATMENTS)
@pytest.mark.parametrize("truth", [False, True])
def test_recursive_equals_batch_to_1e_minus_8_sigma(make_problem, covariance_error, z, treatments, truth):
    for state_prior in ("none", "joint"):
        if state_prior == "joint" and treatments.get("c") == "fixed":
            continue
        problem = make_problem(seed=2, z=z, treatments=treatments, truth=truth, state_prior=state_prior, spread=1e3)
        if treatments.get("c") == "fixed":
            problem = replace(problem, priors=tuple(p for p in problem.priors if p.name != "c"))
        one, all_at_once = recursive.solve(problem), batch.solve(problem)
        sigma = np.sqrt(np.diag(all_at_once.K_true))
        assert np.max(np.abs(one.mean - all_at_once.mean) / sigma) < 1e-8
        assert covariance_error(one.K_true, all_at_once.K_true) < 1e-8
        assert covariance_error(one.K_formal, all_at_once.K_formal) < 1e-8
        assert one.chi2 == pytest.approx(all_at_once.chi2, rel=1e-9)
        np.testing.assert_allclose(one.history.sigma_formal[-1], np.sqrt(np.diag(all_at_once.K_formal)), rtol=1e-8)
        if one.history.sigma is not None:
            np.testing.assert_allclose(one.history.sigma[-1], sigma, rtol=1e-8)


def test_the_history_is_the_batch_of_the_measurements_so_far(make_problem):
    problem = make_problem(seed=6, z="white", treatments={"c": "considered", "bias": "ignored"}, truth=True)
    history = recursive.solve(problem).history
    for k in (5, 11, 23):
        part = _first(problem, k + 1)
        found = batch.solve(part)
        np.testing.assert_allclose(history.sigma_formal[k], np.sqrt(np.diag(found.K_formal)), rtol=1e-9)
        np.testing.assert_allclose(history.sigma[k], np.sqrt(np.diag(found.K_true)), rtol=1e-9)


def test_the_history_with_correlated_nuisances_is_the_batch_so_far_too(make_problem):
    problem = make_problem(seed=6, z="markov")
    history = recursive.solve(problem).history
    for k in (5, 11, 23):
        found = batch.solve(_first(problem, k + 1))
        np.testing.assert_allclose(history.sigma[k], np.sqrt(np.diag(found.K_true)), rtol=1e-9)


def test_sigmas_are_infinite_until_the_state_is_determined_and_priors_hold_meanwhile(make_problem):
    problem = make_problem(seed=6, z="white")
    found = recursive.solve(problem)
    state = [found.names.index(name) for name in ("x", "y", "vx", "vy")]
    c = found.names.index("c1")
    assert np.isinf(found.history.sigma_formal[0, state]).all()
    assert found.history.sigma_formal[0, c] == pytest.approx(np.sqrt(problem.priors[0].covariance[0, 0]), rel=1e-12)
    assert np.isfinite(found.history.sigma_formal[5:]).all()
    assert (np.diff(found.history.sigma_formal[5:], axis=0) <= 1e-12).all()


def test_square_root_form_keeps_nine_digits_with_a_prior_of_1e12(make_problem, covariance_error):
    problem = make_problem(seed=4, z="white")
    vague = Prior(name="state", names=problem.blocks[0].names, covariance=1e12 * np.eye(4))
    problem = replace(problem, priors=(*problem.priors, vague))
    one, all_at_once = recursive.solve(problem), batch.solve(problem)
    assert covariance_error(one.K_true, all_at_once.K_true) < 1e-9


def test_an_unobservable_problem_is_a_status(make_problem):
    found = recursive.solve(make_problem(n=1))
    assert found.status is Status.NOT_OBSERVABLE
    assert found.history is None


def _first(problem, count):
    """The problem of the first `count` measurements."""
    white = []
    for w in problem.white:
        keep = w.rows < count
        white.append(
            replace(w, H=w.H[keep], rows=w.rows[keep], Q=w.Q[0], true_Q=None if w.true_Q is None else w.true_Q[0])
        )
    markov = []
    for m in problem.markov:
        keep = m.rows < count
        markov.append(replace(m, H=m.H[keep], F=m.F[keep], Q=m.Q[keep], rows=m.rows[keep]))
    return replace(
        problem,
        residual=problem.residual[:count],
        R=problem.R[:count],
        true_R=None if problem.true_R is None else problem.true_R[:count],
        blocks=tuple(replace(b, H=b.H[:count]) for b in problem.blocks),
        white=tuple(white),
        markov=tuple(markov),
        noise_label=problem.noise_label[:count],
    )


@pytest.mark.parametrize("treatments", TREATMENTS)
@pytest.mark.parametrize("truth", [False, True])
def test_a_followed_quantity_has_the_sigma_of_the_batch_of_the_measurements_so_far(make_problem, treatments, truth):
    problem = make_problem(seed=6, z="white", treatments=treatments, truth=truth)
    if treatments.get("c") == "fixed":
        problem = replace(problem, priors=tuple(p for p in problem.priors if p.name != "c"))
    names = batch.solve(problem).names + batch.solve(problem).left_out
    W = np.random.default_rng(1).normal(size=(2, len(names)))
    formal, true = recursive.follow(problem, W, names)
    for k in (5, 11, 24):
        then = batch.solve(_first(problem, k)).predict(W, names)
        np.testing.assert_allclose(formal[k - 1], then.sigma_formal, rtol=1e-9)
        np.testing.assert_allclose(true[k - 1], then.sigma, rtol=1e-9)


def test_a_followed_quantity_is_infinite_until_it_is_determined_and_unknown_names_are_refused(make_problem):
    problem = make_problem(seed=6, z="none")
    formal, true = recursive.follow(problem, [[1.0]], ("x",))
    assert np.isinf(formal[0, 0])
    assert np.isfinite(formal[-1, 0])
    np.testing.assert_array_equal(formal, true)
    with pytest.raises(InputError, match="follow"):
        recursive.follow(problem, [[1.0]], ("nobody",))
