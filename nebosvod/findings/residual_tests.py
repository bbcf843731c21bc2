"""Are the residuals noise: runs of one sign, correlation from one to the next, rhythms; which rhythm would hurt most.

What is tested are recursive residuals in a model of everything that errs: independent numbers of one variance where
that model is right. Each telescope has six tests, runs, correlation and rhythm of RA* and Dec; a finding is one whose
chance is below the level shared by all tests of a run or a fit. The rhythm that would hurt a mission most is that of
the noise which Akim's family of correlations finds worst for what is predicted.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.errors import GeometryError
from nebosvod.estimation.accuracy.consistency import residual_pattern
from nebosvod.estimation.accuracy.extended import worst_prediction
from nebosvod.estimation.accuracy.periodogram import MOST, Rhythm, rhythm_at, strongest_rhythms
from nebosvod.estimation.accuracy.recursive_residuals import recursive_residuals
from nebosvod.findings.comparison import Accuracies
from nebosvod.findings.settled import settled
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
LEVEL = 0.01  # chance of any finding in a run or a fit whose residuals are noise
LAGS = 10
LEAST = 3 * LAGS  # measurements of a telescope that is tested
MOST_TELESCOPES = 12  # that are tested, those with most measurements
FEW = 300_000  # products of frequencies and recorded residuals
AXES = ("RA*", "Dec")
DAYS_S = (SECONDS_PER_DAY, 86164.1)  # of the Sun, and of the stars
NAMED_S = np.array([*DAYS_S, 0.5 * DAYS_S[0], 29.53 * DAYS_S[0], 365.25 * DAYS_S[0]])
ALIKE = 0.02  # of a period: called by its name
HURTS = 1.1  # worst sigma over the sigma, from which a rhythm is told


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeriesTest:
    """The tests of one component of one telescope.

    Attributes
    ----------
    runs, runs_expected, runs_chance : of one sign.
    lag, correlation, correlation_chance : the correlation of residuals so many places apart that is least likely.
    period_s, amplitude_sigmas, rhythm_chance : the strongest rhythm; shortest_s : the shortest period looked at.
    at_worst_chance : chance of the power at the period that would hurt most; None where that is not known.
    """

    axis: str
    runs: int
    runs_expected: float
    runs_chance: float
    lag: int
    correlation: float
    correlation_chance: float
    period_s: float
    amplitude_sigmas: float
    rhythm_chance: float
    shortest_s: float
    at_worst_chance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TelescopeTest:
    """The tests of one telescope; `scatter` is the root mean square of its residuals in their stated sigmas."""

    telescope: str
    n: int
    scatter: float
    series: tuple[SeriesTest, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorstRhythm:
    """The rhythm of the noise that would hurt a predicted quantity most.

    Attributes
    ----------
    what : the quantity, in words. period_s : of the noise. name : of the period, empty where it has none.
    times_worse : the sigma with such noise over the sigma with independent noise.
    """

    what: str
    period_s: float
    name: str
    times_worse: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResidualTests:
    """All tests of a fit; `alone` is the level of each by itself, `findings` what is below it, a sentence each."""

    level: float
    alone: float
    telescopes: tuple[TelescopeTest, ...]
    worst: WorstRhythm | None
    findings: tuple[str, ...]


def residual_tests(scene: Scene, fit: Fit, worst: WorstRhythm | None, *, recorded: bool = False) -> ResidualTests:
    """Test the residuals of a settled fit, telescope by telescope.

    Parameters
    ----------
    worst : the rhythm that would hurt most (`worst_of_predictions`, `worst_of_state`).
    recorded : whether the measurements are real ones: then there may be many telescopes, and few frequencies do.
    """
    nothing = ResidualTests(level=LEVEL, alone=LEVEL, telescopes=(), worst=worst, findings=())
    if fit.estimate.solution is None:
        return nothing
    index, names = scene.exposures.telescope_index, [one.name for one in scene.exposures.telescopes]
    told = recursive_residuals(settled(fit))
    known = np.isfinite(told).all(axis=1)
    counts = [int(np.count_nonzero(known & (index == i))) for i in range(len(names))]
    asked = sorted(sorted(range(len(names)), key=lambda i: (-counts[i], i))[:MOST_TELESCOPES])
    asked = [i for i in asked if counts[i] >= LEAST]
    if not asked:
        return nothing
    period = None if worst is None else worst.period_s
    found = []
    for i in asked:
        rows = np.flatnonzero(known & (index == i))
        e, t_s = told[rows], scene.exposures.t_s[rows]
        rhythms = strongest_rhythms(t_s, e, FEW if recorded else MOST)
        series = tuple(_series(axis, t_s, e[:, k], rhythms[k], period) for k, axis in enumerate(AXES))
        found.append(
            TelescopeTest(telescope=names[i], n=len(rows), scatter=float(np.sqrt(np.mean(e**2))), series=series)
        )
    alone = LEVEL / (6 * len(found))
    said = [text for one in found for text in _findings(one, alone, worst)]
    return ResidualTests(level=LEVEL, alone=alone, telescopes=tuple(found), worst=worst, findings=tuple(said))


def _series(axis: str, t_s: Array, e: Array, rhythm: Rhythm, worst_s: float | None) -> SeriesTest:
    """All tests of one series, in the order of time; `rhythm` is its strongest."""
    pattern = residual_pattern(e, LAGS)
    reached = worst_s is not None and worst_s <= np.ptp(t_s)
    return SeriesTest(
        axis=axis,
        runs=pattern.runs,
        runs_expected=pattern.runs_expected,
        runs_chance=pattern.runs_p,
        lag=pattern.lag,
        correlation=pattern.correlation,
        correlation_chance=pattern.lag_p,
        period_s=rhythm.period,
        amplitude_sigmas=rhythm.amplitude,
        rhythm_chance=rhythm.chance,
        shortest_s=rhythm.shortest,
        at_worst_chance=rhythm_at(t_s, e, worst_s).chance if worst_s is not None and reached else None,
    )


def _findings(one: TelescopeTest, alone: float, worst: WorstRhythm | None) -> Iterator[str]:
    """What noise alone would not bring, in few sentences: tests that a correlation upsets stand back behind it."""
    correlated = [s for s in one.series if s.correlation_chance < alone]
    if correlated:
        size = ", ".join(f"{s.axis} by {s.correlation:+.2f}" for s in correlated)
        least = min(correlated, key=lambda s: s.correlation_chance)
        apart = "neighbours" if least.lag == 1 else f"those {least.lag} places apart"
        heavy = ": they weigh too much" if all(s.correlation > 0.0 for s in correlated) else ""
        chance = f"(chance {least.correlation_chance:.1g})"
        yield f"{one.telescope}: residuals are correlated, {apart} in {size} {chance}{heavy}"
    runs = [s for s in one.series if s.runs_chance < alone]
    if runs and not correlated:
        least = min(runs, key=lambda s: s.runs_chance)
        many = "more" if least.runs > least.runs_expected else "fewer"
        yield (
            f"{one.telescope}, {least.axis}: {least.runs} runs of residuals of one sign, {many} than the "
            f"{least.runs_expected:.0f} of noise (chance {least.runs_chance:.1g})"
        )
    waves = [s for s in one.series if s.rhythm_chance < alone]
    if waves:
        least = min(waves, key=lambda s: s.rhythm_chance)
        same = worst is not None and abs(least.period_s / worst.period_s - 1.0) < ALIKE
        name = period_name(least.period_s)
        if same or name or not (correlated or runs):
            yield (
                f"{one.telescope}, {least.axis}: residuals have a rhythm of {period_words(least.period_s)}"
                f"{f' ({name})' if name else ''} with an amplitude of {least.amplitude_sigmas:.2f} sigmas "
                f"(chance {least.rhythm_chance:.1g}){', the one that hurts this mission most' if same else ''}"
            )


def worst_of_predictions(rows: Sequence[Accuracies], estimator: str) -> WorstRhythm | None:
    """The rhythm that would hurt the predictions of an estimator most, of the component it makes worst.

    Where it has no rows of its own, the accuracies of the first are what it shares.
    """
    name = estimator if any(row.estimator == estimator for row in rows) else rows[0].estimator
    mine = [
        row
        for row in rows
        if row.estimator == name and row.worst_correlation is not None and row.worst_period_s is not None
    ]
    usable = [row for row in mine if row.extended > 0.0]
    if not usable:
        return None

    def worse(row: Accuracies) -> float:
        return (row.worst_correlation or 0.0) / row.extended

    row = max(usable, key=worse)
    return _worst(f"component {row.component + 1} of {row.prediction}", row.worst_period_s or np.inf, worse(row))


def worst_of_state(fit: Fit, *, rough: bool = False) -> WorstRhythm | None:
    """The rhythm that would hurt the position at the reference epoch most, along its longest axis.

    rough : look at rhythms that have a name and a few others, not at all.
    """
    estimate = fit.estimate
    if estimate.solution is None or fit.own_gain:
        return None
    K = estimate.covariance(STATE_NAMES[:3])
    axis = np.linalg.eigh(K)[1][:, -1]
    W = np.zeros((1, len(estimate.names)))
    W[0, [estimate.names.index(name) for name in STATE_NAMES[:3]]] = axis
    try:
        found = worst_prediction(fit.problem, W, fit.observation.t_s, rough=NAMED_S if rough else None)[0]
    except GeometryError:
        return None
    rest = max(float(axis @ K @ axis) - found.sigma_white**2, 0.0)
    now, then = np.sqrt(rest + found.sigma_white**2), np.sqrt(rest + found.sigma**2)
    return _worst("position at the reference epoch", 2.0 * np.pi / found.frequency_rad_per_s, float(then / now))


def _worst(what: str, period_s: float, times: float) -> WorstRhythm | None:
    """The rhythm with the name of its period; None where it would not hurt."""
    if not (times > HURTS and np.isfinite(period_s)):
        return None
    return WorstRhythm(what=what, period_s=period_s, name=period_name(period_s), times_worse=times)


def period_name(period_s: float) -> str:
    """What a period is called; empty where it has no name."""
    for times, name in ((1.0, "daily"), (2.0, "twice a day")):
        if any(abs(times * period_s / day - 1.0) < ALIKE for day in DAYS_S):
            return name
    return ""


def with_orbits(worst: WorstRhythm | None, periods_s: Sequence[tuple[str, float]]) -> WorstRhythm | None:
    """The rhythm called by the orbital period of a telescope where it is one."""
    if worst is None:
        return None
    same = [name for name, period in periods_s if abs(worst.period_s / period - 1.0) < ALIKE]
    if not same:
        return worst
    words = f"the orbital period of {', '.join(same)}"
    return replace(worst, name=f"{worst.name}, {words}" if worst.name else words)


def period_words(period_s: float) -> str:
    """A period with its unit."""
    if period_s >= 1000.0 * SECONDS_PER_DAY:
        return f"{period_s / (365.25 * SECONDS_PER_DAY):.3g} years"
    if period_s >= 2.0 * SECONDS_PER_DAY or abs(period_s / SECONDS_PER_DAY - 1.0) < 0.5:
        return f"{period_s / SECONDS_PER_DAY:.4g} d"
    return f"{period_s / 3600.0:.3g} h" if period_s >= 3600.0 else f"{period_s / 60.0:.3g} min"
