"""Covariance-form filters: Joseph equals batch, Schmidt is honest, the printed form is not."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Prior
from nebosvod.estimation.solvers import batch, sequential


@pytest.mark.parametrize(
    "treatments",
    [{}, {"c": "considered", "bias": "ignored"}, {"z": "considered"}, {"z": "fixed", "bias": "considered"}],
)
def test_joseph_form_equals_the_batch_to_1e_minus_9_with_its_budget(make_problem, covariance_error, treatments):
    problem = make_problem(seed=3, treatments=treatments, truth=True, state_prior="own", spread=10.0)
    found, wanted = sequential.solve(problem), batch.solve(problem)
    assert covariance_error(found.K_formal, wanted.K_formal) < 1e-9
    assert covariance_error(found.K_true, wanted.K_true) < 1e-9
    assert np.max(np.abs(found.mean - wanted.mean) / np.sqrt(np.diag(wanted.K_true))) < 1e-9
    assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-9)
    sigma = np.sqrt(np.diag(wanted.K_true))
    for source, share in wanted.shares.items():
        assert np.max(np.abs(found.shares[source] - share) / np.outer(sigma, sigma)) < 1e-9
    W = np.random.default_rng(0).normal(size=(2, len(found.names + found.left_out)))
    one, two = (e.predict(W, found.names + found.left_out) for e in (found, wanted))
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-7)


@pytest.mark.parametrize("prior", [1e2, 1e4, 1e6])
def test_joseph_form_holds_1e_minus_9_up_to_a_prior_of_1e6(make_problem, covariance_error, prior):
    problem = make_problem(seed=4)
    vague = Prior(name="state", names=problem.blocks[0].names, covariance=prior * np.eye(4))
    problem = replace(problem, priors=(*problem.priors, vague))
    assert covariance_error(sequential.solve(problem).K_true, batch.solve(problem).K_true) < 1e-9


def test_schmidt_claims_exactly_its_true_covariance_and_is_never_better_than_estimating(make_problem):
    for seed in range(4):
        problem = make_problem(seed=seed, state_prior="own", treatments={"bias": "considered"})
        found = sequential.solve(problem, "schmidt")
        np.testing.assert_allclose(found.K_formal, found.K_true, atol=1e-11)
        considered = batch.solve(problem)
        blocks = tuple(replace(block, treatment="estimated") for block in problem.blocks)
        best = batch.solve(replace(problem, blocks=blocks))
        better = np.linalg.eigvalsh(found.K_true - best.covariance(found.names))
        assert better[0] > -1e-12
        assert np.trace(found.K_true) < np.trace(considered.K_true)


def test_schmidt_depends_on_the_order_of_the_data(make_problem):
    problem = make_problem(seed=1, state_prior="own", treatments={"bias": "considered"}, z="none")
    order = np.arange(problem.n)[::-1]
    turned = replace(
        problem,
        residual=problem.residual[order],
        R=problem.R[order],
        blocks=tuple(replace(b, H=b.H[order]) for b in problem.blocks),
        noise_label=problem.noise_label[order],
    )
    one, two = (np.trace(sequential.solve(p, "schmidt").K_true) for p in (problem, turned))
    assert abs(one / two - 1.0) > 1e-4
    one, two = (np.trace(sequential.solve(p).K_true) for p in (problem, turned))
    assert one == pytest.approx(two, rel=1e-10)


def track(n):
    """Position and rate from n positions with a common bias: the case against the printed filter."""
    t = np.linspace(0.0, 1.0, n)
    H = np.stack([np.ones(n), t], axis=1)[:, None, :]
    names = ("position", "rate")
    return LinearProblem(
        residual=np.zeros((n, 1)),
        R=[[1.0]],
        blocks=(Block(name="state", names=names, H=H), Block(name="bias", names=("bias",), H=np.ones((n, 1, 1)))),
        priors=(
            Prior(name="state", names=names, covariance=100.0 * np.eye(2)),
            Prior(name="bias", names=("bias",), covariance=[[0.25]]),
        ),
    )


def test_the_printed_filter_warns_and_claims_too_small_a_sigma_when_a_bias_is_common():
    with pytest.warns(UserWarning, match="takes bias as fresh noise"):
        found = sequential.solve(track(1000), "as_printed")
    ratio = found.sigma("position") / found.sigma_formal("position")
    assert ratio > 5.0
    honest = batch.solve(track(1000)).sigma("position")
    assert found.sigma("position") >= honest * (1 - 1e-9)


def test_the_printed_filter_is_right_when_nuisances_are_white(make_problem, covariance_error):
    problem = make_problem(seed=2, state_prior="own")
    blocks = (problem.blocks[0], *(replace(block, treatment="fixed") for block in problem.blocks[1:]))
    problem = replace(problem, blocks=blocks, priors=tuple(p for p in problem.priors if p.name == "state"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = sequential.solve(problem, "as_printed")
    assert covariance_error(found.K_formal, batch.solve(problem).K_formal) < 1e-11


def test_what_it_cannot_do_is_refused(make_problem):
    with pytest.raises(InputError, match="prior for every"):
        sequential.solve(make_problem())
    with pytest.raises(InputError, match="time-correlated"):
        sequential.solve(make_problem(z="markov", state_prior="own"))
    with pytest.raises(InputError, match="formal, schmidt, as_printed"):
        sequential.solve(make_problem(state_prior="own"), "best")  # type: ignore[arg-type]


def test_the_gate_leaves_gross_errors_out_counts_them_and_saves_the_estimate(make_problem):
    problem = make_problem(seed=6, state_prior="own", n=60)
    rng = np.random.default_rng(0)
    clean = 0.5 * rng.normal(size=(60, 2))
    spoilt = clean.copy()
    spoilt[[20, 41]] += 1e4
    good = sequential.solve(replace(problem, residual=clean))
    gated = sequential.solve(replace(problem, residual=spoilt), gate=0.9999)
    assert gated.notes == ("2 of 60 measurements left out by the gate",)
    assert gated.dof == good.dof - 4
    sigma = np.sqrt(np.diag(good.K_true))
    assert np.max(np.abs(gated.mean - good.mean) / sigma) < 3.0
    assert np.max(np.abs(sequential.solve(replace(problem, residual=spoilt)).mean - good.mean) / sigma) > 100.0
    assert good.notes == ()
