"""The two-stage filter over a `LinearProblem`: a state as if nothing else were uncertain, everything else beside it.

The first estimated block is the state of the first stage; all other estimated parameters, constant as they are, are
the bias of the second. White nuisances are in the noise of their measurement, time-correlated ones are removed from
the rows before. The blend of the stages equals the batch.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters.two_stage import TwoStage, update
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import Solved, estimate_of, not_observable
from nebosvod.estimation.problem.square_root import append_rows, conditioning, solve_positive, solve_square
from nebosvod.estimation.problem.whitening import Whitener, raw_rows, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows
from nebosvod.estimation.solvers.sequential import UNRESOLVED, resolved

Array = npt.NDArray[np.float64]


def solve(problem: LinearProblem) -> Estimate:
    """Process the measurements in order by the two-stage filter.

    Parameters
    ----------
    problem : every estimated parameter needs a prior, together not singular; the first estimated block is the state.

    Returns
    -------
    Estimate
        With status `not_observable` where the covariances have lost their digits; `recursive.solve` keeps them.

    Raises
    ------
    InputError
        If a parameter has no prior, a prior is singular, or nothing is estimated beside the state.

    Notes
    -----
    About 0.2 ms a measurement: this is the filter to compare with, not the fast one.

    References
    ----------
    Friedland 1969, IEEE Trans. Automatic Control 14, 359; Ignagni 1990.
    """
    partition = Partition.of(problem)
    state = next(block.names for block in problem.blocks if block.treatment == "estimated")
    inside = np.isin(partition.estimated, state)
    if partition.n_free:
        raise InputError(
            "the two-stage filter needs a prior for every estimated parameter; recursive.solve does without"
        )
    if inside.all():
        raise InputError("the two-stage filter has no second stage: nothing but the state is estimated")
    if partition.n_unknowns < len(partition.estimated):
        raise InputError("the two-stage filter needs regular priors, and one holds a combination exactly")
    whitener = Whitener.of(problem)
    unit = np.sqrt(np.einsum("sr,sr->s", partition.T, partition.T))
    stage, chi2 = _filtered(_rows(problem, partition, whitener), partition.T / unit[:, None], inside, unit)
    rows = whitened_rows(problem, partition, whitener)
    if not (resolved(stage.P) and resolved(stage.P_b)):
        size, width = partition.n_unknowns, rows.shape[2]
        triangle = append_rows(prior_rows(partition, width), rows.reshape(-1, width))
        return not_observable(problem, partition, conditioning(triangle[:size, :size]), UNRESOLVED)
    solved = _solved(stage, chi2, rows, solve_square(partition.T, np.diag(unit)), inside)
    condition = conditioning(np.asarray(np.linalg.qr(solve_square(solved.S, np.eye(len(unit))), mode="r")))
    return estimate_of(problem, partition, whitener, rows, solved, condition)


def _rows(problem: LinearProblem, partition: Partition, whitener: Whitener) -> Array:
    """Whitened rows [H | v] (n, p, s + 1) by the estimated parameters themselves."""
    rows = raw_rows(problem, partition)[:, :, : len(partition.estimated) + 1]
    whitener.whiten(rows)
    return rows


def _filtered(rows: Array, prior: Array, inside: npt.NDArray[np.bool_], unit: Array) -> tuple[TwoStage, float]:
    """Both stages after all rows, in units of the prior's sigmas, and the sum of squared normalised innovations."""
    size = len(unit)
    K = prior @ prior.T
    stage = TwoStage.start(
        np.zeros(np.count_nonzero(inside)),
        np.zeros(np.count_nonzero(~inside)),
        K[np.ix_(inside, inside)],
        K[np.ix_(~inside, ~inside)],
        K[np.ix_(inside, ~inside)],
    )
    C, G = rows[:, :, :size][:, :, inside] * unit[inside], rows[:, :, :size][:, :, ~inside] * unit[~inside]
    noise, chi2 = np.eye(rows.shape[1]), 0.0
    for k in range(len(rows)):
        before = stage
        stage, seen = update(stage, rows[k, :, size], C[k], G[k], noise)
        innovation = seen.r - seen.S @ before.b
        chi2 += float(innovation @ solve_positive(seen.M + seen.S @ before.P_b @ seen.S.T, innovation[:, None])[:, 0])
    return stage, chi2


def _solved(stage: TwoStage, chi2: float, rows: Array, back: Array, inside: npt.NDArray[np.bool_]) -> Solved:
    """The blend in the unknowns of the partition: the joint factor is [[L_x, V L_b], [0, L_b]], nothing subtracted.

    back : (s_y, s), from units of the prior's sigmas to the unknowns.
    """
    size = len(inside)
    factor, mean = np.zeros((size, size)), np.zeros(size)
    split = len(stage.x0)
    L_b = np.linalg.cholesky(stage.P_b)
    factor[np.ix_(inside, np.arange(size) < split)] = np.linalg.cholesky(stage.P)
    factor[np.ix_(inside, np.arange(size) >= split)] = stage.V @ L_b
    factor[np.ix_(~inside, np.arange(size) >= split)] = L_b
    mean[inside], mean[~inside] = stage.x, stage.b
    S = back @ factor
    left_out = rows[:, :, size + 1 :]
    M = S @ (S.T @ np.einsum("npi,npj->ij", rows[:, :, :size], left_out))
    return Solved(y=back @ mean, S=S, M=M, chi2=chi2)
