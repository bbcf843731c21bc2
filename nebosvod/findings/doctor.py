"""What the residuals of a run or a fit say of its model: is there a bias, a pattern, and which rhythm would hurt."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from nebosvod.engine.fitting import Fit
from nebosvod.estimation import Status
from nebosvod.findings.bias_tests import NOTHING, BiasTest, BiasTests, bias_tests
from nebosvod.findings.blame import LARGE, kind_of_problem
from nebosvod.findings.comparison import Accuracies
from nebosvod.findings.residual_tests import (
    ResidualTests,
    period_words,
    residual_tests,
    with_orbits,
    worst_of_predictions,
    worst_of_state,
)
from nebosvod.observation.earth.sites import GroundSite
from nebosvod.scene.scene import Scene
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagnosis:
    """The tests of one fit, and what is found in sentences; nothing is said that chance would bring."""

    biases: BiasTests
    residuals: ResidualTests
    findings: tuple[str, ...]


def diagnose(
    scene: Scene, fit: Fit, accuracies: Sequence[Accuracies] = (), *, recorded: bool = False
) -> Diagnosis | None:
    """Test a settled fit; None where it did not converge, or has so many measurements that tests would take long.

    Parameters
    ----------
    accuracies : of what was predicted, the rhythms that would hurt it among them.
    recorded : whether the measurements are real ones.
    """
    settled = fit.status is Status.CONVERGED and fit.estimate.solution is not None
    if not settled or fit.own_gain or fit.problem.n > LARGE:
        return None
    biases = bias_tests(scene, fit, recorded=recorded)
    worst = (worst_of_predictions(accuracies, fit.estimator.name) if accuracies else None) or worst_of_state(
        fit, rough=recorded
    )
    named = with_orbits(worst, [] if recorded else orbital_periods(scene))
    residuals = residual_tests(scene, fit, named, recorded=recorded)
    said = [sentence(scene.epoch, one) for one in biases.tests if one.verdict != NOTHING]
    return Diagnosis(biases=biases, residuals=residuals, findings=(*said, *residuals.findings))


def most_complete(fits: Iterable[Fit]) -> Fit | None:
    """The estimator with most of what may err in its model, the first of such; None where there are none."""
    return max(fits, key=lambda fit: sum(kind == "estimated" for _, kind in kind_of_problem(fit)), default=None)


def sentence(epoch: Epoch, one: BiasTest) -> str:
    """What was found of a bias."""
    found = one.leading
    bias, sigma = found.bias_rad / ARCSEC, found.sigma_rad / ARCSEC
    since = "" if found.since_s is None else f" since {(epoch + found.since_s).iso(digits=0)}"
    size = ", ".join(f"{axis} {b:+.3g} +- {s:.2g}" for axis, b, s in zip(("RA*", "Dec"), bias, sigma))
    moved = f"{found.shift_km:.3g} km, {found.shift_sigmas:.2g} sigmas"
    if one.modelled and found.since_s is None:
        what = f"it is estimated with the orbit, which without it would be off at the reference epoch by {moved}"
    else:
        what = f"estimated with the orbit it would move the position at the reference epoch by {moved}"
    return f"{one.telescope} has a bias{since}: {size} arcsec, by chance {found.chance:.1g}; {what}"


def orbital_periods(scene: Scene) -> list[tuple[str, float]]:
    """Periods, s, of the telescopes that go around the Earth, of the ellipse they are on at their first exposure."""
    gm, found = scene.ephemeris.gm_km3_s2["earth"], []
    for number, telescope in enumerate(scene.exposures.telescopes):
        rows = np.flatnonzero(scene.exposures.telescope_index == number)
        if getattr(telescope.spacecraft, "centre", "") != "earth" or isinstance(telescope.spacecraft, GroundSite):
            continue
        t_s = scene.exposures.t_s[rows[:1]]
        state = scene.exposures.observer[rows[0]] - scene.ephemeris.state_km_km_s("earth", scene.epoch, t_s)[0]
        inverse_a = 2.0 / np.linalg.norm(state[:3]) - float(state[3:] @ state[3:]) / gm
        if inverse_a > 0.0:
            found.append((telescope.name, float(2.0 * np.pi / np.sqrt(gm * inverse_a**3))))
    return found


def rhythm_words(found: ResidualTests) -> str | None:
    """The rhythm of the noise that would hurt most, and whether the residuals show it."""
    worst = found.worst
    if worst is None:
        return None
    name = f" ({worst.name})" if worst.name else ""
    text = (
        f"noise with a rhythm of {period_words(worst.period_s)}{name} would hurt most: {worst.what} "
        f"would be {worst.times_worse:.3g} times worse"
    )
    chances = [
        (series.at_worst_chance, f"{one.telescope} {series.axis}")
        for one in found.telescopes
        for series in one.series
        if series.at_worst_chance is not None
    ]
    if not chances:
        return text
    shown = [where for chance, where in chances if chance < found.level / len(chances)]
    seen = "residuals of " + ", ".join(shown) + " show it" if shown else "no residuals show it"
    return f"{text}; {seen}"
