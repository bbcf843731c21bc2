"""What errors in boxes allow once the measurements are made, and which errors look like motion.

The guaranteed bound of `comparison` stands before the measurements are known. Realised, the set of orbits that
contradict no box is smaller, or empty: then the boxes are too narrow for what was measured, by the inflation told.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.errors import GeometryError
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy import extended, guaranteed
from nebosvod.estimation.solvers import batch
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.findings.comparison import LEVEL, boxed, thinned

Array = npt.NDArray[np.float64]
MOST_MEASUREMENTS = 100  # in a programme; leaving measurements out can only widen the set


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Realised:
    """Bounds (d,) of predicted components about what is predicted, from the measurements that were made.

    Attributes
    ----------
    lower, upper : of errors within LEVEL sigmas, or that many times `inflation`; None with a reason where none exist.
    inflation : smallest factor on all boxes that makes them agree with the measurements; 1 when they do.
    measurements : how many of them were used.
    """

    prediction: str
    unit: str
    lower: Array | None
    upper: Array | None
    inflation: float
    measurements: int
    reason: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Imitation:
    """The direction of the state that a group of common errors imitates best (Klaus), without its prior.

    Attributes
    ----------
    group : the errors. direction : weights by name, the largest 1, in the parameters' own units.
    condition_number : of what the group leaves of the state's partials; infinite where a direction is lost.
    """

    group: str
    direction: dict[str, float]
    condition_number: float


def realised(fit: Fit, predicted: Sequence[Quantity]) -> tuple[Realised, ...]:
    """The bounds of each prediction of an estimate."""
    whole = recentred(fit.problem, fit.deviation)
    problem = thinned(boxed(whole), MOST_MEASUREMENTS)
    found = batch.solve(whole)
    return tuple(_bounds(problem, found.names, found.mean, fit, quantity) for quantity in predicted)


def _bounds(problem: LinearProblem, names: tuple[str, ...], mean: Array, fit: Fit, asked: Quantity) -> Realised:
    W, known = known_partials(asked, fit.estimate)
    # the sizes of parameters and of what is predicted differ by powers of ten; so do components
    size = np.abs(W).max(axis=1, keepdims=True)
    size[size == 0.0] = 1.0
    try:
        bounds = guaranteed.bound(problem, W / size, known, LEVEL)
    except GeometryError as error:
        return Realised(
            prediction=asked.request.name,
            unit=asked.unit,
            lower=None,
            upper=None,
            inflation=1.0,
            measurements=problem.n,
            reason=str(error),
        )
    place = dict(zip(names, mean))
    offset = W @ np.array([place.get(name, 0.0) for name in known])
    return Realised(
        prediction=asked.request.name,
        unit=asked.unit,
        lower=bounds.lower * size[:, 0] - offset,
        upper=bounds.upper * size[:, 0] - offset,
        inflation=bounds.inflation,
        measurements=problem.n,
    )


def imitations(fit: Fit) -> tuple[Imitation, ...]:
    """For each group of common errors, which motion it looks like."""
    problem = fit.problem
    state, *others = problem.blocks
    rows = []
    for block in others:
        if block.treatment == "fixed":
            continue
        found = extended.bias_imitates(problem, state.name, block.name)
        rows.append(Imitation(group=block.name, direction=found.direction, condition_number=found.condition_number))
    return tuple(rows)
