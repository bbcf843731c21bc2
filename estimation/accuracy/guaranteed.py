"""Guaranteed bounds: how far a predicted quantity can be when every error stays inside a stated box.

No distribution is assumed: measurement noise within `level` sigma of each component, nuisances and priors within
`level` in whitened coordinates. The extreme is a linear programme (HiGHS); its dual gives the same number and is
computed on its own as a check. Bounds that contradict the measurements are reported with the smallest common
inflation that reconciles them.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy.zonogon import Segments, largest
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import covariance_factor
from nebosvod.estimation.problem.whitening import raw_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bounds:
    """Guaranteed interval of each predicted quantity (d,), deviations from the linearisation point.

    `inflation` is the smallest factor on all boxes that makes them consistent with the measurements: 1 when they
    are, above 1 when not; then lower and upper hold for the inflated boxes and `consistent` is False.
    `duality_gap` is the largest relative difference of primal and dual.
    """

    lower: Array
    upper: Array
    level: float
    consistent: bool
    inflation: float
    duality_gap: float

    @property
    def half_width(self) -> Array:
        """Half of upper minus lower (d,)."""
        return 0.5 * (self.upper - self.lower)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polytope:
    """All unknowns xi with |right - A xi| <= bound (m,), and objective rows over xi."""

    A: "csr_matrix"
    right: Array
    bound: Array


def bound(problem: LinearProblem, W: npt.ArrayLike, names: tuple[str, ...] | None = None, level: float = 3.0) -> Bounds:
    """Bound predicted quantities w = W x over all errors inside the boxes.

    Parameters
    ----------
    W : shape (d, k), partials by the named parameters; `names` defaults to all that have an error.
    level : half-width of each box in true sigmas (state it with the result).

    Raises
    ------
    GeometryError
        If the boxes do not bound the quantity: the measurements do not determine it.
    InputError
        If a nuisance is time-correlated: it has no box that is comparable.
    """
    partition = Partition.of(problem)
    _require_boxes(problem)
    polytope, spread = _polytope(problem, partition, level)
    full = _over_all(partition, W, names)
    offset = full @ np.concatenate([partition.mean, partition.left_out_mean])
    objective = np.zeros((len(full), polytope.A.shape[1]))
    objective[:, : spread.shape[1]] = full @ spread
    return extreme(polytope, objective, level=level, offset=offset)


def largest_error(
    problem: LinearProblem, W: npt.ArrayLike, names: tuple[str, ...] | None = None, level: float = 3.0
) -> Array:
    """Largest error (d,) of w = W x that the boxes allow, before the measurements are known.

    Notes
    -----
    The set of errors inside the boxes that leave no residual is symmetric, so one programme a component finds both
    ends. By duality it is the error of the linear estimator whose worst case is smallest. Measurements of one or two
    components go by `zonogon`, which has no column for a nuisance. Arguments, errors as `bound`.
    """
    silent = replace(
        problem,
        residual=np.zeros_like(problem.residual),
        priors=tuple(replace(prior, mean=None) for prior in problem.priors),
    )
    if problem.p > 2:
        return _by_draws(silent, W, names, level)
    partition = Partition.of(silent)
    _require_boxes(silent)
    spread = _spread(partition)
    n, p = problem.n, problem.p
    partials = np.delete(raw_rows(silent, partition), len(partition.estimated), axis=2)
    sigma = np.sqrt(np.einsum("npp->np", np.broadcast_to(problem.truth, (n, p, p))))
    parts = [(np.arange(n), np.broadcast_to(np.eye(p), (n, p, p)))]
    for white in problem.white:
        if white.treatment != "fixed":
            ends = _white_ends(white.H, white.truth, white.name) / sigma[white.rows][:, None, :]
            parts.append((white.rows, ends))
    return largest(
        (partials @ spread) / (level * sigma)[:, :, None],
        Segments.of(parts, n, p),
        boxed=spread.shape[1] - partition.n_free,
        level=level,
        objective=_over_all(partition, W, names) @ spread,
    )


def _by_draws(silent: LinearProblem, W: npt.ArrayLike, names: tuple[str, ...] | None, level: float) -> Array:
    """Largest error with a column for each draw of a white nuisance, whatever the size of a measurement."""
    partition = Partition.of(silent)
    _require_boxes(silent)
    polytope, spread = _polytope(silent, partition, level)
    worst = np.zeros(len(np.atleast_2d(np.asarray(W))))
    for row, p in enumerate(_over_all(partition, W, names) @ spread):
        size = float(np.abs(p).max())
        if size > 0.0:
            objective = np.concatenate([p / size, np.zeros(polytope.A.shape[1] - len(p))])
            worst[row] = size * _primal(polytope, polytope.bound, objective)
    return worst


def extreme(polytope: Polytope, objective: Array, level: float = 1.0, offset: Array | None = None) -> Bounds:
    """Extremes of objective rows (d, k) over a polytope."""
    inflation = _inflation(polytope)
    factor = 1.0 if inflation <= 1.0 + 1e-9 else inflation * (1.0 + 1e-9)
    bounds = polytope.bound * factor
    _, unit = _scaled(polytope.A)
    lower, upper, gap = np.empty(len(objective)), np.empty(len(objective)), 0.0
    for row, p in enumerate(objective):
        size = float(np.abs(p).max())
        if size == 0.0:
            lower[row] = upper[row] = 0.0
            continue
        for sign, out in ((1.0, upper), (-1.0, lower)):
            value = _primal(polytope, bounds, sign * p / size)
            other = _dual(polytope, bounds, sign * p / size)
            gap = max(gap, abs(value - other) / max(abs(value), 1e-12 * float(np.abs(p / size / unit).max())))
            out[row] = sign * value * size
    shift = np.zeros(len(objective)) if offset is None else offset
    return Bounds(
        lower=lower + shift,
        upper=upper + shift,
        level=level,
        consistent=factor == 1.0,
        inflation=max(inflation, 1.0),
        duality_gap=gap,
    )


def _require_boxes(problem: LinearProblem) -> None:
    if any(markov.treatment != "fixed" for markov in problem.markov):
        raise InputError("guaranteed: time-correlated nuisances have no box; give them as white or constant")


def _over_all(partition: Partition, W: npt.ArrayLike, names: tuple[str, ...] | None) -> Array:
    """Partials (d, s + s_j) by all parameters that have an error."""
    order = partition.names if names is None else names
    matrix = np.atleast_2d(np.asarray(W, dtype=np.float64))
    if matrix.shape[1] != len(order):
        raise InputError(f"guaranteed: W needs {len(order)} columns, got {matrix.shape[1]}")
    full = np.zeros((len(matrix), len(partition.names)))
    full[:, [partition.names.index(name) for name in order]] = matrix
    return full


def polytope(U: npt.ArrayLike, bounds: npt.ArrayLike, right: npt.ArrayLike | None = None) -> Polytope:
    """Polytope |right - U x| <= bounds for a small dense system."""
    from scipy.sparse import csr_matrix  # 0.1 s of import, for this stage alone

    A = np.atleast_2d(np.asarray(U, dtype=np.float64))
    values = np.zeros(len(A)) if right is None else np.asarray(right, dtype=np.float64)
    limits = np.asarray(bounds, dtype=np.float64)
    # Every row in units of its bound, as everywhere here: the solver's tolerances are absolute.
    unit = np.where(limits > 0.0, limits, 1.0)
    return Polytope(A=csr_matrix(A / unit[:, None]), right=values / unit, bound=limits / unit)


def _polytope(problem: LinearProblem, partition: Partition, level: float) -> tuple[Polytope, Array]:
    """Rows of measurements over [free parameters | prior draws | white draws], then the boxes of the draws."""
    from scipy.sparse import csr_matrix, hstack, vstack  # 0.1 s of import, for this stage alone

    n, p = problem.n, problem.p
    rows = raw_rows(problem, partition).reshape(n * p, -1)
    s = len(partition.estimated)
    partials = np.delete(rows, s, axis=1)
    spread = _spread(partition)
    common = partials @ spread
    blocks, widths = [csr_matrix(common)], 0
    for white in problem.white:
        if white.treatment != "fixed":
            block = _white_columns(problem, white.H, white.truth, white.rows, white.name)
            blocks.append(block)
            widths += block.shape[1]
    A = hstack(blocks, format="csr")
    noise = level * np.sqrt(np.einsum("npp->np", np.broadcast_to(problem.truth, (n, p, p)))).reshape(-1)
    draws = A.shape[1] - partition.n_free
    box = hstack([csr_matrix((draws, partition.n_free)), _identity(draws)], format="csr")
    # Every row in units of its bound: the solver's tolerances are absolute.
    scale = csr_matrix((1.0 / noise, (np.arange(n * p), np.arange(n * p))))
    whole = vstack([scale @ A, box / level], format="csr")
    right = np.concatenate([rows[:, s] / noise, np.zeros(draws)])
    return Polytope(A=whole, right=right, bound=np.ones(len(right))), spread


def _spread(partition: Partition) -> Array:
    """Map (s + s_j, n_free + draws) from free parameters and unit draws of the priors to all parameters."""
    columns = [np.vstack([partition.T[:, : partition.n_free], np.zeros((len(partition.left_out), partition.n_free))])]
    place = {name: index for index, name in enumerate(partition.names)}
    for source in partition.sources:
        block = np.zeros((len(place), source.draw.shape[1]))
        block[[place[name] for name in source.names]] = source.draw
        columns.append(block)
    return np.hstack(columns)


def _white_columns(problem: LinearProblem, H: Array, Q: Array, rows: npt.NDArray[np.int64], name: str) -> "csr_matrix":
    """Sparse columns of a white nuisance's unit draws, q for each touched measurement."""
    from scipy.sparse import csr_matrix  # 0.1 s of import, for this stage alone

    n_r, p, _ = H.shape
    parts = _white_ends(H, Q, name).transpose(0, 2, 1)
    q = parts.shape[2]
    row = (rows[:, None, None] * p + np.arange(p)[None, :, None]) * np.ones((1, 1, q), dtype=np.int64)
    column = (np.arange(n_r)[:, None, None] * q + np.arange(q)[None, None, :]) * np.ones((1, p, 1), dtype=np.int64)
    shape = (problem.n * p, n_r * q)
    return csr_matrix((parts.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=shape)


def _white_ends(H: Array, Q: Array, name: str) -> Array:
    """What a unit draw of each component (n, q, p) of a white nuisance adds to the measurements it touches."""
    roots = [covariance_factor(each, name) for each in Q]
    parts = H @ roots[0] if len(roots) == 1 else np.stack([h @ _square(root) for h, root in zip(H, roots)])
    ends: Array = parts.transpose(0, 2, 1)
    return ends


def _square(root: Array) -> Array:
    out = np.zeros((len(root), len(root)))
    out[:, : root.shape[1]] = root
    return out


def _identity(size: int) -> "csr_matrix":
    from scipy.sparse import csr_matrix  # 0.1 s of import, for this stage alone

    return csr_matrix((np.ones(size), (np.arange(size), np.arange(size))), shape=(size, size))


def _scaled(A: "csr_matrix") -> "tuple[csr_matrix, Array]":
    """Columns scaled to unit size: parameters differ by 1e12, the solver's tolerances do not."""
    from scipy.sparse import csr_matrix  # 0.1 s of import, for this stage alone

    size = np.asarray(abs(A).max(axis=0).todense(), dtype=np.float64).reshape(-1)
    unit = np.where(size > 0.0, size, 1.0)
    return A @ csr_matrix((1.0 / unit, (np.arange(len(unit)), np.arange(len(unit))))), unit


def _solve(cost: Array, **system: Any) -> tuple[int, float]:
    """Minimise a linear cost with HiGHS; status 0 = done, 3 = not bounded."""
    from scipy.optimize import linprog  # 0.7 s of import, for this stage alone

    found = linprog(cost, method="highs", **system)
    if found.status not in (0, 3):
        raise GeometryError(f"guaranteed: the linear programme failed: {found.message}")
    return int(found.status), 0.0 if found.fun is None else float(found.fun)


def _primal(body: Polytope, bounds: Array, p: Array) -> float:
    """max p xi over the polytope."""
    from scipy.sparse import vstack  # 0.1 s of import, for this stage alone

    A, unit = _scaled(body.A)
    limits = np.concatenate([body.right + bounds, bounds - body.right])
    size = float(np.abs(p / unit).max())  # the solver's tolerances are absolute here too
    status, value = _solve(-p / unit / size, A_ub=vstack([A, -A]), b_ub=limits, bounds=(None, None))
    if status == 3:
        raise GeometryError("guaranteed: the quantity is not bounded; the measurements and boxes do not determine it")
    return -value * size


def _dual(body: Polytope, bounds: Array, p: Array) -> float:
    """min y right + sum |y_i| bound_i subject to A^T y = p: the same extreme from the other side."""
    from scipy.sparse import hstack  # 0.1 s of import, for this stage alone

    A, unit = _scaled(body.A)
    transposed = A.T.tocsr()
    cost = np.concatenate([body.right + bounds, bounds - body.right])
    size = float(np.abs(p / unit).max())
    return size * _solve(cost, A_eq=hstack([transposed, -transposed]), b_eq=p / unit / size, bounds=(0, None))[1]


def _inflation(body: Polytope) -> float:
    """Smallest factor on all bounds for which the polytope is not empty."""
    from scipy.sparse import csr_matrix, hstack, vstack  # 0.1 s of import, for this stage alone

    A, _ = _scaled(body.A)
    column = csr_matrix(-body.bound[:, None])
    both = vstack([hstack([A, column]), hstack([-A, column])])
    cost = np.zeros(A.shape[1] + 1)
    cost[-1] = 1.0
    box = [(None, None)] * A.shape[1] + [(0, None)]
    return _solve(cost, A_ub=both, b_ub=np.concatenate([body.right, -body.right]), bounds=box)[1]
