"""Accuracy beyond the formal covariance: a bias that imitates motion, and the worst correlation of the noise.

The formal covariance trusts the model of the noise. Klaus' filter asks whether a constant bias can be told from
motion at all; Akim's and Lidov's bounds ask how bad a prediction can be when the noise has its stated sigma but any
correlation in time, within a family or at all, and Lidov's six measurements are the best to be had in that case.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy.correlation import Series, roughly_worst, worst
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import measurement_gain
from nebosvod.estimation.problem.square_root import cholesky_rows, conditioning, solve_rows, solve_upper

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
    # A bias that is seen by no measurement, or only together with another, takes no direction away.
    sizes = np.linalg.norm(S, axis=0)
    basis, spread, _ = np.linalg.svd(S[:, sizes > 0.0] / sizes[sizes > 0.0], full_matrices=False)
    basis = basis[:, spread > 1e-13 * spread.max(initial=0.0)]
    r = basis.shape[1]
    triangle = np.asarray(np.linalg.qr(np.hstack([basis, U]), mode="r"))
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


def worst_correlation(
    a: Array, t_s: Array, series: npt.NDArray[np.int64] | None = None, *, rough: Array | None = None
) -> WorstCorrelation:
    """Search the exponential-cosine correlation of unit noise that is worst for sum a_i v_i.

    Parameters
    ----------
    a : shape (m,), weights times sigma of each scalar measurement.
    t_s : shape (m,), times.
    series : shape (m,), which series a measurement belongs to; different series stay independent.
    rough : periods (k,) to look at beside a few others, instead of all; see `correlation.roughly_worst`.

    Notes
    -----
    See `correlation`: every frequency is looked at, in steps of 1 / (2 span) up to pi / shortest step of a series, for
    decays from 1e-4 / span to 10 / shortest step; the highest peaks are climbed exactly. 20 ms for 1000 measurements.
    """
    weights, times = np.array(a, dtype=np.float64), np.array(t_s, dtype=np.float64)
    label = np.zeros(len(weights), dtype=np.int64) if series is None else np.array(series, dtype=np.int64)
    if weights.ndim != 1 or weights.shape != times.shape or label.shape != times.shape or not weights.size:
        raise InputError(f"worst_correlation: needs vectors of one length, got {weights.shape}, {times.shape}")
    white = float(np.linalg.norm(weights))
    found = Series.of(weights / white if white > 0.0 else weights, times, label)
    # measurements at one moment are one draw, whatever the decay
    k, w = 1.0, 1.0
    if found.shortest > 0.0 and white > 0.0:
        k, w = worst(found) if rough is None else roughly_worst(found, rough)
    return WorstCorrelation(
        sigma=white * float(np.sqrt(max(found.variance(k, w), 1.0))),
        sigma_white=white,
        bound=float(np.abs(weights).sum()),
        decay_per_s=k,
        frequency_rad_per_s=w,
        phase_rad=found.phase(k, w),
    )


def worst_prediction(
    problem: LinearProblem, W: Array, t_s: Array, *, rough: Array | None = None
) -> tuple[WorstCorrelation, ...]:
    """Worst correlation of the measurement noise for each predicted quantity w = W x (d, s) of the estimated x.

    Parameters
    ----------
    t_s : shape (n,). Components of one instrument (noise source) are each a series of their own.
    rough : as of `worst_correlation`.

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
    return tuple(worst_correlation(flat[:, d], times, series, rough=rough) for d in range(flat.shape[1]))


def bias_imitates(problem: LinearProblem, state: str, bias: str) -> Klaus:
    """Apply Klaus' filter to two blocks of a problem, with the measurement noise as assumed."""
    blocks = {block.name: block for block in problem.blocks}
    for name in (state, bias):
        if name not in blocks:
            raise InputError(f"bias_imitates: no block {name!r}; there are {', '.join(blocks)}")
    L = cholesky_rows(problem.R, "R")
    U, S = (np.array(blocks[name].H) for name in (state, bias))
    for rows in (U, S):
        solve_rows(L, rows)
    return klaus(U.reshape(problem.n * problem.p, -1), S.reshape(problem.n * problem.p, -1), blocks[state].names)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FewMeasurements:
    """Best use of measurements whose errors may be correlated in any way.

    Attributes
    ----------
    bound : sigma of the predicted quantity that no correlation whatever can pass; the smallest of any estimator.
    weights : shape (m,), of the measurements; not more than s are not zero.
    rows : the measurements that are used, at most s.
    bound_all : the same bound, sum |a_i| sigma_i, for the least-squares weights of all measurements.
    """

    bound: float
    weights: Array
    rows: npt.NDArray[np.int64]
    bound_all: float


def few_measurements(U: Array, sigma: Array, p: Array) -> FewMeasurements:
    """Find Lidov's measurements: at most s of them, which predict p^T x best whatever the correlation.

    Parameters
    ----------
    U : shape (m, s), partials of scalar measurements by the unknowns; priors are rows too. sigma : shape (m,).
    p : shape (s,), partials of the predicted quantity.

    Raises
    ------
    GeometryError
        If the measurements do not determine the quantity.

    Notes
    -----
    An unbiased estimate a^T y, U^T a = p, has the variance a^T K a. Over all correlations with the stated sigmas its
    largest root is sum |a_i| sigma_i (all errors +-1 together). The smallest such sum is a linear programme in
    standard form with s equations, so a vertex solves it: s measurements, six for a state, and nothing is gained
    from the others (Lidov 1964). The covariance of six measurements with the information of the others added,
    [iK_r0 + sum iG_k]^-1 (Platonov and Ivanov 2013, pp. 135-138), supposes independent errors; it is then the
    covariance of all measurements whichever six begin the sum, and K_r0 bounds it from above: see `base_bound`.

    References
    ----------
    Lidov 1964.
    Platonov, Ivanov 2013, Methods of measurement processing, pp. 135-138.
    """
    from scipy.optimize import linprog  # 0.7 s of import, for this search alone

    rows, s, wanted = _scalar_rows(U, sigma, p)
    unit = np.linalg.norm(rows, axis=0)
    unit = np.where(unit > 0.0, unit, 1.0)
    equations = (rows / unit).T
    right = wanted / unit
    size = float(np.abs(right).max())
    if size == 0.0:
        nothing = np.zeros(len(rows))
        return FewMeasurements(bound=0.0, weights=nothing, rows=np.array([], dtype=np.int64), bound_all=0.0)
    found = linprog(
        np.ones(2 * len(rows)), A_eq=np.hstack([equations, -equations]), b_eq=right / size, method="highs-ds"
    )
    if found.status != 0:
        raise GeometryError("few_measurements: the measurements do not determine the predicted quantity")
    a = size * (found.x[: len(rows)] - found.x[len(rows) :])
    least = np.linalg.lstsq(equations, right, rcond=None)[0]  # shortest a: the least-squares weights
    used = np.flatnonzero(np.abs(a) > 1e-12 * np.abs(a).max())
    return FewMeasurements(bound=float(np.abs(a).sum()), weights=a / s, rows=used, bound_all=float(np.abs(least).sum()))


def base_bound(U: Array, sigma: Array, rows: npt.ArrayLike) -> Array:
    """Factor S of K_r0 = S S^T, the covariance from s measurements alone: an upper bound of that from all.

    Parameters
    ----------
    rows : the base, at least s measurements that determine the state, e.g. `few_measurements(...).rows`.

    Raises
    ------
    GeometryError
        If they do not determine it.
    """
    white, _, _ = _scalar_rows(U, sigma, np.zeros(np.shape(U)[1]))
    R = np.asarray(np.linalg.qr(white[np.asarray(rows, dtype=np.int64)], mode="r"), dtype=np.float64)
    if R.shape[0] < R.shape[1] or not conditioning(R).observable:
        raise GeometryError("base_bound: these measurements do not determine the state")
    return solve_upper(R, np.eye(len(R)))


def _scalar_rows(U: Array, sigma: Array, p: Array) -> tuple[Array, Array, Array]:
    """Check shapes; return rows in units of their sigma, the sigmas, and p."""
    partials, s, wanted = (np.asarray(value, dtype=np.float64) for value in (U, sigma, p))
    if partials.ndim != 2 or s.shape != partials.shape[:1] or wanted.shape != partials.shape[1:]:
        raise InputError(
            f"few_measurements: needs U (m, s), sigma (m,) and p (s,), got {partials.shape}, {s.shape}, {wanted.shape}"
        )
    if not (s > 0.0).all():
        raise InputError("few_measurements: every sigma must be positive")
    return partials / s[:, None], s, wanted
