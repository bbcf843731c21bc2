"""Accuracy beyond the formal covariance: a bias that imitates motion, and the worst correlation of the noise.

The formal covariance trusts the model of the noise. Klaus' filter asks whether a constant bias can be told from
motion at all; Akim's and Lidov's bounds ask how bad a prediction can be when the noise has its stated sigma but any
correlation in time, within a family or at all.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from nebosvod.errors import InputError
from nebosvod.estimation.problem import LinearProblem
from nebosvod.estimation.sources import measurement_gain
from nebosvod.estimation.square_root import solve_upper

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Klaus:
    """Klaus' filter: state after a bias without prior is projected out.

    Attributes
    ----------
    covariance : shape (s, s); None when a bias imitates the motion.
    condition_number : of the column-scaled projected partials.
    direction : the combination of the state that a bias imitates best, by name, largest weight 1.
    """

    covariance: Array | None
    condition_number: float
    direction: dict[str, float]


def klaus(U: Array, S: Array, names: tuple[str, ...]) -> Klaus:
    """Project a bias out of whitened partials: M = U^T U - U^T S i(S^T S) S^T U, by QR.

    Parameters
    ----------
    U : shape (m, s), whitened partials by the state. S : shape (m, r), by the bias. names : s names.
    """
    if U.shape[0] != S.shape[0] or U.shape[1] != len(names):
        raise InputError(f"klaus: needs U (m, {len(names)}) and S (m, r), got {U.shape} and {S.shape}")
    r = S.shape[1]
    triangle = np.asarray(np.linalg.qr(np.hstack([S, U]), mode="r"))
    rest = np.zeros((len(names), len(names)))
    tail = triangle[r : r + len(names), r:]
    rest[: len(tail)] = tail
    # Scaling by the columns of U, not of the projection: a column that vanishes is then seen as one.
    lengths = np.linalg.norm(U, axis=0)
    unit = np.where(lengths > 0.0, lengths, 1.0)
    _, values, vectors = np.linalg.svd(rest / unit)
    number = float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf
    if values[-1] <= 1e-13 * np.sqrt(U.shape[0]):
        number = np.inf
    weights = vectors[-1] / vectors[-1][np.argmax(np.abs(vectors[-1]))]
    direction = {name: float(weight) for name, weight in zip(names, weights)}
    if not number <= 1e13:
        return Klaus(covariance=None, condition_number=number, direction=direction)
    inverse = solve_upper(rest, np.eye(len(names)))
    return Klaus(covariance=inverse @ inverse.T, condition_number=number, direction=direction)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorstCorrelation:
    """Worst sigma of a predicted quantity over a family of correlations, and where it is reached.

    `sigma_white` is the one for independent noise; `bound` is Lidov's and Britkov's sum |a_i| sigma_i, which no
    correlation whatever can pass.
    """

    sigma: float
    sigma_white: float
    bound: float
    decay_per_s: float
    frequency_rad_per_s: float
    phase_rad: float


def worst_correlation(a: Array, t_s: Array, series: npt.NDArray[np.int64] | None = None) -> WorstCorrelation:
    """Search the exponential-cosine correlation of unit noise that is worst for sum a_i v_i.

    Parameters
    ----------
    a : shape (m,), weights times sigma of each scalar measurement.
    t_s : shape (m,), times, not decreasing within a series.
    series : shape (m,), which series a measurement belongs to; different series stay independent.

    Notes
    -----
    K(tau) = exp(-k |tau|) cos(w |tau| + phi) / cos phi is positive definite iff |tan phi| <= k / w. The variance is
    linear in tan phi, so its extreme over phi is at the edge: Re Z + (k / w) |Im Z| with
    Z = sum_{j<i} a_i a_j exp((-k + i w)(t_i - t_j)), a recursion in O(m). (k, w) by grid and simplex.
    """
    from scipy.optimize import minimize  # 0.7 s of import, for this search alone

    weights, times, label = _checked(a, t_s, series)
    span = max(float(np.ptp(times)), 1e-30)
    steps = np.diff(np.unique(times))
    shortest = float(steps.min()) if steps.size else span
    own = float(np.sum(weights**2))

    def variance(logs: Array) -> float:
        k, w = np.exp(logs)
        real, imaginary = _lagged(weights, times, label, k, w)
        return float(own + 2.0 * (real + (k / w) * abs(imaginary)))

    lo, hi = np.log(0.01 / span), np.log(10.0 / shortest)
    grid = np.linspace(lo, hi, 25)
    found = max((variance(np.array([x, y])), x, y) for x in grid for y in grid)
    polished = minimize(lambda logs: -variance(np.clip(logs, lo, hi)), found[1:], method="Nelder-Mead")
    best = np.clip(polished.x, lo, hi) if -polished.fun > found[0] else np.array(found[1:])
    k, w = (float(value) for value in np.exp(best))
    _, imaginary = _lagged(weights, times, label, k, w)
    return WorstCorrelation(
        sigma=float(np.sqrt(max(variance(best), own))),
        sigma_white=float(np.sqrt(own)),
        bound=float(np.abs(weights).sum()),
        decay_per_s=k,
        frequency_rad_per_s=w,
        phase_rad=float(-np.sign(imaginary) * np.arctan2(k, w)),
    )


def worst_prediction(problem: LinearProblem, W: Array, t_s: Array) -> tuple[WorstCorrelation, ...]:
    """Worst correlation of the measurement noise for each predicted quantity w = W x (d, s) of the estimated x.

    Parameters
    ----------
    t_s : shape (n,). Components of one instrument (noise source) are each a series of their own.

    Notes
    -----
    Only the measurement noise is re-correlated; add the shares of the other sources in quadrature. Components that
    are correlated within a measurement are taken apart by their Cholesky factor first.
    """
    gain = measurement_gain(problem) @ np.atleast_2d(W).T
    n, p = problem.n, problem.p
    L = np.linalg.cholesky(np.broadcast_to(problem.truth, (n, p, p)))
    weights = np.einsum("npi,npd->nid", L, gain)
    label = np.zeros(n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
    series = (label[:, None] * p + np.arange(p)).reshape(-1)
    times = np.repeat(np.asarray(t_s, dtype=np.float64), p)
    flat = weights.reshape(n * p, -1)
    return tuple(worst_correlation(flat[:, d], times, series) for d in range(flat.shape[1]))


def _checked(a: Array, t_s: Array, series: npt.NDArray[np.int64] | None) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Bring the measurements into one order per series; refuse what is not a series."""
    weights, times = np.array(a, dtype=np.float64), np.array(t_s, dtype=np.float64)
    label = np.zeros(len(weights), dtype=np.int64) if series is None else np.array(series, dtype=np.int64)
    if weights.ndim != 1 or weights.shape != times.shape or label.shape != times.shape or not weights.size:
        raise InputError(f"worst_correlation: needs vectors of one length, got {weights.shape}, {times.shape}")
    order = np.lexsort((times, label))
    return weights[order], times[order], label[order]


@njit(cache=True)
def _lagged(a, t, series, k, w):  # type: ignore[no-untyped-def]
    """Real and imaginary part of sum_{j<i} a_i a_j exp((-k + i w)(t_i - t_j)) within each series."""
    real, imaginary = 0.0, 0.0
    c, s = 0.0, 0.0
    step, x, y = -1.0, 0.0, 0.0
    for i in range(len(a)):
        if i == 0 or series[i] != series[i - 1]:
            c, s = 0.0, 0.0
        else:
            if t[i] - t[i - 1] != step:  # a steady cadence needs one exponential
                step = t[i] - t[i - 1]
                damp = np.exp(-k * step)
                x, y = damp * np.cos(w * step), damp * np.sin(w * step)
            c, s = (c + a[i - 1]) * x - s * y, (c + a[i - 1]) * y + s * x
        real += a[i] * c
        imaginary += a[i] * s
    return real, imaginary


def bias_imitates(problem: LinearProblem, state: str, bias: str) -> Klaus:
    """Apply Klaus' filter to two blocks of a problem, with the measurement noise as assumed."""
    blocks = {block.name: block for block in problem.blocks}
    for name in (state, bias):
        if name not in blocks:
            raise InputError(f"bias_imitates: no block {name!r}; there are {', '.join(blocks)}")
    L = np.linalg.cholesky(np.broadcast_to(problem.R, (problem.n, problem.p, problem.p)))
    U, S = (np.linalg.solve(L, blocks[name].H).reshape(problem.n * problem.p, -1) for name in (state, bias))
    return klaus(np.asarray(U, dtype=np.float64), np.asarray(S, dtype=np.float64), blocks[state].names)
