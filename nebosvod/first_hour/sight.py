"""Many orbits of one tracklet at once: what is seen of each, against what was observed.

Orbits that differ in range by ten orders of magnitude fly together, on even steps; of those that these do not suit, the
ones alike in range share steps, and who fails the check of a step goes on in a flock of its own.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import propagate_many
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.even import EvenSteps
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
ALIKE = np.array([1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1]) * AU_KM  # borders of ranges within which orbits share steps
LIGHT_TIMES = 4  # corrections; each gains a factor of v/c


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """Of m orbits, at the n measurements of a tracklet.

    Attributes
    ----------
    residual : (m, n, 2) observed minus computed in RA cos Dec and Dec, rad; nan where an orbit ran into a body.
    rate : (m, n, 2) apparent motion, rad/s; this and what follows of some of the orbits, where few are asked for.
    across : (m, n, 2, 3) how the direction moves with the place of the observer, rad/km.
    from_earth_km : (m, n) distance from the Earth's centre.
    """

    residual: Array
    rate: Array
    across: Array
    from_earth_km: Array


class Flights:
    """Flights of any orbits from the reference time to the same times."""

    def __init__(self, tracklet: Tracklet, t_s: Array) -> None:
        self.tracklet, self.t_s = tracklet, t_s
        # forward and backward each by itself: so flocks part where the Earth tears them apart
        self.sides = [
            (side, EvenSteps(tracklet.epoch, t_s[side], tracklet.forces))
            for side in (t_s < 0.0, t_s > 0.0)
            if side.any()
        ]

    def fly(self, states: Array) -> Array:
        """Heliocentric states (m, n, 6) at the times of orbits (m, 6) at the reference time; nan of one that hits."""
        found = np.repeat(states[:, None], len(self.t_s), axis=1)
        away = np.linalg.norm(states[:, :3] - self.tracklet.place[:3], axis=1)
        for side, steps in self.sides:
            flown, known = steps.fly(states)
            for alike in _alike(away, np.flatnonzero(~known)):
                flown[alike] = propagate_many(
                    states[alike], self.tracklet.epoch, steps.t_s, self.tracklet.forces, threads=1
                ).state
            found[:, side] = flown
        return found


def until(tracklet: Tracklet, states: Array, end_s: Array, t_s: Array) -> Array:
    """States (m, n, 6) of orbits (m, 6) at ascending times (n,), nan from when each ends (m,), where it does.

    Who falls on the way is flown to the last of the times before it, and not to the ground.
    """
    found = np.full((len(states), len(t_s), 6), np.nan)
    count = np.searchsorted(t_s, np.where(np.isfinite(end_s), end_s, np.inf))
    for n in np.unique(count[count > 0]).tolist():
        found[count == n, :n] = Flights(tracklet, t_s[:n]).fly(states[count == n])
    return found


def _alike(away_km: Array, rows: Rows) -> list[Rows]:
    """Some rows, parted by distance."""
    group = np.searchsorted(ALIKE, away_km[rows])
    return [rows[group == k] for k in np.unique(group)]


def lines(
    exposures: Exposures, flown: Array, late_s: Array | None = None, displaced: Array | None = None
) -> tuple[Array, Array]:
    """Lines of sight (m, n, 3), km, to orbits with states (m, n, 6) at reception, and their motions (m, n, 3), km/s.

    Parameters
    ----------
    late_s, displaced : as of `Sight.see`.

    Notes
    -----
    Light comes from where the orbit was, r - v tau + a tau^2 / 2 with the Sun's pull, about a Sun that moves.
    """
    r, v = flown[..., :3], flown[..., 3:]
    pull = (-exposures.gm_sun_km3_s2 / _length(r) ** 3)[..., None] * r
    body_v, body_a = v + exposures.sun[:, 3:], pull + exposures.sun_pull
    body, observer = r + exposures.sun[:, :3], exposures.observer[:, :3]
    if late_s is not None:
        late = late_s[..., None]
        body = body + late * (body_v + 0.5 * late * body_a)
        observer = observer + late * exposures.observer[:, 3:]
    if displaced is not None:
        observer = observer + displaced
    away = body - observer
    line = away
    for _ in range(LIGHT_TIMES):
        tau = (_length(line) / SPEED_OF_LIGHT_KM_S)[..., None]
        line = away - tau * (body_v - 0.5 * tau * body_a)
    return line, body_v - exposures.observer[:, 3:]


def _length(vectors: Array) -> Array:
    """Of vectors (..., 3); numpy's own norm takes four times as long along so short an axis."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


class Sight:
    """What everybody needs of a tracklet, computed once."""

    def __init__(self, tracklet: Tracklet) -> None:
        exposures, ephemeris = tracklet.exposures, tracklet.forces.ephemeris
        self.tracklet = tracklet
        self.t_s = exposures.t_s
        self.axes = tracklet.axes
        earth = ephemeris.state_km_km_s("earth", tracklet.epoch, exposures.t_s)
        self.earth = earth[:, :3] - exposures.sun[:, :3]
        self.gm = exposures.gm_sun_km3_s2
        self.flights = Flights(tracklet, exposures.t_s)

    def fly(self, states: Array) -> Array:
        """Heliocentric states (m, n, 6) at the measurements of orbits (m, 6) at the reference time; nan of who hits."""
        return self.flights.fly(states)

    def see(self, flown: Array, late_s: Array | None = None, displaced: Array | None = None, every: int = 1) -> Seen:
        """Compare orbits with what was observed.

        Parameters
        ----------
        flown : states (m, n, 6) at the measurements.
        late_s, displaced : (m, n) and (m, n, 3) by how much each measurement was later than its record says, s, and
            its observer elsewhere, km; 0 where None.
        every : of which orbits more than residuals is asked: the first, and each so many further on.
        """
        exposures = self.tracklet.exposures
        line, motion = lines(exposures, flown, late_s, displaced)
        distance = _length(line)
        # a product of matrices for each measurement is six times as fast as their sum written out
        local = np.matmul(line.swapaxes(0, 1), self.axes.swapaxes(1, 2)).swapaxes(0, 1) / distance[..., None]
        chord = np.hypot(local[..., 0], local[..., 1])
        stretch = np.where(chord > 1e-12, np.arctan2(chord, local[..., 2]) / np.maximum(chord, 1e-12), 1.0)
        across = -self.axes[:, :2] / distance[::every, :, None, None]
        return Seen(
            residual=-local[..., :2] * stretch[..., None],
            rate=-np.einsum("mnij,mnj->mni", across, motion[::every]),
            across=across,
            from_earth_km=_length(flown[::every, :, :3] - self.earth),
        )
