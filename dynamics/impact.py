"""Orbits that hit a body: how far they are followed, and what is predicted of the hit.

An orbit ends at the surface (of the Earth: the reference ellipsoid), so it has no closest approach. Its target plane
and smallest distance are those of the osculating hyperbola ten radii before: what they would be if the body were a
point. It is followed for two seconds below the surface, so that everything down to the ground can be differenced.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, ForceModel, TargetPlane, Trajectory, find_encounters, propagate, target_plane
from nebosvod.dynamics.collision import arrival
from nebosvod.dynamics.encounter import relative_state
from nebosvod.dynamics.surface import SURFACE_KM, height_km
from nebosvod.errors import GeometryError, ImpactError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
BELOW_S = 2.0  # an orbit that hits is followed so far below the surface: target planes difference it over a second
GATE = 10.0  # radii, where an approach is described by its osculating hyperbola
GRAIN_S = 1e-6  # to which a time of passage is found
MOST_HALVINGS = 60
MOST_STEPS = 13_000  # of one flight, six centuries of the longest ones: with their nodes a quarter of a gigabyte


def follow(
    state: Array,
    epoch: Epoch,
    span_s: tuple[float, float],
    needed_s: float,
    forces: ForceModel,
    sensitivities: bool,
    grid: Trajectory | None = None,
) -> Trajectory:
    """The orbit over a span, or until just after the impact that ends it.

    Parameters
    ----------
    state : shape (6,), heliocentric ICRF at `epoch`.
    needed_s : the last time somebody asks about.
    grid : a near orbit, whose steps and ephemeris are used again where they suit (see `propagate`).

    Raises
    ------
    ImpactError
        If it hits before `needed_s`; says what, when, and how deep.
    """
    try:
        return propagate(
            state, epoch, np.array(span_s), forces, sensitivities=sensitivities, grid=grid, most_steps=MOST_STEPS
        )
    except ImpactError as hit:
        if hit.t_s <= max(needed_s, 0.0):
            raise
        end = min(hit.t_s + BELOW_S, span_s[1])
    return propagate(
        state, epoch, np.array([span_s[0], end]), forces, sensitivities=sensitivities, solid=False,
        most_steps=MOST_STEPS,
    )  # fmt: skip


def fly(
    state: Array, epoch: Epoch, span_s: tuple[float, float], forces: ForceModel, grid: Trajectory | None = None
) -> Trajectory:
    """The orbit over a span of which all is needed, with its sensitivities; `grid` as of `follow`."""
    return propagate(state, epoch, np.array(span_s), forces, grid=grid, most_steps=MOST_STEPS)


def carry(state: Array, epoch: Epoch, to: Epoch, forces: ForceModel, sensitivities: bool = False) -> Trajectory:
    """The orbit from one epoch of a mission to another, which is its only time."""
    gap = np.array([to - epoch])
    return propagate(state, epoch, gap, forces, sensitivities=sensitivities, most_steps=MOST_STEPS)


def impact(trajectory: Trajectory, body: str) -> Encounter | None:
    """The end of an orbit that hits a body, as an encounter where it comes to the surface; None if it does not."""
    last = trajectory.span_s[1]
    relative = relative_state(trajectory, body)
    end = relative(np.array([last]))
    if height_km(body, end[:, :3], trajectory.epoch, np.array([last]))[0] >= 0.0:
        return None
    t = arrival(trajectory, body, np.array([last - 2.0 * BELOW_S, last]))
    return None if t is None else _encounter(trajectory, body, t)


def events(trajectory: Trajectory, body: str, within_km: float = np.inf) -> list[tuple[Encounter, bool]]:
    """Closest approaches to a body, and the impact that ends the orbit there; each with whether it is an impact."""
    found = [(event, False) for event in find_encounters(trajectory, body, within_km)]
    hit = impact(trajectory, body)
    return found if hit is None else [*[one for one in found if one[0].t_s < hit.t_s], (hit, True)]


def b_plane(trajectory: Trajectory, event: Encounter, hits: bool) -> tuple[TargetPlane | None, str]:
    """The b-plane of an encounter, of an impact that at its gate; None for a captured orbit, with the reason.

    References
    ----------
    Milani et al. 2002, Icarus 159, 284; Valsecchi et al. 2003, A&A 408, 1179.
    """
    try:
        return target_plane(trajectory, gate(trajectory, event) if hits else event, kind="b_plane"), ""
    except GeometryError as error:
        return None, str(error)


def time_partials(trajectory: Trajectory, event: Encounter) -> Array:
    """Partials (k,) of the time of closest approach, s: where r.v = 0, dt = -(v.dr + r.dv)/(v.v + r.a)."""
    at, (first, last) = trajectory.at([event.t_s]), trajectory.span_s
    around = np.array([max(event.t_s - 1.0, first), min(event.t_s + 1.0, last)])
    rate = np.diff(relative_state(trajectory, event.body)(around), axis=0)[0] / np.diff(around)
    condition = np.concatenate([event.state[3:], event.state[:3]])
    partials: Array = -(condition @ np.hstack([at.Phi[0], at.zeta[0]])) / float(condition @ rate)
    return partials


def what_it_hits(trajectory: Trajectory) -> Encounter | None:
    """The impact that ends an orbit, whatever it hits; None if it goes on."""
    ephemeris, last = trajectory.forces.ephemeris, trajectory.span_s[1:]
    sun = ephemeris.position_km("sun", trajectory.epoch, last)[0]
    end = trajectory.state_at(last)[0, :3] + sun
    for body in trajectory.forces.bodies:
        if body not in SURFACE_KM:
            continue
        place = sun if body == "sun" else ephemeris.position_km(body, trajectory.epoch, last)[0]
        if float(np.linalg.norm(end - place)) > 2.0 * SURFACE_KM[body]:  # far from every flattened surface
            continue
        hit = impact(trajectory, body)
        if hit is not None:
            return hit
    return None


def gate(trajectory: Trajectory, hit: Encounter) -> Encounter:
    """The same approach ten radii out, where the body still acts as a point; where it ends, if it begins closer."""
    relative = relative_state(trajectory, hit.body)
    radius = GATE * SURFACE_KM[hit.body]

    def above(t_s: float) -> float:
        return float(np.linalg.norm(relative(np.array([t_s]))[0, :3])) - radius

    t = descent(trajectory, hit, above)
    return hit if t is None else _encounter(trajectory, hit.body, t)


def _encounter(trajectory: Trajectory, body: str, t_s: float) -> Encounter:
    """Where an orbit is at a time, as an encounter."""
    state = relative_state(trajectory, body)(np.array([t_s]))[0]
    distance, speed = (float(np.linalg.norm(part)) for part in (state[:3], state[3:]))
    epoch = trajectory.epoch + t_s
    return Encounter(body=body, epoch=epoch, t_s=t_s, distance_km=distance, speed_km_s=speed, state=state)


def descent(trajectory: Trajectory, approach: Encounter, above: Callable[[float], float]) -> float | None:
    """When, on the way to an approach, a height `above` something falls below zero; None if it does not.

    It is looked for from the approach backwards, in steps that double, as long as the orbit comes nearer.
    """
    relative, first = relative_state(trajectory, approach.body), trajectory.span_s[0]
    high, step = approach.t_s, 0.25 * approach.distance_km / approach.speed_km_s
    if above(high) > 0.0:
        return None
    while True:
        low = max(high - step, first)
        state = relative(np.array([low]))[0]
        if above(low) > 0.0:
            break
        if low == first or state[:3] @ state[3:] > 0.0:
            return None
        high, step = low, 2.0 * step
    for _ in range(MOST_HALVINGS):
        if high - low < GRAIN_S:
            break
        middle = 0.5 * (low + high)
        low, high = (middle, high) if above(middle) > 0.0 else (low, middle)
    return high


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
