"""What another orbit changes in a prediction: the orbit moved by a deviation, flown anew, and asked the same."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.engine.approach import hits_body
from nebosvod.engine.entry import ground_displacement
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.facts import REFERENCE, EntryFacts, SkyFacts, StateFacts
from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import M_PER_KM, Quantity
from nebosvod.errors import EventError, ImpactError, InputError, NoAnswerError
from nebosvod.scene.point import Point
from nebosvod.scene.prior import STATE_NAMES, by_density, with_mass
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]


def displaced(base: Quantity, other: Quantity) -> Array | None:
    """What another orbit changes in a quantity, on the axes of the base (d,); None where that is not defined."""
    if base.request.plane == "entry":
        if base.anchor is None or base.axes is None or other.anchor is None:
            return None
        return ground_displacement(base.anchor, base.axes, other.anchor)
    if base.value is None and isinstance(base.facts, SkyFacts) and isinstance(other.facts, SkyFacts):
        return np.asarray(_on_the_sky(base.facts, np.radians([[other.facts.ra_deg, other.facts.dec_deg]]))[0])
    if base.axes is None:
        if base.value is None or other.value is None:
            return None
        moved = np.asarray(other.value - base.value)
        return (
            moved - 360.0 * np.round(moved / 360.0) if base.request.plane == "element" and base.unit == "deg" else moved
        )
    if isinstance(base.facts, StateFacts) and isinstance(other.facts, StateFacts):
        state = np.concatenate([other.facts.position_km, other.facts.velocity_km_s])
        return np.asarray(of_the_state(base.axes, base.unit, base.facts, state[None])[0])
    if base.value is None or other.value is None or other.axes is None:
        return None
    point = other.value[0] * other.axes[0] + other.value[1] * other.axes[2]
    if base.request.plane == "mtp":  # along the other orbit's direction into the base's plane
        point = point - (base.axes[1] @ point) / (base.axes[1] @ other.axes[1]) * other.axes[1]
    return np.asarray(base.axes[[0, 2]] @ point - base.value)


def as_seen(base: Quantity, facts: SkyFacts, psi: Array, distance_km: Array) -> Array:
    """What orbits seen at psi (n, 2), rad, and distances (n,) change in a quantity that a telescope sees.

    Offsets (n, 2) from the direction of the base, RA cos Dec and Dec, arcsec; (n, 1) from its distance, km.

    Raises
    ------
    LookupError
        For a quantity that is neither: it has to be added here.
    """
    plane = base.request.plane
    if plane == "distance" and base.value is not None:
        return np.asarray(distance_km[:, None] - base.value)
    if plane != "sky":
        raise LookupError(f"what drawn orbits change in a {plane} is not known")
    return _on_the_sky(facts, psi)


def _on_the_sky(base: SkyFacts, psi: Array) -> Array:
    """Offsets (n, 2) of directions psi (n, 2), rad, from that of the base: RA cos Dec and Dec, arcsec."""
    turn = (psi[:, 0] - np.radians(base.ra_deg) + np.pi) % (2.0 * np.pi) - np.pi
    north = np.radians(base.dec_deg)
    return np.stack([turn * np.cos(north), psi[:, 1] - north], axis=1) / ARCSEC


def of_the_state(axes: Array, unit: str, base: StateFacts, states: Array) -> Array:
    """Displacements (n, 3) of heliocentric states (n, 6) from the base, on axes (3, 3): of position, km, or in m/s."""
    if unit == "m_s":
        return np.asarray((states[:, 3:] - base.velocity_km_s) @ (M_PER_KM * axes).T)
    return np.asarray((states[:, :3] - base.position_km) @ axes.T)


def moved_quantities(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], deviation: Mapping[str, float]
) -> list[Array | None]:
    """Displacement (d,) of each quantity on the orbit moved by a deviation; None where it has no value there."""
    return [moved for moved, _ in moved_events(scene, fit, asked, deviation)]


def moved_events(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], deviation: Mapping[str, float]
) -> list[tuple[Array | None, bool | None]]:
    """The same, and whether that orbit hits the body of the encounter; None where there is no such orbit."""
    flown: dict[bool, Trajectory | str | None] = {False: _fly(scene, moved_point(scene, fit.point, deviation))}
    found: list[tuple[Array | None, bool | None]] = []
    for one in asked:
        # the base of an entry that only the reference orbit has is that orbit
        about_reference = isinstance(one.facts, EntryFacts) and one.facts.evaluated_on == REFERENCE
        if about_reference not in flown:
            flown[about_reference] = _fly(scene, moved_point(scene, _reference(scene), deviation))
        hits = None if one.encounter is None else _hits(flown[False], one.encounter.body)
        found.append((_moved(scene, one, flown[about_reference]), hits))
    return found


def _moved(scene: Scene, one: Quantity, orbit: Trajectory | str | None) -> Array | None:
    """Displacement (d,) of a quantity on another orbit; None where it has no value there."""
    if not isinstance(orbit, Trajectory):
        return None
    try:
        return displaced(one, quantity(scene, orbit, one.request, one.epoch))
    except (NoAnswerError, InputError):  # no encounter of this kind on that orbit
        return None


def _hits(orbit: Trajectory | str | None, body: str) -> bool | None:
    """Whether an orbit hits a body; None where it cannot be flown."""
    if not isinstance(orbit, Trajectory):
        return None if orbit is None else orbit == body
    return hits_body(orbit, body)


def uncertain(fit: Fit) -> tuple[str, ...]:
    """State and dynamic parameters that have an error, estimated or left out."""
    known = {*fit.estimate.names, *fit.estimate.left_out}
    return tuple(name for name in (*STATE_NAMES, *fit.observation.parameter_names) if name in known)


def moved_point(scene: Scene, point: Point, deviation: Mapping[str, float]) -> Point:
    """The point moved, a mass that comes from a density with its radius."""
    moved = point.moved(deviation)
    if not by_density(scene.mission):
        return moved
    return replace(moved, parameters=with_mass(point.parameters, moved.parameters))


def _reference(scene: Scene) -> Point:
    """The reference orbit with every dynamic parameter at its nominal value."""
    values = {parameter.name: parameter.value for parameter in scene.mission.free_parameters}
    return Point(state=scene.state, parameters=values, nuisances={})


def _fly(scene: Scene, point: Point) -> Trajectory | str | None:
    """The orbit through a point; the body it hits before a date asked about; or None where it cannot be flown."""
    try:
        return scene.propagate(point.state, scene.forces.with_values(point.parameters))
    except ImpactError as error:
        return error.body
    except (EventError, InputError):  # a mass below zero, or an integration that stops
        return None
