"""Errors that are off on average from what an estimator assumes, and how far each of them shifts its estimate.

A bias left out is assumed to be zero; a truth declared beside the assumption (`true:`) may have any mean. Covariances
are about these means (Guo, Ivashkin 2018, (3.2), (3.5)).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import assumed_mean, nuisance_treatment
from nebosvod.estimation import Estimate, LinearProblem
from nebosvod.estimation.accuracy import mean_error
from nebosvod.mission import Estimator
from nebosvod.observation import Common, Term
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanErrors:
    """What is off on average for one estimator; false where nothing is.

    Attributes
    ----------
    common : mean of truth minus assumed value, by parameter; those that are not zero.
    fresh : mean (p,) or (q,) of noise and of errors of each exposure, by source.
    moved : by such a source, the mean of estimate minus truth it gives each parameter.
    """

    common: Mapping[str, float] = field(default_factory=dict)
    fresh: Mapping[str, Array] = field(default_factory=dict)
    moved: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Whether anything is off."""
        return bool(self.common or self.fresh)

    def shift(self, estimate: Estimate, names: Sequence[str]) -> Array:
        """Mean (k,) of estimate minus truth of some parameters."""
        total = estimate.mean_shift(self.common, names)
        for own in self.moved.values():
            total = total + np.array([own[name] for name in names])
        return total

    def by_source(self, estimate: Estimate, names: Sequence[str]) -> dict[str, Array]:
        """What each source adds to it (k,), by its name in the budget."""
        found: dict[str, Array] = {}
        solution = estimate.solution
        for source, parameters in ({} if solution is None else solution.gain_names).items():
            own = {name: self.common[name] for name in parameters if name in self.common}
            if own:
                found[source] = estimate.mean_shift(own, names)
        return found | {source: np.array([own[name] for name in names]) for source, own in self.moved.items()}

    def residual(self, problem: LinearProblem) -> Array:
        """What the means do to the measurements (n, p) of a problem, wherever that is linearised."""
        return mean_error.caused(problem, {**self.common, **self.fresh})


NONE = MeanErrors()


def mean_errors(
    scene: Scene,
    estimator: Estimator,
    terms: Sequence[Term],
    priors: PriorTable,
    problem: LinearProblem,
    solve: Callable[[LinearProblem], Estimate] | None,
) -> MeanErrors:
    """What is off on average for an estimator.

    Parameters
    ----------
    problem, solve : its linear problem, and how it solves one; None where it cannot.
    """
    live = set(problem.names("estimated", "considered", "ignored"))
    assumed = {name for prior in problem.priors for name in prior.names}
    common = {name: off for name, off in priors.mean_errors.items() if name in live}
    fresh: dict[str, Array] = {}
    for term in terms:
        treatment = nuisance_treatment(scene, estimator, term.name)
        if isinstance(term, Common):
            true = term.mean if term.true_mean is None else term.true_mean
            off = true - assumed_mean(scene, term, treatment)
            known = zip(term.names, off)
            common |= {name: float(value) for name, value in known if value != 0.0 and name in live & assumed}
        elif term.true_mean is not None and term.true_mean.any() and treatment != "fixed":
            fresh[term.name] = term.true_mean
    for name, telescope in zip(problem.noise_names, scene.exposures.telescopes):
        if telescope.truth is not None and telescope.truth.mean_rad.any():
            fresh[name] = telescope.truth.mean_rad
    moved = {} if solve is None else {one: mean_error.shift(problem, {one: fresh[one]}, solve) for one in fresh}
    return MeanErrors(common=common, fresh=fresh, moved=moved)
