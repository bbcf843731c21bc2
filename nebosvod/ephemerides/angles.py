"""Elongation, phase and distance from the Sun as they are seen: with light time and stellar aberration, as of Horizons.

The Sun is seen where it was when its light left it, and both directions are turned by the observer's velocity. The
phase is the angle at the object between the Sun as seen from there and the direction back along the line of sight as
it is seen here. Geometric angles differ from these by up to 0.01 deg.
"""

from dataclasses import dataclass

import erfa
import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM, SPEED_OF_LIGHT_KM_S
from nebosvod.observation import Observation
from nebosvod.observation.contracts import Array
from nebosvod.observation.measurement.direction import angle_between


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SunAngles:
    """Elongation and phase (n,), rad; distance (n,) of the object from the Sun along the light that is seen, km."""

    elongation: Array
    phase: Array
    r_sun_km: Array


def sun_angles(seen: Observation, ephemeris: Ephemeris) -> SunAngles:
    """Angles to the Sun of lines of sight whose light time is solved."""
    here, there = seen.telescope_state, seen.target_state
    left = seen.t_s - seen.light_time_s
    sun, _ = _sun_from(here, seen, seen.t_s, ephemeris)
    sun_there, r = _sun_from(there, seen, left, ephemeris)
    target = _turned(seen.u, here, seen.distance_km)
    return SunAngles(elongation=angle_between(target, sun), phase=angle_between(sun_there, -target), r_sun_km=r)


def _sun_from(place: Array, seen: Observation, t_s: Array, ephemeris: Ephemeris) -> tuple[Array, Array]:
    """Direction (n, 3) in which the Sun is seen from barycentric states (n, 6), and how far its light has come."""
    distance = np.linalg.norm(ephemeris.position_km("sun", seen.epoch, t_s) - place[:, :3], axis=1)
    to_sun = ephemeris.position_km("sun", seen.epoch, t_s - distance / SPEED_OF_LIGHT_KM_S) - place[:, :3]
    distance = np.linalg.norm(to_sun, axis=1)
    return _turned(to_sun / distance[:, None], place, distance), distance


def _turned(direction: Array, place: Array, distance_km: Array) -> Array:
    """Directions (n, 3) turned by the velocity of who looks (aberration)."""
    v = place[:, 3:] / SPEED_OF_LIGHT_KM_S
    seen: Array = erfa.ab(direction, v, distance_km / AU_KM, np.sqrt(1.0 - np.sum(v * v, axis=1)))
    return seen
