"""Measurements one after another: the augmented filter in square-root information form, equal to the batch.

The common nuisances are part of the state, so nothing constant is counted as fresh noise at each step (the form
printed in Guo and Ivashkin (2.139) does that and claimed sigmas up to 13.6 times too small). White nuisances are
in the noise of their measurement; time-correlated ones are removed by the innovations of their own small filter,
which looks only backwards, so that the history is what a filter carrying them as states would have shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop
from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate, History
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import Block, LinearProblem, Markov, White
from nebosvod.estimation.problem.sources import estimate_of, not_observable, prior_draws
from nebosvod.estimation.problem.square_root import OBSERVABLE_CONDITION, root_rows
from nebosvod.estimation.problem.whitening import Whitener, add_white, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows, solved_triangle

Array = npt.NDArray[np.float64]


def solve(problem: LinearProblem, history: bool = True) -> Estimate:
    """Process the measurements in order; the last estimate equals the batch.

    Parameters
    ----------
    problem : rows in time order.
    history : also return the sigmas of all estimated parameters after each measurement.

    Returns
    -------
    Estimate
        With `history.sigma_formal` (n, s), inf while the parameters without a prior are not determined, and
        `history.sigma` (n, s), the true ones; None when a time-correlated nuisance is present and assumed and
        true model differ (its error then depends on all later gains).

    Notes
    -----
    Givens rotations take each measurement into [R | d | C]: R^T R = information, y = iR d, and the gains of the
    parameters left out M = iR C. No covariance is updated, so none can become indefinite, and no prior is needed.
    """
    partition = Partition.of(problem)
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    size = partition.n_unknowns
    spread = np.hstack([partition.T, np.zeros((len(partition.estimated), len(partition.left_out)))])
    triangle, formal, true = _pass(problem, partition, whitener, rows, spread, history)
    solved, condition, reason = solved_triangle(triangle, size)
    if solved is None:
        return not_observable(problem, partition, condition, reason)
    record = History(names=partition.estimated, sigma_formal=formal, sigma=true) if history else None
    return estimate_of(problem, partition, whitener, rows, solved, condition, record)


def follow(problem: LinearProblem, W: npt.ArrayLike, names: Sequence[str]) -> tuple[Array, Array | None]:
    """Sigmas of predicted quantities w = W x after each measurement, in one pass of O(n).

    Parameters
    ----------
    problem : rows in time order.
    W : shape (d, k), partials by the k named parameters; considered and ignored ones may be among them.

    Returns
    -------
    sigma_formal : shape (n, d), inf while a parameter without a prior is not determined.
    sigma : shape (n, d), the true ones; None as in `solve`.
    """
    partition = Partition.of(problem)
    place = {name: index for index, name in enumerate(partition.names)}
    unknown = [name for name in names if name not in place]
    matrix = np.atleast_2d(np.asarray(W, dtype=np.float64))
    if unknown or matrix.shape[1] != len(names):
        raise InputError(f"follow: W needs one column for each of {', '.join(place)}; got {tuple(names)}")
    full = np.zeros((len(matrix), len(place)))
    np.add.at(full.T, [place[name] for name in names], matrix.T)
    inside = len(partition.estimated)
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    spread = np.hstack([full[:, :inside] @ partition.T, full[:, inside:]])
    _, formal, true = _pass(problem, partition, whitener, rows, spread, True)
    return formal, true


def _pass(
    problem: LinearProblem, partition: Partition, whitener: Whitener, rows: Array, spread: Array, history: bool
) -> tuple[Array, Array, Array | None]:
    """Take in all rows: the triangle, and formal and true sigmas (n, d) of spread (d, s_y + s_j) times the unknowns."""
    width, size = rows.shape[2], partition.n_unknowns
    triangle = np.zeros((width, width))
    triangle[partition.n_free : size] = prior_rows(partition, width)
    truth = _Truth.of(problem, partition, whitener, rows, history)
    formal = np.full((problem.n if history else 0, len(spread)), np.inf)
    true = np.full(formal.shape if truth.differs else (0, formal.shape[1]), np.inf)
    _sweep(rows, triangle, np.ascontiguousarray(spread), truth.rows, truth.inside, truth.outside, formal, true)
    return triangle, formal, (true if truth.differs else formal) if truth.known else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Truth:
    """What the true sigmas need besides the estimator's own triangle, where assumed and true model differ.

    Fresh noise as rows (n, p, s_y), and the true draws (D of them) of the priors: `inside` (s_y, D) in the unknowns,
    `outside` (s_j, D) in the parameters left out.
    """

    known: bool
    differs: bool
    rows: Array
    inside: Array
    outside: Array

    @classmethod
    def of(
        cls, problem: LinearProblem, partition: Partition, whitener: Whitener, rows: Array, wanted: bool
    ) -> "_Truth":
        """Collect them; cheap when the truth is as assumed."""
        size = partition.n_unknowns
        differs = wanted and mismatched(problem)
        known = not (differs and any(markov.treatment != "fixed" for markov in problem.markov))
        if not (differs and known):
            none = np.zeros((len(partition.left_out), 0))
            return cls(known=known, differs=False, rows=np.zeros((0, 0, 0)), inside=np.zeros((size, 0)), outside=none)
        total = np.array(np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p)))
        for white in problem.white:
            if white.treatment != "fixed":
                add_white(total, white, white.truth)
        partials = np.array(rows[:, :, :size])
        whitener.adjoint(partials)
        fresh = np.einsum("npi,npw->niw", root_rows(total), partials)
        inside, outside = prior_draws(partition)
        return cls(known=True, differs=True, rows=fresh, inside=inside, outside=outside)


def mismatched(problem: LinearProblem) -> bool:
    """Whether the truth differs from what the estimator assumes."""
    groups: tuple[Block | White | Markov, ...] = (*problem.blocks, *problem.white, *problem.markov)
    if any(group.treatment in ("considered", "ignored") for group in groups):
        return True
    return (
        problem.true_R is not None
        or any(white.true_Q is not None for white in problem.white)
        or any(markov.differs for markov in problem.markov)
        or any(prior.true_covariance is not None for prior in problem.priors)
    )


@plain_loop
def rotate_in(row, triangle):  # type: ignore[no-untyped-def]
    """Rotate one row (w,) into the upper triangle (., w) by Givens rotations; the row is destroyed."""
    width = triangle.shape[1]
    for j in range(min(width, triangle.shape[0])):
        b = row[j]
        if b == 0.0:
            continue
        a = triangle[j, j]
        length = np.sqrt(a * a + b * b)  # hypot costs 20 ns; whitened rows are far from overflow
        if length == 0.0:
            continue  # both are below 1e-162: nothing
        c, s = a / length, b / length
        triangle[j, j] = length
        for k in range(j + 1, width):
            t = triangle[j, k]
            triangle[j, k] = c * t + s * row[k]
            row[k] = c * row[k] - s * t


@plain_loop
def _inverse_upper(R, size, out, limit):  # type: ignore[no-untyped-def]
    """out = iR for the leading (size, size) of R; returns the first row from which R is safely regular."""
    begin = 0
    for j in range(size):
        length = 0.0
        for i in range(j + 1):
            length += R[i, j] * R[i, j]
        if not R[j, j] * R[j, j] * limit * limit > length:
            begin = j + 1
    # Row by row from the last: the inner loop runs along rows of out, which vectorises.
    for i in range(size - 1, begin - 1, -1):
        diagonal = 1.0 / R[i, i]
        for j in range(i + 1, size):
            out[i, j] = 0.0
        for k in range(i + 1, size):
            factor = -R[i, k] * diagonal
            for j in range(k, size):
                out[i, j] += factor * out[k, j]
        out[i, i] = diagonal
    return begin


@plain_loop
def _row_lengths(spread, factor, begin, upper, out):  # type: ignore[no-untyped-def]
    """Lengths of the rows of spread times factor; inf where a row needs an unknown before `begin`.

    upper : whether factor is upper triangular, and half of the products nothing.
    """
    width = factor.shape[1]
    row = np.empty(width)
    for i in range(spread.shape[0]):
        row[:] = 0.0
        known = True
        for j in range(factor.shape[0]):
            if spread[i, j] != 0.0:
                known = known and j >= begin
                for k in range(j if upper else 0, width):
                    row[k] += spread[i, j] * factor[j, k]
        square = 0.0
        for k in range(width):
            square += row[k] * row[k]
        out[i] = np.sqrt(square) if known else np.inf


@plain_loop
def _sweep(rows, triangle, spread, truth_rows, inside, outside, formal, true):  # type: ignore[no-untyped-def]
    """Take in all rows; fill the sigma histories (n, s) where they have rows of their own."""
    n, p, width = rows.shape
    size = inside.shape[0]
    row = np.empty(width)
    fresh_row = np.empty(size)
    fresh = np.zeros((size, size))
    S = np.zeros((size, size))
    assumed = np.hstack((np.zeros((len(outside), size)), -outside))  # errors of what is not estimated
    for k in range(n):
        for i in range(p):
            row[:] = rows[k, i]
            rotate_in(row, triangle)
        if len(true):
            for i in range(truth_rows.shape[1]):
                fresh_row[:] = truth_rows[k, i]
                rotate_in(fresh_row, fresh)
        if len(formal):
            begin = _inverse_upper(triangle, size, S, OBSERVABLE_CONDITION)
            _row_lengths(spread, S, begin, True, formal[k])
            if len(true) and begin == 0:
                K = S @ np.ascontiguousarray(S.T)
                left = S @ (np.ascontiguousarray(triangle[:size, size + 1 :]) @ outside)
                errors = np.hstack((K @ np.ascontiguousarray(fresh.T), K @ inside + left))
                _row_lengths(spread, np.vstack((errors, assumed)), 0, False, true[k])
