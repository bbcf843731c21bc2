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
from nebosvod.estimation.problem.estimate import Estimate, Status
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import whiten
from nebosvod.estimation.problem.whitening import Whitener
from nebosvod.estimation.solvers.batch import solve as solve_batch

Array = npt.NDArray[np.float64]
Linearise = Callable[[Mapping[str, float]], LinearProblem]
ARMIJO = 1e-4
SHORTEST = 2.0**-20
GROWTH = 0.01  # of a cost, which second-order terms may add to what a linear step makes of it


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
    """
    point = dict(start or {})
    problem = linearise(point)
    names = problem.names("estimated")
    point = {name: float(point.get(name, 0.0)) for name in names}
    costs, lengths, dampings = [cost(recentred(problem, point))], [], []
    status = Status.ITERATION_LIMIT
    estimate = solve(recentred(problem, point))
    allowed = costs[0] if damped else max(costs[0], _linear_cost(recentred(problem, point), estimate))
    for _ in range(limit):
        if estimate.solution is None:
            status = Status.NOT_OBSERVABLE
            break
        if not _sound(estimate, costs[-1]):
            status = Status.DIVERGED
            break
        length = step_length(estimate)
        lengths.append(length)
        if length <= tolerance:
            # where the partials vanish a step is short in sigmas, however far from any minimum
            grown = costs[-1] > allowed * (1.0 + GROWTH) + GROWTH
            status = Status.DIVERGED if grown else Status.CONVERGED
            break
        begun = (linearise, point, problem, estimate)
        found = _damped(*begun, costs[-1]) if damped else _tried(*begun)
        if found is None:
            status = Status.DIVERGED
            break
        point, problem, _, fraction = found
        costs.append(cost(recentred(problem, point)))
        dampings.append(fraction)
        estimate = solve(recentred(problem, point))
    return IterationResult(
        estimate=_about_start(estimate, point),
        status=status,
        message=estimate.message if status is Status.NOT_OBSERVABLE else status.sentence,
        iterations=len(dampings),
        deviation=point,
        cost=tuple(costs),
        steps=tuple(lengths),
        damping=tuple(dampings),
    )


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


def _damped(
    linearise: Linearise, point: Mapping[str, float], start: LinearProblem, estimate: Estimate, before: float
) -> tuple[dict[str, float], LinearProblem, float, float] | None:
    """Halve the step until the cost drops enough; None when no step does."""
    # Along the exact descent the cost falls from `before` towards the linear minimum.
    promised = max(before - estimate.chi2, 0.0)
    fraction = 1.0
    while fraction >= SHORTEST:
        found = _tried(linearise, point, start, estimate, fraction)
        # Round-off of a cost of this size must not stop an iteration that stands at its minimum.
        if found is not None and found[2] <= before - ARMIJO * fraction * promised + 1e-10 * max(before, 1.0):
            return found
        fraction *= 0.5
    return None


def _tried(
    linearise: Linearise, point: Mapping[str, float], start: LinearProblem, estimate: Estimate, fraction: float = 1.0
) -> tuple[dict[str, float], LinearProblem, float, float] | None:
    """Take a fraction of a step: point, problem, cost by the weights of the start; None where there is no problem."""
    trial = {name: point[name] + fraction * step for name, step in zip(estimate.names, estimate.mean)}
    try:
        problem = linearise(trial)
        weighed = replace(problem, R=start.R, white=start.white, markov=start.markov)
        return trial, problem, cost(recentred(weighed, trial)), fraction
    except (InputError, CoverageError, EventError):
        return None  # the start was good; a step may lead out of the domain, or to where values overflow


def _about_start(estimate: Estimate, point: Mapping[str, float]) -> Estimate:
    """Express the mean of the last linear estimate as the deviation from the start."""
    if estimate.solution is None:
        return estimate
    moved = estimate.solution.mean + np.array([point[name] for name in estimate.names])
    return replace(estimate, solution=replace(estimate.solution, mean=moved))
