"""The two-stage filter over a whole problem: the batch by another road, and plain words where it cannot go."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Prior, Status
from nebosvod.estimation.solvers import batch, separated


@pytest.mark.parametrize("z", ["none", "white", "markov", "both"])
@pytest.mark.parametrize("state_prior", ["own", "joint"])
def test_it_equals_the_batch_whatever_the_nuisances_and_the_prior(make_problem, covariance_error, z, state_prior):
    for seed in range(3):
        problem = make_problem(seed=seed, z=z, state_prior=state_prior, spread=1e3)
        found, wanted = separated.solve(problem), batch.solve(problem)
        assert found.names == wanted.names
        assert covariance_error(found.K_formal, wanted.K_formal) < 1e-9  # issue of rounding alone
        assert covariance_error(found.K_true, wanted.K_true) < 1e-9
        sigma = np.sqrt(np.diag(wanted.K_formal))
        assert np.max(np.abs(found.mean - wanted.mean) / sigma) < 1e-9
        assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-9)
        assert found.dof == wanted.dof
        assert found.condition_number == pytest.approx(wanted.condition_number, rel=1e-6)


def test_the_shares_of_what_is_left_out_are_those_of_the_batch(make_problem, covariance_error):
    problem = make_problem(seed=5, state_prior="own", treatments={"c": "considered", "z": "considered"}, truth=True)
    found, wanted = separated.solve(problem), batch.solve(problem)
    assert covariance_error(found.K_true, wanted.K_true) < 1e-9
    for source, share in wanted.shares.items():
        np.testing.assert_allclose(found.shares[source], share, atol=1e-9 * np.max(np.abs(share)))


def test_means_of_priors_and_the_order_of_the_blocks_do_not_matter(make_problem):
    problem = make_problem(seed=7, state_prior="own")
    priors = tuple(replace(prior, mean=np.full(len(prior.names), 0.3)) for prior in problem.priors)
    problem = replace(problem, priors=priors)
    turned = replace(problem, blocks=problem.blocks[::-1])  # the bias of B is then the state of the first stage
    wanted = batch.solve(problem)
    for found in (separated.solve(problem), separated.solve(turned)):
        for name in wanted.names:
            assert found.value(name) == pytest.approx(wanted.value(name), abs=1e-9 * wanted.sigma(name))
            assert found.sigma(name) == pytest.approx(wanted.sigma(name), rel=1e-9)


def test_what_it_cannot_do_is_refused(make_problem):
    with pytest.raises(InputError, match="prior for every"):
        separated.solve(make_problem())
    alone = make_problem(state_prior="own", treatments={"c": "considered", "bias": "considered"})
    with pytest.raises(InputError, match="no second stage"):
        separated.solve(alone)
    singular = make_problem(state_prior="own")
    priors = tuple(
        replace(prior, covariance=np.zeros((2, 2)), true_covariance=None) if prior.name == "c" else prior
        for prior in singular.priors
    )
    with pytest.raises(InputError, match="regular priors"):
        separated.solve(replace(singular, priors=priors))


def test_digits_that_are_lost_are_said_not_guessed():
    """A prior of sigma 1e8 on two parameters of which the sum is measured: round-off of P exceeds what is left."""
    rng = np.random.default_rng(0)
    H = rng.normal(size=(30, 2, 2))
    H[:, :, 1] = H[:, :, 0] * (1.0 + 1e-9)
    problem = LinearProblem(
        residual=rng.normal(size=(30, 2)),
        R=np.eye(2),
        blocks=(
            Block(name="state", names=("x", "y"), H=H),
            Block(name="bias", names=("b",), H=rng.normal(size=(30, 2, 1))),
        ),
        priors=(
            Prior(name="state", names=("x", "y"), covariance=1e16 * np.eye(2)),
            Prior(name="bias", names=("b",), covariance=np.eye(1)),
        ),
    )
    found = separated.solve(problem)
    assert found.status is Status.NOT_OBSERVABLE
    assert "recursive.solve keeps them" in found.message
    assert found.weak_direction["x"] == pytest.approx(-found.weak_direction["y"], rel=1e-3)
