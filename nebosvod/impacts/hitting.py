"""The orbit that hits and is most probable: an impact as a pseudo-observation of the target plane.

In whitened deviations u, the orbit x + S u, the sum |u|^2 + |b(u)|^2/s^2 is least where the orbit passes the centre of
the body, and is as probable as that allows; b is the point of the b-plane, s a part of the radius that captures. Its
second derivatives give the ellipsoid of the orbits that hit, from which importance sampling draws.

References
----------
Roa, Farnocchia, Chesley 2021, Astronomical Journal 162, 277.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import TargetPlane, Trajectory
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.impact import b_plane, events, follow
from nebosvod.errors import EventError, GeometryError
from nebosvod.impacts.coordinates import starts
from nebosvod.impacts.flight import GAP_S, Course
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
PART = 0.5  # of the capture radius: the sigma of the pseudo-observation
MOST_STEPS = 25
STILL = 1e-3  # sigmas
LONGEST = 2.0  # sigmas of one step
AFTER_S = 2.0 * DAY_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HittingOrbit:
    """The most probable orbit that hits.

    Attributes
    ----------
    u : (n,) its whitened deviation from the estimate; |u| is how many sigmas away it is.
    plane : its b-plane, with partials by state and parameters at the epoch. epoch : when.
    J : (2, n) d(xi, zeta)/du, km.
    factor : (n, n) of the covariance of u among the orbits that hit.
    """

    u: Array
    plane: TargetPlane
    epoch: Epoch
    J: Array
    factor: Array


def hitting_orbit(course: Course, body: str, near: Epoch, u: Array) -> HittingOrbit | None:
    """Find it from a start near it; None where the iteration does not end at one.

    Parameters
    ----------
    near : about when. u : (n,) whitened deviation from which to begin.
    """
    best: HittingOrbit | None = None
    for _ in range(MOST_STEPS):
        here = plane_at(course, body, near, u)
        if here is None:
            return best
        plane, epoch = here
        J = np.hstack([plane.partials_state, plane.partials_parameters]) @ _jacobian(course, u)
        s = PART * plane.capture_radius_km
        U, size, V = np.linalg.svd(J / s, full_matrices=True)
        best = HittingOrbit(u=u, plane=plane, epoch=epoch, J=J, factor=_narrowed(size, V))
        # least |v|^2 + |b/s + J (v - u)/s|^2 over v, in the singular directions of J/s
        target = U.T @ ((J @ u - plane.coordinates_km) / s)
        new = V[:2].T @ (size / (1.0 + size**2) * target)
        move = new - u
        length = float(np.linalg.norm(move))
        near, u = epoch, u + move * min(1.0, LONGEST / max(length, 1e-300))
        if length < STILL:
            break
    if best is None or np.linalg.norm(best.plane.coordinates_km) > 3.0 * best.plane.capture_radius_km:
        return None
    return best


def _narrowed(size: Array, V: Array) -> Array:
    """Factor of (I + J'J/s^2)^-1."""
    scale = np.ones(len(V))
    scale[: len(size)] = 1.0 / np.sqrt(1.0 + size**2)
    factor: Array = V.T * scale
    return factor


def _jacobian(course: Course, u: Array) -> Array:
    """d(state, parameters)/du at u: the factor, turned with the coordinates where they are curved."""
    S = course.orbit.factor
    if course.coordinates == "cartesian":
        return S
    gm, step = course.ephemeris.gm_km3_s2["sun"], 1e-3
    moved = np.concatenate([u + step * np.eye(len(u)), u - step * np.eye(len(u))])
    states, _ = starts(course.orbit, moved @ S.T, course.coordinates, gm)
    J = S.copy()
    J[:6] = (states[: len(u)] - states[len(u) :]).T / (2.0 * step)
    return J


def plane_at(course: Course, body: str, near: Epoch, u: Array) -> tuple[TargetPlane, Epoch] | None:
    """The b-plane of one orbit at the approach nearest in time; None where it has none."""
    trajectory = _flown(course, near, u)
    if trajectory is None:
        return None
    about = near - course.orbit.epoch
    found = [(event, hits) for event, hits in events(trajectory, body) if abs(event.t_s - about) < GAP_S]
    if not found:
        return None
    event, hits = min(found, key=lambda one: (not one[1], one[0].distance_km))
    try:
        plane, _ = b_plane(trajectory, event, hits)
    except GeometryError:
        return None
    return None if plane is None else (plane, event.epoch)


def _flown(course: Course, near: Epoch, u: Array) -> Trajectory | None:
    """One orbit with its sensitivities to just after an encounter, or its impact."""
    orbit, epoch = course.orbit, course.orbit.epoch
    states, values = starts(orbit, (orbit.factor @ u)[None], course.coordinates, course.ephemeris.gm_km3_s2["sun"])
    forces = orbit.forces(course.ephemeris)
    if values.shape[1]:
        forces = forces.with_values(dict(zip(forces.parameters, values[0].tolist())))
    end = min(near - epoch + GAP_S, course.last - epoch)
    try:
        return follow(states[0], epoch, (0.0, end), 0.0, forces, True)
    except EventError:
        return None
