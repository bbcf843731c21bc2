"""Gauss-Newton for a nonlinear problem, with the prior kept where it was and damped steps.

Re-using the last estimate as the prior mean with an unchanged covariance (as (2.110) of Guo and Ivashkin is
printed) converges to the solution WITHOUT the prior while the covariance keeps it. Here the priors stay about the
start point by construction: the caller linearises anew and never touches them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation.problem.descent import Step, Trial, descend
from nebosvod.estimation.problem.estimate import Estimate, Status
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import left_inverse, whiten
from nebosvod.estimation.problem.whitening import Whitener
from nebosvod.estimation.solvers.batch import solve as solve_batch

Array = npt.NDArray[np.float64]
LEAST_DAMPING = 1e-3  # Marquardt's parameter of the first step that is bent; it grows to 1e9
Linearise = Callable[[Mapping[str, float]], LinearProblem]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IterationResult:
    """Outcome of an iteration.

    Attributes
    ----------
    estimate : of the problem linearised at the last point; its mean is the deviation from the START point.
    status, message : how it ended, as a word and as a sentence.
    iterations : steps taken.
    deviation : estimated parameters as deviations from the start point.
    cost : chi2 at the start and after each step (residuals, nuisances and priors).
    steps : length of each full step in sigmas, root mean square over the parameters.
    damping : fraction of each full step that was taken.
    """

    estimate: Estimate
    status: Status
    message: str
    iterations: int
    deviation: dict[str, float]
    cost: tuple[float, ...]
    steps: tuple[float, ...]
    damping: tuple[float, ...]


def gauss_newton(
    linearise: Linearise,
    start: Mapping[str, float] | None = None,
    *,
    solve: Callable[[LinearProblem], Estimate] = solve_batch,
    tolerance: float = 1e-4,
    limit: int = 20,
    damped: bool = True,
    bent: bool = False,
) -> IterationResult:
    """Minimise the nonlinear cost, residuals plus priors, by damped Gauss-Newton steps.

    Parameters
    ----------
    linearise : takes deviations of the estimated parameters from the start point by name (absent = 0) and returns
        the problem there: residual and partials at that point, PRIORS ABOUT THE START POINT, the same each time.
    start : deviations to begin from.
    solve : the linear solver of each step.
    tolerance : convergence when a full step is shorter than this many sigmas (root mean square).
    limit : number of steps allowed.
    damped : False takes every step whole: for a solver with a gain of its own, whose estimate is not the minimum of
        this cost. Such an iteration has converged only if its cost has not grown beyond what its own first step, in a
        linear world, would have made of it.
    bent : whether a step that must be shortened also turns towards steepest descent, as Levenberg's and Marquardt's.

    Returns
    -------
    IterationResult
        Status converged, iteration_limit, not_observable or diverged; never an exception for the last three.

    Notes
    -----
    s_i = s_{i-1} + lambda d with d from the problem at s_{i-1}, prior means moved to sbar - s_{i-1}: the same as
    s_i = sbar + k [psi - h(s_{i-1}) - H (sbar - s_{i-1})] for lambda = 1. lambda is halved with the same normal
    matrix until the cost drops by the Armijo fraction; the merit is the cost, never its gradient. The weights of a step
    are those where it begins: what the position of a telescope does to a direction goes with the distance, so a cost
    weighed anew has another gradient than the step, and no step, however short, need make it smaller.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (2.110): as printed it feeds the estimate back as the prior.
    """
    begin = dict(start or {})
    problem = linearise(begin)
    begin = {name: float(begin.get(name, 0.0)) for name in problem.names("estimated")}

    def solved(at: Linearised, value: float) -> Step[Estimate]:
        here = at.recentred
        estimate = solve(here)
        if estimate.solution is None:
            return Step(what=estimate, length=float("nan"), promised=0.0)
        # along the exact descent the cost falls towards the linear minimum
        promised = max(value - estimate.chi2, 0.0) if damped else value - _linear_cost(here, estimate)
        sound = _sound(estimate, value)
        return Step(what=estimate, length=step_length(estimate) if sound else np.inf, promised=promised, sound=sound)

    def attempt(at: Linearised, step: Step[Estimate], fraction: float) -> Trial[Linearised] | None:
        return _tried(linearise, at, step.what, _bent(step.what, fraction) if bent else fraction * step.what.mean)

    at = Linearised(deviation=begin, problem=problem)
    ended = descend(at, cost(at.recentred), solved, attempt, tolerance=tolerance, limit=limit, damped=damped)
    estimate, status = ended.step.what, ended.status
    if status is Status.CONVERGED and len(ended.damping) == limit:
        status = Status.ITERATION_LIMIT  # the limit counts the step that would have shown it
    return IterationResult(
        estimate=_about_start(estimate, ended.point.deviation),
        status=status,
        message=estimate.message if status is Status.NOT_OBSERVABLE else status.sentence,
        iterations=len(ended.damping),
        deviation=ended.point.deviation,
        cost=ended.cost,
        steps=ended.lengths,
        damping=ended.damping,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearised:
    """A point, by deviations of the estimated parameters from the start, and the problem there."""

    deviation: dict[str, float]
    problem: LinearProblem

    @property
    def recentred(self) -> LinearProblem:
        """The problem with its priors counted from the point."""
        return recentred(self.problem, self.deviation)


def cost(problem: LinearProblem) -> float:
    """Return chi2 of a problem at zero deviation: weighted residuals, minimised over nuisances, plus priors.

    A prior held exactly (zero covariance) does not contribute: the solver never leaves it.
    """
    partition = Partition.of(problem)
    rows = problem.residual[:, :, None].copy()
    for block in problem.blocks:
        if block.treatment in ("considered", "ignored"):
            place = [partition.left_out.index(name) for name in block.names]
            rows[:, :, 0] -= block.H @ partition.left_out_mean[place]
    Whitener.of(problem).whiten(rows)
    total = float(np.sum(rows**2))
    place_of = {name: index for index, name in enumerate(partition.estimated)}
    for source in partition.sources:
        inside = [place_of[name] for name in source.names[: source.inverse.shape[1]]]
        total += float(np.sum((source.inverse @ partition.mean[inside]) ** 2))
    return total


def recentred(problem: LinearProblem, point: Mapping[str, float]) -> LinearProblem:
    """Express the priors, given about the start of an iteration, about a point given by deviations from that start."""
    priors = tuple(
        replace(prior, mean=np.asarray(prior.mean) - np.array([point.get(name, 0.0) for name in prior.names]))
        for prior in problem.priors
    )
    return replace(problem, priors=priors)


def step_length(estimate: Estimate) -> float:
    """Length of a step from the linearisation point in sigmas: root mean square over independent directions."""
    whitened = whiten(estimate.S_formal, estimate.mean)
    return float(np.sqrt(np.mean(whitened**2))) if whitened.size else 0.0


def _sound(estimate: Estimate, value: float) -> bool:
    """Whether cost, estimate and sigmas are numbers: an overflow is no minimum."""
    with np.errstate(over="ignore"):
        sigma = np.linalg.norm(estimate.S_formal, axis=1)
    return bool(np.isfinite(value) and np.isfinite(estimate.mean).all() and np.isfinite(sigma).all())


def _linear_cost(problem: LinearProblem, estimate: Estimate) -> float:
    """What the cost of a problem would become by the step of an estimate if it were linear."""
    if estimate.solution is None:
        return 0.0
    step = dict(zip(estimate.names, estimate.mean))
    moved = np.array(problem.residual)
    for block in problem.blocks:
        if block.treatment == "estimated":
            moved -= block.H @ np.array([step[name] for name in block.names])
    return cost(recentred(replace(problem, residual=moved), step))


def _bent(estimate: Estimate, fraction: float) -> Array:
    """The step (s,) that Marquardt's parameter l = 1e-3 (1 / fraction - 1)^2 makes of a full one; the full one for 1.

    (N + l diag N) p = N p0 with N the information matrix, p0 the full step [Marquardt 1963, J. SIAM 11, 431]: from
    K = S S^T = N^-1, p = S (I + l S^T D S)^-1 S^-1 p0. Common nuisances take part, others are marginalised in K.
    """
    damping = LEAST_DAMPING * (1.0 / fraction - 1.0) ** 2
    if damping == 0.0:
        return estimate.mean
    inverse, S = left_inverse(estimate.S_formal), estimate.S_formal
    D = np.sum(inverse**2, axis=0)
    core = np.eye(S.shape[1]) + damping * (S.T * D) @ S
    step: Array = S @ np.linalg.solve(core, inverse @ estimate.mean)
    return step


def _tried(linearise: Linearise, start: Linearised, estimate: Estimate, step: Array) -> Trial[Linearised] | None:
    """Take a step (s,); None where there is no problem."""
    deviation = {name: start.deviation[name] + change for name, change in zip(estimate.names, step)}
    try:
        at = Linearised(deviation=deviation, problem=linearise(deviation))
        weighed = replace(at.problem, R=start.problem.R, white=start.problem.white, markov=start.problem.markov)
        return Trial(point=at, cost=cost(recentred(weighed, deviation)), own_cost=cost(at.recentred))
    except (InputError, CoverageError, EventError):
        return None  # the start was good; a step may lead out of the domain, or to where values overflow


def _about_start(estimate: Estimate, point: Mapping[str, float]) -> Estimate:
    """Express the mean of the last linear estimate as the deviation from the start."""
    if estimate.solution is None:
        return estimate
    moved = estimate.solution.mean + np.array([point[name] for name in estimate.names])
    return replace(estimate, solution=replace(estimate.solution, mean=moved))
