"""The filter of the current state is the filter of the first state, seen from epoch k."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Prior
from nebosvod.estimation.filters import current_state
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.solvers import batch, sequential

STATE, C = ("x", "v"), ("a",)


def moving(n=12, c="estimated"):
    """Position measured on a line; the acceleration is the parameter c: Phi = [[1, t], [0, 1]], zeta = [t^2/2, t]."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 3.0, n) ** 1.3
    Phi, zeta = np.tile(np.eye(2), (n, 1, 1)), np.stack([0.5 * t**2, t], axis=1)[:, :, None]
    Phi[:, 0, 1] = t
    H_x = np.tile([[1.0, 0.0], [0.2, 1.0]], (n, 1, 1)) + 0.1 * rng.normal(size=(n, 2, 2))
    H_c = 0.3 * rng.normal(size=(n, 2, 1))  # the parameter acts on the measurement itself, too
    problem = LinearProblem(
        residual=rng.normal(size=(n, 2)),
        R=np.diag([0.04, 0.25]),
        blocks=(
            Block(name="state", names=STATE, H=H_x @ Phi),
            Block(name="c", names=C, H=H_x @ zeta + H_c, treatment=c),
        ),
        priors=(
            Prior(name="state", names=STATE, covariance=np.array([[4.0, 0.5], [0.5, 1.0]])),
            Prior(name="c", names=C, covariance=[[0.3]]),
        ),
    )
    return problem, Phi, zeta, np.concatenate([H_x, H_c], axis=2)


def first(problem, count):
    blocks = tuple(replace(b, H=b.H[:count]) for b in problem.blocks)
    return replace(problem, residual=problem.residual[:count], blocks=blocks, noise_label=None)


def joint_prior(problem):
    P0 = np.zeros((3, 3))
    P0[:2, :2], P0[2:, 2:] = (prior.covariance for prior in problem.priors)
    return Belief.of(np.zeros(3), P0)


def test_at_every_epoch_it_equals_the_batch_so_far_carried_there():
    problem, Phi, zeta, H = moving()
    R = np.broadcast_to(problem.R, (problem.n, 2, 2))
    beliefs = current_state.follow(joint_prior(problem), current_state.step(Phi, zeta), problem.residual, H, R)
    for k, belief in enumerate(beliefs):
        for solve in (batch.solve, sequential.solve):
            carried = current_state.at_epoch(solve(first(problem, k + 1)), Phi[k], zeta[k], STATE, C)
            np.testing.assert_allclose(belief.mean[:2], carried.value, rtol=1e-9, atol=1e-10)
            np.testing.assert_allclose(belief.covariance[:2, :2], carried.covariance, rtol=1e-9, atol=1e-12)


def test_the_covariance_without_the_terms_of_zeta_as_printed_is_wrong():
    problem, Phi, zeta, _ = moving()
    found = batch.solve(problem)
    whole = current_state.at_epoch(found, Phi[-1], zeta[-1], STATE, C).covariance
    K = found.K_true
    written_out = Phi[-1] @ K[:2, :2] @ Phi[-1].T + zeta[-1] @ K[2:, 2:] @ zeta[-1].T
    cross = Phi[-1] @ K[:2, 2:] @ zeta[-1].T
    np.testing.assert_allclose(whole, written_out + cross + cross.T, rtol=1e-10)
    printed = Phi[-1] @ K[:2, :2] @ Phi[-1].T
    assert printed[0, 0] > 2.0 * whole[0, 0]  # what the acceleration errs is made good by what the state errs


def test_a_considered_parameter_errs_at_the_epoch_with_its_own_sign():
    problem, Phi, zeta, _ = moving(c="considered")
    found = batch.solve(problem)
    carried = current_state.at_epoch(found, Phi[5], zeta[5], STATE, C)
    M = Phi[5] @ found.solution.gains["c"][:2] - zeta[5]
    np.testing.assert_allclose(carried.shares["c"], 0.3 * M @ M.T, rtol=1e-10)


def test_shapes_that_do_not_fit_are_refused():
    problem, Phi, zeta, H = moving()
    with pytest.raises(InputError, match="needs Phi"):
        current_state.step(Phi, zeta[:3])
    R = np.broadcast_to(problem.R, (problem.n, 2, 2))
    moves = current_state.step(Phi, zeta)[:4]
    with pytest.raises(InputError, match="need 11 transitions"):
        current_state.follow(joint_prior(problem), moves, problem.residual, H, R)
