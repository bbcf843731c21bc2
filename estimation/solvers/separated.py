"""The two-stage filter over a `LinearProblem`: a state as if nothing else were uncertain, everything else beside it.

The first estimated block is the state of the first stage; all other estimated parameters, constant as they are, are
the bias of the second. White nuisances are in the noise of their measurement. Time-correlated ones are removed from the
rows before (`solve`), or belong to the bias, which then drifts (`solve_drifting`, after Hsieh and Chen). The blend of
the stages equals the batch either way; `stages` shows what each stage believed after each measurement.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters.two_stage import System, TwoStage, predict_hsieh_chen, update
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import Solved, estimate_of, not_observable
from nebosvod.estimation.problem.square_root import (
    append_rows,
    conditioning,
    covariance_factor,
    lower_factor,
    solve_square,
)
from nebosvod.estimation.problem.whitening import Whitener, raw_rows, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows
from nebosvod.estimation.solvers.sequential import UNRESOLVED, resolved
from nebosvod.estimation.solvers.tracked import Moving, Track

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
    partition, inside = _parted(problem)
    whitener = Whitener.of(problem)
    unit = np.sqrt(np.einsum("sr,sr->s", partition.T, partition.T))
    stage, chi2 = _filtered(_rows(problem, partition, whitener), partition.T / unit[:, None], inside, unit)
    rows = whitened_rows(problem, partition, whitener)
    if not (resolved(stage.P) and resolved(stage.P_b)):
        return _unresolved(problem, partition, rows)
    return _dressed(problem, partition, whitener, rows, _joint(stage, inside), unit, chi2)


def solve_drifting(problem: LinearProblem) -> Estimate:
    """Process the measurements in order by the two-stage filter of Hsieh and Chen, whose bias may drift.

    Parameters
    ----------
    problem : as of `solve`; time-correlated nuisances that are estimated are part of the bias.

    Returns
    -------
    Estimate
        As of `solve`, of the parameters that stand still.

    Raises
    ------
    InputError
        As `solve`.

    References
    ----------
    Hsieh, Chen 1999, IEEE Trans. Automatic Control 44, 194.
    """
    found = stages(problem)
    partition, _ = _parted(problem)
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    if not (resolved(found.last.P) and resolved(found.last.P_b)):
        return _unresolved(problem, partition, rows)
    s = len(partition.estimated)
    mean, factor = _joint(found.last, found.inside)
    # parameters stand before what drifts, and what drifts is not asked for
    kept = (mean[:s], lower_factor(factor[:s]))
    return _dressed(problem, partition, whitener, rows, kept, found.unit[:s], found.chi2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stages:
    """What both stages believed after each of n measurements, in the parameters' own units.

    Attributes
    ----------
    state, bias : names of the a components of the first stage and the r of the second.
    x0 : (n, a), the state as if the bias were what it is assumed to be beforehand; sigma_x0 : (n, a), what that filter
        believes of it.
    V : (n, a, r), the blend: x = x0 + V (b - assumed b).
    track : of the whole: beliefs of state and bias together, and innovations.
    last, unit, inside, chi2 : both stages at the end in units of typical sizes (w,), which of the components are the
        state's, and the sum of squared normalised innovations.
    """

    state: tuple[str, ...]
    bias: tuple[str, ...]
    x0: Array
    sigma_x0: Array
    V: Array
    track: Track
    last: TwoStage
    unit: Array
    inside: npt.NDArray[np.bool_]
    chi2: float


def stages(problem: LinearProblem) -> Stages:
    """Run both stages and keep what they believed, time-correlated nuisances being part of the bias.

    Raises
    ------
    InputError
        As `solve`.
    """
    _partition, _ = _parted(problem)
    moving = Moving.of(problem)
    names = np.array(moving.names, dtype=object)
    inside = np.isin(names, _state_names(problem))
    unit = _typical(moving)
    track, kept = Track.empty(moving), []
    prior = moving.factor / unit[:, None]
    K = prior @ prior.T
    stage = TwoStage.start(
        np.zeros(np.count_nonzero(inside)),
        np.zeros(np.count_nonzero(~inside)),
        K[np.ix_(inside, inside)],
        K[np.ix_(~inside, ~inside)],
        K[np.ix_(inside, ~inside)],
    )
    H, v = moving.H * unit, moving.residual - moving.H @ moving.mean
    chi2 = 0.0
    for k in range(len(v)):
        stage = _advanced(stage, moving.step(k), inside, unit)
        stage, seen = update(stage, v[k], H[k][:, inside], H[k][:, ~inside], moving.R[k])
        chi2 += seen.square
        mean, factor = _joint(stage, inside)
        track.mean[k], track.factor[k] = moving.mean + unit * mean, unit[:, None] * factor
        track.innovation[k], track.spread[k] = seen.told, np.linalg.cholesky(seen.total)
        kept.append((stage.x0, np.sqrt(np.diag(stage.P)), stage.V))
    x0, sigma, V = (np.array(part) for part in zip(*kept))
    own = unit[inside]
    return Stages(
        state=tuple(names[inside]),
        bias=tuple(names[~inside]),
        x0=moving.mean[inside] + own * x0,
        sigma_x0=own * sigma,
        V=own[:, None] * V / unit[~inside],
        track=track,
        last=stage,
        unit=unit,
        inside=inside,
        chi2=chi2,
    )


def _advanced(
    stage: TwoStage, step: tuple[Array, Array] | None, inside: npt.NDArray[np.bool_], unit: Array
) -> TwoStage:
    """Both stages before the next measurement: the bias moves, the state stands still."""
    if step is None:
        return stage
    F, Q = (part[np.ix_(~inside, ~inside)] for part in step)
    size, nothing = unit[~inside], np.zeros_like(stage.P)
    system = System(
        A=np.eye(len(stage.x0)),
        D=np.zeros((len(stage.x0), len(size))),
        B=F * size / size[:, None],
        Q_x=nothing,
        Q_b=Q / size[:, None] / size,
    )
    return predict_hsieh_chen(stage, system)


def _state_names(problem: LinearProblem) -> tuple[str, ...]:
    """Parameters of the first estimated block."""
    return next(block.names for block in problem.blocks if block.treatment == "estimated")


def _parted(problem: LinearProblem) -> tuple[Partition, npt.NDArray[np.bool_]]:
    """The partition of a problem that two stages can solve, and which of its parameters are the state's."""
    partition = Partition.of(problem)
    inside = np.isin(partition.estimated, _state_names(problem))
    if partition.n_free:
        raise InputError(
            "the two-stage filter needs a prior for every estimated parameter; recursive.solve does without"
        )
    drifting = any(markov.treatment == "estimated" for markov in problem.markov)
    if inside.all() and not drifting:
        raise InputError("the two-stage filter has no second stage: nothing but the state is estimated")
    if partition.n_unknowns < len(partition.estimated):
        raise InputError("the two-stage filter needs regular priors, and one holds a combination exactly")
    return partition, inside


def _typical(moving: Moving) -> Array:
    """Sizes (w,) of the components: sigmas beforehand, of a nuisance that begins at zero those of its steps."""
    unit = np.linalg.norm(moving.factor, axis=1)
    for chain in moving.chains:
        grown = np.sqrt(np.einsum("rqq->q", chain.Q[1:]))
        unit[chain.span] = np.where(unit[chain.span] > 0.0, unit[chain.span], grown)
    return np.where(unit > 0.0, unit, 1.0)


def _unresolved(problem: LinearProblem, partition: Partition, rows: Array) -> Estimate:
    """The answer where the covariances have lost their digits."""
    size, width = partition.n_unknowns, rows.shape[2]
    triangle = append_rows(prior_rows(partition, width), rows.reshape(-1, width))
    return not_observable(problem, partition, conditioning(triangle[:size, :size]), UNRESOLVED)


def _dressed(
    problem: LinearProblem,
    partition: Partition,
    whitener: Whitener,
    rows: Array,
    joint: tuple[Array, Array],
    unit: Array,
    chi2: float,
) -> Estimate:
    """The estimate that a belief of the parameters is, mean (s,) and factor (s, s) in their units."""
    solved = _solved(joint, chi2, rows, solve_square(partition.T, np.diag(unit)))
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
        stage, seen = update(stage, rows[k, :, size], C[k], G[k], noise)
        chi2 += seen.square
    return stage, chi2


def _joint(stage: TwoStage, inside: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """The blend: mean (w,) and factor (w, w), which is [[L_x, V L_b], [0, L_b]], nothing subtracted."""
    size, split = len(inside), len(stage.x0)
    factor, mean = np.zeros((size, size)), np.zeros(size)
    L_b = covariance_factor(stage.P_b, "bias")
    wide = split + L_b.shape[1]  # a nuisance may begin without any error
    factor[np.ix_(inside, np.arange(size) < split)] = np.linalg.cholesky(stage.P)
    factor[np.ix_(inside, np.arange(split, wide))] = stage.V @ L_b
    factor[np.ix_(~inside, np.arange(split, wide))] = L_b
    mean[inside], mean[~inside] = stage.x, stage.b
    return mean, factor


def _solved(joint: tuple[Array, Array], chi2: float, rows: Array, back: Array) -> Solved:
    """A belief of the parameters in the unknowns of the partition; back (s_y, s), from its units to them."""
    mean, factor = joint
    S = back @ factor
    left_out = rows[:, :, len(mean) + 1 :]
    M = S @ (S.T @ np.einsum("npi,npj->ij", rows[:, :, : len(mean)], left_out))
    return Solved(y=back @ mean, S=S, M=M, chi2=chi2)
