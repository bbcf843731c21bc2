"""Which observation would settle it: truths drawn, an observation simulated of each, the whole answer found again."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.first_hour.alert import Alert, alert
from nebosvod.first_hour.candidate import NEW, Candidate
from nebosvod.first_hour.sight import until
from nebosvod.impacts.interval import of_count
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
TRUTHS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decision:
    """What one more observation would do.

    Attributes
    ----------
    outcomes : (m,) probabilities of impact after it, one for each drawn truth.
    low, high : thresholds: a tenth of the probability now, and the middle between it and 1.
    """

    telescope: str
    epoch: Epoch
    sigma_rad: float
    outcomes: Array
    low: float
    high: float

    @property
    def settles(self) -> float:
        """Chance to end beyond one of the thresholds."""
        return float(np.mean(self._beyond))

    @property
    def interval(self) -> tuple[float, float]:
        """Of that chance at 95 %, for the number of truths."""
        hits, truths = int(self._beyond.sum()), len(self.outcomes)
        if 2 * hits > truths:
            low, high = of_count(truths - hits, truths)
            return 1.0 - high, 1.0 - low
        return of_count(hits, truths)

    @property
    def _beyond(self) -> npt.NDArray[np.bool_]:
        found: npt.NDArray[np.bool_] = (self.outcomes < self.low) | (self.outcomes > self.high)
        return found


def decide(
    found: Alert, telescopes: Sequence[Telescope], after_s: Array, say: Callable[[str], None], truths: int = TRUTHS,
    left_out: Collection[tuple[str, str]] = (),
) -> list[Decision]:  # fmt: skip
    """Decisions for every telescope and time, s after the last measurement; the best first.

    Parameters
    ----------
    truths : orbits drawn of the posterior; the same for all candidates.
    left_out : names and times (UTC to a second) of telescopes that cannot observe then.

    Notes
    -----
    The posterior after an observation is found anew by the grid: the cloud that is there would have no two orbits
    within half an arcsecond. A station that has observed errs anew as it did: each truth has its bias, clock and
    place, drawn with the orbit, and the answer after it knows that they are the same. One that has not has a bias, and
    on the ground a clock, of its own. A truth that has come down before is not counted.
    """
    rng = np.random.default_rng(np.random.SeedSequence(found.question.seed, spawn_key=(7,)))
    tracklet, p = found.tracklet, found.headline.probability
    rows = rng.choice(len(found.draws), truths, p=found.draws.weight())
    t_s = float(tracklet.exposures.t_s.max()) + after_s
    flown = until(tracklet, found.draws.states[rows], found.falls.t_s[rows], t_s)
    normal = rng.standard_normal((truths, 2 + NEW))
    decisions = []
    for telescope in telescopes:
        one = Candidate.of(tracklet, telescope)
        u = one.errors(found.draws.nuisance[rows], normal[:, 2:])
        seen, psi = one.observed(t_s, flown, u, normal[:, :2])
        for k, t in enumerate(t_s.tolist()):
            if (telescope.name, (tracklet.epoch + t).iso("utc", 0)) in left_out:
                continue
            say(f"one more observation by {telescope.name}, {(tracklet.epoch + t).iso('utc', 0)}")
            outcomes = [_after(found, one, seen.select(np.array([k])), psi[j, k]) for j in range(truths)]
            alive = np.array([one for one in outcomes if one is not None])
            if alive.size:
                decisions.append(Decision(
                    telescope=telescope.name, epoch=tracklet.epoch + t, sigma_rad=one.sigma_rad, outcomes=alive,
                    low=0.1 * p, high=0.5 * (1.0 + p),
                ))  # fmt: skip
    return sorted(decisions, key=lambda one: -one.settles)


def _after(found: Alert, one: Candidate, seen: Exposures, psi: Array) -> float | None:
    """The probability after one more direction (2,); None where the object has come down before or nothing fits."""
    if not np.isfinite(psi).all():
        return None
    try:
        return alert(one.longer(seen, psi), found.question).headline.probability
    except GeometryError:
        return None
