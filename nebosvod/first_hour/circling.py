"""Which orbits circle the Earth so low that the Moon and the Sun will not bring them down: they need not be flown.

A hundred days of a geostationary orbit are a hundred revolutions; a cloud of a thousand such took four seconds to say
that none falls. What moves a perigee is the pull of a third body: averaged over a revolution |de/dt| is below
15/2 sum(GM / d^3) / n e sqrt(1 - e^2): with e = sin(psi), tan(psi / 2) grows by no more than the exponential of that
factor times the time.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import DAY_S, EARTH_RADIUS_KM
from nebosvod.first_hour.tracklet import Tracklet

Array = npt.NDArray[np.float64]
NEAREST_KM = {"moon": 356_400.0, "sun": 147.09e6}  # from the Earth
HIGHEST = 0.5  # of the Moon's least distance, to which an apogee may grow: beyond, averages say little
FORCED = 0.03  # of the eccentricity, what is left out: within a revolution, and by the Moon's parallax
SAFE = 1.5  # radii, above which a perigee is high


def lowest_perigee(tracklet: Tracklet, states: Array, within_d: float) -> Array:
    """The least perigee (m,), km, that heliocentric states (m, 6) may come to; nan where it may be on the ground.

    References
    ----------
    Kozai 1962, Astronomical Journal 67, 591; Murray and Correia 2010, arXiv:1009.1738, on averaged perturbations.
    """
    ephemeris, now = tracklet.forces.ephemeris, np.zeros(1)
    earth, sun = (ephemeris.state_km_km_s(body, tracklet.epoch, now)[0] for body in ("earth", "sun"))
    away, gm = states - (earth - sun), ephemeris.gm_km3_s2["earth"]
    with np.errstate(all="ignore"):
        speed2, distance = np.sum(away[:, 3:] ** 2, axis=1), np.linalg.norm(away[:, :3], axis=1)
        a = 1.0 / (2.0 / distance - speed2 / gm)
        h2 = np.sum(np.cross(away[:, :3], away[:, 3:]) ** 2, axis=1)
        e = np.sqrt(np.maximum(1.0 - h2 / (gm * a), 0.0))
        pull = sum(ephemeris.gm_km3_s2[body] / far**3 for body, far in NEAREST_KM.items())
        growth = 7.5 * pull * np.sqrt(a**3 / gm) * within_d * DAY_S
        half = np.tan(0.5 * np.arcsin(np.minimum(e + FORCED, 1.0))) * np.exp(growth)
        most = np.where(half < 1.0, 2.0 * half / (1.0 + half**2), 1.0)
        stays = (a > 0.0) & (a * (1.0 + most) < HIGHEST * NEAREST_KM["moon"])
        perigee = a * (1.0 - most)
    return np.where(stays & (perigee > SAFE * EARTH_RADIUS_KM), perigee, np.nan)
