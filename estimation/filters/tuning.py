"""Process noise from the data: the likelihood of the innovations, or errors against a known truth.

A filter with too small a Q believes what it has forgotten to doubt; with too large a one it throws measurements away.
Its innovations tell: their likelihood is largest at the right Q. Where the truth is known, in a simulation, the mean of
NEES over its dimension must be one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters.kalman import Belief, predict, update

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pass:
    """A filter's way through measurements.

    Attributes
    ----------
    beliefs : after each measurement.
    nis : shape (n,), normalised innovations squared. cost : -2 log likelihood, of all innovations.
    """

    beliefs: tuple[Belief, ...]
    nis: Array
    cost: float


def run(
    start: Belief, y: npt.ArrayLike, F: Sequence[Array], Q: Sequence[Array], H: Sequence[Array], R: Sequence[Array]
) -> Pass:
    """Filter measurements y (n, p) of a linear system, with the likelihood of what came.

    Parameters
    ----------
    start : belief before the first step. F, Q : n motions, each to the epoch of its measurement. H, R : n of each.

    Notes
    -----
    -2 log L = sum log det 2 pi V_k + r_k^T V_k^-1 r_k over innovations r_k of covariance V_k.

    References
    ----------
    Schweppe 1965, IEEE Trans. Information Theory 11, 61.
    """
    rows = np.asarray(y, dtype=np.float64)
    if not len(rows) == len(F) == len(Q) == len(H) == len(R):
        raise InputError(f"run: {len(rows)} measurements with {len(F)} F, {len(Q)} Q, {len(H)} H, {len(R)} R")
    belief, beliefs, nis, cost = start, [], [], 0.0
    for k, measured in enumerate(rows):
        belief = predict(belief, F[k], Q[k])
        belief, innovation = update(belief, measured - H[k] @ belief.mean, H[k], R[k])
        beliefs.append(belief)
        nis.append(innovation.nis)
        cost += innovation.nis + 2.0 * float(np.log(np.diag(innovation.factor)).sum())
    return Pass(beliefs=tuple(beliefs), nis=np.array(nis), cost=cost + rows.size * float(np.log(2.0 * np.pi)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tuned:
    """Factors (k,) on the parts that were tuned, and the sigma of their natural logarithms."""

    factors: Array
    sigma_log: Array


def by_likelihood(cost: Callable[[Array], float], parts: int = 1, widest: float = 1e6) -> Tuned:
    """Find the factors on covariances at which the innovations are likeliest.

    Parameters
    ----------
    cost : takes factors (k,), returns -2 log likelihood, e.g. `run(...).cost` with Q and R times these.
    parts : k. widest : factors are looked for between 1 / widest and widest.

    Raises
    ------
    GeometryError
        If the likelihood is largest at the end of the range: the measurements do not tell this factor.

    Notes
    -----
    Newton's steps on the logarithms of the factors, halved until the cost falls; a step never passes a factor of e.
    The sigmas are those of the curvature at the end, right for long series.

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, pp. 197-199.
    """

    def at(logs: Array) -> float:
        return float(cost(np.exp(logs)))

    logs = np.zeros(parts)
    value = at(logs)
    for _ in range(200):
        gradient, curvature = _derivatives(at, logs, value)
        size, axes = np.linalg.eigh(curvature)
        step = -axes @ ((axes.T @ gradient) / np.maximum(np.abs(size), 1e-9))
        step /= max(1.0, float(np.abs(step).max()))
        if not np.abs(logs + step).max() < np.log(widest):
            raise GeometryError(f"by_likelihood: a factor passes {widest:g} or 1/{widest:g}: the data do not tell it")
        while at(logs + step) > value and np.abs(step).max() > 1e-7:
            step = 0.5 * step
        logs, before = logs + step, value
        value = at(logs)
        if np.abs(step).max() < 1e-5 and abs(before - value) < 1e-6:
            break
    curvature = 0.5 * _derivatives(at, logs, value)[1]
    if not np.linalg.eigvalsh(curvature)[0] > 1.0 / np.log(widest) ** 2:
        raise GeometryError("by_likelihood: the likelihood has no maximum in some factor: the data do not tell it")
    variance = np.diag(np.linalg.solve(curvature, np.eye(parts)))
    return Tuned(factors=np.exp(logs), sigma_log=np.sqrt(variance))


def _derivatives(at: Callable[[Array], float], logs: Array, value: float) -> tuple[Array, Array]:
    """Gradient (k,) and curvature (k, k) by central differences."""
    h, k = 1e-2, len(logs)
    E = h * np.eye(k)
    ahead, behind = (np.array([at(logs + sign * e) for e in E]) for sign in (1.0, -1.0))
    curvature = np.diag((ahead - 2.0 * value + behind) / h**2)
    for i in range(k):
        for j in range(i):
            cross = at(logs + E[i] + E[j]) - at(logs + E[i] - E[j]) - at(logs - E[i] + E[j]) + at(logs - E[i] - E[j])
            curvature[i, j] = curvature[j, i] = cross / (4.0 * h**2)
    return (ahead - behind) / (2.0 * h), curvature


def by_nees(nees: Callable[[float], float], wanted: float = 1.0, widest: float = 1e6) -> float:
    """Find the factor on Q at which the mean NEES over its dimension is as wanted.

    Parameters
    ----------
    nees : takes the factor, returns the mean of NEES / dimension over runs with known truth; it falls with the factor.

    Raises
    ------
    GeometryError
        If it is not met between 1 / widest and widest: something other than Q is wrong.
    """
    low, high = -float(np.log(widest)), float(np.log(widest))
    if not nees(np.exp(low)) >= wanted >= nees(np.exp(high)):
        raise GeometryError(f"by_nees: no factor from 1/{widest:g} to {widest:g} gives NEES {wanted:g}")
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if nees(float(np.exp(middle))) > wanted else (low, middle)
    return float(np.exp(0.5 * (low + high)))
