"""Apparent places: the astrometric direction bent by the Sun's gravity and turned by the telescope's velocity."""

import erfa
import numpy as np

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.constants import AU_KM, SPEED_OF_LIGHT_KM_S
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.measurement.direction import ra_dec
from nebosvod.observation.measurement.sight import Sight
from nebosvod.timescale import Epoch

# erfa's own limit for the Sun: the deflection is frozen inside phi^2/2 < 1e-6, 0.08 deg from the Sun's centre
DEFLECTION_LIMIT = 1e-6


@bordered()
def apparent_place(seen: Observation | Sight, epoch: Epoch, ephemeris: Ephemeris) -> Array:
    """Apparent RA and Dec (n, 2), rad, ICRF axes (no precession): what a telescope points at.

    Parameters
    ----------
    seen : lines of sight (light time already solved); epoch : t = 0 of its times.

    Notes
    -----
    Deflection by the Sun for a source at finite distance (erfa.ld: 4 mas at 90 deg from the Sun), then relativistic
    aberration with the telescope's barycentric velocity (erfa.ab: up to 21"). The Earth's deflection (0.5 mas close to
    its limb from orbit) is left out. A measurement reduced against background stars is astrometric: stars suffer
    aberration and most of the deflection with the target, so the default everywhere else is the astrometric place.
    """
    telescope = seen.telescope_state
    sun = ephemeris.position_km("sun", epoch, seen.t_s)
    from_sun = telescope[:, :3] - sun
    distance = np.linalg.norm(from_sun, axis=1)
    target = seen.target_state[:, :3] - sun
    q = target / np.linalg.norm(target, axis=1, keepdims=True)
    e = from_sun / distance[:, None]
    bent = erfa.ld(1.0, seen.u, q, e, distance / AU_KM, DEFLECTION_LIMIT)
    v = telescope[:, 3:] / SPEED_OF_LIGHT_KM_S
    shortening = np.sqrt(1.0 - np.sum(v * v, axis=1))
    turned: Array = erfa.ab(bent, v, distance / AU_KM, shortening)
    return ra_dec(turned)
