"""Surfaces of bodies: the Earth's reference ellipsoid, spheres of the other bodies; heights above them.

A height above the ellipsoid needs the Earth's pole alone, not its rotation. The pole is that of the forces, good to
0.25 arcsec: 0.03 m of height.
"""

from types import MappingProxyType

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import (
    ASTEROID_RADIUS_KM,
    DAY_S,
    EARTH_FLATTENING,
    EARTH_RADIUS_KM,
    J2000_JD,
    RADIUS_KM,
)
from nebosvod.dynamics.forces import earth_pole
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
CENTURY_DAYS = 36525.0
SURFACE_KM = MappingProxyType({**RADIUS_KM, **ASTEROID_RADIUS_KM})


def radius_km(body: str, direction: Array, epoch: Epoch, t_s: float) -> float:
    """Distance of the surface of a body from its centre, km, along a planetocentric ICRF direction (3,)."""
    if body != "earth":
        return SURFACE_KM[body]
    sine = float(direction @ earth_pole_icrf(epoch, t_s)) / float(np.linalg.norm(direction))
    polar = EARTH_RADIUS_KM * (1.0 - EARTH_FLATTENING)
    return float(1.0 / np.sqrt((1.0 - sine**2) / EARTH_RADIUS_KM**2 + sine**2 / polar**2))


def height_km(body: str, position_km: Array, epoch: Epoch, t_s: Array) -> Array:
    """Height (n,) above the surface of a body, km, negative below it.

    Parameters
    ----------
    body : a planet, "moon", "sun", or an asteroid.
    position_km : shape (n, 3), planetocentric ICRF.
    epoch, t_s : when, (n,) TDB seconds after `epoch`.

    Notes
    -----
    Above the Earth along the normal of the ellipsoid of WGS 84 (by erfa); above others from a sphere.

    References
    ----------
    Fukushima 2006, Journal of Geodesy 79, 689.
    """
    distance = np.linalg.norm(position_km, axis=1)
    if body != "earth":
        height: Array = distance - SURFACE_KM[body]
        return height
    pole = earth_pole_icrf(epoch, float(np.mean(t_s)))  # 0.02 arcsec in a day
    along = position_km @ pole
    across = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
    flat = np.stack([across, np.zeros(len(along)), along], axis=1)
    above: Array = erfa.gc2gde(EARTH_RADIUS_KM, EARTH_FLATTENING, flat)[2]
    return above


def earth_pole_icrf(epoch: Epoch, t_s: float) -> Array:
    """The Earth's pole of date (3,), ICRF, `t_s` TDB seconds after an epoch."""
    pole = np.empty(3)
    earth_pole(True, ((epoch.day - J2000_JD) + epoch.fraction + t_s / DAY_S) / CENTURY_DAYS, pole)
    return pole
