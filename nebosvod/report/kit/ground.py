"""Places on the Earth from distances along and across a path, for maps."""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import EARTH_FLATTENING, EARTH_RADIUS_KM

Array = npt.NDArray[np.float64]
POLAR = (1.0 - EARTH_FLATTENING) ** 2  # tangent of the geocentric latitude over that of the geodetic one


def reached(
    longitude_deg: float, latitude_deg: float, azimuth_deg: float, displacement_km: Array, altitude_km: float = 0.0
) -> tuple[Array, Array]:
    """Geodetic longitudes and latitudes, deg (n,), of displacements (n, 2) downrange and crossrange from a place.

    Parameters
    ----------
    azimuth_deg : direction downrange, from north to east; crossrange is to its left.

    Notes
    -----
    Along great circles of a sphere through the place, about the centre of the Earth: the displacements of entries are
    arcs of such circles (`engine.entry.ground_displacement`). On the ellipsoid it is good to a third of a per cent.
    """
    latitude = np.arctan(POLAR * np.tan(np.radians(latitude_deg)))
    flat = (1.0 - EARTH_FLATTENING) / np.sqrt(
        (1.0 - EARTH_FLATTENING) ** 2 * np.cos(latitude) ** 2 + np.sin(latitude) ** 2
    )
    radius = EARTH_RADIUS_KM * flat + altitude_km
    along, across = np.asarray(displacement_km, dtype=np.float64).T
    angle, turn = np.hypot(along, across) / radius, np.radians(azimuth_deg) - np.arctan2(across, along)
    sine = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * np.sin(angle) * np.cos(turn)
    east = np.arctan2(
        np.sin(turn) * np.sin(angle) * np.cos(latitude), np.cos(angle) - np.sin(latitude) * np.clip(sine, -1.0, 1.0)
    )
    there = np.arcsin(np.clip(sine, -1.0, 1.0))
    longitude = (longitude_deg + np.degrees(east) + 180.0) % 360.0 - 180.0
    return longitude, np.degrees(np.arctan(np.tan(there) / POLAR))


def continued(longitude_deg: Array, centre_deg: float) -> Array:
    """Longitudes within half a turn of a central one, so that a map about it shows them on its sheet."""
    return np.asarray(centre_deg + (np.asarray(longitude_deg) - centre_deg + 180.0) % 360.0 - 180.0)


def middle(longitude_deg: Array) -> float:
    """The longitude about which points lie, wherever the date line runs."""
    angle = np.radians(longitude_deg)
    return float(np.degrees(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())))
