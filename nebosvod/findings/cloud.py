"""A cloud of orbits drawn from an estimate, flown at once, where every prediction is about a given time.

An encounter comes at another time on each orbit, which is flown by itself (`nebosvod.findings.displacement`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Clones, Trajectory, propagate_many
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.engine.facts import SkyFacts, StateFacts, ValueFacts
from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity
from nebosvod.errors import EventError, InputError
from nebosvod.findings.displacement import as_seen, moved_point, moved_quantities, of_the_state
from nebosvod.observation import sight
from nebosvod.scene.point import Point
from nebosvod.scene.scene import Scene
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]


def displacements(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], deviations: Sequence[Mapping[str, float]]
) -> list[Array] | None:
    """Displacements (runs, d) of each quantity on the orbits moved by deviations; nan where it has no value there.

    None where that takes a flight of each by itself: a prediction is of an encounter or one number, or no orbit of the
    cloud can lead the others.
    """
    if any(one.encounter is not None or isinstance(one.facts, ValueFacts) for one in asked):
        return None
    points = [moved_point(scene, fit.point, deviation) for deviation in deviations]
    able = np.flatnonzero([_exists(scene, point) for point in points])
    found = [np.full((len(points), len(one.partials)), np.nan) for one in asked]
    if not able.size:
        return found
    flown = _flown(scene, asked, [points[k] for k in able.tolist()])
    if flown is None:
        return None
    for k, one in enumerate(asked):
        found[k][able] = _displaced(scene, one, flown, k)
    for number in able[list(flown.lost)].tolist():  # an orbit that hits a body has what comes before
        for row, moved in zip(found, moved_quantities(scene, fit, asked, deviations[number])):
            row[number] = np.nan if moved is None else moved
    return found


def _flown(scene: Scene, asked: Sequence[Quantity], points: Sequence[Point]) -> Clones | None:
    """The orbits through some points at the time of each quantity, and where they are needed; None without a lead."""
    names = scene.forces.parameters
    try:
        return propagate_many(
            np.array([point.state for point in points]),
            scene.epoch,
            np.array([*(_when(scene, one) for one in asked), scene.needed_s]),
            scene.forces,
            np.array([[point.parameters[name] for name in names] for point in points]) if names else None,
        )
    except EventError:
        return None


def _exists(scene: Scene, point: Point) -> bool:
    """Whether the forces at a point are physical: a drawn mass may be below zero."""
    try:
        scene.forces.with_values(point.parameters)
    except InputError:
        return False
    return True


def _when(scene: Scene, one: Quantity) -> float:
    """When the orbits must be known for a quantity, s: at its time, or when the light of the base left."""
    delay = one.facts.distance_km / SPEED_OF_LIGHT_KM_S if isinstance(one.facts, SkyFacts) else 0.0
    return one.epoch - scene.epoch - delay


def _displaced(scene: Scene, one: Quantity, flown: Clones, place: int) -> Array:
    """Displacements (clones, d) of one quantity by the states at the time of that place; nan where an orbit is lost."""
    states = flown.state[:, place]
    here = np.isfinite(states).all(axis=1)
    found = np.full((len(states), len(one.partials)), np.nan)
    if isinstance(one.facts, StateFacts) and one.axes is not None:
        found[here] = of_the_state(one.axes, one.unit, one.facts, states[here])
    elif isinstance(one.facts, SkyFacts) and here.any():
        telescope = next(each for each in scene.telescopes if each.name == one.facts.telescope)
        near = _Near(epoch=scene.epoch, t_s=flown.t_s[place], state=states[here], gm=scene.ephemeris.gm_km3_s2["sun"])
        at = np.full(int(here.sum()), one.epoch - scene.epoch)
        orbits = cast(Trajectory, near)  # of which light time asks epoch and states alone
        seen = sight(orbits, telescope.spacecraft, at, scene.ephemeris)
        found[here] = as_seen(one, one.facts, seen.psi, seen.distance_km)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Near:
    """Orbits by their heliocentric states (n, 6) at one time, for times so near that the fall towards the Sun does."""

    epoch: Epoch
    t_s: float
    state: Array
    gm: float

    def state_at(self, t_s: Array) -> Array:
        """States (n, 6), each orbit at its own time (n,)."""
        dt, r, v = (t_s - self.t_s)[:, None], self.state[:, :3], self.state[:, 3:]
        a = -self.gm * r / np.linalg.norm(r, axis=1)[:, None] ** 3
        return np.hstack([r + v * dt + 0.5 * a * dt**2, v + a * dt])
