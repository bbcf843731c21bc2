"""The extended Kalman filter of a mission: each measurement is linearised at what the ones before it say.

The state of the filter is the current one, carried from measurement to measurement by the equations of motion at the
parameters estimated so far. Its covariance is kept in terms of the state at the reference epoch, x_k = Phi_k x0 +
zeta_k c along the filter's own path, where nothing has to be carried and a square root stays one: the same filter, seen
from there. The iterated filter moves the point of linearisation within each measurement, which counts once. Partials by
errors of the telescopes are those of the nominal orbit.

References
----------
Tapley, Schutz, Born 2004, Statistical Orbit Determination, section 4.7: the extended filter.
Guo, Ivashkin 2018, KIAM preprint 213, (2.143)-(2.146).
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.dynamics.impact import fly
from nebosvod.engine.filtering import Path, state_columns
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import IterationResult, LinearProblem, Status
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.solvers import batch, recursive
from nebosvod.estimation.solvers.iteration import recentred, step_length
from nebosvod.estimation.solvers.tracked import Moving, Track
from nebosvod.observation import Common, residual
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
TOLERANCE = 1e-4  # of a sigma, that a measurement may still move its point when it is left
FAR = 1.0  # of a sigma, root mean square, from the minimum: what is left of second-order terms is no estimate
WENT_ONCE = "The filter went once through the measurements; it does not return to them."
LOST = "The filter lost the orbit: {}."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passed:
    """Where a filter ended, the problem of its own linearisations about the start, and its way."""

    found: IterationResult
    problem: LinearProblem
    path: Path


def pass_through(scene: Scene, start: View, problem: LinearProblem, observed_psi: Array, iterated: bool) -> Passed:
    """Filter the measurements in the order of time.

    Parameters
    ----------
    start : the nominal point, seen. problem : linearised there.
    observed_psi : shape (n, 2), rad.
    iterated : whether each measurement is linearised anew until its point stands still.
    """
    moving = Moving.of(problem)
    run = _Run.begin(scene, start, problem, moving, observed_psi)
    try:
        for k in range(problem.n):
            run.take(k, iterated)
        x0 = run.at_the_epoch()
    except (InputError, CoverageError, EventError) as error:
        return lost(problem, run.path(), error)
    own = run.linearised()
    estimate = recursive.solve(own, history=False)
    status, message = Status.CONVERGED, WENT_ONCE
    if estimate.solution is None:
        status, message = estimate.status, estimate.message
    elif run.unsettled:
        status = Status.ITERATION_LIMIT
        message = f"{WENT_ONCE} {run.unsettled} of {problem.n} measurements were left before their point stood still."
    mean = run.belief.mean[: len(estimate.names)].copy()
    place = [estimate.names.index(name) for name in STATE_NAMES]
    mean[place] = x0 - start.point.state
    if estimate.solution is not None:
        estimate = replace(estimate, solution=replace(estimate.solution, mean=mean))
    found = IterationResult(
        estimate=replace(estimate, status=status, message=message),
        status=status,
        message=message,
        iterations=1,
        deviation=dict(zip(estimate.names, mean.tolist())),
        cost=() if estimate.solution is None else (estimate.chi2,),
        steps=(),
        damping=(),
    )
    return Passed(found=found, problem=own, path=run.path())


def lost(problem: LinearProblem, path: Path, reason: Exception) -> Passed:
    """The end of a filter whose orbit is none."""
    message = LOST.format(str(reason).rstrip("."))
    estimate = replace(batch.solve(problem), status=Status.DIVERGED, message=message, solution=None)
    found = IterationResult(
        estimate=estimate, status=Status.DIVERGED, message=message, iterations=1,
        deviation=dict.fromkeys(estimate.names, 0.0), cost=(), steps=(), damping=(),
    )  # fmt: skip
    return Passed(found=found, problem=problem, path=path)


def held_against(passed: Passed, there: LinearProblem) -> Passed:
    """The end of a filter, doubted where the problem linearised there says that its minimum is far.

    Parameters
    ----------
    there : linearised where the filter ended, priors about the start.
    """
    step = recursive.solve(recentred(there, passed.found.deviation), history=False)
    far = np.inf if step.solution is None else step_length(step)
    if not far > FAR or passed.found.estimate.solution is None:
        return passed
    message = f"{WENT_ONCE} It ended {far:.3g} sigmas from the minimum of the cost: the problem bends too much for it."
    status = Status.DIVERGED
    estimate = replace(passed.found.estimate, status=status, message=message)
    return replace(passed, found=replace(passed.found, estimate=estimate, status=status, message=message))


@dataclass(slots=True, kw_only=True, eq=False)
class _Run:
    """The running filter: the current state at time t, how components move it, the belief; and what it leaves behind.

    Attributes
    ----------
    partials : (6, 6 + m) of the current state by the state at the epoch and all parameters, along the filter's path.
    shift : (n, 2) what the nuisances at the start do to the directions.
    """

    scene: Scene
    start: View
    problem: LinearProblem
    moving: Moving
    observed: Array
    shift: Array
    t_s: float
    x: Array
    partials: Array
    belief: Belief
    track: Track
    states: Array
    W: Array
    rows: Array
    told: Array
    unsettled: int = 0

    @classmethod
    def begin(cls, scene: Scene, start: View, problem: LinearProblem, moving: Moving, observed: Array) -> "_Run":
        """Stand at the reference epoch with what is known beforehand."""
        n, m = problem.n, len(start.observation.parameter_names)
        shift = np.zeros((n, 2))
        for term in start.terms:
            if isinstance(term, Common):
                shift += term.H @ np.array([start.point.nuisances[name] for name in term.names])
        place = [moving.names.index(name) for name in STATE_NAMES]
        return cls(
            scene=scene,
            start=start,
            problem=problem,
            moving=moving,
            observed=observed,
            shift=shift,
            t_s=0.0,
            x=start.point.state + moving.mean[place],
            partials=np.eye(6, 6 + m),
            belief=moving.prior,
            track=Track.empty(moving),
            states=np.empty((n, 6)),
            W=np.empty((n, 6, len(moving.names))),
            rows=np.empty((n, 2, 6 + m)),
            told=np.empty((n, 2)),
        )

    def take(self, k: int, iterated: bool) -> None:
        """Go to measurement k and take it in."""
        self._go_to(float(self.scene.exposures.t_s[k]))
        before = self.moving.carried(self.belief, k)
        W = self.W[k] = state_columns(self.moving, self.partials[None], self.start.observation.parameter_names)[0]
        latest = np.empty((2, len(self.moving.names)))

        def measure(s: Array) -> tuple[Array, Array]:
            """Predicted minus observed, so that nothing is observed: RA has no zero to count from."""
            v, latest[:] = self._seen(k, self.x + W @ (s - before.mean), s)
            return -v, latest.copy()

        value, H = measure(before.mean)
        if iterated:
            R = self.moving.R[k]
            after, seen, settled = kalman.iterated_update(before, np.zeros(2), measure, R, tolerance=TOLERANCE)
            self.unsettled += not settled
        else:
            after, seen = kalman.update(before, -value, H, self.moving.R[k])
        # a linear filter with these partials and this residual does the same
        self.told[k] = seen.residual + latest @ before.mean
        self.x = self.x + W @ (after.mean - before.mean)
        self.belief = after
        self.track.keep(k, after, seen, -value)
        self.states[k] = self.x

    def _go_to(self, t_s: float) -> None:
        """Carry the current state, and its partials, by the equations of motion at the parameters estimated."""
        gap = t_s - self.t_s
        if gap == 0.0:
            return
        leg = fly(self.x, self.scene.epoch + self.t_s, (min(gap, 0.0), max(gap, 0.0)), self._forces(self.belief.mean))
        at = leg.at([gap])
        self.partials = at.Phi[0] @ self.partials
        self.partials[:, 6:] += at.zeta[0]
        self.x, self.t_s = at.state[0], t_s

    def _forces(self, s: Array) -> ForceModel:
        """The forces at the parameters of the components s."""
        free = self.start.point.parameters
        moved = dict(zip(self.moving.names, s.tolist()))
        return self.scene.forces.with_values({name: value + moved.get(name, 0.0) for name, value in free.items()})

    def _seen(self, k: int, x: Array, s: Array) -> tuple[Array, Array]:
        """Observed minus predicted (2,) at measurement k for a state x and components s; its partials (2, w) by s."""
        epoch = self.scene.epoch + self.t_s
        leg = fly(x, epoch, (0.0, 0.0), self._forces(s))
        exposure = self.scene.exposures.select(np.array([k])).counted_from(epoch)
        near = self.start.observation.light_time_s[k : k + 1]
        seen = compute(leg, exposure, near, simulates=False)
        self.rows[k] = seen.H_x0[0] @ self.partials
        self.rows[k][:, 6:] += seen.H_c[0]
        H = self.moving.H[k].copy()
        column = {name: j for j, name in enumerate((*STATE_NAMES, *seen.parameter_names))}
        orbit = [j for j, name in enumerate(self.moving.names) if name in column]
        H[:, orbit] = self.rows[k][:, [column[self.moving.names[j]] for j in orbit]]
        beside = [j for j in range(len(self.moving.names)) if j not in set(orbit)]
        v = residual(self.observed[k : k + 1], offset(seen.psi, self.shift[k : k + 1]))[0]
        v = v + (self.moving.residual[k] - self.problem.residual[k])  # assumed means of what is left out
        return v - self.moving.H[k][:, beside] @ s[beside], H

    def at_the_epoch(self) -> Array:
        """The last state carried back to the reference epoch (6,)."""
        self._go_to(0.0)
        return self.x

    def linearised(self) -> LinearProblem:
        """The problem about the start whose linear filter does what this one did."""
        columns = {name: j for j, name in enumerate((*STATE_NAMES, *self.start.observation.parameter_names))}
        blocks = tuple(
            replace(block, H=self.rows[:, :, [columns[name] for name in block.names]])
            if block.names[0] in columns
            else block
            for block in self.problem.blocks
        )
        off = self.moving.residual - self.problem.residual
        return replace(self.problem, residual=self.told - off, blocks=blocks)

    def path(self) -> Path:
        """What it left behind."""
        return Path(moving=self.moving, track=self.track, state=self.states, about=self.track.mean, W=self.W)
