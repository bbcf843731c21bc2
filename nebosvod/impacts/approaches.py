"""Every approach of an orbit to planets and the Moon, with sigmas, target plane and the linear chance of impact."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, Ephemeris, TargetPlane, Trajectory, perigee_distance
from nebosvod.dynamics.constants import AU_KM
from nebosvod.dynamics.impact import b_plane, events, follow, osculating_perigee, time_partials, what_it_hits
from nebosvod.engine.entry import Place, entry_point
from nebosvod.errors import ImpactError, InputError
from nebosvod.estimation.accuracy.ellipse import Ellipse
from nebosvod.estimation.accuracy.inside import inside_disc
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
BODIES = ("mercury", "venus", "earth", "moon", "mars", "jupiter", "saturn", "uranus", "neptune")
SIGMAS = 3.0
MOST_WITHIN_AU = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Approach:
    """One approach, or the impact that ends the orbit.

    Attributes
    ----------
    body, epoch, hits : to what, when it is nearest or comes to the surface, and whether it does that.
    distance_km : from the body's centre; of an impact that of the osculating hyperbola, as if the body were a point.
    sigma_time_s, sigma_distance_km : 1 sigma; of an impact of the time at the surface.
    speed_km_s : relative to the body, then.
    plane : the b-plane; None where the orbit is bound to the body, `no_plane` says so.
    factor : (2, 2) lower factor of the covariance of (xi, zeta), km; None without a plane.
    least_km : smallest distance within 3 sigma, from the target plane: 0 where the centre is inside of the ellipse.
    probability : of an impact, by the linear target plane; None without a plane.
    place : on the ground, of an impact on the Earth.
    """

    body: str
    epoch: Epoch
    hits: bool
    distance_km: float
    sigma_time_s: float
    sigma_distance_km: float
    speed_km_s: float
    plane: TargetPlane | None
    no_plane: str
    factor: Array | None
    least_km: float
    probability: float | None
    place: Place | None

    @property
    def ellipse(self) -> Ellipse | None:
        """The 1 sigma ellipse of the target plane."""
        return None if self.factor is None else Ellipse.of_factor(self.factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Approaches:
    """Approaches in the order of time, and why the search ended early, if it did."""

    found: tuple[Approach, ...]
    nearest: Approach | None
    ended: str


def approaches(orbit: UncertainOrbit, first: Epoch, last: Epoch, within_au: float, ephemeris: Ephemeris) -> Approaches:
    """All approaches to planets and the Moon between two epochs.

    Parameters
    ----------
    within_au : only those nearer than this; `nearest` tells the nearest one of all where there is none.

    Raises
    ------
    CoverageError
        If an epoch is outside the ephemeris, with what to install.
    ImpactError
        If the orbit hits something before `first`.

    Notes
    -----
    Sigmas are linear, by the partials of one flight; the search is of the dense output at four points a step and at
    least twice a day, each bracketed minimum refined to 1 us.
    """
    if not 0.0 < within_au <= MOST_WITHIN_AU:
        raise InputError(f"--within: {within_au:g} au (allowed: more than 0, up to {MOST_WITHIN_AU:g} au)")
    begin, end = first - orbit.epoch, last - orbit.epoch
    ephemeris.require(orbit.epoch, np.array([begin, end]))
    trajectory = _flight(orbit, (begin, end), ephemeris)
    return approaches_on(trajectory, orbit.factor, (begin, end), within_au)


def approaches_on(
    trajectory: Trajectory, factor: Array, span_s: tuple[float, float], within_au: float, bodies: Sequence[str] = BODIES
) -> Approaches:
    """The same on a trajectory with sensitivities.

    Parameters
    ----------
    factor : shape (6 + m, k), of the covariance of state and parameters at the trajectory's epoch.
    span_s : between which times it is looked for them, s after that epoch.
    """
    begin, end = span_s
    every = [(event, hits) for body in bodies for event, hits in events(trajectory, body) if begin <= event.t_s <= end]
    limit = within_au * AU_KM
    near = sorted((one for one in every if one[0].distance_km <= limit or one[1]), key=lambda one: one[0].t_s)
    found = tuple(_described(factor, trajectory, *one) for one in near)
    nearest = min(every, key=lambda one: one[0].distance_km, default=None)
    hit, ended = what_it_hits(trajectory), ""
    if hit is not None and hit.t_s < end:
        ended = f"the orbit hits {hit.body} on {hit.epoch.iso('utc', 0)} and ends there"
    alone = None if found or nearest is None else _described(factor, trajectory, *nearest)
    return Approaches(found=found, nearest=alone, ended=ended)


def _flight(orbit: UncertainOrbit, span: tuple[float, float], ephemeris: Ephemeris) -> Trajectory:
    """The orbit between two times, or to its impact."""
    try:
        return follow(
            orbit.state, orbit.epoch, (min(span[0], 0.0), max(span[1], 0.0)), span[0], orbit.forces(ephemeris), True
        )
    except ImpactError as error:
        raise ImpactError(f"{orbit.name}: {error}", body=error.body, t_s=error.t_s) from None


def _described(joint: Array, trajectory: Trajectory, event: Encounter, hits: bool) -> Approach:
    """Sigmas, plane and chance of one approach."""
    distance, by_state, by_parameters = (osculating_perigee if hits else perigee_distance)(trajectory, event)
    ground = entry_point(trajectory, event, 0.0) if hits else None
    by_time = time_partials(trajectory, event) if ground is None else ground.time_partials
    plane, reason = b_plane(trajectory, event, hits)
    factor = None if plane is None else _on_plane(joint, plane)
    sigma_distance = float(np.linalg.norm(np.concatenate([by_state, by_parameters]) @ joint))
    gm = trajectory.forces.ephemeris.gm_km3_s2[event.body]
    return Approach(
        body=event.body,
        epoch=event.epoch if ground is None else ground.epoch,
        hits=hits,
        distance_km=distance,
        sigma_time_s=float(np.linalg.norm(by_time @ joint)),
        sigma_distance_km=sigma_distance,
        speed_km_s=event.speed_km_s,
        plane=plane,
        no_plane=reason,
        factor=factor,
        least_km=max(distance - SIGMAS * sigma_distance, 0.0)
        if plane is None or factor is None
        else perigee_km(least_in_ellipse(plane.coordinates_km, SIGMAS * factor), plane.v_infinity_km_s, gm),
        probability=None
        if plane is None or factor is None
        else inside_disc(plane.coordinates_km, factor, plane.capture_radius_km),
        place=None if ground is None else ground.place,
    )


def _on_plane(joint: Array, plane: TargetPlane) -> Array:
    """Factor (2, k) of the covariance of (xi, zeta), km."""
    factor: Array = np.hstack([plane.partials_state, plane.partials_parameters]) @ joint
    return factor


def sigmas_to_hit(approach: Approach, most: float = 5.0) -> float | None:
    """How many sigmas away an orbit is that hits, by the linear target plane; None beyond `most` or without a plane."""
    if approach.hits:
        return 0.0
    plane, factor = approach.plane, approach.factor
    if plane is None or factor is None:
        return None

    def reaches(sigmas: float) -> bool:
        return least_in_ellipse(plane.coordinates_km, sigmas * factor) <= plane.capture_radius_km

    if not reaches(most):
        return None
    low, high = 0.0, most
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return high


def perigee_km(b_km: float, v_infinity_km_s: float, gm_km3_s2: float) -> float:
    """Smallest distance of the hyperbola with an impact parameter: gravity focuses, r = sqrt(b^2 + a^2) - a."""
    a = gm_km3_s2 / v_infinity_km_s**2
    return b_km * b_km / (float(np.hypot(b_km, a)) + a)


def least_in_ellipse(centre: Array, factor: Array) -> float:
    """Smallest distance from the origin to the ellipse centre + factor u, |u| <= 1; 0 inside of it.

    Notes
    -----
    In principal axes with half lengths s the nearest point is d_i lambda/(lambda + s_i^2) from the origin, d the
    centre, where sum (s_i d_i/(s_i^2 + lambda))^2 = 1; the sum falls with lambda, which is bisected.
    """
    axes, s, _ = np.linalg.svd(factor, full_matrices=False)
    d = axes.T @ centre

    def reached(multiplier: float) -> float:
        return float(np.sum((s * d / (s * s + multiplier)) ** 2))

    if s[-1] > 0.0 and np.sum((d / s) ** 2) <= 1.0:
        return 0.0
    low, high = 0.0, float(np.linalg.norm(s * d)) + 1e-300
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if reached(middle) > 1.0 else (low, middle)
    return float(np.linalg.norm(d * high / (s * s + high)))
