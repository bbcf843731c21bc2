"""Orbits that hit a body: how far they can be followed, and what is predicted of the hit.

An orbit ends at the surface, so it has no closest approach. Its target plane and smallest distance are those of the
osculating hyperbola ten radii before: what they would be if the body were a point. The entry point is where the
orbit comes down through a given altitude.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, ForceModel, Trajectory, propagate
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.errors import EventError, InputError
from nebosvod.observation.constants import EARTH_ROTATION_RAD_S
from nebosvod.observation.earth_rotation import R_icrf_from_cirs, earth_rotation_angle
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
GRAIN_S = 1.0  # an orbit that hits is followed to within this of the surface
END_S = 2.0  # before its end such an orbit is evaluated: target planes difference it over a second to either side
FASTEST_KM_S = 75.0  # of any impact on a planet
NEAR = 30.0  # radii, where the two-body fall is good enough
GATE = 10.0  # radii, where an approach is described by its osculating hyperbola
MOST_STEPS = 60
MOST_HALVINGS = 40


def follow(
    state: Array,
    epoch: Epoch,
    span_s: tuple[float, float],
    needed_s: float,
    forces: ForceModel,
    sensitivities: bool,
    grid: Trajectory | None = None,
) -> Trajectory:
    """The orbit over a span, or to within a second of the impact that ends it.

    Parameters
    ----------
    state : shape (6,), heliocentric ICRF at `epoch`.
    needed_s : the last time somebody asks about.
    grid : a near orbit, whose steps and ephemeris are used again where they suit (see `propagate`).

    Raises
    ------
    EventError
        If it hits before `needed_s`; says what, when, and how deep.
    """
    first = span_s[0]
    try:
        return propagate(state, epoch, np.array(span_s), forces, sensitivities=sensitivities, grid=grid)
    except EventError:
        end = max(needed_s, 0.0)
        known = propagate(state, epoch, np.array([first, end]), forces, sensitivities=False)
    for _ in range(MOST_STEPS):
        step = min(_time_left(known, body, end) for body in RADIUS_KM) - GRAIN_S
        if step < 0.5 * GRAIN_S:
            break
        end = min(end + step, span_s[1])
        known = propagate(state, epoch, np.array([first, end]), forces, sensitivities=False)
    return propagate(state, epoch, np.array([first, end]), forces, sensitivities=sensitivities)


def _time_left(trajectory: Trajectory, body: str, t_s: float) -> float:
    """Time, s, until the orbit can be at the surface of a body: a lower bound, close by the two-body time of fall.

    The fall is the integral of dr/|r'|, r'^2 = v^2 + 2 GM (1/r - 1/r0) - h^2/r^2; between
    30 radii and the surface the Sun and the Earth's J2 change it by less than 0.1 s.
    """
    state = relative_state(trajectory, body)(np.array([t_s]))[0]
    gm, surface = trajectory.forces.ephemeris.gm_km3_s2[body], RADIUS_KM[body]
    r, v = state[:3], state[3:]
    distance, speed2 = float(np.linalg.norm(r)), float(v @ v)
    h2 = float(np.sum(np.cross(r, v) ** 2))
    left = (distance - surface) / np.sqrt(speed2 + 2.0 * gm / surface)
    if distance > NEAR * surface or r @ v >= 0.0:
        return float(left)
    node, weight = np.polynomial.legendre.leggauss(60)
    half = 0.5 * (distance - surface)
    at = surface + half * (node + 1.0)
    radial2 = speed2 + 2.0 * gm * (1.0 / at - 1.0 / distance) - h2 / at**2
    return float(left) if np.any(radial2 <= 0.0) else float(half * np.sum(weight / np.sqrt(radial2)))


def impact(trajectory: Trajectory, body: str) -> Encounter | None:
    """The end of an orbit that hits a body, as an encounter at its last time; None if it does not end there."""
    end_s = trajectory.span_s[1] - END_S
    state = relative_state(trajectory, body)(np.array([end_s]))[0]
    distance = float(np.linalg.norm(state[:3]))
    if distance > RADIUS_KM.get(body, 0.0) + FASTEST_KM_S * (GRAIN_S + END_S) or state[:3] @ state[3:] >= 0.0:
        return None
    speed = float(np.linalg.norm(state[3:]))
    epoch = trajectory.epoch + end_s
    return Encounter(body=body, epoch=epoch, t_s=end_s, distance_km=distance, speed_km_s=speed, state=state)


def gate(trajectory: Trajectory, hit: Encounter) -> Encounter:
    """The same approach ten radii out, where the body still acts as a point; where it ends, if it begins closer."""
    relative = relative_state(trajectory, hit.body)
    t = _descent(relative, hit, GATE * RADIUS_KM[hit.body])
    if t is None:
        return hit
    state = relative(np.array([t]))[0]
    distance, speed = (float(np.linalg.norm(part)) for part in (state[:3], state[3:]))
    epoch = trajectory.epoch + t
    return Encounter(body=hit.body, epoch=epoch, t_s=t, distance_km=distance, speed_km_s=speed, state=state)


def osculating_perigee(trajectory: Trajectory, hit: Encounter) -> tuple[float, Array, Array]:
    """Smallest distance of the osculating orbit, km, with its partials (6,) and (m,) as of `perigee_distance`."""
    gm, hit = trajectory.forces.ephemeris.gm_km3_s2[hit.body], gate(trajectory, hit)

    def perigee(x: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        r, v = x[:3], x[3:]
        h = np.cross(r, v)
        e = np.cross(v, h) / gm - r / np.sqrt(r @ r)
        return (h @ h) / gm / (1.0 + np.sqrt(e @ e))

    start = hit.state.astype(np.complex128)
    gradient = np.array([np.imag(perigee(start + 1e-40j * unit)) / 1e-40 for unit in np.eye(6)])
    at = trajectory.at([hit.t_s])
    return float(np.real(perigee(start))), gradient @ at.Phi[0], gradient @ at.zeta[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """Where an orbit comes down through an altitude.

    Attributes
    ----------
    epoch : when.
    partials_state (2, 6), partials_parameters (2, m) : of the point, downrange and crossrange on the sphere of entry,
        km, as it moves over the rotating Earth (over any other body: in space); the time of entry is eliminated.
    speed_km_s, elevation_rad : relative to the body's centre; the angle of the path below the horizon.
    longitude_rad, latitude_rad : geocentric, of the Earth (UT1 = UTC); nan for another body.
    """

    epoch: Epoch
    partials_state: Array
    partials_parameters: Array
    speed_km_s: float
    elevation_rad: float
    longitude_rad: float
    latitude_rad: float


def entry_point(trajectory: Trajectory, approach: Encounter, altitude_km: float) -> Entry:
    """The entry of an orbit into the sphere `altitude_km` above the (equatorial) surface of a body.

    Raises
    ------
    InputError
        If it never comes as low as that.
    """
    body = approach.body
    radius = RADIUS_KM[body] + altitude_km
    relative = relative_state(trajectory, body)
    t = _descent(relative, approach, radius)
    if t is None:
        raise InputError(
            f"the orbit passes {approach.distance_km - RADIUS_KM[body]:.0f} km above the surface of {body} and does "
            f"not come down to {altitude_km:g} km; use b_plane or perigee_distance"
        )
    state, at, epoch = relative(np.array([t]))[0], trajectory.at([t]), trajectory.epoch + t
    r, v = state[:3], state[3:]
    up = r / np.linalg.norm(r)
    over_ground, longitude, latitude = v, np.nan, np.nan
    if body == "earth":
        R = R_icrf_from_cirs(epoch, np.zeros(1))[0]
        over_ground = v - EARTH_ROTATION_RAD_S * np.cross(R[:, 2], r)
        x, y, z = R.T @ up
        turned = float(np.arctan2(y, x) - earth_rotation_angle(epoch, np.zeros(1))[0])
        longitude, latitude = (turned + np.pi) % (2.0 * np.pi) - np.pi, float(np.arcsin(z))
    along = over_ground - (over_ground @ up) * up
    along /= np.linalg.norm(along)
    # the crossing moves by dt = -(up.dr)/(up.v); the point by dr + v_ground dt
    moved = np.eye(3) - np.outer(over_ground, up) / (up @ v)
    plane = np.stack([along, np.cross(up, along)]) @ moved
    return Entry(
        epoch=epoch,
        partials_state=plane @ at.Phi[0, :3],
        partials_parameters=plane @ at.zeta[0, :3],
        speed_km_s=float(np.linalg.norm(v)),
        elevation_rad=float(-np.arcsin(up @ v / np.linalg.norm(v))),
        longitude_rad=longitude,
        latitude_rad=latitude,
    )


def _descent(relative: Callable[[Array], Array], approach: Encounter, radius: float) -> float | None:
    """When, on the way to an approach, the distance falls below a radius; None if it does not."""

    def above(t: float) -> float:
        return float(np.linalg.norm(relative(np.array([t]))[0, :3])) - radius

    low, high = approach.t_s - 2.0 * radius / approach.speed_km_s, approach.t_s
    if above(high) > 0.0 or above(low) < 0.0:
        return None
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if above(middle) > 0.0 else (low, middle)
    return high


def relative_state(trajectory: Trajectory, body: str) -> Callable[[Array], Array]:
    """States (n, 6) relative to a body, ICRF, at times (n,) of the trajectory."""
    ephemeris, epoch = trajectory.forces.ephemeris, trajectory.epoch

    def state(t_s: Array) -> Array:
        of_body = ephemeris.state_km_km_s(body, epoch, t_s) - ephemeris.state_km_km_s("sun", epoch, t_s)
        relative: Array = trajectory.state_at(t_s) - of_body
        return relative

    return state
