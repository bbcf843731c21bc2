"""Predictions of an encounter: which one is meant, its target plane, smallest distance, and place of entry."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, TargetPlane, Trajectory, perigee_distance, target_plane
from nebosvod.dynamics.impact import b_plane, events, follow, osculating_perigee, time_partials, what_it_hits
from nebosvod.dynamics.surface import height_km
from nebosvod.engine.entry import Entry, entry_point
from nebosvod.engine.quantity import Disc, Quantity, make_quantity, time_scale
from nebosvod.errors import CoverageError, EventError, NoAnswerError
from nebosvod.mission.request import EncounterPrediction
from nebosvod.scene.scene import Scene
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
NEAR_S = 3.0 * SECONDS_PER_DAY  # from `near`: an encounter farther than this is another one
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
    plane, reason = b_plane(trajectory, event, hits)
    ground = entry_point(trajectory, event, 0.0) if hits else None
    facts = _facts(event, hits, request) | _place(ground)
    by_time = time_partials(trajectory, event) if ground is None else ground.time_partials
    common: dict[str, Any] = {"disc": None if plane is None else _disc(plane), "further": {"time_s": by_time}}
    if request.plane == "entry":
        return _entry(scene, trajectory, event, request, facts, common, about)
    if request.plane == "perigee_distance":
        distance, by_state, by_parameters = (osculating_perigee if hits else perigee_distance)(trajectory, event)
        return make_quantity(
            request, event.epoch, "km", np.array([distance]), by_state, by_parameters, trajectory, facts, **common
        )
    if request.plane == "mtp":
        if hits:
            when = event.epoch.iso(time_scale(request), 0)
            raise NoAnswerError(
                f"the orbit hits {request.body} on {when} and has no closest approach for mtp; use b_plane or entry",
                status="no_closest_approach",
                facts=facts,
            )
        plane = target_plane(trajectory, event, kind="mtp")
    if plane is None:
        raise NoAnswerError(reason, status="captured", facts=facts)
    return make_quantity(
        request,
        event.epoch,
        "km",
        plane.coordinates_km,
        plane.partials_state,
        plane.partials_parameters,
        trajectory,
        facts | {"capture_radius_km": plane.capture_radius_km},
        plane.axes,
        **common,
    )


def _facts(event: Encounter, hits: bool, request: EncounterPrediction) -> dict[str, Any]:
    """What is known of the encounter itself."""
    return {
        "body": request.body,
        "impact": hits,
        "closest_approach_tdb": event.epoch.iso(),
        "closest_approach_utc": event.epoch.iso("utc"),
        "closest_distance_km": event.distance_km,
        "speed_km_s": event.speed_km_s,
    }


def _place(ground: Entry | None) -> dict[str, Any]:
    """Where on the ground an orbit comes down."""
    if ground is None or ground.place is None:
        return {}
    return {
        "impact_longitude_deg": float(np.degrees(ground.place.longitude_rad)),
        "impact_latitude_deg": float(np.degrees(ground.place.latitude_rad)),
    }


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
    facts: dict[str, Any],
    common: dict[str, Any],
    about: Epoch | None,
) -> Quantity:
    """Point of entry at an altitude: downrange and crossrange over the ground, km.

    Where a poorly known orbit passes the body by although the reference orbit of a simulation enters, the place is that
    of the reference orbit; what is said of the encounter, and its probability, stay those of the estimated orbit.
    """
    altitude = request.altitude or 0.0
    evaluated_on, entry = "estimated orbit", entry_point(trajectory, event, altitude)
    if entry is None and about is None and scene.trajectory is not trajectory:
        other, _ = _chosen(scene, scene.trajectory, request, None)
        entry = entry_point(scene.trajectory, other, altitude)
        evaluated_on, trajectory = "reference orbit", scene.trajectory
    if entry is None:
        above = float(height_km(request.body, event.state[None, :3], event.epoch, np.zeros(1))[0])
        raise NoAnswerError(
            f"the orbit passes {above:.0f} km above the surface of {request.body} and does not come down to "
            f"{altitude:g} km; use b_plane or perigee_distance",
            status="no_entry",
            facts=facts | {"disc": common["disc"]},
        )
    made, further = _entry_facts(entry, request)
    return make_quantity(
        request, entry.epoch, "km", None, entry.partials_state, entry.partials_parameters, trajectory,
        facts | {"evaluated_on": evaluated_on} | made, entry.axes, anchor=entry.position_km, further=further,
        disc=common["disc"],
    )  # fmt: skip


def _entry_facts(entry: Entry, request: EncounterPrediction) -> tuple[dict[str, Any], dict[str, Array]]:
    """When, where and how an orbit enters, and the partials of what has a sigma."""
    facts: dict[str, Any] = {
        "epoch_utc": entry.epoch.iso("utc"),
        "altitude_km": request.altitude or 0.0,
        "speed_km_s": entry.speed_km_s,
        "path_below_horizon_deg": float(np.degrees(entry.elevation_rad)),
    }
    further: dict[str, Array] = {"time_s": entry.time_partials}
    place, by_place = entry.place, entry.place_partials
    if place is not None and by_place is not None:
        facts |= {
            "longitude_deg": float(np.degrees(place.longitude_rad)),
            "latitude_deg": float(np.degrees(place.latitude_rad)),
            "latitude_geocentric_deg": float(np.degrees(place.geocentric_latitude_rad)),
        }
        further |= {"longitude_deg": np.degrees(by_place[0]), "latitude_deg": np.degrees(by_place[1])}
    return facts, further


def _chosen(
    scene: Scene, trajectory: Trajectory, request: EncounterPrediction, about: Epoch | None
) -> tuple[Encounter, bool]:
    """The closest approach nearest in time to `near`, and whether it is an impact."""
    when = (about or request.near) - scene.epoch
    nearest = min(events(trajectory, request.body), key=lambda event: abs(event[0].t_s - when), default=None)
    if nearest is not None and (about is not None or abs(nearest[0].t_s - when) <= NEAR_S):
        return nearest
    asked = request.near.iso(request.near.scale, 0)
    raise NoAnswerError(
        f"the orbit has no closest approach to {request.body} within {NEAR_S / SECONDS_PER_DAY:.0f} d of {asked}; "
        f"{_others(scene, trajectory, request)}",
        status="no_encounter",
        facts={"body": request.body},
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
