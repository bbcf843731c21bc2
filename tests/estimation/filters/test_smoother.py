"""The smoother with nuisances: a constant bias and a Gauss-Markov error as states, against the joint normal law."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.filters import current_state
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.smoother import smooth

STEPS, DECAY = 9, 0.7


def system(process_noise):
    """[position, velocity; bias; z]: the bias stands still, z decays; both measurements see the bias or z."""
    F = np.eye(4)
    F[0, 1], F[3, 3] = 0.5, DECAY
    Q = np.zeros((4, 4))
    Q[3, 3] = 0.5 * (1.0 - DECAY**2)
    if process_noise:
        Q[:2, :2] = 0.1 * np.array([[0.04, 0.1], [0.1, 0.5]])
    H = np.array([[1.0, 0.0, 1.0, 1.0], [1.0, 0.0, 0.0, 0.0]])
    P0 = np.diag([2.0, 1.0, 0.4, 0.5])
    return F, Q, H, np.diag([0.1, 0.8]), P0


def dense(F, Q, H, R, P0, y):
    """Mean and covariance of all states given all measurements, by conditioning their joint covariance."""
    size = STEPS * 4
    K = np.zeros((size, size))
    K[:4, :4] = P0
    for k in range(1, STEPS):
        here, before = slice(4 * k, 4 * k + 4), slice(4 * k - 4, 4 * k)
        K[here, : 4 * k] = F @ K[before, : 4 * k]
        K[: 4 * k, here] = K[here, : 4 * k].T
        K[here, here] = F @ K[before, before] @ F.T + Q
    A = np.kron(np.eye(STEPS), H)
    gain = np.linalg.solve(A @ K @ A.T + np.kron(np.eye(STEPS), R), A @ K).T
    return gain @ y.reshape(-1), K - gain @ A @ K


@pytest.mark.parametrize("process_noise", [False, True])
def test_smoothed_states_and_nuisances_equal_the_joint_law_given_all_data(process_noise):
    F, Q, H, R, P0 = system(process_noise)
    y = np.random.default_rng(1).normal(size=(STEPS, 2))
    moves, noises = [F] * (STEPS - 1), [Q] * (STEPS - 1)
    filtered = current_state.follow(
        Belief.of(np.zeros(4), P0), moves, y, np.tile(H, (STEPS, 1, 1)), np.tile(R, (STEPS, 1, 1)), noises
    )
    mean, K = dense(F, Q, H, R, P0, y)
    smoothed = smooth(filtered, moves, noises)
    for k, belief in enumerate(smoothed):
        here = slice(4 * k, 4 * k + 4)
        np.testing.assert_allclose(belief.mean, mean[here], atol=1e-10)
        np.testing.assert_allclose(belief.covariance, K[here, here], atol=1e-11)
    assert smoothed[0].covariance[2, 2] == pytest.approx(smoothed[-1].covariance[2, 2], rel=1e-9)  # one bias for all
    assert smoothed[0].covariance[2, 2] < 0.7 * filtered[0].covariance[2, 2]


def test_a_missing_transition_is_refused():
    belief = Belief.of(np.zeros(1), np.eye(1))
    with pytest.raises(InputError, match="need 1 transitions"):
        smooth([belief, belief], [], [])
