"""How a fit ended, and whether its numbers are an orbit: a status, and sentences that say why."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, chdtri

from nebosvod.dynamics.elements import state_to_cometary
from nebosvod.errors import counted
from nebosvod.estimation import Status
from nebosvod.findings.distance import unknown_distance
from nebosvod.fits.general import General
from nebosvod.fits.leading import Led
from nebosvod.fits.remarks import findings
from nebosvod.mission import FitMission
from nebosvod.mission.fit import FitPlan
from nebosvod.scene.material import Material
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
UNBOUND = 3.0  # sigmas of e that a hyperbola must lie above 1 to be believed
CIRCLE = "the selection of observations went in a circle or to its limit of rounds, and was kept as it was"
LEFT_OUT = 0.5  # of the observations: a fit that rejects more fits something else
DOUBTED = 1e-2  # probability of so large a chi squared by chance, below which a reader is warned
REFUSED, TIMES = 1e-6, 3.0  # rarer than this, and so many times too large: the sigmas of the orbit say nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """How it ended.

    Attributes
    ----------
    status : `not_observable` also where the solution exists and says next to nothing.
    message : the status as a sentence.
    cautions : what a reader should know before using the numbers.
    """

    status: Status
    message: str
    cautions: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether the answer is no orbit to rely on."""
        return self.status is not Status.CONVERGED


def verdict(found: Led, general: General) -> Verdict:
    """Judge a fit by its estimate and by the tests made on the way."""
    lean, material = found.lean, found.material
    rejected = int((~general.selected).sum())
    few = [f"{rejected} of {counted(len(material), 'observation')} were rejected: this orbit is not theirs"]
    few = few if rejected > LEFT_OUT * len(material) else []
    circle = [] if lean.stands and general.stands else [CIRCLE]
    chance, times, words = _misfit(general)
    large = [words] if chance < DOUBTED else []
    cautions = (*few, *circle, *large, *_kept(found, general), *findings(found, general))
    status = lean.correction.status
    if status is Status.CONVERGED:
        status = general.fit.status
    if general.fit.estimate.solution is None or status is Status.NOT_OBSERVABLE:
        return Verdict(status=Status.NOT_OBSERVABLE, message=_weak(general), cautions=cautions)
    vague = _vague(general, material)
    if vague:
        return Verdict(status=Status.NOT_OBSERVABLE, message=vague, cautions=cautions)
    if status is Status.ITERATION_LIMIT:
        message = f"{status.sentence} Raise fit.iterations (now {_plan(general).iterations})."
        return Verdict(status=status, message=message, cautions=cautions)
    if status is Status.CONVERGED and (few or circle or (chance < REFUSED and times > TIMES)):
        return Verdict(status=Status.DIVERGED, message=cautions[0], cautions=cautions[1:])
    return Verdict(status=status, message=status.sentence, cautions=cautions)


def _plan(general: General) -> FitPlan:
    """What the settings ask."""
    return cast(FitMission, general.scene.mission).fit


def _misfit(general: General) -> tuple[float, float, str]:
    """Probability of so large a chi squared by chance, how many times it is too large, and the sentence that says it.

    Probability and ratio are 1 where nothing is left over to judge by.
    """
    estimate = general.fit.estimate
    if estimate.solution is None:
        return 1.0, 1.0, ""
    known = {name for prior in general.fit.problem.priors for name in prior.names}
    freedom = 2 * int(general.selected.sum()) - len(set(estimate.names) - known)
    if freedom <= 0:
        return 1.0, 1.0, ""
    times = estimate.chi2 / freedom
    return (
        float(chdtrc(freedom, estimate.chi2)),
        times,
        (
            f"chi squared is {estimate.chi2:.4g} for {counted(freedom, 'degree')} of freedom, where chance leads above "
            f"{chdtri(freedom, DOUBTED):.4g} once in {1.0 / DOUBTED:.0f}: the sigmas are too small, "
            f"as if by a factor of {np.sqrt(times):.2g}"
        ),
    )


def _kept(found: Led, general: General) -> list[str]:
    """A caution where selected observations lie beyond the threshold of rejection."""
    said, material = _plan(general).rejection, found.material
    beyond = np.flatnonzero(general.selected & (general.chi2 > said.reject))
    if not beyond.size:
        return []
    worst = beyond[np.argmax(general.chi2[beyond])]
    place = f"{Path(str(material.astrometry.path[worst])).name}:{material.astrometry.line[worst]}"
    why = "because there are few" if said.enabled else "because rejection is off"
    if found.spared is not None and found.spared[beyond].all():
        why = "because the sharpest records agree with each other"
    verb = "has" if beyond.size == 1 else "have"
    return [
        f"{beyond.size} of the selected observations {verb} chi squared above {said.reject:g}, kept {why}; "
        f"the worst is {place}, chi {np.sqrt(general.chi2[worst]):.1f}"
    ]


def arc_words(material: Material) -> str:
    """Length of the arc for a sentence."""
    length = float(np.ptp(material.astrometry.t_s))
    for size, unit in ((365.25 * SECONDS_PER_DAY, "years"), (SECONDS_PER_DAY, "days"), (3600.0, "hours")):
        if length >= 2.0 * size:
            return f"{length / size:.3g} {unit}"
    return f"{length / 60.0:.0f} minutes"


def _weak(general: General) -> str:
    """The weak direction by names."""
    estimate = general.fit.estimate
    if estimate.solution is not None or not estimate.weak_direction:
        return Status.NOT_OBSERVABLE.sentence
    parts = sorted(estimate.weak_direction.items(), key=lambda item: -abs(item[1]))[:3]
    return f"{Status.NOT_OBSERVABLE.sentence} Weakest together: {', '.join(name for name, _ in parts)}."


def _vague(general: General, material: Material) -> str:
    """Why a solution is no orbit: a distance not known, or a hyperbola within its sigma; empty where it is one."""
    estimate, arc = general.fit.estimate, arc_words(material)
    far = unknown_distance(general.scene, general.fit)
    if far:
        return f"{Status.NOT_OBSERVABLE.sentence} The arc of {arc} does not tell how far the object is: {far}."
    state, gm = general.fit.point.state, general.scene.ephemeris.gm_km3_s2["sun"]
    if 0.5 * float(state[3:] @ state[3:]) < gm / float(np.linalg.norm(state[:3])):
        return ""
    elements, jacobian = state_to_cometary(state, gm)
    spread = float(np.linalg.norm(jacobian[0] @ estimate.factor(STATE_NAMES)))
    if elements[0] >= 1.0 and elements[0] - 1.0 < UNBOUND * spread:
        return (
            f"{Status.NOT_OBSERVABLE.sentence} The best orbit is unbound (e = {elements[0]:.4g} +- {spread:.2g}), "
            f"which an arc of {arc} does not show."
        )
    return ""
