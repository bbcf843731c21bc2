"""Monte Carlo: truths really drawn, measured, estimated again; the sample of errors that K_true must describe.

The orbit of each truth is linear about the reference (by Phi and zeta), the measurement is not: direction and light
time are computed in full. Run i draws from its own seed, so the result does not depend on how runs are shared out.
Every truth is estimated with one factorisation of the problem at the reference (`nebosvod.estimation.repeated`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.assembly import View, computed_psi, linear_problem, mean_errors
from nebosvod.estimation import Estimate, LinearProblem
from nebosvod.estimation.repeated import Repeated
from nebosvod.fitting import SOLVERS
from nebosvod.mission import Estimator
from nebosvod.mission.request import OWN_GAIN
from nebosvod.observation import Common, draw_noise, draw_truth, measure, residual
from nebosvod.prior import STATE_NAMES, PriorTable
from nebosvod.scene import Scene

Array = npt.NDArray[np.float64]
LEVELS = (0.5, 0.9, 0.99)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Errors of repeated estimation.

    Attributes
    ----------
    names : s estimated parameters.
    errors : (runs, s), estimate minus truth.
    mean : (s,), mean of the errors that the estimator's left-out sources promise; K_true is the covariance about it.
    reference : the estimate at the reference, whose K_true is on trial.
    """

    names: tuple[str, ...]
    errors: Array
    mean: Array
    reference: Estimate

    @property
    def spread(self) -> Array:
        """Errors (runs, s) about their promised mean."""
        return self.errors - self.mean

    @property
    def nees(self) -> Array:
        """Normalised squared error (runs,) of the state, through the factor of K_true."""
        place = [self.names.index(name) for name in STATE_NAMES]
        whitened = np.linalg.solve(self.reference.factor(STATE_NAMES), self.spread[:, place].T)
        total: Array = np.sum(whitened**2, axis=0)
        return total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimating:
    """One estimator, ready for any number of residual vectors about the nominal point.

    Attributes
    ----------
    base : the problem at the nominal point with zero residual.
    reference : its estimate; `solution` is None where the problem is not observable.
    repeated : the affine map from residuals to estimates, where the method has one.
    mean_errors : mean of truth minus assumed value, by parameter left out; those that are not zero.
    """

    estimator: Estimator
    base: LinearProblem
    reference: Estimate
    repeated: Repeated | None
    mean_errors: Mapping[str, float]

    @classmethod
    def of(cls, scene: Scene, estimator: Estimator, nominal: View, priors: PriorTable) -> "Estimating":
        """Prepare an estimator at the nominal point."""
        base = linear_problem(scene, estimator, nominal, computed_psi(nominal), priors, about=nominal.point)
        reference = SOLVERS[estimator.method](base)
        # all but these give K_formal H^T W v, so one factor serves every residual; these are solved anew for each
        affine = estimator.method not in OWN_GAIN and reference.solution is not None
        repeated = Repeated.of(base, reference) if affine else None
        off = mean_errors(scene, estimator, nominal.terms)
        return cls(estimator=estimator, base=base, reference=reference, repeated=repeated, mean_errors=off)

    def mean(self, names: Sequence[str]) -> Array:
        """Mean (k,) of estimate minus truth, for what is left out may have a mean."""
        return self.reference.mean_shift(self.mean_errors, names)

    def mean_residual(self) -> Array:
        """What the mean errors do to the measurements (n, 2), which the estimator does not know of."""
        total = np.zeros_like(self.base.residual)
        for block in self.base.blocks:
            total += block.H @ np.array([self.mean_errors.get(name, 0.0) for name in block.names])
        return total

    def means(self, residuals: Array) -> Array:
        """Estimated deviations (N, s) from the nominal point for residuals (N, n, 2)."""
        if self.repeated is not None:
            return self.repeated.means(residuals)
        return np.array([self.solved_anew(one) for one in residuals])

    def solved_anew(self, one: Array) -> Array:
        """Estimated deviations (s,) by the estimator's own method, from the measurements on."""
        return SOLVERS[self.estimator.method](replace(self.base, residual=one)).mean


def repeat(
    scene: Scene,
    estimator: Estimator,
    nominal: View,
    priors: PriorTable,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda message: None,
) -> Sample:
    """Estimate `runs` drawn truths with one estimator, linear about the nominal point.

    Parameters
    ----------
    nominal : the nominal point, seen.
    seed : run i draws from SeedSequence(seed, spawn_key=(i,)).
    """
    estimating = Estimating.of(scene, estimator, nominal, priors)
    computed = computed_psi(nominal)
    names = estimating.reference.names
    errors = np.empty((runs, len(names)))
    for i in range(runs):
        if i % 100 == 0:
            progress(f"Monte Carlo: {i} of {runs} runs")
        psi, truth = measured_truth(scene, nominal, priors, generator(seed, i))
        errors[i] = estimating.means(residual(psi, computed)[None])[0] - np.array([truth[name] for name in names])
    return Sample(names=names, errors=errors, mean=estimating.mean(names), reference=estimating.reference)


def generator(seed: int, run: int) -> np.random.Generator:
    """The random numbers of one run, whoever computes it."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(run,)))


def measured_truth(
    scene: Scene, nominal: View, priors: PriorTable, rng: np.random.Generator
) -> tuple[Array, Mapping[str, float]]:
    """Draw one truth and measure it: directions (n, 2), and every true value as a deviation from the nominal point."""
    values = nominal.point.values
    fixed = {parameter.name for parameter in scene.mission.free_parameters if parameter.treatment == "fixed"}
    truth = dict.fromkeys(values, 0.0)
    truth |= {name: value - values[name] for name, value in priors.draw(rng).items() if name not in fixed}
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
        noise=draw_noise(nominal.observation.noise, rng),
    )
    return psi, truth


def consistency(sample: Sample) -> dict[str, Any]:
    """The `consistency` block of summary.json: mean NEES with its 99 % interval, and coverage of the state."""
    from scipy.special import chdtri, gammainc

    nees, size = sample.nees, len(STATE_NAMES)
    runs = len(nees)
    # the sum of the NEES over the runs is chi-square with 6 N degrees of freedom when K_true is right
    interval = [float(chdtri(size * runs, tail)) / (size * runs) for tail in (0.995, 0.005)]
    inside = gammainc(size / 2.0, nees / 2.0)
    return {
        "n_runs": runs,
        "nees_mean": float(nees.mean() / size),
        "nees_interval_99": interval,
        "coverage": {f"{100 * level:g}_percent": float(np.mean(inside <= level)) for level in LEVELS},
    }


def consistency_block(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The `consistency` entry of summary.json: the first estimator's numbers, and all of them; empty without runs."""
    return {"consistency": {**rows[0], "by_estimator": rows}} if rows else {}
