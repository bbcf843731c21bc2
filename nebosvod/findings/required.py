"""How well a telescope's position must be known: the inverse question, answered by the full covariance.

The position error of one telescope (all its sources together) is scaled by a common factor f. With the gain as it is
the variance of a prediction is a sum, s_0^2 + f^2 s_1^2, and the answer closed. With the gain re-optimised each f is a
new solve and the answer a root; it may not exist, for an estimator that knows a telescope to be lost turns to others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.estimation import Estimate, LinearProblem, White
from nebosvod.estimation.accuracy import budget
from nebosvod.estimation.solvers import batch
from nebosvod.findings.blame import kind_of_problem
from nebosvod.observation import Common, Markov, Term
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
GROWTHS_PERCENT = (1.0, 10.0, 50.0)
LARGEST_KM = 1e6  # a telescope whose position is known no better measures nothing
SMALLEST_KM = 1e-6
TOLERANCE = 1e-3  # relative, of the size found
MOST_STEPS = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Position:
    """What is uncertain about the position of one telescope.

    Attributes
    ----------
    sources : names in the problem, scaled together.
    sigma_km : root mean square of one axis, over its measurements, at factor 1.
    assumed : True when the mission gives no position error, and a white one of 1 km an axis stands for it.
    """

    telescope: str
    problem: LinearProblem
    sources: tuple[str, ...]
    sigma_km: float
    assumed: bool

    def scaled(self, factor: float) -> LinearProblem:
        """The problem with this position error `factor` times as large, known to the estimator."""
        problem = self.problem
        for source in self.sources:
            problem = budget.scaled(problem, source, factor)
        return problem


def position_of(scene: Scene, fit: Fit, telescope: str) -> Position | None:
    """The position error of a telescope in the problem of a fit; None where it measures nothing."""
    seen, problem = fit.observation, fit.problem
    number = next((i for i, one in enumerate(seen.telescopes) if one.name == telescope), None)
    if number is None:
        return None
    treated = dict(kind_of_problem(fit))
    mine = [
        term
        for term in fit.seen.terms
        if scene.sources[term.name].group == "position"
        and telescope in scene.sources[term.name].telescopes
        and treated[term.name] != "fixed"
    ]
    if mine:
        variance = sum(_mean_variance(term, seen.telescope_index == number) for term in mine)
        sources, sigma, assumed = tuple(term.name for term in mine), float(np.sqrt(variance)), False
    else:
        rows = np.flatnonzero(seen.telescope_index == number)
        name = f"position of {telescope}, assumed"
        white = White(name=name, H=seen.H_z[rows], Q=np.eye(3), rows=rows)
        problem = replace(problem, white=(*problem.white, white))
        sources, sigma, assumed = (name,), 1.0, True
    return Position(telescope=telescope, problem=problem, sources=sources, sigma_km=sigma, assumed=assumed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionLimit:
    """The size of a position error, 1 sigma on each axis, that makes the sigma of a prediction grow by so many percent.

    Attributes
    ----------
    same_gain_km, new_gain_km : with the gain as it is, and re-optimised; None where no size does it.
    reason : why the second is None.
    """

    growth_percent: float
    same_gain_km: float | None
    new_gain_km: float | None
    reason: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RequiredPosition:
    """How well the position of one telescope must be known for one prediction.

    Attributes
    ----------
    position : what is uncertain about it now.
    unit : of the prediction; sigma_total_perfect : its total sigma were the position known exactly, None where even
        then it is not determined.
    """

    position: Position
    estimator: str
    prediction: str
    unit: str
    sigma_total_perfect: float | None
    limits: tuple[PositionLimit, ...]


def required(scene: Scene, fit: Fit, asked: Sequence[Quantity]) -> list[RequiredPosition]:
    """For each telescope and prediction, the sizes of the position error that cost 1, 10 and 50 %."""
    rows = []
    for telescope in scene.telescopes:
        position = position_of(scene, fit, telescope.name)
        if position is None or position.sigma_km == 0.0:
            continue
        search = _Search.of(fit, position, asked)
        rows += [
            RequiredPosition(
                position=position,
                estimator=fit.estimator.name,
                prediction=quantity.request.name,
                unit=quantity.unit,
                sigma_total_perfect=search.perfect(index),
                limits=tuple(search.limit(index, percent) for percent in GROWTHS_PERCENT),
            )
            for index, quantity in enumerate(asked)
        ]
    return rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Total sigmas of all predictions as a function of the factor, each factor solved once."""

    position: Position
    W: tuple[tuple[Array, tuple[str, ...]], ...]
    rest: Array  # (quantities,) variance with the present gain of all that is not the position
    own: Array  # (quantities,) variance with the present gain of the position at factor 1
    solved: dict[float, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, fit: Fit, position: Position, asked: Sequence[Quantity]) -> "_Search":
        now = fit.estimate
        if position.assumed:  # the gain that does not know of it
            unknown = [
                replace(w, treatment="ignored") if w.name in position.sources else w for w in position.problem.white
            ]
            now = batch.solve(replace(position.problem, white=tuple(unknown)))
        W = tuple(known_partials(quantity, now) for quantity in asked)
        parts = [now.predict(*one).factors for one in W]
        own = [sum(float(np.sum(part[name] ** 2)) for name in position.sources) for part in parts]
        every = [sum(float(np.sum(G**2)) for G in part.values()) for part in parts]
        return cls(position=position, W=W, own=np.array(own), rest=np.array(every) - np.array(own))

    def sigmas(self, factor: float) -> Array:
        """Total sigma (quantities,) with the gain re-optimised."""
        if factor not in self.solved:
            estimate = batch.solve(self.position.scaled(factor))
            self.solved[factor] = self._totals(estimate)
        return self.solved[factor]

    def _totals(self, estimate: Estimate) -> Array:
        if estimate.solution is None:
            return np.full(len(self.W), np.inf)
        both = np.hstack([np.zeros((len(estimate.names + estimate.left_out), 0)), *estimate.solution.factors.values()])
        place = {name: index for index, name in enumerate(estimate.names + estimate.left_out)}
        return np.array([np.linalg.norm(W @ both[[place[name] for name in names]]) for W, names in self.W])

    def perfect(self, index: int) -> float | None:
        """Total sigma of a quantity were the position known exactly; None if even then it is not determined."""
        value = float(self.sigmas(0.0)[index])
        return value if np.isfinite(value) else None

    def limit(self, index: int, percent: float) -> PositionLimit:
        """The size of the position error that makes the sigma of a quantity grow by so many percent."""
        growth = 1.0 + percent / 100.0
        size = self.position.sigma_km
        same = None
        if self.own[index] > 0.0:
            same = float(size * np.sqrt((growth**2 - 1.0) * self.rest[index] / self.own[index]))
        new, reason = self._root(index, growth, same)
        return PositionLimit(growth_percent=percent, same_gain_km=same, new_gain_km=new, reason=reason)

    def _root(self, index: int, growth: float, guess_km: float | None) -> tuple[float | None, str | None]:
        best = self.perfect(index)
        if best is None or best == 0.0:
            return None, "not determined even with a perfectly known position"
        size = self.position.sigma_km

        def excess(x: float) -> float:
            """Logarithm of the variance's growth over the wanted one: a line of slope 2 while x is small."""
            variance = (float(self.sigmas(float(np.exp(x)) / size)[index]) / best) ** 2 - 1.0
            return float(np.log(max(variance, 1e-12) / (growth**2 - 1.0)))

        high = float(np.log(LARGEST_KM))
        if excess(high) < 0.0:
            most = 100.0 * (float(self.sigmas(LARGEST_KM / size)[index]) / best - 1.0)
            return None, f"no size does it: with a lost telescope the sigma grows by {most:.3g} %"
        low = float(np.log(SMALLEST_KM))
        known = sorted(float(np.log(f * size)) for f in self.solved if f > 0.0)
        low = max([low, *(x for x in known if excess(x) < 0.0)])
        high = min([high, *(x for x in known if excess(x) >= 0.0)])
        start = float(np.log(guess_km)) if guess_km else 0.5 * (low + high)
        return float(np.exp(_bracketed(excess, low, high, start))), None


def _bracketed(function: Callable[[float], float], low: float, high: float, start: float) -> float:
    """Root of a growing function between low and high: Newton's step with slope 2 first, then secants inside."""
    x, slope = min(max(start, low), high), 2.0
    before: tuple[float, float] | None = None
    for _ in range(MOST_STEPS):
        value = function(x)
        low, high = (x, high) if value < 0.0 else (low, x)
        if before is not None and before[0] != x and (value - before[1]) / (x - before[0]) > 0.0:
            slope = (value - before[1]) / (x - before[0])
        before = (x, value)
        step = -value / slope
        if abs(step) < TOLERANCE or high - low < TOLERANCE:
            return x + step if low <= x + step <= high else x
        x = x + step if low < x + step < high else 0.5 * (low + high)
    return x


def _mean_variance(term: Term, mine: npt.NDArray[np.bool_]) -> float:
    """Mean variance of one axis over a telescope's measurements, km^2."""
    if term.displacement is None:
        return 0.0
    if isinstance(term, Common):
        D, C = term.displacement[mine], term.covariance[None]
    else:
        own = mine[term.rows]
        D, C = term.displacement[own], (_chain(term) if isinstance(term, Markov) else term.Q)[own]
    return float(np.mean(np.einsum("naq,nqr,nar->n", D, np.broadcast_to(C, (len(D), *C.shape[1:])), D)) / 3.0)


def _chain(term: Markov) -> Array:
    """Covariances (r, q, q) of a chain at its rows."""
    C = np.empty(term.F.shape)
    C[0] = term.P0
    for k in range(1, len(C)):
        C[k] = term.F[k] @ C[k - 1] @ term.F[k].T + term.Q[k]
    return C
