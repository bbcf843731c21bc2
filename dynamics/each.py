"""Many orbits, each on steps of its own: to their fates, where nothing is kept of the way, or to states at some times.

Flocks (flock.py) serve clouds that stay together. Orbits of which some circle the Earth, some fall and some pass share
no steps; a flock of one is led, searched for a surface and watched, three flights of which the last one is enough.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import integrator
from nebosvod.dynamics.dense import join
from nebosvod.dynamics.fates import Fates
from nebosvod.dynamics.flock import LOW, MOST_STEPS, NO_COLUMNS, STOP
from nebosvod.dynamics.model import ForceModel, arc_of
from nebosvod.dynamics.passages import Records, Seen, descents, nearest
from nebosvod.dynamics.propagator import NO_GUIDES, TOLERANCE
from nebosvod.dynamics.surface import SURFACE_KM, height_km
from nebosvod.dynamics.watch import NEAREST, RECORD, STEEP
from nebosvod.dynamics.workspace import NO_SAMPLES, Samples, Watch
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ROOM = 64  # records for each orbit, at first
DEEPEST = 2.0  # closest approaches of an orbit up to so many times its least distance at a node are refined
GRAZE = 1.1  # of the radius: as are all that come so near


def fates_of_each(
    states_km_km_s: Array, epoch: Epoch, end_s: float, forces: ForceModel, body: str, within_km: float,
    tolerance: float = TOLERANCE,
) -> Fates:  # fmt: skip
    """Fly orbits to the end, or to a surface.

    Parameters
    ----------
    states_km_km_s : (k, 6) heliocentric ICRF at `epoch`; finite.
    end_s : TDB seconds after it.
    body : its closest approaches, within so many km, are told where an orbit hits nothing; the least of each orbit.

    Raises
    ------
    CoverageError
        If the end is outside the ephemeris.
    """
    arc = arc_of(forces, epoch, min(end_s, 0.0), max(end_s, 0.0), 0.0)
    rows, count = [], len(states_km_km_s)
    there = forces.ephemeris.position_km(body, epoch, 0.0)[0] - arc.sun[:3]
    begun, strengths = np.sum((states_km_km_s[:, :3] - there) ** 2, axis=1), arc.physics.strength[None]
    samples = _watching(forces.bodies, body, within_km, np.empty((ROOM, RECORD)))
    for k in range(count):
        while True:
            _begin(samples, begun[k])
            integrator.integrate(
                arc, states_km_km_s[k : k + 1], strengths, end_s, NO_COLUMNS, False, tolerance, *NO_GUIDES[0], samples
            )
            written, room = int(samples.watch.written[0]), samples.watch.records
            if written <= len(room):
                break
            samples = _watching(forces.bodies, body, within_km, np.empty((2 * written, RECORD)))
        room[:written, 0] = k
        rows.append(room[:written].copy())
    records = Records(rows=np.concatenate([*rows, np.empty((0, RECORD))]), names=forces.bodies,
                      ephemeris=forces.ephemeris, epoch=epoch)  # fmt: skip
    return _told(_deepest(records, body, count), count, body, forces)


def states_of_each(
    states_km_km_s: Array, epoch: Epoch, t_s: Array, forces: ForceModel, tolerance: float = TOLERANCE
) -> Array:
    """Where orbits are at some times.

    Parameters
    ----------
    states_km_km_s : (k, 6) heliocentric ICRF at `epoch`; finite.
    t_s : (n,) TDB seconds after it, all positive or all negative.
    forces : the Earth among its bodies.

    Returns
    -------
    Heliocentric states (k, n, 6), km and km/s; nan of an orbit that begins below a surface or comes down before the
    last of the times, and of one that no steps suit.

    Raises
    ------
    CoverageError
        If a time is outside the ephemeris.

    Notes
    -----
    Who comes so deep into the field of a body that it may be low flies again, and surfaces are looked for.
    """
    end_s = float(t_s[np.argmax(np.abs(t_s))])
    found, deep = np.full((len(states_km_km_s), len(t_s), 6), np.nan), []
    arc = arc_of(forces, epoch, min(end_s, 0.0), max(end_s, 0.0), 0.0)
    strengths, ahead = arc.physics.strength[None], end_s > 0.0
    for k in range(len(states_km_km_s)):
        status, steps, tide = integrator.integrate(
            arc, states_km_km_s[k : k + 1], strengths, end_s, NO_COLUMNS, False, tolerance, *NO_GUIDES[0], NO_SAMPLES,
            most=MOST_STEPS,
        )  # fmt: skip
        if status == integrator.OK:
            table = join(None if ahead else steps, steps if ahead else None, arc.window, 0, 0.0)
            found[k] = table.evaluate(t_s, variations=False)[0]
            deep += [k] if tide > STEEP else []
    if deep:
        some = states_km_km_s[deep]
        fates = fates_of_each(some, epoch, end_s, forces, "earth", LOW * SURFACE_KM["earth"], tolerance)
        up = _above_every_surface(some, epoch, forces, arc.sun) & ~fates.impact
        found[np.array(deep)[~up]] = np.nan
    return found


def _above_every_surface(states: Array, epoch: Epoch, forces: ForceModel, sun: Array) -> npt.NDArray[np.bool_]:
    """Which heliocentric states (k, 6) are."""
    above = np.ones(len(states), dtype=np.bool_)
    for body in forces.bodies:
        away = states[:, :3] + sun[:3] - forces.ephemeris.position_km(body, epoch, 0.0)[0]
        low = np.flatnonzero(np.linalg.norm(away, axis=1) < LOW * SURFACE_KM[body])
        if low.size:
            above[low] = height_km(body, away[low], epoch, np.zeros(len(low))) > 0.0
    return above


def _told(records: Records, count: int, body: str, forces: ForceModel) -> Fates:
    """The fates by the records."""
    fates = Fates.unknown(count)
    near = nearest(records)
    (impact,) = descents(records, near)
    distance = np.linalg.norm(near.state[:, :3], axis=1)
    _put(fates, near, np.argsort(-distance, kind="stable"), body, False)  # the last one written is the nearest
    for row in np.unique(impact.body):
        _put(fates, impact, np.flatnonzero(impact.body == row), forces.bodies[row], True)
    return fates


def _put(fates: Fates, seen: Seen, order: npt.NDArray[np.int64], body: str, impact: bool) -> None:
    """Write moments in an order."""
    k = seen.orbit[order]
    fates.body[k], fates.impact[k], fates.t_s[k] = body, impact, seen.t_s[order]
    fates.position_km[k], fates.velocity_km_s[k] = seen.state[order, :3], seen.state[order, 3:]
    fates.distance_km[k] = np.linalg.norm(seen.state[order, :3], axis=1)


def _deepest(records: Records, body: str, count: int) -> Records:
    """Without closest approaches that are not the closest one: a satellite has hundreds."""
    near = np.flatnonzero(records.rows[:, 1] == NEAREST)
    some = records.where(near)
    distance = np.linalg.norm(some.relative(some.rows[:, 5])[:, :3], axis=1)
    orbit, least = some.rows[:, 0].astype(np.int64), np.full(count, np.inf)
    np.minimum.at(least, orbit, distance)
    kept = np.ones(len(records.rows), dtype=np.bool_)
    kept[near] = distance < np.maximum(DEEPEST * least[orbit], GRAZE * SURFACE_KM[body])
    return records.where(kept)


def _watching(bodies: tuple[str, ...], body: str, within_km: float, room: Array) -> Samples:
    """What is watched of one orbit at a time, and room for it."""
    radius = np.array([SURFACE_KM[name] for name in bodies])
    watch = Watch(
        np.array([bodies.index(body)]), np.array([within_km**2]), np.zeros(1), (LOW * radius) ** 2,
        (STOP * radius) ** 2, np.empty((1, 2)), room, np.zeros(1, np.int64), np.empty((1, 8)),
    )  # fmt: skip
    return Samples(*NO_SAMPLES[:4], np.empty((1, 0, 6)), np.zeros(1), watch)


def _begin(samples: Samples, begun2: float) -> None:
    """Forget the orbit before; the next one begins so far from the body, km^2."""
    samples.tide[:], samples.watch.written[:], samples.watch.left[:] = 0.0, 0, 0.0
    samples.watch.last2[0] = -1.0, begun2
