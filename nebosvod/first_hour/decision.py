"""Which observation would settle it: truths drawn, an observation simulated of each, the whole answer found again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.first_hour.alert import Alert, alert
from nebosvod.first_hour.sight import lines, together
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
TRUTHS = 12
SIGMA_RAD = 0.5 * ARCSEC  # of the observation that is simulated, where nobody says otherwise


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
        return float(np.mean((self.outcomes < self.low) | (self.outcomes > self.high)))


def decide(
    found: Alert, telescopes: Sequence[Telescope], after_s: Array, say: Callable[[str], None], truths: int = TRUTHS
) -> list[Decision]:
    """Decisions for every telescope and time, s after the last measurement; the best first.

    Parameters
    ----------
    truths : orbits drawn of the posterior; the same for all candidates.

    Notes
    -----
    The posterior after an observation is found anew by the grid: the cloud that is there would have no two orbits
    within half an arcsecond. Errors that the new observation shares with earlier ones of its station are left out.
    """
    rng = np.random.default_rng(np.random.SeedSequence(found.question.seed, spawn_key=(7,)))
    tracklet, p = found.tracklet, found.headline.probability
    rows = rng.choice(len(found.draws), truths, p=found.draws.weight())
    t_s = float(tracklet.exposures.t_s.max()) + after_s
    flown, _ = together(tracklet, found.draws.states[rows], t_s)
    noise = SIGMA_RAD * rng.standard_normal((truths, 2))
    decisions = []
    for telescope in telescopes:
        observer = telescope.spacecraft.state_km_km_s(tracklet.forces.ephemeris, tracklet.epoch, t_s)
        seen = Exposures.at(
            tracklet.epoch, t_s, observer, tracklet.forces.ephemeris, telescopes=(telescope,), sigma_rad=SIGMA_RAD
        )
        line, _ = lines(seen, flown)
        for k, t in enumerate(t_s.tolist()):
            say(f"one more observation by {telescope.name}, {(tracklet.epoch + t).iso('utc', 0)}")
            outcomes = [_after(found, seen.select(np.array([k])), line[j, k], noise[j]) for j in range(truths)]
            alive = np.array([one for one in outcomes if one is not None])
            if alive.size:
                decisions.append(Decision(
                    telescope=telescope.name, epoch=tracklet.epoch + t, sigma_rad=SIGMA_RAD, outcomes=alive,
                    low=0.1 * p, high=0.5 * (1.0 + p),
                ))  # fmt: skip
    return sorted(decisions, key=lambda one: -one.settles)


def _after(found: Alert, seen: Exposures, line: Array, noise: Array) -> float | None:
    """The probability after one more direction; None where the object has come down before or nothing fits."""
    if not np.isfinite(line).all():
        return None
    dec = float(np.arctan2(line[2], np.hypot(line[0], line[1]))) + noise[1]
    ra = float(np.arctan2(line[1], line[0])) + noise[0] / max(np.cos(dec), 1e-6)
    try:
        return alert(
            _longer(found.tracklet, seen, np.array([[ra % (2.0 * np.pi), dec]])), found.question
        ).headline.probability
    except GeometryError:
        return None


def _longer(tracklet: Tracklet, seen: Exposures, observed: Array) -> Tracklet:
    """The tracklet with one more measurement, by a telescope without errors of its own but noise."""
    old = tracklet.exposures
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(old, name), getattr(seen, name)])
        for name in ("t_s", "observer", "sun", "sun_pull", "sigma_rad", "correlation", "timing_sigma_s")
    }
    index = np.append(old.telescope_index, len(old.telescopes))
    exposures = replace(old, telescopes=(*old.telescopes, *seen.telescopes), telescope_index=index, **rows)
    columns = tracklet.columns
    none = Columns.none(1)
    k = len(columns.names)
    longer = replace(
        columns,
        bias=np.concatenate([columns.bias, np.zeros((1, 2, k))]),
        clock=np.concatenate([columns.clock, np.zeros((len(none.clock), k))]),
        place=np.concatenate([columns.place, np.zeros((1, 3, k))]),
    )
    return Tracklet.of(
        tracklet.name,
        exposures,
        np.concatenate([tracklet.observed, observed]),
        tracklet.forces,
        longer,
        tracklet.magnitude,
    )
