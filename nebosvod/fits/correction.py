"""Differential correction: damped Gauss-Newton of state and dynamic parameters, white noise, arrays only.

The cheap inner loop of a fit. Each iteration is one propagation, which re-uses steps and ephemeris nodes of the last
one, one pass over all observations, and one reduction of the whitened rows; the step is halved until the cost drops.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Trajectory
from nebosvod.dynamics.impact import fly
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Status
from nebosvod.estimation.problem.descent import Step, Trial, descend
from nebosvod.estimation.problem.reduction import reduced, solved
from nebosvod.estimation.problem.square_root import Conditioning, append_rows, conditioning, solve_upper
from nebosvod.observation import Observation
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
TOLERANCE = 1e-3  # of a sigma, root mean square over the parameters: what is left of the step when it has converged
# Of a cost, which must not stop an iteration that stands at its minimum: 10^4 km from the Earth directions carry
# 3e-12 rad, and with residuals of 70 sigma the cost 4e-9 of itself (2024 BX1, all outliers kept)
ROUND_OFF = 1e-8
LIMIT = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Knowledge:
    """What is known of state and parameters beforehand, as rows U (x - mean) = 0 +- 1.

    Parameters
    ----------
    U : shape (k, 6 + m), an inverse factor of the covariance; zero columns where nothing is known.
    mean : shape (6 + m,), km, km/s and the parameters' own units; or (k, 6 + m), one for each row.
    """

    U: Array
    mean: Array

    def rows(self, x: Array) -> Array:
        """The rows [U | U (mean - x)], shape (k, 7 + m)."""
        return np.column_stack([self.U, np.sum(self.U * (self.mean - x), axis=1)])

    def beside(self, other: "Knowledge") -> "Knowledge":
        """Both together."""
        means = [np.broadcast_to(one.mean, one.U.shape) for one in (self, other)]
        return Knowledge(U=np.vstack([self.U, other.U]), mean=np.vstack(means))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correction:
    """Where a differential correction ended.

    Attributes
    ----------
    status : how; anything but `converged` says that the numbers below are of the last point, not of a minimum.
    x : (6 + m,) heliocentric ICRF state at the epoch of the sky, km, km/s, and dynamic parameters.
    S : (6 + m, 6 + m) factor of the covariance, K = S S^T; None where not observable.
    trajectory, seen : the orbit through x, and what it says of every observation, selected or not.
    residual : (n, 2) observed minus computed, (wrapped dRA cos Dec, dDec), rad, of every observation.
    cost : sum of the squared whitened residuals of the selected observations, and of the prior's.
    step : length of the last full step in sigmas.
    """

    status: Status
    x: Array
    S: Array | None
    conditioning: Conditioning
    trajectory: Trajectory
    seen: Observation
    residual: Array
    cost: float
    step: float
    iterations: int

    @property
    def state(self) -> Array:
        """Heliocentric ICRF state (6,)."""
        return self.x[:6]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """One linearisation: x, the orbit through it, its look at the sky, its rows as a triangle [R | z], and its cost."""

    x: Array
    trajectory: Trajectory
    seen: Observation
    residual: Array
    triangle: Array
    cost: float


def correct(
    sky: Sky,
    x: Array,
    forces: ForceModel,
    *,
    selected: Flags | None = None,
    prior: Knowledge | None = None,
    near: Correction | None = None,
    limit: int = LIMIT,
    tolerance: float = TOLERANCE,
) -> Correction:
    """Fit state and parameters to the selected observations.

    Parameters
    ----------
    x : shape (6 + m,), start: heliocentric ICRF state at the epoch of the sky, and a value for each of
        `forces.parameters`.
    selected : shape (n,), which observations count; all by default.
    near : an earlier correction of the same directions and forces, whose steps, ephemeris nodes and light times are
        used again; where it stands at x, its orbit.

    Raises
    ------
    InputError, CoverageError, EventError
        If the start itself cannot be propagated over the observations; later trouble only shortens a step.
    """
    chosen = np.ones(len(sky), dtype=bool) if selected is None else selected
    start = _at(sky, x, forces, chosen, prior, near)

    def attempt(point: Point, step: Step[Array], fraction: float) -> Trial[Point] | None:
        try:
            trial = _at(sky, point.x + fraction * step.what, forces, chosen, prior, point)
        except (EventError, CoverageError, InputError):
            return None  # an orbit that cannot be propagated has no cost
        return Trial(point=trial, cost=trial.cost, own_cost=trial.cost)

    ended = descend(start, start.cost, _solved, attempt, tolerance=tolerance, limit=limit, round_off=ROUND_OFF)
    point, status = ended.point, ended.status
    R = point.triangle[: len(x), : len(x)]
    condition = conditioning(R)
    if status is not Status.NOT_OBSERVABLE and not condition.observable:
        status = Status.NOT_OBSERVABLE
    return Correction(
        status=status,
        x=point.x,
        S=solve_upper(R, np.eye(len(x))) if condition.observable else None,
        conditioning=condition,
        trajectory=point.trajectory,
        seen=point.seen,
        residual=point.residual,
        cost=point.cost,
        step=ended.lengths[-1] if ended.lengths else np.inf,
        iterations=len(ended.damping),
    )


def _at(
    sky: Sky, x: Array, forces: ForceModel, chosen: Flags, prior: Knowledge | None, near: Correction | Point | None
) -> Point:
    """Propagate, look, and reduce the whitened rows [H | v] of the chosen observations and of the prior."""
    if near is not None and np.array_equal(x, near.x):  # only weights and selection are others
        trajectory, seen = near.trajectory, near.seen
    else:
        model = forces.with_values(dict(zip(forces.parameters, x[6:].tolist()))) if forces.parameters else forces
        grid, tau = (None, None) if near is None else (near.trajectory, near.seen.light_time_s)
        trajectory = fly(x[:6], sky.epoch, sky.span_s, model, grid)
        seen = compute(trajectory, sky.exposures, tau)
    off = sky.residual(seen.psi)
    known = np.zeros((0, len(x) + 1)) if prior is None else prior.rows(x)
    start = append_rows(np.zeros((0, len(x) + 1)), known) if len(known) else known
    triangle, cost = reduced(seen.H, off, sky.whitener, chosen, start)
    return Point(
        x=x, trajectory=trajectory, seen=seen, residual=off, triangle=triangle,
        cost=cost + float(known[:, -1] @ known[:, -1]),
    )  # fmt: skip


def _solved(point: Point, cost: float) -> Step[Array]:
    """The full step (6 + m,) from a point; without a length where its rows do not determine it."""
    step, length = solved(point.triangle, 1e-13)
    # |R step| = |z|: the step in sigmas, and what its cost loses
    return Step(what=step, length=length / math.sqrt(len(step)), promised=0.0 if math.isnan(length) else length**2)
