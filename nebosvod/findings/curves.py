"""Curves of accuracy: the sigma of each prediction against the number of measurements, arc, cadence and noise.

Against the number of measurements four curves stand together, as in the first figure of the source: noise only (the
state from noisy measurements, nothing else uncertain), prior only (a level), noise and prior of the dynamics, and
everything. Each is one O(n) pass of the sequential filter, in time order, so the same pass is the curve against the
arc; where the filter cannot follow the truth (something is left out beside an error correlated in time) each point is a
batch of its own. Repeating one geometry N times gives the slope -1/2 in logarithms; a growing arc does better.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy import budget
from nebosvod.estimation.problem.subset import subset
from nebosvod.estimation.solvers import batch, recursive
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
WORLDS = ("noise_only", "noise_and_prior", "all")  # what is uncertain in each curve
POINTS = 40  # of a curve against the number of measurements
SPARSER = (1, 2, 4, 8, 16, 32, 64)
NOISE_FACTORS = tuple(float(f) for f in 10.0 ** np.arange(-2.0, 2.01, 0.5))
EXPECTED_SLOPE = -0.5
FEWEST = 4  # measurements of a telescope, below which a sparser cadence is not tried


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CountCurve:
    """Total sigma of a prediction after each of m numbers of measurements, in its unit.

    Attributes
    ----------
    count, days : (m,) how many measurements, and how long after the first.
    totals : (m,) by what is uncertain, a name of WORLDS; inf where that is not observable.
    slope, slope_arc : of log sigma against the logarithm of count, and of the arc, over the last octave; by the same
        names, None where there are too few points.
    prior_only : from the priors alone; None while some of the state has no prior.
    """

    count: Integers
    days: Array
    totals: Mapping[str, Array]
    slope: Mapping[str, float | None]
    slope_arc: Mapping[str, float | None]
    prior_only: float | None
    expected_slope: float = EXPECTED_SLOPE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CadenceCurve:
    """Total sigma (m,) of a prediction with every m-th exposure only, in its unit; inf where not observable."""

    every: Sequence[int]
    count: Sequence[int]
    total: Array
    slope: float | None
    expected_slope: float = EXPECTED_SLOPE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseCurve:
    """Total sigma (m,) of a prediction with the noise of all telescopes so many times as large, in its unit."""

    factor: Sequence[float]
    total: Array
    slope_quiet: float | None
    slope_noisy: float | None
    expected_slope_noisy: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """The curves of one prediction of one estimator."""

    prediction: str
    estimator: str
    unit: str
    measurements: CountCurve
    cadence: CadenceCurve
    telescope_noise: NoiseCurve


def curves(fit: Fit, asked: Sequence[Quantity]) -> list[Curve]:
    """The curves of each prediction: total sigmas, roots of the summed variances."""
    if not asked:
        return []
    return [
        Curve(
            prediction=quantity.request.name,
            estimator=fit.estimator.name,
            unit=quantity.unit,
            measurements=counted,
            cadence=sparser,
            telescope_noise=noisy,
        )
        for quantity, counted, sparser, noisy in zip(
            asked, by_count(fit, asked), by_cadence(fit, asked), by_noise(fit, asked)
        )
    ]


def noise_only(problem: LinearProblem) -> LinearProblem:
    """The state from noisy measurements with everything else known exactly and nothing known of the state."""
    blocks = tuple(b if b.names == STATE_NAMES else replace(b, treatment="fixed") for b in problem.blocks)
    return replace(problem, blocks=blocks, priors=(), white=(), markov=())


def noise_and_prior(problem: LinearProblem, dynamic: Sequence[str]) -> LinearProblem:
    """The state and the dynamic parameters with their priors; nothing uncertain about the telescopes."""
    kept = {*STATE_NAMES, *dynamic}
    blocks = tuple(b if set(b.names) <= kept else replace(b, treatment="fixed") for b in problem.blocks)
    priors = tuple(prior for prior in problem.priors if set(prior.names) <= kept)
    return replace(problem, blocks=blocks, priors=priors, white=(), markov=())


def by_count(fit: Fit, asked: Sequence[Quantity]) -> list[CountCurve]:
    """Sigmas after each measurement, thinned to even steps of the logarithm, with the slope of the last octave."""
    problem, t_s = fit.problem, fit.observation.t_s
    place = np.unique(np.round(np.geomspace(1, problem.n, POINTS)).astype(np.int64)) - 1
    arc = np.maximum(t_s - t_s[0], 0.0)
    worlds = (noise_only(problem), noise_and_prior(problem, fit.observation.parameter_names), problem)
    found = {name: _along(world, asked, place) for name, world in zip(WORLDS, worlds)}
    rows = []
    for index, quantity in enumerate(asked):
        own = {name: (known, totals[index]) for name, (known, totals) in found.items()}
        rows.append(
            CountCurve(
                count=place + 1,
                days=(t_s[place] - t_s[0]) / SECONDS_PER_DAY,
                totals={name: total[np.searchsorted(known, place)] for name, (known, total) in own.items()},
                slope={name: last_slope(known.astype(np.float64) + 1.0, total) for name, (known, total) in own.items()},
                slope_arc={name: last_slope(arc[known], total) for name, (known, total) in own.items()},
                prior_only=prior_sigma(problem, quantity),
            )
        )
    return rows


def _along(problem: LinearProblem, asked: Sequence[Quantity], place: Integers) -> tuple[Integers, list[Array]]:
    """Numbers (k,) of measurements, and the total sigma (k,) of each quantity after them; inf where not observable."""
    passed = _followed(problem, asked)
    if passed is None:
        return place, _stepped(problem, asked, place)
    first = _first_observable(problem, place)
    for total in passed:
        total[:first] = np.inf
    return np.arange(problem.n), passed


def prior_sigma(problem: LinearProblem, quantity: Quantity) -> float | None:
    """Total sigma of a quantity from the priors alone; None while some of the state has no prior."""
    live = set(problem.names("estimated", "considered", "ignored"))  # what is fixed has no error
    place = {name: index for index, name in enumerate(quantity.names) if name in live}
    variance, known = 0.0, set()
    for prior in problem.priors:
        inside = [index for index, name in enumerate(prior.names) if name in place]
        W = quantity.partials[:, [place[prior.names[index]] for index in inside]]
        variance += float(np.trace(W @ prior.truth[np.ix_(inside, inside)] @ W.T))
        known |= set(prior.names)
    return float(np.sqrt(variance)) if set(STATE_NAMES) <= known else None


def by_cadence(fit: Fit, asked: Sequence[Quantity]) -> list[CadenceCurve]:
    """Sigmas with every m-th exposure of each telescope, the arc being the same; all nuisances as they are."""
    problem, index = fit.problem, fit.observation.telescope_index
    order = np.zeros(problem.n, dtype=np.int64)
    for number in np.unique(index):
        order[index == number] = np.arange(np.count_nonzero(index == number))
    fewest = min(int(np.count_nonzero(index == number)) for number in np.unique(index))
    steps = [m for m in SPARSER if m == 1 or fewest // m >= FEWEST]
    parts = [subset(problem, order % m == 0) for m in steps]
    counts = [part.n for part in parts]
    return [
        CadenceCurve(
            every=steps,
            count=counts,
            total=total,
            slope=last_slope(np.array(counts, dtype=np.float64)[::-1], total[::-1]),
        )
        for total in _totals(parts, asked)
    ]


def by_noise(fit: Fit, asked: Sequence[Quantity]) -> list[NoiseCurve]:
    """Sigmas with the noise of all telescopes scaled, gains re-optimised: a floor of nuisances, then slope 1."""
    worlds = []
    for factor in NOISE_FACTORS:
        world = fit.problem
        for name in world.noise_names:
            world = budget.scaled(world, name, factor)
        worlds.append(world)
    factors = np.array(NOISE_FACTORS)
    return [
        NoiseCurve(
            factor=NOISE_FACTORS,
            total=total,
            slope_quiet=last_slope(1.0 / factors[:3], total[:3], -1.0),
            slope_noisy=last_slope(factors[-3:], total[-3:]),
        )
        for total in _totals(worlds, asked)
    ]


def last_slope(x: Array, sigma: Array, sign: float = 1.0) -> float | None:
    """Slope of log sigma against log x over the last octave of x (all of it if that holds under three points)."""
    inside = x >= 0.5 * x.max()
    if np.count_nonzero(inside) < 3:
        inside = np.ones(len(x), dtype=bool)
    inside &= np.isfinite(sigma) & (sigma > 0.0) & (x > 0.0)
    if np.count_nonzero(inside) < 3:
        return None
    return float(sign * np.polyfit(np.log(x[inside]), np.log(sigma[inside]), 1)[0])


def _first_observable(problem: LinearProblem, place: Integers) -> int:
    """Number of measurements before the first of `place` where the problem is observable in double precision.

    A filter goes on through a problem whose condition is beyond 1/eps and then shows numbers of no meaning.
    """
    for last in place:
        if batch.solve(subset(problem, np.arange(problem.n) <= last)).solution is not None:
            return int(last)
    return problem.n


def _stepped(problem: LinearProblem, asked: Sequence[Quantity], place: Integers) -> list[Array]:
    """Total sigma of each quantity after some of the measurements, a batch each."""
    return _totals((subset(problem, np.arange(problem.n) <= last) for last in place), asked)


def _followed(problem: LinearProblem, asked: Sequence[Quantity]) -> list[Array] | None:
    """Total sigma (n,) of each quantity after each measurement, all in one pass; None where that has no truth."""
    known = set(problem.names("estimated", "considered", "ignored"))
    names = tuple(dict.fromkeys(name for quantity in asked for name in quantity.names if name in known))
    blocks = [quantity.partials_by(names) for quantity in asked]
    _, sigma = recursive.follow(problem, np.vstack(blocks), names)
    if sigma is None:
        return None
    edges = np.cumsum([len(W) for W in blocks])[:-1]
    return [np.sqrt(np.sum(part**2, axis=1)) for part in np.split(sigma, edges, axis=1)]


def _totals(problems: Iterable[LinearProblem], asked: Sequence[Quantity]) -> list[Array]:
    """Total sigma (problems,) of each quantity; inf where it is not observable."""
    found: list[list[float]] = [[] for _ in asked]
    for problem in problems:
        estimate = batch.solve(problem)
        for values, quantity in zip(found, asked):
            if estimate.solution is None:
                values.append(float("inf"))
            else:
                factors = estimate.predict(*known_partials(quantity, estimate)).factors
                values.append(float(np.sqrt(sum(np.sum(G**2) for G in factors.values()))))
    return [np.array(values) for values in found]
