"""Rauch-Tung-Striebel smoother: beliefs at all epochs from all measurements, after a forward filter."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters.kalman import Belief, predict
from nebosvod.estimation.problem.square_root import covariance_factor, left_inverse, lower_factor

Array = npt.NDArray[np.float64]


def smooth(
    filtered: Sequence[Belief],
    F: Sequence[Array],
    Q: Sequence[Array | None],
    shift: Sequence[Array | None] | None = None,
) -> tuple[Belief, ...]:
    """Smooth filtered beliefs backwards.

    Parameters
    ----------
    filtered : n beliefs after each epoch's measurement.
    F, Q, shift : n - 1 transitions, process noises and shifts from epoch k to k + 1.

    Notes
    -----
    P_s = (I - J F) P (I - J F)^T + J Q J^T + J P_s' J^T with J = P F^T iP_pred: a sum of squares, so factors are
    joined and nothing is subtracted.

    References
    ----------
    Rauch, Tung, Striebel 1965, AIAA Journal 3, 1445.
    """
    count = len(filtered) - 1
    if len(F) != count or len(Q) != count:
        raise InputError(f"smooth: {count + 1} beliefs need {count} transitions, got {len(F)} and {len(Q)}")
    moves: Sequence[Array | None] = [None] * count if shift is None else shift
    out = [filtered[-1]]
    for k in range(count - 1, -1, -1):
        here = filtered[k]
        ahead = predict(here, F[k], Q[k], moves[k])
        back = left_inverse(ahead.factor)
        J = here.factor @ (back @ (F[k] @ here.factor)).T @ back
        noise = Q[k]
        root = np.zeros((len(here.mean), 0)) if noise is None else covariance_factor(noise, "process noise")
        keep = here.factor - J @ (F[k] @ here.factor)
        factor = lower_factor(np.hstack([keep, J @ root, J @ out[-1].factor]))
        out.append(Belief(mean=here.mean + J @ (out[-1].mean - ahead.mean), factor=factor))
    return tuple(reversed(out))
