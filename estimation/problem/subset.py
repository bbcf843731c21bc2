"""A problem with fewer measurements: the same parameters, priors and nuisances, some rows taken out exactly."""

import itertools
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.problem import LinearProblem, Markov, White

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def subset(problem: LinearProblem, keep: npt.ArrayLike) -> LinearProblem:
    """Keep some measurements of a problem.

    Parameters
    ----------
    keep : shape (n,), which measurements stay; at least one.

    Notes
    -----
    A time-correlated nuisance keeps its statistics: over rows that go, F = F_b F_a and Q = F_b Q_a F_b^T + Q_b are
    composed, and its first covariance is carried to the first row that stays.
    """
    mask = np.asarray(keep, dtype=bool)
    if mask.shape != (problem.n,) or not mask.any():
        raise InputError(f"subset: keep needs {problem.n} flags, at least one of them true")
    place = np.cumsum(mask) - 1
    return replace(
        problem,
        residual=problem.residual[mask],
        R=_rows(problem.R, mask),
        true_R=None if problem.true_R is None else _rows(problem.true_R, mask),
        blocks=tuple(replace(block, H=block.H[mask]) for block in problem.blocks),
        white=tuple(_white(white, mask, place) for white in problem.white if mask[white.rows].any()),
        markov=tuple(_markov(markov, mask, place) for markov in problem.markov if mask[markov.rows].any()),
        noise_label=None if problem.noise_label is None else problem.noise_label[mask],
    )


def _rows(stack: Array, mask: Mask) -> Array:
    """The kept covariances of a stack (1 or n, p, p)."""
    return stack if len(stack) == 1 else stack[mask]


def _white(white: White, mask: Mask, place: npt.NDArray[np.int64]) -> White:
    mine = mask[white.rows]
    return replace(
        white,
        H=white.H[mine],
        rows=place[white.rows[mine]],
        Q=_rows(white.Q, mine),
        true_Q=None if white.true_Q is None else _rows(white.true_Q, mine),
    )


def _markov(markov: Markov, mask: Mask, place: npt.NDArray[np.int64]) -> Markov:
    """The chain over the rows that stay, as assumed and as it really is."""
    kept = _chain(markov.assumed, mask, place)
    if not markov.differs:
        return kept
    true = _chain(markov.truth, mask, place)
    return replace(kept, true_F=true.F, true_Q=true.Q, true_P0=true.P0)


def _chain(markov: Markov, mask: Mask, place: npt.NDArray[np.int64]) -> Markov:
    mine = np.flatnonzero(mask[markov.rows])
    size = markov.P0.shape[0]
    P0, F, Q = markov.P0, np.empty((len(mine), size, size)), np.empty((len(mine), size, size))
    for k in range(1, mine[0] + 1):
        P0 = _even(markov.F[k] @ P0 @ markov.F[k].T + markov.Q[k])
    F[0], Q[0] = markov.F[mine[0]], markov.Q[mine[0]]
    for i, (before, row) in enumerate(itertools.pairwise(mine), start=1):
        F[i], Q[i] = np.eye(size), np.zeros((size, size))
        for k in range(before + 1, row + 1):
            F[i] = markov.F[k] @ F[i]
            Q[i] = _even(markov.F[k] @ Q[i] @ markov.F[k].T + markov.Q[k])
    return replace(markov, H=markov.H[mine], F=F, Q=Q, P0=P0, rows=place[markov.rows[mine]])


def _even(matrix: Array) -> Array:
    """The symmetric part: round-off only."""
    return 0.5 * (matrix + matrix.T)
