"""Which source causes which part of the error: the factors G_g of every estimator, in O(n).

With the gain M_v of the measurements, a source that is fresh at each measurement contributes
sum_k M_vk N_k M_vk^T, a common one M_g Sigma_g M_g^T. In the coordinates y = S q that the estimator's own factor
S gives, M_vk = S X_k^T with X = L^-T (L^-1 H) S and sum X^T Sigma X <= I: Gram matrices of X lose nothing to the
condition number, which Gram matrices of H do.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.estimation.problem.estimate import Estimate, History, Solution, Status
from nebosvod.estimation.problem.markov import accumulated
from nebosvod.estimation.problem.partition import CommonSource, Partition
from nebosvod.estimation.problem.problem import LinearProblem, White
from nebosvod.estimation.problem.square_root import (
    Conditioning,
    append_rows,
    conditioning,
    gram_factor,
    multiply_rows,
    solve_upper,
)
from nebosvod.estimation.problem.whitening import Whitener, chunks, projected, whitened_rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """The outcome of any way of solving, in the unknowns y of the partition.

    Attributes
    ----------
    y : shape (s_y,).
    S : shape (s_y, s_y), covariance of y = S S^T.
    M : shape (s_y, s_j), gain by the parameters left out.
    chi2 : cost at the minimum.
    """

    y: Array
    S: Array
    M: Array
    chi2: float


def estimate_of(
    problem: LinearProblem,
    partition: Partition,
    whitener: Whitener,
    rows: Array,
    solved: Solved,
    condition: Conditioning,
    history: History | None = None,
) -> Estimate:
    """Dress a solution: back to the parameters' units, factors by source, residuals."""
    mean = partition.mean + partition.T @ solved.y
    factors = _fresh_factors(problem, partition, whitener, rows, solved)
    gains = {}
    for source in partition.sources:
        factors[source.name], gains[source.name] = _common_factor(partition, source, solved)
    solution = Solution(
        mean=mean,
        mean_left_out=partition.left_out_mean,
        S_formal=partition.T @ solved.S,
        factors=factors,
        gains=gains,
        gain_names={source.name: source.names for source in partition.sources},
        residual_after=residual_after(problem, partition, mean),
        chi2=solved.chi2,
    )
    return Estimate(
        names=partition.estimated,
        left_out=partition.left_out,
        status=Status.CONVERGED,
        message=Status.CONVERGED.sentence,
        dof=problem.counted - partition.n_free,
        condition_number=condition.number,
        rank=condition.rank,
        weak_direction=weak_direction(problem, partition, condition),
        solution=solution,
        history=history,
    )


def not_observable(problem: LinearProblem, partition: Partition, condition: Conditioning, reason: str = "") -> Estimate:
    """Report a problem without a solution: rank and the weak direction by name, no covariance."""
    weak = weak_direction(problem, partition, condition)
    leading = sorted(weak, key=lambda name: -abs(weak[name]))[:4]
    words = ", ".join(f"{weak[name]:+.3g} {name}" for name in leading)
    message = (
        f"{reason or Status.NOT_OBSERVABLE.sentence} Rank {condition.rank} of {partition.n_unknowns}, "
        f"condition number {condition.number:.3g}; weakest combination (in typical sizes): {words}."
    )
    return Estimate(
        names=partition.estimated,
        left_out=partition.left_out,
        status=Status.NOT_OBSERVABLE,
        message=message,
        dof=problem.counted - partition.n_free,
        condition_number=condition.number,
        rank=condition.rank,
        weak_direction=weak,
        solution=None,
    )


def weak_direction(problem: LinearProblem, partition: Partition, condition: Conditioning) -> dict[str, float]:
    """Weights of the worst determined combination by parameter name, each in its typical size, largest 1.

    The typical size is the problem's `scale`, else the prior's sigma, else the inverse length of the column.
    """
    move = partition.T @ condition.direction
    typical = np.sqrt(np.einsum("sr,sr->s", partition.T[:, partition.n_free :], partition.T[:, partition.n_free :]))
    lengths = _column_lengths(problem, partition)
    free = typical == 0.0
    typical[free] = 1.0 / np.where(lengths[free] > 0.0, lengths[free], 1.0)
    for index, name in enumerate(partition.estimated):
        if problem.scale and name in problem.scale:
            typical[index] = problem.scale[name]
    weights = move / typical
    largest = int(np.argmax(np.abs(weights)))
    if weights[largest] != 0.0:
        weights = weights / weights[largest]
    return {name: float(weight) for name, weight in zip(partition.estimated, weights)}


def _column_lengths(problem: LinearProblem, partition: Partition) -> Array:
    """Lengths (s,) of the columns of H in units of the mean noise."""
    noise = np.sqrt(np.einsum("npp->p", problem.R) / len(problem.R))
    unit = np.where(noise > 0.0, noise, 1.0)
    lengths: dict[str, float] = {}
    for block in problem.blocks:
        square = np.einsum("npk,npk->pk", block.H, block.H)
        lengths.update(zip(block.names, np.sqrt((square / unit[:, None] ** 2).sum(axis=0))))
    return np.array([lengths[name] for name in partition.estimated])


def residual_after(problem: LinearProblem, partition: Partition, mean: Array) -> Array:
    """Residual (n, p) minus H times the estimates, and the assumed means of parameters left out."""
    values = dict(zip(partition.names, [*mean, *partition.left_out_mean]))
    after = np.array(problem.residual)
    for block in problem.blocks:
        if block.treatment != "fixed":
            flat = block.H.reshape(problem.n * problem.p, len(block.names))  # one product, not n small ones
            after -= (flat @ np.array([values[name] for name in block.names])).reshape(after.shape)
    return after


def _fresh_factors(
    problem: LinearProblem, partition: Partition, whitener: Whitener, rows: Array, solved: Solved
) -> dict[str, Array]:
    """Factors of the noise sources, white and time-correlated nuisances."""
    size = partition.n_unknowns
    grams = {name: np.zeros((size, size)) for name in problem.noise_names}
    live = [(white, np.argsort(white.rows, kind="stable")) for white in problem.white if white.treatment != "fixed"]
    chains = [markov for markov in problem.markov if markov.treatment != "fixed"]
    grams.update({white.name: np.zeros((size, size)) for white, _ in live})
    X = _whole_gain(whitener, rows, solved.S) if chains else None
    for start, stop, part in _gain_parts(whitener, rows, solved.S) if X is None else _parts(X):
        for name, gram in _noise_grams(problem, start, stop, part):
            grams[name] += gram
        for white, order in live:
            grams[white.name] += _white_gram(white, order, start, stop, part)
    if X is not None:
        grams.update({markov.name: accumulated(markov, X) for markov in chains})
    base = partition.T @ solved.S
    pad = np.zeros((len(partition.left_out), size))
    both = np.vstack([base, pad])
    return {name: both @ gram_factor(gram) for name, gram in grams.items()}


def _gain_parts(whitener: Whitener, rows: Array, S: Array) -> Iterator[tuple[int, int, Array]]:
    """Yield (start, stop, X) with X (., p, s_y) = L^-T (whitened partials) S; no time-correlated nuisance."""
    for start, stop in chunks(len(rows)):
        X = _times(rows[start:stop, :, : len(S)], S)
        whitener.adjoint_part(start, stop, X)
        yield start, stop, X


def _whole_gain(whitener: Whitener, rows: Array, S: Array) -> Array:
    """X of all measurements at once (n, p, s_y), which a time-correlated nuisance needs."""
    X = np.empty((*rows.shape[:2], S.shape[1]))
    for start, stop in chunks(len(rows)):
        X[start:stop] = _times(rows[start:stop, :, : len(S)], S)
    whitener.adjoint(X)
    return X


def _times(rows: Array, S: Array) -> Array:
    """rows (n, p, s) times S as one product: a stacked matmul would call the library n times."""
    n, p, size = rows.shape
    flat: Array = np.ascontiguousarray(rows).reshape(n * p, size) @ S
    return flat.reshape(n, p, S.shape[1])


def _parts(X: Array) -> Iterator[tuple[int, int, Array]]:
    """Yield X in parts that stay in the cache."""
    for start, stop in chunks(len(X)):
        yield start, stop, X[start:stop]


def _noise_grams(problem: LinearProblem, start: int, stop: int, X: Array) -> Iterator[tuple[str, Array]]:
    """Gram matrices sum X^T R_true X of one part, by noise source."""
    truth = problem.truth if len(problem.truth) == 1 else problem.truth[start:stop]
    weighted = multiply_rows(truth, X)
    labels = np.zeros(stop - start, dtype=np.int64) if problem.noise_label is None else problem.noise_label[start:stop]
    for index, name in enumerate(problem.noise_names):
        if len(problem.noise_names) == 1:
            yield name, _gram(X, weighted)
            continue
        mine = labels == index
        yield name, _gram(X[mine], weighted[mine])


def _white_gram(white: White, order: IntArray, start: int, stop: int, X: Array) -> Array:
    """Gram matrix sum X^T H Q_true H^T X of one part; `order` sorts the rows that the nuisance touches."""
    first, last = np.searchsorted(white.rows, (start, stop), sorter=order)
    mine = order[first:last]
    Q = white.truth if len(white.truth) == 1 else white.truth[mine]
    part = X[white.rows[mine] - start]
    return _gram(part, multiply_rows(projected(white.H[mine], Q), part))


def _gram(left: Array, right: Array) -> Array:
    n, p, size = left.shape
    product: Array = left.reshape(n * p, size).T @ right.reshape(n * p, size)
    return product


def _common_factor(partition: Partition, source: CommonSource, solved: Solved) -> tuple[Array, Array]:
    """Factor G (s + s_j, r) and gain (s + s_j, k) of one prior."""
    n_inside = source.inverse.shape[1]
    K = solved.S @ solved.S[source.unknowns].T
    gain = np.zeros((len(partition.names), len(source.names)))
    s = len(partition.estimated)
    gain[:s, :n_inside] = -partition.T @ (K @ source.inverse)
    gain[:s, n_inside:] = partition.T @ solved.M[:, source.left_out]
    gain[s + source.left_out, n_inside + np.arange(source.left_out.size)] = -1.0
    # The draw is carried to whitened units before it meets K: the product of a tiny inverse and a huge draw is exact.
    inside = -partition.T @ (K @ (source.inverse @ source.draw[:n_inside]))
    outside = gain[:, n_inside:] @ source.draw[n_inside:]
    factor = outside
    factor[:s] += inside
    return factor, gain


def prior_draws(partition: Partition) -> tuple[Array, Array]:
    """How the D unit draws of all priors, in truth, enter an estimate that has seen no measurement.

    Returns
    -------
    inside : shape (s_y, D), error of the unknowns.
    outside : shape (s_j, D), true deviation of the parameters left out from their assumed mean.
    """
    count = sum(source.draw.shape[1] for source in partition.sources)
    inside, outside = np.zeros((partition.n_unknowns, count)), np.zeros((len(partition.left_out), count))
    first = 0
    for source in partition.sources:
        span, estimated = slice(first, first + source.draw.shape[1]), source.inverse.shape[1]
        inside[source.unknowns, span] = -(source.inverse @ source.draw[:estimated])
        outside[source.left_out, span] = source.draw[estimated:]
        first = span.stop
    return inside, outside


def measurement_gain(problem: LinearProblem) -> Array:
    """Return M_v^T (n, p, s) of the batch estimator: how each measurement moves each estimated parameter.

    Raises
    ------
    GeometryError
        If the problem is not observable.
    """
    partition = Partition.of(problem)
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    width, size = rows.shape[2], partition.n_unknowns
    start = np.eye(size, width)[partition.n_free :]
    R = append_rows(start, rows.reshape(-1, width))[:size, :size]
    if R.shape[0] < size or not conditioning(R).observable:
        raise GeometryError("measurement_gain: the problem is not observable")
    S = solve_upper(R, np.eye(size))
    gain: Array = _whole_gain(whitener, rows, S) @ (partition.T @ S).T
    return gain
