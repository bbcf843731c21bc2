"""One estimator on one set of measurements: Gauss-Newton from the nominal point, with the solver the mission names."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.engine.assembly import linear_problem, view
from nebosvod.engine.extended import held_against, lost, pass_through
from nebosvod.engine.filtering import MOST, Filtered, Path, filtered, linear_path, with_process_noise
from nebosvod.engine.mean_errors import MeanErrors, mean_errors
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Estimate, History, IterationResult, LinearProblem, Status, gauss_newton
from nebosvod.estimation.solvers import batch, recursive, separated, sequential
from nebosvod.mission import Estimator
from nebosvod.mission.request import EXTENDED, OWN_GAIN, WITH_HISTORY
from nebosvod.observation import Observation
from nebosvod.scene.point import Point, View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
TOLERANCE = 1e-4  # of a sigma, root mean square over the parameters


def as_printed(problem: LinearProblem) -> Estimate:
    """The filter as printed; what it warns of is a note of its estimate, for the report to say."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = sequential.solve(problem, "as_printed")
    said = sequential.as_printed_takes_afresh(problem)
    return replace(found, notes=(*found.notes, said)) if said else found


SOLVERS: Mapping[str, Callable[[LinearProblem], Estimate]] = {
    "batch_qr": partial(batch.solve, way="qr"),
    "batch_blocks": partial(batch.solve, way="blocks"),
    "batch_identity": partial(batch.solve, way="identity"),
    "recursive": partial(recursive.solve, history=False),
    "two_stage": separated.solve,
    "schmidt": partial(sequential.solve, gain="schmidt"),
    "as_printed": as_printed,
    "levenberg_marquardt": partial(batch.solve, way="qr"),
    # of one linear problem these are the augmented filter
    "ekf": partial(recursive.solve, history=False),
    "iterated_ekf": partial(recursive.solve, history=False),
    "hsieh_chen": separated.solve_drifting,
    "smoother": partial(recursive.solve, history=False),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """What one estimator found.

    Attributes
    ----------
    estimate : of the problem linearised at the last point (`seen`), deviations counted from the start.
    point : the estimated values; start values where nothing could be estimated, assumed ones of what is left out.
    problem : the last linear problem.
    seen : orbit and computed measurements at the last point.
    history : sigmas after each measurement, of the gain of least squares; None for another gain, and where the
        problem is not observable.
    mean_errors : what is off on average from what the estimator assumes.
    filtered : what a filter believed after each measurement, of the methods that keep it.
    deviation : of the point where `problem` is linearised from the start.
    """

    estimator: Estimator
    estimate: Estimate
    status: Status
    message: str
    iterations: int
    cost: tuple[float, ...]
    point: Point
    problem: LinearProblem
    seen: View
    history: History | None
    mean_errors: MeanErrors
    filtered: Filtered | None = None
    deviation: Mapping[str, float] = field(default_factory=dict)

    def mean_error(self, W: Array, names: Sequence[str]) -> Array:
        """Mean (d,) of estimated minus true w = W x, for what is off on average."""
        moved: Array = W @ self.mean_errors.shift(self.estimate, names)
        return moved

    @property
    def limited(self) -> bool:
        """Whether it takes the measurements of some telescopes alone."""
        return self.problem.weightless > 0

    @property
    def own_gain(self) -> bool:
        """Whether the estimator weighs otherwise than least squares."""
        return self.estimator.method in OWN_GAIN

    @property
    def trajectory(self) -> Trajectory:
        """The orbit through the last point."""
        return self.seen.trajectory

    @property
    def observation(self) -> Observation:
        """The measurements computed at the last point."""
        return self.seen.observation

    @property
    def prior_sigmas(self) -> dict[str, float]:
        """Prior standard deviation of every parameter that has one."""
        return {
            name: float(np.sqrt(prior.covariance[index, index]))
            for prior in self.problem.priors
            for index, name in enumerate(prior.names)
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Convergence:
    """Where the iteration of one estimator ended.

    Attributes
    ----------
    found : its outcome, deviations counted from the start.
    problem : linearised at the last point, priors about the start.
    seen : orbit and computed measurements at the last point.
    path : of a filter that went through the measurements one by one.
    """

    found: IterationResult
    problem: LinearProblem
    seen: View
    path: Path | None = None

    @property
    def point(self) -> Point:
        """The estimated values; assumed ones of what is left out."""
        return taken(self.seen.point, self.found.estimate)


def converge(
    scene: Scene,
    estimator: Estimator,
    start: View,
    observed_psi: Array,
    priors: PriorTable,
    tolerance: float = TOLERANCE,
) -> Convergence:
    """Iterate an estimator to its end; parameters as of `fit`, whose numbers these are without the rest."""
    if estimator.method in EXTENDED:
        return _passed_through(scene, estimator, start, observed_psi, priors)
    latest: list[tuple[dict[str, float], View, LinearProblem]] = []

    def linearise(deviation: Mapping[str, float]) -> LinearProblem:
        moved = {name: value for name, value in deviation.items() if value != 0.0}
        near = start.observation.light_time_s
        seen = view(scene, start.point.moved(moved), near, simulates=False) if moved else start
        problem = linear_problem(scene, estimator, seen, observed_psi, priors, about=start.point)
        latest[:] = [(moved, seen, problem)]
        return problem

    solve, damped = SOLVERS[estimator.method], estimator.method not in OWN_GAIN
    found = gauss_newton(
        linearise,
        solve=solve,
        limit=estimator.iterations,
        damped=damped,
        tolerance=tolerance,
        bent=estimator.method == "levenberg_marquardt",
    )
    # the last call of the iteration may have been a rejected trial: then the view is taken anew where it ended
    if latest[0][0] != {name: value for name, value in found.deviation.items() if value != 0.0}:
        linearise(found.deviation)
    return Convergence(found=found, problem=latest[0][2], seen=latest[0][1])


def _passed_through(
    scene: Scene, estimator: Estimator, start: View, observed_psi: Array, priors: PriorTable
) -> Convergence:
    """The end of an extended filter, and the orbit through it."""
    problem = linear_problem(scene, estimator, start, observed_psi, priors, about=start.point)
    passed = pass_through(scene, start, problem, observed_psi, estimator.method == "iterated_ekf")
    seen = start
    if passed.found.estimate.solution is not None:
        point = start.point.moved(passed.found.deviation)
        try:
            seen = view(scene, point, start.observation.light_time_s, simulates=False)
        except (InputError, CoverageError, EventError) as error:
            passed = lost(problem, passed.path, error)
        else:
            there = linear_problem(scene, estimator, seen, observed_psi, priors, about=start.point)
            passed = held_against(passed, there)
    return Convergence(found=passed.found, problem=passed.problem, seen=seen, path=passed.path)


def fit(
    scene: Scene,
    estimator: Estimator,
    start: View,
    observed_psi: Array,
    priors: PriorTable,
    *,
    tolerance: float = TOLERANCE,
    history: bool = True,
) -> Fit:
    """Estimate from measured directions, drawn or recorded.

    Parameters
    ----------
    start : the nominal point, seen; priors stay about it while the iteration moves.
    observed_psi : shape (n, 2), rad, rows as the exposures of the scene.
    tolerance : of a sigma: a step shorter than this ends the iteration.
    history : whether the sigmas after each measurement are wanted.
    """
    ended = converge(scene, estimator, start, observed_psi, priors, tolerance)
    found = ended.found
    shown = history and found.estimate.solution is not None and estimator.method not in OWN_GAIN
    return Fit(
        estimator=estimator,
        estimate=found.estimate,
        status=found.status,
        message=found.message,
        iterations=found.iterations,
        cost=found.cost,
        point=ended.point,
        problem=ended.problem,
        deviation=found.deviation,
        seen=ended.seen,
        history=recursive.solve(ended.problem).history if shown else None,
        mean_errors=mean_errors(
            scene,
            estimator,
            ended.seen.terms,
            priors,
            ended.problem,
            None if found.estimate.solution is None else SOLVERS[estimator.method],
        ),
        filtered=_filtered(scene, ended, estimator, start) if history and estimator.method in WITH_HISTORY else None,
    )


def _filtered(scene: Scene, ended: Convergence, estimator: Estimator, start: View) -> Filtered | None:
    """What the filter believed on its way; None where there is no estimate, or the arc is too long to keep it."""
    found = ended.found
    if found.estimate.solution is None or ended.problem.n > MOST:
        return None
    noise, t_s = process_noise_of(scene.nuisances), ended.seen.observation.t_s
    if ended.path is not None:
        return filtered(with_process_noise(ended.path, noise, start.point, t_s), start.point, ended.seen)
    path = linear_path(ended.problem, found.deviation, ended.seen, estimator.method)
    return filtered(with_process_noise(path, noise, ended.seen.point, t_s), ended.seen.point, ended.seen)


def taken(point: Point, estimate: Estimate) -> Point:
    """The last point of an iteration, with what the estimator leaves out at the value it assumes."""
    if estimate.solution is None:
        return point
    return point.moved({name: estimate.value(name) for name in estimate.left_out})
