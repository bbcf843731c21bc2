"""Collisions: whether and when an orbit comes to the surface of a body that attracts it."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.encounter import closest_approaches, from_body, relative_state
from nebosvod.dynamics.ephemeris import PLANETS, Ephemeris
from nebosvod.dynamics.model import ForceModel
from nebosvod.dynamics.surface import SURFACE_KM, height_km
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.errors import ImpactError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
IMPACT_TIDE = 1e-7  # s^-2: GM/r^3 at the surface of every body is larger (Saturn 1.7e-7)
IMPACT_SAMPLES = 33  # to a step
SKIPPED = 16  # steps of which one is looked at first
FASTEST_KM_S = 70.0  # Mercury's 59
AT_ONCE = 1000  # steps sampled at a time: 20 MB
IMPACT_GRAIN_S = 1e-3  # to which the time of an impact is found
MASSIVE = tuple(body for body in PLANETS if body in SURFACE_KM)  # what an orbit cannot begin inside of


def require_no_impact(trajectory: Trajectory, tide: Array) -> None:
    """Raise ImpactError if the trajectory passes below the surface of a body that attracts it.

    The impact reported is the one nearest the epoch, at the moment the orbit comes to the surface.

    Parameters
    ----------
    trajectory : any.
    tide : shape (steps,), the largest GM/r^3 of each step, s^-2: only steps with that of a surface are searched.
    """
    steep = (tide > IMPACT_TIDE).nonzero()[0]
    if not steep.size:
        return
    edges = trajectory.step_edges_s
    ends = np.stack([edges[steep], edges[steep + 1]])
    way = trajectory.state_at(ends.ravel())
    within_reach = {body: _may_reach(trajectory, body, ends, way) for body in trajectory.forces.bodies}
    suspect = np.flatnonzero(np.any(list(within_reach.values()), axis=0))
    for k in suspect[np.argsort(np.abs(ends[:, suspect].sum(axis=0)))]:
        times = np.linspace(ends[0, k], ends[1, k], IMPACT_SAMPLES)
        for body in (name for name, reached in within_reach.items() if reached[k]):
            t = arrival(trajectory, body, times)
            if t is not None:
                distance = float(np.linalg.norm(relative_state(trajectory, body)(np.array([t]))[0, :3]))
                raise ImpactError(
                    f"the asteroid hits {body} at about {(trajectory.epoch + t).iso(digits=0)}: {distance:.0f} km from "
                    f"its centre, radius {SURFACE_KM[body]:.0f} km; {_advice(t)}",
                    body=body,
                    t_s=t,
                )


def require_start_above(start: Array, epoch: Epoch, forces: ForceModel) -> None:
    """Raise ImpactError if an orbit begins below the surface of the Sun, a planet or the Moon.

    Integrating it first would take millions of steps about the centre. An asteroid is no obstacle: the orbit that
    begins there is the asteroid's own.

    Parameters
    ----------
    start : heliocentric ICRF state (6,) at the epoch, km and km/s.
    """
    # every force model has the Sun, all planets and the Moon
    spheres, places, radii = _places(forces.ephemeris, epoch)
    x, y, z = start[:3].tolist()
    for px, py, pz, reach in spheres:  # in plain Python: a third of the time that small arrays take
        dx, dy, dz = x - px, y - py, z - pz
        if dx * dx + dy * dy + dz * dz <= reach:
            break
    else:
        return
    gaps = start[:3] - places
    distances = np.linalg.norm(gaps, axis=1)
    for k in np.flatnonzero(distances < radii):
        body = MASSIVE[k]
        if height_km(body, gaps[k][None], epoch, np.zeros(1))[0] < 0.0:
            raise ImpactError(
                f"the asteroid hits {body} at about {epoch.iso(digits=0)}: {distances[k]:.0f} km from its centre, "
                f"radius {radii[k]:.0f} km; {_advice(0.0)}",
                body=body,
                t_s=0.0,
            )


@lru_cache(maxsize=64)
def _places(ephemeris: Ephemeris, epoch: Epoch) -> tuple[list[list[float]], Array, Array]:
    """Heliocentric places (k, 3) and radii (k,) of MASSIVE, km; before them, the same with radii squared, in a list.

    Kept, for a fit begins at one epoch many times.
    """
    now = np.zeros(1)
    sun = ephemeris.position_km("sun", epoch, now)[0]
    places = np.array([ephemeris.position_km(body, epoch, now)[0] - sun for body in MASSIVE])
    radii = np.array([SURFACE_KM[body] for body in MASSIVE])
    return np.column_stack([places, radii**2 * (1.0 + 1e-9)]).tolist(), places, radii


def _may_reach(trajectory: Trajectory, body: str, ends: Array, way: Array) -> npt.NDArray[np.bool_]:
    """Which steps with these ends (2, k) can come to the surface, first by their ends, then by samples between them.

    An orbit close about the Sun is in reach of it by every end, thousands of times. `way` (2 k, 6) are its heliocentric
    states at the ends, for all bodies the same.
    """
    reached = ~_far(trajectory, body, ends, way)
    close = np.flatnonzero(reached)
    if close.size:
        both = np.concatenate([close, close + ends.shape[1]])
        reached[close] = _within_reach(trajectory, body, ends[:, close], way[both])
    near = np.flatnonzero(reached)
    for some in np.split(near, range(AT_ONCE, near.size, AT_ONCE)):
        if some.size:
            times = np.linspace(ends[0, some], ends[1, some], IMPACT_SAMPLES)
            reached[some] = _within_reach(trajectory, body, times, trajectory.state_at(times.ravel()))
    return reached


def _far(trajectory: Trajectory, body: str, ends: Array, way: Array) -> npt.NDArray[np.bool_]:
    """Which steps with these ends (2, k) are out of reach by the distance at one of many: a satellite has thousands.

    No body goes faster about the Sun than FASTEST_KM_S.
    """
    count = ends.shape[1]
    looked = np.arange(0, count, SKIPPED)
    t_s, own = ends[0, looked], np.arange(count) // SKIPPED
    distance = np.linalg.norm(from_body(trajectory, body, t_s, way[looked])[:, :3], axis=1)
    speed = float(np.linalg.norm(way[:, 3:], axis=1).max()) + FASTEST_KM_S
    apart = np.abs(ends - t_s[own]).max(axis=0) + np.abs(ends[1] - ends[0])
    return np.asarray(distance[own] - speed * apart > SURFACE_KM[body])


def _within_reach(trajectory: Trajectory, body: str, times: Array, way: Array) -> npt.NDArray[np.bool_]:
    """Which steps with these samples (m, k) can come to the surface: it is nearer to one than speed times spacing.

    One of the samples is half the spacing away, so there is room for twice the speed between them.
    """
    states = from_body(trajectory, body, times.ravel(), way).reshape(*times.shape, 6)
    distance, speed = (np.linalg.norm(part, axis=2) for part in (states[:, :, :3], states[:, :, 3:]))
    reach = speed.max(axis=0) * (times[1] - times[0])
    reached: npt.NDArray[np.bool_] = distance.min(axis=0) < SURFACE_KM[body] + reach
    return reached


def arrival(trajectory: Trajectory, body: str, times: Array) -> float | None:
    """When an orbit first comes below a surface on the way from the epoch through ascending times, or None.

    The lowest points between the samples are among those looked at: a graze is deep for less than a sample's distance.
    """
    relative = relative_state(trajectory, body)

    def height(t_s: Array) -> Array:
        return height_km(body, relative(t_s)[:, :3], trajectory.epoch, t_s)

    lowest = [t for t, _ in closest_approaches(relative, times)]
    first, last = trajectory.span_s
    if body == "earth":
        lowest += [_vertex(height, t) for t in lowest if first + 9.0 < t < last - 9.0]
    points = np.array(sorted([*times, *lowest], key=abs))
    below = height(points) < 0.0
    if not below.any():
        return None
    k = int(np.argmax(below))
    inside, outside = float(points[k]), float(points[max(k - 1, 0)])
    while abs(inside - outside) > IMPACT_GRAIN_S:
        middle = 0.5 * (inside + outside)
        if height(np.array([middle]))[0] < 0.0:
            inside = middle
        else:
            outside = middle
    return inside


def _vertex(height: Callable[[Array], Array], t_s: float) -> float:
    """Where a height is lowest, near a closest approach: over an ellipsoid a second or two from it."""
    before, here, after = height(t_s + np.array([-1.0, 0.0, 1.0]))
    bend = float(before - 2.0 * here + after)
    return t_s - min(max(0.5 * float(after - before) / bend, -8.0), 8.0) if bend > 0.0 else t_s


def _advice(t_s: float) -> str:
    """What to do about an impact at a time after (or before) the epoch."""
    if t_s == 0.0:
        return "the arc starts below the surface, check the state and its epoch"
    return "end the arc before this time" if t_s > 0.0 else "begin the arc after this time"
