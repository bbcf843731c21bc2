"""Exact parabolic descent: along the curve on which the root of the cost falls at a steady rate.

Gauss-Newton jumps along its direction; the curve whose tangent is everywhere that direction leads down without a jump:
sqrt(Psi) = sqrt(Psi0) - s, so that Psi is a parabola in s. Slow and sure: for a start from which steps go astray.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Status
from nebosvod.estimation.problem.square_root import conditioning, solve_upper

Array = npt.NDArray[np.float64]
Whitened = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A descent.

    Attributes
    ----------
    s : shape (k,), how far the root of the cost has come down. x : shape (k, n). psi : shape (k,), the cost.
    status : converged, iteration_limit, not_observable (the partials lose rank) or diverged (not a number).
    """

    s: Array
    x: Array
    psi: Array
    status: Status


def descend(
    whitened: Whitened, start: npt.ArrayLike, *, tolerance: float = 1e-8, deviation: float = 1e-6, limit: int = 2000
) -> Path:
    """Follow the exact descent of Psi = |v(x)|^2 from a start to where its gradient vanishes.

    Parameters
    ----------
    whitened : takes x (n,), returns whitened residuals v (m,) and their partials dv/dx (m, n).
    tolerance : ends the descent when the linear part of v is this part of v, or this size.
    deviation : of sqrt(Psi) from sqrt(Psi0) - s allowed in a step, relative; a step that misses is halved.

    Notes
    -----
    dx/ds = d |v| / |P v|^2 with the full Gauss-Newton step d = -(J^T J)^-1 J^T v and P v = -J d, the part of v that the
    partials can reach. Runge and Kutta's steps of fourth order; none goes further than half of what a linear problem
    has left, so the minimum of a problem with residuals left is approached like 2^-k.

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, part V.
    """
    x = np.atleast_1d(np.asarray(start, dtype=np.float64))
    root, reach, slope = _slope(whitened, x)
    if not np.isfinite(root):
        raise InputError("parabolic descent: the residuals at the start are not finite")
    s, path, longest = 0.0, [(0.0, x, root**2)], np.inf
    status = Status.ITERATION_LIMIT
    for _ in range(limit):
        if slope is None:
            status = Status.NOT_OBSERVABLE
            break
        if reach <= tolerance * max(root, 1.0):
            status = Status.CONVERGED
            break
        left = root - np.sqrt(max(root**2 - reach**2, 0.0))
        step = min(longest, 0.5 * left)
        taken = None
        while step > 1e-14 * max(root, 1.0):
            taken = _step(whitened, x, slope, step)
            if taken is not None and abs(taken[1] - (root - step)) <= deviation * max(root, step):
                break
            step, taken = 0.5 * step, None
        if taken is None:
            status = Status.DIVERGED
            break
        x, s, longest = taken[0], s + step, 2.0 * step
        root, reach, slope = _slope(whitened, x)
        path.append((s, x, root**2))
    return Path(
        s=np.array([row[0] for row in path]),
        x=np.array([row[1] for row in path]),
        psi=np.array([row[2] for row in path]),
        status=status,
    )


def _slope(whitened: Whitened, x: Array) -> tuple[float, float, Array | None]:
    """|v|, the length of the part of v that the partials reach, and dx/ds; None where the partials lose rank."""
    with np.errstate(all="ignore"):
        v, J = whitened(x)
        root = float(np.linalg.norm(v))
    if not (np.isfinite(root) and np.isfinite(J).all()):
        return np.inf, np.inf, None
    unit = np.linalg.norm(J, axis=0)
    if not (unit > 0.0).all():
        return root, 0.0 if not J.any() else np.inf, None
    Q, R = np.linalg.qr(J / unit)
    if len(R) < len(x) or not conditioning(R).observable:
        return root, np.inf, None
    inside = Q.T @ v
    reach = float(np.linalg.norm(inside))
    if reach == 0.0:
        return root, 0.0, np.zeros_like(x)
    return root, reach, -solve_upper(R, inside) / unit * (root / reach**2)


def _step(whitened: Whitened, x: Array, slope: Array, step: float) -> tuple[Array, float] | None:
    """One step of Runge and Kutta along the curve, and |v| at its end; None where it leads to no numbers."""
    slopes = [slope]
    for part in (0.5, 0.5, 1.0):
        _, _, there = _slope(whitened, x + part * step * slopes[-1])
        if there is None:
            return None
        slopes.append(there)
    end = x + step / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
    with np.errstate(all="ignore"):
        root = float(np.linalg.norm(whitened(end)[0]))
    return (end, root) if np.isfinite(root) else None
