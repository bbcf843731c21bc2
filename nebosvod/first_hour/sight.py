"""Many orbits of one tracklet at once: what is seen of each, against what was observed.

Orbits that differ in range by ten orders of magnitude fly together, on even steps; those that these do not suit fly
each on steps of its own.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.each import states_of_each
from nebosvod.dynamics.even import EvenSteps
from nebosvod.first_hour.received import fill_lines, fill_offsets
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.measurement.exposures import Exposures

Array = npt.NDArray[np.float64]


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
        self.sides = [
            (side, EvenSteps(tracklet.epoch, t_s[side], tracklet.forces))
            for side in (t_s < 0.0, t_s > 0.0)
            if side.any()
        ]

    def fly(self, states: Array) -> Array:
        """Heliocentric states (m, n, 6) at the times of orbits (m, 6) at the reference time; nan of one that hits."""
        found = np.repeat(states[:, None], len(self.t_s), axis=1)
        for side, steps in self.sides:
            flown, known = steps.fly(states)
            left = np.flatnonzero(~known)
            if left.size:
                flown[left] = states_of_each(states[left], self.tracklet.epoch, steps.t_s, self.tracklet.forces)
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
    line, motion = np.empty((*flown.shape[:2], 3)), np.empty((*flown.shape[:2], 3))
    whole = np.ascontiguousarray
    fill_lines(
        whole(flown), whole(exposures.sun), whole(exposures.sun_pull), whole(exposures.observer),
        exposures.gm_sun_km3_s2, np.empty((0, 0)) if late_s is None else whole(late_s),
        np.empty((0, 0, 0)) if displaced is None else whole(displaced), line, motion,
    )  # fmt: skip
    return line, motion


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
        distance, offset = np.empty(line.shape[:2]), np.empty((*line.shape[:2], 2))
        fill_offsets(line, np.ascontiguousarray(self.axes), distance, offset)
        across = -self.axes[:, :2] / distance[::every, :, None, None]
        return Seen(
            residual=-offset,
            rate=-np.einsum("mnij,mnj->mni", across, motion[::every]),
            across=across,
            from_earth_km=_length(flown[::every, :, :3] - self.earth),
        )
