"""Clouds flown to their fates: what each drawn orbit hits, when and where, and how it passes each encounter."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.clones import strengths_of
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.encounter import plane_axes
from nebosvod.dynamics.flock import Flight, Flyer
from nebosvod.dynamics.hyperbola import b_plane_points, capture_radius_km
from nebosvod.dynamics.passages import Seen
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.engine.entry import on_the_ground
from nebosvod.impacts.approaches import Approach
from nebosvod.impacts.cloud import Cloud, Crossing, Passage
from nebosvod.impacts.coordinates import Coordinates, starts
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
TOLERANCE = 1e-8  # of the steps of a cloud: 2 cm after twelve years
WITHIN_KM, WIDER_KM = 0.05 * AU_KM, 0.2 * AU_KM
GAP_S = 20.0 * DAY_S  # between two encounters with one body


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """How the orbits of one object are flown: its forces, how far, near what they are watched.

    Parameters
    ----------
    orbit : about which deviations are.
    last : until when. bodies : watched. coordinates : in which deviations are straight.
    planes : axes (3, 3) of the target planes that are given, by body and time, from elsewhere.
    """

    orbit: UncertainOrbit
    ephemeris: Ephemeris
    last: Epoch
    bodies: Sequence[str]
    coordinates: Coordinates = "cartesian"
    planes: Sequence[tuple[str, Epoch, Array]] = ()
    within_km: float = WITHIN_KM

    def fly(self, deviations: Array, weights: Array | None = None, last: Epoch | None = None) -> Cloud:
        """Fly deviations (n, 6 + m) from the epoch until a date, or each until its impact."""
        orbit, epoch, count = self.orbit, self.orbit.epoch, len(deviations)
        forces = orbit.forces(self.ephemeris)
        states, values = starts(orbit, deviations, self.coordinates, self.ephemeris.gm_km3_s2["sun"])
        own = values if values.shape[1] else None
        flight = Flyer(
            epoch=epoch, end_s=(self.last if last is None else last) - epoch, forces=forces, values=own,
            strengths=strengths_of(forces, epoch, own, count), watch=tuple(self.bodies), within_km=self.within_km,
            times=np.empty(0), tolerance=TOLERANCE,
        ).fly(states)  # fmt: skip
        body = np.full(count, "", dtype="<U16")
        body[flight.impact.orbit] = np.array(forces.bodies)[flight.impact.body]
        return Cloud(
            epoch=epoch, names=orbit.names, deviations=deviations,
            weights=np.ones(count) if weights is None else weights, body=body,
            ground=_crossing(flight.impact, count, forces, epoch), entry=_crossing(flight.entry, count, forces, epoch),
            passages=self._passages(flight, count, forces), lost=flight.lost,
        )  # fmt: skip

    def _passages(self, flight: Flight, count: int, forces: ForceModel) -> tuple[Passage, ...]:
        """Encounters of members with each body that is watched, by time."""
        found = []
        for body in self.bodies:
            row = forces.bodies.index(body)
            near, gate, impact = (one.where(one.body == row) for one in (flight.near, flight.gate, flight.impact))
            times = np.sort(np.concatenate([near.t_s, gate.t_s, impact.t_s]))
            edges = np.flatnonzero(np.diff(times) > GAP_S)
            for first, last in zip(np.concatenate([[0], edges + 1]), np.concatenate([edges, [len(times) - 1]])):
                if len(times):
                    span = times[first], times[last]
                    parts = [one.where((one.t_s >= span[0]) & (one.t_s <= span[1])) for one in (near, gate, impact)]
                    found.append(self._passage(body, count, *parts))
        return tuple(sorted(found, key=lambda one: one.epoch - self.orbit.epoch))

    def _passage(self, body: str, count: int, near: Seen, gate: Seen, impact: Seen) -> Passage:
        """One encounter of all members: of each the nearest approach; its hyperbola ten radii out where it comes there.

        An orbit is described where it is not yet bent by the body's figure; one that passes farther out, where nearest.
        """
        gm, epoch = self.ephemeris.gm_km3_s2[body], self.orbit.epoch
        state, t_s, hits = np.full((count, 6), np.nan), np.full(count, np.nan), np.zeros(count, dtype=np.bool_)
        for k in np.argsort(-np.linalg.norm(near.state[:, :3], axis=1), kind="stable"):
            state[near.orbit[k]], t_s[near.orbit[k]] = near.state[k], near.t_s[k]
        state[gate.orbit] = gate.state
        t_s[gate.orbit] = np.where(np.isfinite(t_s[gate.orbit]), t_s[gate.orbit], gate.t_s)
        hits[impact.orbit], t_s[impact.orbit] = True, impact.t_s
        state[impact.orbit] = np.where(np.isfinite(state[impact.orbit]), state[impact.orbit], impact.state)
        here = np.isfinite(t_s)
        about = float(np.median(t_s[here]))
        middle = int(np.flatnonzero(here)[np.argmin(np.abs(t_s[here] - about))])
        axes = self._axes(body, about)
        if axes is None:
            axes = plane_axes(self.ephemeris, body, epoch, about, state[middle], gm)
        points, speed, lowest = b_plane_points(state, gm, axes)
        known = speed[np.isfinite(speed)]
        v_infinity = float(np.median(known)) if known.size else float("nan")
        return Passage(
            body=body, epoch=epoch + about, t_s=t_s, distance_km=np.where(here, lowest, np.nan), xi_zeta_km=points,
            axes=axes, hits=hits, v_infinity_km_s=v_infinity,
            capture_radius_km=capture_radius_km(SURFACE_KM[body], gm, v_infinity),
        )  # fmt: skip

    def _axes(self, body: str, about_s: float) -> Array | None:
        """Axes that were given for an encounter."""
        same = [(abs((when - self.orbit.epoch) - about_s), axes) for name, when, axes in self.planes if name == body]
        gap, axes = min(same, key=lambda one: one[0], default=(np.inf, None))
        return axes if gap < GAP_S else None


def _crossing(seen: Seen, count: int, forces: ForceModel, epoch: Epoch) -> Crossing:
    """The first descent of each member; places on the Earth."""
    order = np.argsort(-seen.t_s, kind="stable")  # the first is written last
    who, t_s, state = seen.orbit[order], seen.t_s[order], seen.state[order]
    rows = np.full((5, count), np.nan)
    speed = np.linalg.norm(state[:, 3:], axis=1)
    up = state[:, :3] / np.linalg.norm(state[:, :3], axis=1)[:, None]
    earth = seen.body[order] == forces.bodies.index("earth")
    if earth.any():
        longitude, latitude, up[earth] = on_the_ground(state[earth, :3], epoch, t_s[earth])
        rows[1, who[earth]], rows[2, who[earth]] = np.degrees(longitude), np.degrees(latitude)
    rows[0, who], rows[3, who] = t_s, speed
    rows[4, who] = np.degrees(-np.arcsin(np.sum(up * state[:, 3:], axis=1) / speed))
    return Crossing(t_s=rows[0], longitude_deg=rows[1], latitude_deg=rows[2], speed_km_s=rows[3], elevation_deg=rows[4])


def fly(
    orbit: UncertainOrbit, deviations: Array, weights: Array, last: Epoch, near: Sequence[Approach], bodies: Ephemeris
) -> Cloud:
    """Fly drawn orbits past given encounters of the estimate; the passages are those, in their order.

    Parameters
    ----------
    deviations : (n, 6 + m) from the orbit's state and parameters, at its epoch.
    """
    planes = tuple((one.body, one.epoch, one.plane.axes) for one in near if one.plane is not None)
    names = tuple(dict.fromkeys(one.body for one in near))
    course = Course(orbit=orbit, ephemeris=bodies, last=last, bodies=names, planes=planes, within_km=WIDER_KM)
    cloud = course.fly(deviations, weights)
    asked = [_nearest(cloud.passages, one.body, one.epoch) for one in near]
    return replace(cloud, passages=tuple(one for one in asked if one is not None))


def _nearest(passages: Sequence[Passage], body: str, epoch: Epoch) -> Passage | None:
    same = [one for one in passages if one.body == body and abs(one.epoch - epoch) < GAP_S]
    return min(same, key=lambda one: abs(one.epoch - epoch), default=None)
