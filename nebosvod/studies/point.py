"""One point of a study: a mission's covariance at its reference orbit, and nothing that nobody asked for.

The first estimator, no drawn noise, no iteration: as a run, but for the terms of second order that its drawn truth
brings. Predictions and budgets are made when they are asked for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.engine.fitting import SOLVERS, fit
from nebosvod.engine.mean_errors import MeanErrors, mean_errors
from nebosvod.engine.quantity import M_PER_KM, Quantity, known_partials
from nebosvod.engine.trial import generator
from nebosvod.engine.truth import draw
from nebosvod.errors import GeometryError, NoAnswerError
from nebosvod.estimation import Estimate, LinearProblem
from nebosvod.findings.foretold import Missing, believable, predicted
from nebosvod.findings.nonlinearity import Nonlinearity
from nebosvod.findings.prediction import Answered, answered, unanswered
from nebosvod.mission import Mission, SkyPrediction
from nebosvod.mission.request import Prediction
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import PlannedScene, build_scene, seen_until
from nebosvod.scene.sharing import ALONE, Shared

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Seed:
    """Of a drawn truth.

    Attributes
    ----------
    own : seed and key of this point; outer : of the constant errors of telescopes, which many points have in common;
        None where each point has its own.
    """

    own: tuple[int, ...]
    outer: tuple[int, ...] | None = None


@dataclass(slots=True, kw_only=True, eq=False)
class Point:
    """A mission evaluated.

    Attributes
    ----------
    mean_errors : what is off on average from what the estimator assumes.
    times_s : of the measurements, TDB s after the reference epoch.
    trajectory : of the estimate; problem : linear, from which it comes.
    again : the same with what is measured until a time, TDB s after the reference epoch.
    """

    scene: PlannedScene
    estimate: Estimate
    mean_errors: MeanErrors
    times_s: Array
    trajectory: Trajectory
    problem: LinearProblem
    again: Callable[[float], "Point"]
    _earlier: dict[float, "Point | None"] = field(default_factory=dict)
    _quantities: dict[str, Quantity] = field(default_factory=dict)
    _missing: dict[str, Missing] = field(default_factory=dict)
    _answered: dict[str, Answered | None] = field(default_factory=dict)

    def prediction(self, name: str) -> Answered | None:
        """A prediction with its error; None where it does not exist for this orbit."""
        if name not in self._answered:
            asked = self._quantities.get(name)
            self._answered[name] = (
                None if asked is None else answered(asked, self.estimate, "", (), NOT_MEASURED, self.mean_errors)
            )
        return self._answered[name]

    def earlier(self, before_s: float) -> "Point | None":
        """What was known so long before the epoch of the orbit, which of kind impact is when it comes down.

        None where nothing was measured until then, or not enough for an orbit.
        """
        if before_s not in self._earlier:
            last_s = self.falls_s - before_s
            try:
                found = self if self.times_s[-1] <= last_s else self.again(last_s)
            except (GeometryError, NoAnswerError):
                found = None
            self._earlier[before_s] = found
        return self._earlier[before_s]

    def chance(self, name: str) -> float | None:
        """Linear probability of impact of a prediction, of one too that is too uncertain to be told."""
        if name in self._missing:
            return unanswered(self._missing[name], self.estimate, "", self.mean_errors).impact_probability
        found = self.prediction(name)
        return None if found is None else found.impact_probability

    def why_not(self, name: str) -> str:
        """Why a prediction does not exist; empty for one that does."""
        return self._missing[name].reason if name in self._missing else ""

    def shares(self, name: str) -> dict[str, float] | None:
        """Share of each source in the summed variance of a prediction."""
        asked = self._quantities.get(name)
        return None if asked is None else self._shares(*known_partials(asked, self.estimate))

    def state_shares(self) -> dict[str, float]:
        """Share of each source in the variance of the position at the reference epoch."""
        return self._shares(np.eye(6)[:3], STATE_NAMES)

    def state_sigma(self, half: int, *, formal: bool) -> float:
        """1 sigma of position (half 0, km) or velocity (half 1, m/s): the root of the summed variances."""
        found = self.estimate.predict(np.eye(6)[3 * half : 3 * half + 3], STATE_NAMES)
        sigma = found.sigma_formal if formal else found.sigma
        return float(np.sqrt(np.sum(sigma**2)) * (M_PER_KM if half else 1.0))

    def parameter_sigma(self, name: str) -> float | None:
        """1 sigma of an estimated parameter; None where there is none of this name."""
        return float(self.estimate.sigma(name)) if name in self.estimate.names else None

    def visible(self, telescope: str) -> int:
        """How many measurements a telescope takes."""
        names = [one.name for one in self.scene.telescopes]
        return int(np.count_nonzero(self.scene.visibilities[names.index(telescope)].visible))

    @property
    def falls_s(self) -> float:
        """The epoch of the orbit, which of kind impact is when it comes down, TDB s after the reference epoch."""
        return float(self.scene.mission.object.orbit.epoch - self.scene.epoch)

    def warning_s(self) -> float:
        """From the first measurement to the epoch of the orbit."""
        return float(self.falls_s - self.times_s[0])

    def _shares(self, W: Array, names: tuple[str, ...]) -> dict[str, float]:
        parts = {source: float(np.sum(f**2)) for source, f in self.estimate.predict(W, names).factors.items()}
        total = sum(parts.values())
        return {source: part / total if total > 0.0 else 0.0 for source, part in parts.items()}


NOT_MEASURED = Nonlinearity(
    method="not measured", orbits=0, mean_shift=None, second_order_sigma=None, measure=None, misleads=False, reason=None
)


def _predicted(
    scene: PlannedScene, trajectory: Trajectory, requests: Sequence[Prediction], shared: Shared
) -> tuple[list[Quantity], list[Missing]]:
    """Predictions that exist on an orbit and those that do not; of the same orbit, each once."""
    found, missing = [], []
    for request in requests:
        carrier = scene.mission.carrier(request.telescope) if isinstance(request, SkyPrediction) else None
        one = shared.made(
            "prediction",
            lambda request=request, carrier=carrier: (request, carrier),  # type: ignore[misc]
            lambda request=request: predicted(scene, trajectory, [request]),  # type: ignore[misc]
            (trajectory,),
        )
        found += one.found
        missing += one.missing
    return found, missing


def evaluate(mission: Mission, wanted: frozenset[str], seed: Seed | None = None, shared: Shared = ALONE) -> Point:
    """Evaluate a mission.

    Parameters
    ----------
    wanted : names of the predictions that are asked for.
    seed : of a drawn truth, which is then estimated to convergence; None for the covariance at
        the reference orbit.
    shared : of the points before; what this one has in common with them is taken from there.

    Raises
    ------
    GeometryError
        If the measurements do not determine the orbit.
    NebosvodError
        As the stages raise it.
    """
    return _evaluated(build_scene(mission, shared), wanted, seed, shared)


def _evaluated(scene: PlannedScene, wanted: frozenset[str], seed: Seed | None, shared: Shared) -> Point:
    """A scene evaluated."""
    mission = scene.mission
    priors = prior_table(mission, scene.forces, scene.state)
    nominal, estimator = nominal_view(scene, shared=shared), mission.estimators[0]
    trajectory = scene.trajectory
    if seed is None:
        problem = linear_problem(scene, estimator, nominal, computed_psi(nominal), priors, about=nominal.point)
        solve = SOLVERS[estimator.method]
        estimate = solve(problem)
        known = None if estimate.solution is None else solve
        off = mean_errors(scene, estimator, nominal.terms, priors, problem, known)
    else:
        truth = draw(scene, priors, generator(*seed.own), nominal.point, seed.outer)
        found = fit(scene, estimator, nominal, truth.psi, truth.priors, history=False)
        estimate, trajectory, off, problem = found.estimate, found.trajectory, found.mean_errors, found.problem
    if estimate.solution is None:
        raise GeometryError(estimate.message, rank=estimate.rank, weak_direction=estimate.weak_direction)
    requests = [one for one in mission.predictions if one.name in wanted]
    told = believable(*_predicted(scene, trajectory, requests, shared), estimate)
    return Point(
        scene=scene,
        estimate=estimate,
        mean_errors=off,
        times_s=nominal.observation.t_s,
        trajectory=trajectory,
        problem=problem,
        again=lambda last_s: _evaluated(seen_until(scene, last_s, shared), wanted, seed, shared),
        _quantities={one.request.name: one for one in told.found},
        _missing={one.request.name: one for one in told.missing},
    )
