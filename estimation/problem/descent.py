"""One damped iteration for every nonlinear least-squares problem of the program.

What a step is, and what a point costs, is the caller's: the estimators of a mission solve a linear problem with all its
nuisances in each step, the correction of an orbit reduces whitened rows. When to stop, and how far to go, stands here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from nebosvod.estimation.problem.estimate import Status

P = TypeVar("P")  # a point: wherever the problem is linearised
S = TypeVar("S")  # a step, in the caller's own words
ARMIJO = 1e-4
SHORTEST = 2.0**-20
EFFORT = 4  # points tried a step allowed, over the whole iteration: one that crawls is not going to converge
LEAST_TRIES = 40
GROWTH = 0.01  # of a cost, which second-order terms may add to what a linear step makes of it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step(Generic[S]):
    """A full step from a point.

    Attributes
    ----------
    length : in sigmas, root mean square over the parameters; nan where the problem does not determine them.
    promised : how much the cost falls by it in a linear world.
    sound : whether all of it are numbers.
    """

    what: S
    length: float
    promised: float
    sound: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Descent(Generic[P, S]):
    """Where an iteration ended.

    Attributes
    ----------
    point, step : the last point, and the step from there that was not taken.
    cost : at the start and after each step. lengths : of each full step. damping : fraction taken of each.
    """

    point: P
    step: Step[S]
    status: Status
    cost: tuple[float, ...]
    lengths: tuple[float, ...]
    damping: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial(Generic[P]):
    """A point that was tried: its cost by the weights of the point before, and by its own."""

    point: P
    cost: float
    own_cost: float


def descend(
    point: P,
    cost: float,
    solve: Callable[[P, float], Step[S]],
    attempt: Callable[[P, Step[S], float], Trial[P] | None],
    *,
    tolerance: float,
    limit: int,
    round_off: float = 1e-10,
    damped: bool = True,
) -> Descent[P, S]:
    """Step until a full step is short.

    Parameters
    ----------
    point, cost : the start.
    solve : the full step from a point, whose cost is told.
    attempt : the point that lies a fraction of a step on; None where there is none.
    tolerance : convergence when a full step is no longer than this, in sigmas.
    limit : number of steps allowed; and on average `EFFORT` points tried for each.
    round_off : of a cost, which must not stop an iteration that stands at its minimum.
    damped : False takes every step whole: for a solver with a gain of its own, whose estimate is not the minimum of
        this cost. Such an iteration has converged only if its cost has not grown beyond what its own first step, in a
        linear world, would have made of it.

    Notes
    -----
    A step is halved until the cost drops by Armijo's fraction of what is promised (Armijo 1966, Pac. J. Math. 16, 1);
    the merit is the cost, never its gradient.
    """
    costs = [cost]
    lengths: list[float] = []
    fractions: list[float] = []
    tries, most_tries = 0, max(EFFORT * limit, LEAST_TRIES)
    step = solve(point, cost)
    allowed = cost if damped else max(cost, cost - step.promised)
    while True:
        if np.isnan(step.length):
            status = Status.NOT_OBSERVABLE
            break
        if not (step.sound and np.isfinite(costs[-1])):
            status = Status.DIVERGED
            break
        lengths.append(step.length)
        if step.length <= tolerance:
            # where the partials vanish a step is short in sigmas, however far from any minimum
            grown = costs[-1] > allowed * (1.0 + GROWTH) + GROWTH
            status = Status.DIVERGED if grown else Status.CONVERGED
            break
        if len(fractions) == limit:
            status = Status.ITERATION_LIMIT
            break
        begun = (point, step)

        def tried(fraction: float, begun: tuple[P, Step[S]] = begun) -> Trial[P] | None:
            nonlocal tries
            tries += 1
            return attempt(*begun, fraction) if tries <= most_tries else None

        bound = costs[-1] + round_off * max(costs[-1], 1.0)
        found = shortened(tried, bound, step.promised) if damped else (tried(1.0), 1.0)
        if tries > most_tries:
            status = Status.ITERATION_LIMIT
            break
        if found is None or found[0] is None:
            status = Status.DIVERGED
            break
        point = found[0].point
        costs.append(found[0].own_cost)
        fractions.append(found[1])
        step = solve(point, costs[-1])
    return Descent(
        point=point,
        step=step,
        status=status,
        cost=tuple(costs),
        lengths=tuple(lengths),
        damping=tuple(fractions),
    )


def shortened(
    attempt: Callable[[float], Trial[P] | None], bound: float, promised: float
) -> tuple[Trial[P], float] | None:
    """The longest of the steps 1, 1/2, 1/4 ... by which the cost falls enough, and its fraction; None if none does.

    Parameters
    ----------
    attempt : the point that lies a fraction of the step on; None where there is none.
    bound : the cost at the start, with what round-off may add to it.
    promised : how much the whole step lowers the cost in a linear world; 0 asks for no more than no growth.
    """
    fraction = 1.0
    while fraction >= SHORTEST:
        found = attempt(fraction)
        if found is not None and found.cost <= bound - ARMIJO * fraction * promised:
            return found, fraction
        fraction *= 0.5
    return None
