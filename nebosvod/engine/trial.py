"""One trial of Monte Carlo: a truth drawn and measured, an estimator, and what its estimate and its errors are.

There are two ways to make one. Linear: the orbit of the truth is linear about the reference (by Phi and zeta), the
measurement is not (direction and light time are computed in full), and one factorisation at the reference serves every
truth (`nebosvod.estimation.accuracy.repeated`). Iterated: the truth is propagated with its own parameters and estimated
from the prior to convergence, with the covariances of its own linearisation. `second_order` says whether the first will
do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi, drawn_noise, linear_problem, nominal_view, view
from nebosvod.engine.fitting import SOLVERS, converge
from nebosvod.engine.mean_errors import MeanErrors, mean_errors
from nebosvod.engine.truth import Truth, draw
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Block, Estimate, LinearProblem, Markov, White
from nebosvod.estimation.accuracy.repeated import Repeated
from nebosvod.estimation.problem.square_root import left_inverse, lower_factor
from nebosvod.estimation.solvers.iteration import recentred, step_length
from nebosvod.mission import Estimator, Mission
from nebosvod.mission.request import OWN_GAIN
from nebosvod.observation import Common, draw_truth, measure, residual
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import Scene, build_scene

Array = npt.NDArray[np.float64]
LINEAR_SIGMA = 0.05  # second-order terms below this do: it adds a four-hundredth to a variance
PROBES = 6
DRAWING, PROBING = 1, 2  # keys of random numbers: of orbits about an estimate, of probes; a run has its number


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimating:
    """One estimator, ready for any number of residual vectors about the nominal point.

    Attributes
    ----------
    base : the problem at the nominal point with zero residual.
    reference : its estimate; `solution` is None where the problem is not observable.
    repeated : the affine map from residuals to estimates, where the method has one.
    mean_errors : what is off on average from what the estimator assumes.
    """

    estimator: Estimator
    base: LinearProblem
    reference: Estimate
    repeated: Repeated | None
    mean_errors: MeanErrors

    @classmethod
    def of(cls, scene: Scene, estimator: Estimator, nominal: View, priors: PriorTable) -> "Estimating":
        """Prepare an estimator at the nominal point."""
        base = linear_problem(scene, estimator, nominal, computed_psi(nominal), priors, about=nominal.point)
        reference = SOLVERS[estimator.method](base)
        # all but these give K_formal H^T W v, so one factor serves every residual; these are solved anew for each
        affine = estimator.method not in OWN_GAIN and reference.solution is not None
        repeated = Repeated.of(base, reference) if affine else None
        solve = None if reference.solution is None else SOLVERS[estimator.method]
        off = mean_errors(scene, estimator, nominal.terms, priors, base, solve)
        return cls(estimator=estimator, base=base, reference=reference, repeated=repeated, mean_errors=off)

    def mean(self, names: Sequence[str]) -> Array:
        """Mean (k,) of estimate minus truth, for what is left out may have a mean."""
        return self.mean_errors.shift(self.reference, names)

    def mean_residual(self, problem: LinearProblem | None = None) -> Array:
        """What the mean errors do to the measurements (n, 2), which the estimator does not know of.

        Parameters
        ----------
        problem : linearised somewhere else than at the nominal point.
        """
        return self.mean_errors.residual(self.base if problem is None else problem)

    def means(self, residuals: Array) -> Array:
        """Estimated deviations (N, s) from the nominal point for residuals (N, n, 2)."""
        if self.repeated is not None:
            return self.repeated.means(residuals)
        return np.array([self.solved_anew(one) for one in residuals])

    @property
    def treatments(self) -> tuple[str, ...]:
        """What makes the problem of an estimator: the treatment of every source, in order."""
        groups: tuple[Block | White | Markov, ...] = (*self.base.blocks, *self.base.white, *self.base.markov)
        return tuple(group.treatment for group in groups)

    def solved_anew(self, one: Array) -> Array:
        """Estimated deviations (s,) by the estimator's own method, from the measurements on."""
        return SOLVERS[self.estimator.method](replace(self.base, residual=one)).mean


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """What every trial starts from: the scene, what is known beforehand, the nominal point seen, and the estimators.

    Parameters of the orbit that are `fixed` have their nominal values in every truth.
    """

    scene: Scene
    priors: PriorTable
    nominal: View
    estimating: tuple[Estimating, ...]
    fixed: frozenset[str]

    @classmethod
    def of(cls, mission: Mission) -> "Setting":
        """Build scene, nominal point and estimators of a mission."""
        scene = build_scene(mission)
        priors = prior_table(mission, scene.forces, scene.state)
        return cls.at(scene, nominal_view(scene), priors, mission.estimators)

    @classmethod
    def at(cls, scene: Scene, nominal: View, priors: PriorTable, estimators: Sequence[Estimator]) -> "Setting":
        """Prepare some estimators of a scene at its nominal point."""
        found = tuple(Estimating.of(scene, estimator, nominal, priors) for estimator in estimators)
        fixed = frozenset(one.name for one in scene.mission.free_parameters if one.treatment == "fixed")
        return cls(scene=scene, priors=priors, nominal=nominal, estimating=found, fixed=fixed)

    def moved(self, off: Mapping[str, float]) -> Array:
        """What deviations of state and parameters do to the measurements (n, 2), to first order.

        To an estimator that takes one linear step a prior mean that is off is a truth that is, measured so.
        """
        seen = self.nominal.observation
        state, parameters = (
            np.array([off.get(name, 0.0) for name in names]) for names in (STATE_NAMES, seen.parameter_names)
        )
        return np.asarray(seen.H_x0 @ state + seen.H_c @ parameters)


def generator(seed: int, *key: int) -> np.random.Generator:
    """The random numbers of one run, or of whatever else a key names, whoever computes it."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def measured_truth(setting: Setting, computed: Array, rng: np.random.Generator) -> tuple[Array, Mapping[str, float]]:
    """Draw one truth and measure it: residuals (n, 2), and every true value as a deviation from the nominal point.

    Parameters
    ----------
    computed : shape (n, 2), directions at the nominal point (`computed_psi`), from which residuals count.
    """
    nominal = setting.nominal
    values = nominal.point.values
    truth = dict.fromkeys(values, 0.0)
    near, far = setting.priors.parted(setting.priors.draw(rng))
    truth |= {name: value - values[name] for name, value in near.items() if name not in setting.fixed}
    drawn = draw_truth(nominal.terms, rng)
    for term in nominal.terms:
        if isinstance(term, Common):
            truth |= {name: float(value) - values[name] for name, value in zip(term.names, drawn[term.name])}
    psi = measure(
        nominal.observation,
        nominal.terms,
        drawn,
        state_deviation=np.array([truth[name] for name in STATE_NAMES]),
        parameters_deviation=np.array([truth[name] for name in nominal.observation.parameter_names]),
        noise=drawn_noise(setting.scene, nominal.observation, rng),
    )
    off = {name: value for name, value in far.items() if name not in setting.fixed}
    return residual(psi, computed) + setting.moved(off), truth | {n: truth[n] + value for n, value in off.items()}


def possible(setting: Setting, rng: np.random.Generator) -> Truth | None:
    """A truth, propagated and measured; None if the draw has no physics (a mass of zero, an orbit that hits a body)."""
    try:
        return draw(setting.scene, setting.priors, rng, setting.nominal.point)
    except (InputError, EventError):
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """An estimate iterated to convergence on one drawn truth; its s + s_j parameters are those of the reference.

    Attributes
    ----------
    errors : (s + s_j,), estimate minus truth, and assumed minus true value of the parameters left out.
    mean : (s + s_j,), mean of the errors that the estimator's left-out sources promise.
    factor_true, factor_formal : (s + s_j, s + s_j) and (s + s_j, s), of the covariances of this very estimate; rows of
        zero in the formal one for the parameters left out.
    problem : linearised at the estimate and counted from there, priors too.
    """

    errors: Array
    mean: Array
    factor_true: Array
    factor_formal: Array
    problem: LinearProblem


def iterated(setting: Setting, one: Estimating, truth: Truth) -> Trial | None:
    """Estimate a truth from the prior to convergence; None if the iteration does not converge."""
    ended = converge(setting.scene, one.estimator, setting.nominal, truth.psi, truth.priors)
    estimate = ended.found.estimate
    if str(ended.found.status) != "converged":
        return None
    names = estimate.names + estimate.left_out
    found, true = ended.point.values, truth.point.values
    formal = np.zeros((len(names), len(estimate.names)))
    formal[: len(estimate.names)] = lower_factor(estimate.S_formal)
    return Trial(
        errors=np.array([found[name] - true[name] for name in names]),
        mean=one.mean_errors.shift(estimate, names),
        factor_true=estimate.factor(names),
        factor_formal=formal,
        problem=recentred(ended.problem, ended.found.deviation),
    )


def second_order(setting: Setting, seed: int) -> float:
    """How far the linear step falls short of the iterated estimate, in sigmas: the largest over estimators.

    A few truths are drawn and propagated; from the linear estimate of each one more step is taken. Its length, and the
    change of the sigmas on the way (as a logarithm), are what is left out by stopping after the first: root mean square
    over the truths. Infinite where a linear estimate is no orbit, or lies where nothing is determined.
    """
    kinds = {(one.treatments, one.repeated is None and one.estimator.method): one for one in setting.estimating}
    computed = computed_psi(setting.nominal)
    squares: dict[int, list[float]] = {}
    for i in range(PROBES):
        truth = possible(setting, generator(seed, PROBING, i))
        if truth is None:
            continue
        for number, one in enumerate(kinds.values()):
            if one.reference.solution is not None:
                linear = one.means((residual(truth.psi, computed) + setting.moved(truth.off))[None])[0]
                linear = linear - np.array([truth.off.get(name, 0.0) for name in one.reference.names])
                squares.setdefault(number, []).append(_short_of(setting, one, truth, linear) ** 2)
    return max((float(np.sqrt(np.mean(found))) for found in squares.values()), default=0.0)


def _short_of(setting: Setting, one: Estimating, truth: Truth, linear: Array) -> float:
    """What is left to go from a linear estimate (s,), in sigmas, or the change of the sigmas if that is larger."""
    scene, start = setting.scene, setting.nominal.point
    deviation = dict(zip(one.reference.names, linear.tolist()))
    try:
        seen = view(scene, start.moved(deviation), setting.nominal.observation.light_time_s, simulates=False)
        problem = linear_problem(scene, one.estimator, seen, truth.psi, truth.priors, about=start)
        estimate = SOLVERS[one.estimator.method](recentred(problem, deviation))
    except (InputError, CoverageError, EventError):
        return np.inf
    if estimate.solution is None:
        return np.inf
    ratio = np.linalg.svd(left_inverse(one.reference.S_formal) @ estimate.S_formal, compute_uv=False)
    return max(step_length(estimate), float(np.abs(np.log(ratio)).max()))
