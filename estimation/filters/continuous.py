"""A continuous linear model dx/dt = A x + w as a discrete one: transition and process noise over a step (Van Loan)."""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]


def discretise(A: npt.ArrayLike, spectral_density: npt.ArrayLike, step: float) -> tuple[Array, Array]:
    """Transition F (s, s) and process noise Q (s, s) of dx/dt = A x + w, w white, over a step.

    Parameters
    ----------
    A : shape (s, s), per unit of time.
    spectral_density : shape (s, s), of w: E w(t) w(t')^T = q delta(t - t'); state units squared per unit of time.
    step : length, in the same unit of time.

    Notes
    -----
    exp([[-A, q], [0, A^T]] h) = [[., G], [0, F^T]], Q = F G: the integral of F(t) q F(t)^T without quadrature. It is
    taken over a step so short that neither exponential overflows and doubled: F <- F F, Q <- F Q F^T + Q, which adds
    positive matrices only. States are brought to common units first.

    References
    ----------
    Van Loan 1978, IEEE Trans. Automatic Control 23, 395; Platonov, Ivanov 2013, table 1.
    """
    rate, q = (np.atleast_2d(np.asarray(value, dtype=np.float64)) for value in (A, spectral_density))
    if rate.shape[0] != rate.shape[1] or q.shape != rate.shape:
        raise InputError(f"discretise: A and the spectral density must be square alike, got {rate.shape}, {q.shape}")
    if not (np.isfinite(rate).all() and np.isfinite(q).all() and np.isfinite(step) and step >= 0.0):
        raise InputError("discretise: A, the spectral density and the step (>= 0) must be finite")
    unit = _units(rate, q)
    rate, q = rate * step / unit[:, None] * unit, q * step / unit[:, None] / unit
    size = float(np.abs(rate).sum(axis=1).max(initial=0.0))
    doublings = max(0, math.ceil(math.log2(size)) + 1) if size > 0.0 else 0
    F, Q = _short(rate / 2.0**doublings, q / 2.0**doublings)
    for _ in range(doublings):
        F, Q = F @ F, F @ Q @ F.T + Q
    return F * unit[:, None] / unit, 0.5 * (Q + Q.T) * unit[:, None] * unit


def _short(rate: Array, q: Array) -> tuple[Array, Array]:
    """Van Loan's exponential by its series, for rates up to one half: twenty terms leave nothing."""
    s = len(rate)
    block = np.vstack([np.hstack([-rate, q]), np.hstack([np.zeros((s, s)), rate.T])])
    term = total = np.eye(2 * s)
    for k in range(1, 21):
        term = term @ block / k
        total = total + term
    F = total[s:, s:].T
    return F, F @ total[:s, s:]


def _units(rate: Array, q: Array) -> Array:
    """Units (s,) of the states, powers of two, in which the non-zero elements of A and q are as alike as can be."""
    s = len(rate)
    rows, right = [np.zeros(s + 2)], [0.0]
    for matrix, sign, column in ((rate, -1.0, s), (q, 1.0, s + 1)):
        for i, j in zip(*np.nonzero(matrix)):
            row = np.zeros(s + 2)
            row[i] += 1.0
            row[j] += sign
            row[column] = 1.0
            rows.append(row)
            right.append(float(np.log2(abs(matrix[i, j]))))
    found = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][:s]
    return np.asarray(np.exp2(np.round(found - found.mean())), dtype=np.float64)
