"""Places over the turning Earth at one time: the axes fixed to it, and what falls through the sky over a place."""

import erfa
import numpy as np

from nebosvod.dynamics.constants import EARTH_FLATTENING, EARTH_RADIUS_KM
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.earth.earth_orientation import orientation
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs, tt_days
from nebosvod.timescale import Epoch


def R_itrf_from_icrf(epoch: Epoch) -> Array:
    """Rotation (3, 3) into axes fixed to the Earth: precession, nutation, UT1 and the pole as tabulated."""
    found: Array = R_itrf_from_icrf_at(epoch, np.zeros(1))[0]
    return found


def R_itrf_from_icrf_at(epoch: Epoch, t_s: Array) -> Array:
    """The same (n, 3, 3) at TDB seconds (n,) after an epoch."""
    tt = tt_days(epoch, t_s)
    day = np.full(len(tt), epoch.day)
    earth = orientation(day, tt)
    turned = erfa.rz(erfa.era00(*earth.ut1_jd), R_icrf_from_cirs(epoch, t_s).swapaxes(1, 2))
    result: Array = erfa.pom00(earth.x_pole_rad, earth.y_pole_rad, erfa.sp00(day, tt)) @ turned
    return result


def falling_state(
    ephemeris: Ephemeris,
    epoch: Epoch,
    *,
    longitude_rad: float,
    latitude_rad: float,
    altitude_km: float,
    elevation_rad: float,
    azimuth_rad: float,
    speed_km_s: float,
) -> Array:
    """Heliocentric ICRF state (6,), km and km/s, of a body that comes down over a place.

    Parameters
    ----------
    longitude_rad, latitude_rad, altitude_km : geodetic, over the ellipsoid of WGS 84.
    elevation_rad, azimuth_rad : angle of the path below the horizon, and where it flies to, from north to east.
    speed_km_s : from the Earth's centre, which does not turn: of the velocity that elevation and azimuth are of.

    Raises
    ------
    CoverageError
        If the ephemeris does not cover the epoch.
    """
    place = erfa.gd2gce(EARTH_RADIUS_KM, EARTH_FLATTENING, longitude_rad, latitude_rad, altitude_km)
    sin, cos = np.sin([longitude_rad, latitude_rad]), np.cos([longitude_rad, latitude_rad])
    up = np.array([cos[1] * cos[0], cos[1] * sin[0], sin[1]])
    east = np.array([-sin[0], cos[0], 0.0])
    level = np.cos(azimuth_rad) * np.cross(up, east) + np.sin(azimuth_rad) * east
    velocity = speed_km_s * (np.cos(elevation_rad) * level - np.sin(elevation_rad) * up)
    to_icrf = R_itrf_from_icrf(epoch).T
    at = np.zeros(1)
    earth = ephemeris.state_km_km_s("earth", epoch, at)[0] - ephemeris.state_km_km_s("sun", epoch, at)[0]
    state: Array = earth + np.concatenate([to_icrf @ place, to_icrf @ velocity])
    return state
