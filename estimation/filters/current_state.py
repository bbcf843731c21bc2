"""The state at the current epoch instead of the first one: x_k = Phi_k x0 + zeta_k c.

A Kalman filter of [x_k; c] is the same filter as one of [x0; c], seen from epoch k: Guo and Ivashkin (2018),
(2.144)-(2.145). The covariance is Phi K_x Phi^T + Phi K_xc zeta^T + zeta K_cx Phi^T + zeta K_c zeta^T; (2.143) as
printed drops all that zeta brings.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem.estimate import Estimate, Prediction
from nebosvod.estimation.problem.square_root import solve_square

Array = npt.NDArray[np.float64]


def at_epoch(
    estimate: Estimate, Phi: Array, zeta: Array, state: Sequence[str], parameters: Sequence[str]
) -> Prediction:
    """State at another epoch with its covariance and the share of every source.

    Parameters
    ----------
    estimate : of x0 and c, by any estimator; c may be estimated, considered or ignored.
    Phi : shape (s, s), zeta : shape (s, m), partials of the state at the epoch by x0 and c.
    state, parameters : names of x0 (s) and of c (m).
    """
    return estimate.predict(np.hstack([Phi, zeta]), (*state, *parameters))


def step(Phi: Array, zeta: Array) -> tuple[Array, ...]:
    """Transitions F_k (s + m, s + m) of [x; c] between neighbouring epochs, from partials by the first.

    Parameters
    ----------
    Phi : shape (n, s, s), zeta : shape (n, s, m), partials of the state at n epochs by x0 and c.

    Notes
    -----
    Phi(b, a) = Phi_b iPhi_a and zeta(b, a) = zeta_b - Phi(b, a) zeta_a; c stands still.
    """
    if Phi.ndim != 3 or Phi.shape[1] != Phi.shape[2] or zeta.shape[:2] != Phi.shape[:2]:
        raise InputError(f"step: needs Phi (n, s, s) and zeta (n, s, m), got {Phi.shape} and {zeta.shape}")
    s, m = zeta.shape[1:]
    moves = []
    for k in range(1, len(Phi)):
        F = np.eye(s + m)
        F[:s, :s] = solve_square(Phi[k - 1].T, Phi[k].T).T
        F[:s, s:] = zeta[k] - F[:s, :s] @ zeta[k - 1]
        moves.append(F)
    return tuple(moves)


def follow(
    prior: Belief,
    moves: Sequence[Array],
    residual: Array,
    H: Array,
    R: Array,
    Q: Sequence[Array | None] | None = None,
) -> tuple[Belief, ...]:
    """Filter [x_k; nuisances] through all epochs: the beliefs after each epoch's measurement.

    Parameters
    ----------
    prior : of [x; nuisances] at the first epoch.
    moves : n - 1 transitions, from `step` or wider (a bias stands still, a Gauss-Markov error decays).
    residual : shape (n, p). H : shape (n, p, w), partials by the CURRENT [x_k; nuisances]. R : shape (n, p, p).
    Q : n - 1 process noises, singular ones too; none by default.

    Notes
    -----
    `smoother.smooth(beliefs, moves, Q)` turns the result into beliefs from all measurements.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (2.143)-(2.145).
    """
    count = len(residual) - 1
    noises: Sequence[Array | None] = [None] * count if Q is None else Q
    if len(moves) != count or len(noises) != count or len(H) != count + 1:
        raise InputError(f"follow: {count + 1} measurements need {count} transitions and noises, got {len(moves)}")
    belief, out = prior, []
    for k in range(count + 1):
        if k:
            belief = kalman.predict(belief, moves[k - 1], noises[k - 1])
        belief, _ = kalman.update(belief, residual[k] - H[k] @ belief.mean, H[k], R[k])
        out.append(belief)
    return tuple(out)
