"""Predictions of an encounter: which one is meant, its target plane, smallest distance, and place of entry."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, TargetPlane, Trajectory, perigee_distance, target_plane
from nebosvod.dynamics.impact import b_plane, events, follow, osculating_perigee, time_partials, what_it_hits
from nebosvod.dynamics.surface import height_km
from nebosvod.engine.entry import Entry, Place, azimuth_rad, entry_point
from nebosvod.engine.facts import (
    ESTIMATED,
    REFERENCE,
    BodyFacts,
    Disc,
    EncounterFacts,
    EntryFacts,
    Ground,
    NoEventError,
)
from nebosvod.engine.quantity import Quantity, make_quantity, time_scale
from nebosvod.errors import CoverageError, EventError
from nebosvod.mission.request import EncounterPrediction
from nebosvod.scene.scene import Scene
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
NEAR_S = 3.0 * SECONDS_PER_DAY  # from `near`: an encounter farther than this is another one
KEPT = 4  # encounters kept, two bodies of two orbits: several predictions are about one; each keeps its orbit in memory
SEARCHED_S = 366.0 * SECONDS_PER_DAY  # to either side, for the encounters that a row without an answer names


def encounter_quantity(
    scene: Scene, trajectory: Trajectory, request: EncounterPrediction, about: Epoch | None = None
) -> Quantity:
    """Crossing of a target plane, the smallest distance, or the place of entry, km.

    Parameters
    ----------
    about : where a near orbit has the encounter; it is then taken however far it is from the time asked about.

    Raises
    ------
    NoAnswerError
        If there is no such encounter, no such plane, or no entry.
    """
    event, hits = _chosen(scene, trajectory, request, about)
    plane, reason, ground = _passage(trajectory, event, hits)
    facts = _facts(event, hits, request, ground)
    disc = None if plane is None else _disc(plane)
    if request.plane == "entry":
        return replace(_entry(scene, trajectory, event, request, facts, disc, about), disc=disc)
    if request.plane == "perigee_distance":
        distance, by_state, by_parameters = (osculating_perigee if hits else perigee_distance)(trajectory, event)
        value, axes = np.array([distance]), None
    else:
        if request.plane == "mtp":
            plane, reason = _mtp(trajectory, event, hits, request, facts)
        if plane is None:
            raise NoEventError(reason, status="captured", facts=facts)
        facts = replace(facts, capture_radius_km=plane.capture_radius_km)
        value, axes = plane.coordinates_km, plane.axes
        by_state, by_parameters = plane.partials_state, plane.partials_parameters
    made = make_quantity(request, event.epoch, "km", value, by_state, by_parameters, trajectory, facts, axes)
    by_time = time_partials(trajectory, event) if ground is None else ground.time_partials
    return replace(made, time_partials=by_time, disc=disc)


@lru_cache(maxsize=KEPT)
def passages(trajectory: Trajectory, body: str) -> tuple[tuple[Encounter, bool], ...]:
    """Closest approaches to a body, and the impact that ends the orbit there, each with whether it is one; kept."""
    return tuple(events(trajectory, body))


def hits_body(trajectory: Trajectory, body: str) -> bool:
    """Whether an orbit ends on a body."""
    return any(hits for _, hits in passages(trajectory, body))


@lru_cache(maxsize=KEPT)
def _passage(trajectory: Trajectory, event: Encounter, hits: bool) -> tuple[TargetPlane | None, str, Entry | None]:
    """The b-plane of an encounter, or why there is none, and where an impact meets the surface."""
    return *b_plane(trajectory, event, hits), entry_point(trajectory, event, 0.0) if hits else None


def _facts(event: Encounter, hits: bool, request: EncounterPrediction, ground: Entry | None) -> EncounterFacts:
    """What is known of the encounter itself, and where on the ground an orbit comes down."""
    return EncounterFacts(
        body=request.body,
        impact=hits,
        closest_approach=event.epoch,
        distance_km=event.distance_km,
        speed_km_s=event.speed_km_s,
        ground=None if ground is None else _ground(ground.place),
    )


def _ground(place: Place | None) -> Ground | None:
    if place is None:
        return None
    return Ground(
        longitude_deg=float(np.degrees(place.longitude_rad)),
        latitude_deg=float(np.degrees(place.latitude_rad)),
        latitude_geocentric_deg=float(np.degrees(place.geocentric_latitude_rad)),
    )


def _mtp(
    trajectory: Trajectory, event: Encounter, hits: bool, request: EncounterPrediction, facts: EncounterFacts
) -> tuple[TargetPlane, str]:
    """The modified target plane of an encounter, which an orbit that hits the body before does not have."""
    if hits:
        when = event.epoch.iso(time_scale(request), 0)
        raise NoEventError(
            f"the orbit hits {request.body} on {when} and has no closest approach for mtp; use b_plane or entry",
            status="no_closest_approach",
            facts=facts,
        )
    return target_plane(trajectory, event, kind="mtp"), ""


def _disc(plane: TargetPlane) -> Disc:
    return Disc(
        value=plane.coordinates_km,
        partials=np.hstack([plane.partials_state, plane.partials_parameters]),
        radius_km=plane.capture_radius_km,
    )


def _entry(
    scene: Scene,
    trajectory: Trajectory,
    event: Encounter,
    request: EncounterPrediction,
    facts: EncounterFacts,
    disc: Disc | None,
    about: Epoch | None,
) -> Quantity:
    """Point of entry at an altitude: downrange and crossrange over the ground, km.

    Where a poorly known orbit passes the body by although the reference orbit of a simulation enters, the place is that
    of the reference orbit; what is said of the encounter, and its probability, stay those of the estimated orbit.
    """
    altitude = request.altitude or 0.0
    evaluated_on, entry = ESTIMATED, entry_point(trajectory, event, altitude)
    if entry is None and about is None and scene.trajectory is not trajectory:
        other, _ = _chosen(scene, scene.trajectory, request, None)
        entry = entry_point(scene.trajectory, other, altitude)
        evaluated_on, trajectory = REFERENCE, scene.trajectory
    if entry is None:
        above = float(height_km(request.body, event.state[None, :3], event.epoch, np.zeros(1))[0])
        raise NoEventError(
            f"the orbit passes {above:.0f} km above the surface of {request.body} and does not come down to "
            f"{altitude:g} km; use b_plane or perigee_distance",
            status="no_entry",
            facts=facts,
            disc=disc,
        )
    how = EntryFacts(
        encounter=facts,
        evaluated_on=evaluated_on,
        epoch=entry.epoch,
        altitude_km=altitude,
        speed_km_s=entry.speed_km_s,
        path_below_horizon_deg=float(np.degrees(entry.elevation_rad)),
        ground=_ground(entry.place),
        path_azimuth_deg=None if entry.place is None else float(np.degrees(azimuth_rad(entry.place, entry.axes[0]))),
    )
    by_state, by_parameters, by_place = entry.partials_state, entry.partials_parameters, entry.place_partials
    made = make_quantity(request, entry.epoch, "km", None, by_state, by_parameters, trajectory, how, entry.axes)
    return replace(
        made,
        anchor=entry.position_km,
        time_partials=entry.time_partials,
        ground_partials=None if by_place is None else np.degrees(by_place),
    )


def _chosen(
    scene: Scene, trajectory: Trajectory, request: EncounterPrediction, about: Epoch | None
) -> tuple[Encounter, bool]:
    """The closest approach nearest in time to `near`, and whether it is an impact."""
    when = (about or request.near) - scene.epoch
    nearest = min(passages(trajectory, request.body), key=lambda event: abs(event[0].t_s - when), default=None)
    if nearest is not None and (about is not None or abs(nearest[0].t_s - when) <= NEAR_S):
        return nearest
    asked = request.near.iso(request.near.scale, 0)
    raise NoEventError(
        f"the orbit has no closest approach to {request.body} within {NEAR_S / SECONDS_PER_DAY:.0f} d of {asked}; "
        f"{_others(scene, trajectory, request)}",
        status="no_encounter",
        facts=BodyFacts(body=request.body),
    )


def _others(scene: Scene, trajectory: Trajectory, request: EncounterPrediction) -> str:
    """The encounters before and after the time asked about, in words; looked for a year to either side."""
    when = request.near - scene.epoch
    first, last = (end - scene.epoch for end in scene.ephemeris.coverage(asteroids=scene.forces.asteroids))
    span = (max(min(when - SEARCHED_S, 0.0), first), min(max(when + SEARCHED_S, 0.0), last))
    try:
        start = trajectory.at([0.0]).state[0]
        wide = follow(start, scene.epoch, span, 0.0, trajectory.forces, False)
    except (EventError, CoverageError):
        wide = trajectory
    near = [event for event in events(wide, request.body) if abs(event[0].t_s - when) <= SEARCHED_S]
    around = [
        max((e for e in near if e[0].t_s < when), key=lambda e: e[0].t_s, default=None),
        min((e for e in near if e[0].t_s >= when), key=lambda e: e[0].t_s, default=None),
    ]
    said = [
        f"{event.epoch.iso(request.near.scale, 0)} ({'an impact' if hits else f'{event.distance_km:.4g} km'})"
        for event, hits in (one for one in around if one is not None)
    ]
    hit = what_it_hits(wide) or what_it_hits(trajectory)
    if hit is not None and 0.0 < hit.t_s < when and not any(one is not None and one[1] for one in around):
        ended = f"the orbit hits {hit.body} on {hit.epoch.iso(request.near.scale, 0)} and ends there"
        return f"the nearest: {' and '.join(said)}; {ended}" if said else ended
    return f"the nearest: {' and '.join(said)}" if said else "there is none within a year; change near or body"
