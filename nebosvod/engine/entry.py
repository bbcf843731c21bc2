"""Where an orbit comes down through an altitude: time, place and motion, with partials.

Altitudes are counted from the reference ellipsoid of WGS 84, along its normal (of other bodies: from a sphere), and
longitude and latitude are geodetic. The Earth turns by UT1 and its pole moves as observed, where that is tabulated.
"""

from dataclasses import dataclass

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, Trajectory
from nebosvod.dynamics.constants import EARTH_FLATTENING, EARTH_RADIUS_KM
from nebosvod.dynamics.encounter import relative_state
from nebosvod.dynamics.impact import descent
from nebosvod.dynamics.surface import height_km
from nebosvod.observation.earth.constants import EARTH_ROTATION_RAD_S
from nebosvod.observation.earth.earth_orientation import orientation
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs, tt_days
from nebosvod.observation.earth.ground import R_itrf_from_icrf
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
SQUARED_ECCENTRICITY = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """A point over the rotating Earth.

    Attributes
    ----------
    position_km : (3,), ITRF.
    longitude_rad, latitude_rad, geocentric_latitude_rad : geodetic, and the angle from the equator at the centre.
    altitude_km : above the ellipsoid.
    """

    position_km: Array
    longitude_rad: float
    latitude_rad: float
    geocentric_latitude_rad: float
    altitude_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """Where an orbit comes down through an altitude.

    Attributes
    ----------
    epoch, t_s : when, and the same in TDB seconds after the trajectory's epoch.
    partials_state (2, 6), partials_parameters (2, m) : of the point, downrange and crossrange at the level of entry,
        km, as it moves over the rotating Earth (over any other body: in space); the time of entry is eliminated.
    time_partials (6 + m,) : of the time of entry, s.
    axes : (2, 3) downrange and crossrange, fixed to the ground (ITRF; for another body ICRF).
    position_km : (3,) the point on the same axes, from the body's centre.
    speed_km_s, elevation_rad : relative to the body's centre; the angle of the path below the horizon.
    place : over the Earth; None over another body.
    place_partials : (2, 6 + m) of geodetic longitude and latitude, rad; None over another body.
    """

    epoch: Epoch
    t_s: float
    partials_state: Array
    partials_parameters: Array
    time_partials: Array
    axes: Array
    position_km: Array
    speed_km_s: float
    elevation_rad: float
    place: Place | None
    place_partials: Array | None


def entry_point(trajectory: Trajectory, approach: Encounter, altitude_km: float) -> Entry | None:
    """The entry of an orbit through the level `altitude_km` above a body; None if it never comes as low as that."""
    body = approach.body
    relative = relative_state(trajectory, body)

    def above(t_s: float) -> float:
        at = np.array([t_s])
        return float(height_km(body, relative(at)[:, :3], trajectory.epoch, at)[0]) - altitude_km

    t = descent(trajectory, approach, above)
    if t is None:
        return None
    state, at, epoch = relative(np.array([t]))[0], trajectory.at([t]), trajectory.epoch + t
    r, v = state[:3], state[3:]
    up, over_ground, to_ground = r / np.linalg.norm(r), v, np.eye(3)
    place = None
    if body == "earth":
        to_ground = R_itrf_from_icrf(epoch)
        place = place_of(to_ground @ r)
        up = to_ground.T @ _normal(place)
        over_ground = v - EARTH_ROTATION_RAD_S * np.cross(R_icrf_from_cirs(epoch, np.zeros(1))[0][:, 2], r)
    along = over_ground - (over_ground @ up) * up
    along = along / np.linalg.norm(along) if np.any(along) else np.linalg.svd(up[None])[2][1]
    # the crossing moves by dt = -(up.dr)/(up.v); the point by dr + v_ground dt
    moved = np.eye(3) - np.outer(over_ground, up) / (up @ v)
    both = np.hstack([at.Phi[0, :3], at.zeta[0, :3]])
    axes = np.stack([along, np.cross(up, along)])
    plane = axes @ moved @ both
    return Entry(
        epoch=epoch,
        t_s=t,
        partials_state=plane[:, :6],
        partials_parameters=plane[:, 6:],
        time_partials=-(up @ both) / (up @ v),
        axes=axes @ to_ground.T,
        position_km=to_ground @ r,
        speed_km_s=float(np.linalg.norm(v)),
        elevation_rad=float(-np.arcsin(np.clip(up @ v / np.linalg.norm(v), -1.0, 1.0))),
        place=place,
        place_partials=None if place is None else _on_the_ground(place, to_ground @ moved @ both),
    )


def on_the_ground(positions_km: Array, epoch: Epoch, t_s: Array) -> tuple[Array, Array, Array]:
    """Geodetic longitude and latitude (n,), rad, of points (n, 3) from the Earth's centre, ICRF, each at its own time.

    The third is the normal of the ellipsoid there, up (n, 3), ICRF.

    Parameters
    ----------
    t_s : shape (n,), TDB seconds after the epoch.
    """
    tt = tt_days(epoch, t_s)
    earth = orientation(np.full(len(t_s), epoch.day), tt)
    turn = erfa.rz(erfa.era00(*earth.ut1_jd), np.tile(np.eye(3), (len(t_s), 1, 1)))
    pole = erfa.pom00(earth.x_pole_rad, earth.y_pole_rad, erfa.sp00(epoch.day, tt))
    to_ground = np.einsum("nij,njk,nlk->nil", pole, turn, R_icrf_from_cirs(epoch, t_s))
    fixed = np.einsum("nij,nj->ni", to_ground, positions_km)
    longitude, latitude, _ = erfa.gc2gde(EARTH_RADIUS_KM, EARTH_FLATTENING, fixed)
    cos = np.cos(latitude)
    normal = np.stack([cos * np.cos(longitude), cos * np.sin(longitude), np.sin(latitude)], axis=1)
    up: Array = np.einsum("nij,ni->nj", to_ground, normal)
    return (longitude + np.pi) % (2.0 * np.pi) - np.pi, latitude, up


def place_of(position_km: Array) -> Place:
    """Longitude, latitude and altitude of a point (3,) of ITRF axes, over the ellipsoid of WGS 84."""
    longitude, latitude, altitude = erfa.gc2gde(EARTH_RADIUS_KM, EARTH_FLATTENING, position_km)
    return Place(
        position_km=position_km,
        longitude_rad=float((longitude + np.pi) % (2.0 * np.pi) - np.pi),
        latitude_rad=float(latitude),
        geocentric_latitude_rad=float(np.arcsin(position_km[2] / np.linalg.norm(position_km))),
        altitude_km=float(altitude),
    )


def azimuth_rad(place: Place, along: Array) -> float:
    """Azimuth, from north to east in 0 to 2 pi, of a level direction (3,) at a place; ITRF."""
    east = np.array([-np.sin(place.longitude_rad), np.cos(place.longitude_rad), 0.0])
    return float(np.arctan2(along @ east, along @ np.cross(_normal(place), east)) % (2.0 * np.pi))


def _normal(place: Place) -> Array:
    """Unit normal (3,) of the ellipsoid, ITRF."""
    cos = np.cos(place.latitude_rad)
    return np.array([cos * np.cos(place.longitude_rad), cos * np.sin(place.longitude_rad), np.sin(place.latitude_rad)])


def _on_the_ground(place: Place, moved: Array) -> Array:
    """Changes of longitude and latitude, rad (2, k), by displacements (3, k) of a point along its level, ITRF.

    Radii of curvature: N = a / sqrt(1 - e^2 sin^2 phi) along the parallel, M = N (1 - e^2) / (1 - e^2 sin^2 phi) along
    the meridian, each with the altitude added.
    """
    sin, cos = np.sin(place.latitude_rad), np.cos(place.latitude_rad)
    w = 1.0 - SQUARED_ECCENTRICITY * sin**2
    N = EARTH_RADIUS_KM / np.sqrt(w)
    M = N * (1.0 - SQUARED_ECCENTRICITY) / w
    east = np.array([-np.sin(place.longitude_rad), np.cos(place.longitude_rad), 0.0])
    north = np.cross(_normal(place), east)
    result: Array = np.stack(
        [east @ moved / ((N + place.altitude_km) * max(cos, 1e-12)), north @ moved / (M + place.altitude_km)]
    )
    return result


def ground_displacement(base: Array, axes: Array, other: Array) -> Array:
    """From one point of entry to another, downrange and crossrange (2,), km: the length of the arc between them.

    Parameters
    ----------
    base, other : (3,) from the centre, on axes fixed to the ground.
    axes : (2, 3) downrange and crossrange at the base, on the same.

    Notes
    -----
    Direction of the chord on the axes, with the length of the arc of a circle about the centre: right to the flattening
    at any distance, where a tangent plane is 1 % short after 1600 km. For near points it is the tangent plane.
    """
    chord = other - base
    flat = axes @ chord
    length = float(np.linalg.norm(flat))
    if length == 0.0:
        return np.zeros(2)
    radius = 0.5 * float(np.linalg.norm(base) + np.linalg.norm(other))
    arc = 2.0 * radius * float(np.arcsin(min(float(np.linalg.norm(chord)) / (2.0 * radius), 1.0)))
    result: Array = flat * (arc / length)
    return result
