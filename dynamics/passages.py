"""What watched orbits did: closest approaches, gates passed and impacts, found in the steps that were written down.

Each record is a step with its dense output (watch.py). All are refined together: closest approaches by Newton's method
for r.v = 0, gates and surfaces between samples of the step, by the same method inside of a bracket.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.dense import step_weights
from nebosvod.dynamics.ephemeris import Ephemeris
from nebosvod.dynamics.stages import weighed
from nebosvod.dynamics.surface import SURFACE_KM, height_km
from nebosvod.dynamics.watch import GATE, LOW, NEAREST
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
SAMPLES = 12  # to a step that comes low
SWEEPS = 40  # of Newton's method, at most
GRAIN_S = 1e-5  # to which moments are found
BEYOND = 0.2  # of a step, how far its polynomials serve outside of it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """Moments of watched orbits.

    Attributes
    ----------
    orbit, body : (n,) numbers of the orbit and of the body among those of the forces.
    t_s : (n,) TDB seconds after the epoch.
    state : (n, 6) then, from the centre of the body, ICRF, km, km/s.
    """

    orbit: Integers
    body: Integers
    t_s: Array
    state: Array

    @classmethod
    def joined(cls, parts: "list[Seen]") -> "Seen":
        """Several together."""
        if not parts:
            return cls(orbit=np.empty(0, np.int64), body=np.empty(0, np.int64), t_s=np.empty(0), state=np.empty((0, 6)))
        return cls(
            orbit=np.concatenate([one.orbit for one in parts]), body=np.concatenate([one.body for one in parts]),
            t_s=np.concatenate([one.t_s for one in parts]), state=np.concatenate([one.state for one in parts]),
        )  # fmt: skip

    def where(self, which: npt.NDArray[np.bool_]) -> "Seen":
        """Some of them."""
        return Seen(orbit=self.orbit[which], body=self.body[which], t_s=self.t_s[which], state=self.state[which])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Records:
    """Steps that were written down (n, 36), by bodies with names, times counted from `epoch`."""

    rows: Array
    names: tuple[str, ...]
    ephemeris: Ephemeris
    epoch: Epoch

    def of(self, kind: float) -> "Records":
        """Those of a kind."""
        return self.where(self.rows[:, 1] == kind)

    def where(self, which: npt.NDArray[np.bool_] | Integers) -> "Records":
        """Some of them."""
        return Records(rows=self.rows[which], names=self.names, ephemeris=self.ephemeris, epoch=self.epoch)

    @property
    def body(self) -> Integers:
        """Row (n,) of the body of each among those of the forces."""
        return self.rows[:, 2].astype(np.int64)

    def relative(self, t_s: Array) -> Array:
        """States (n, 6) from the body of each, each at its own time (n,)."""
        state = np.empty((len(t_s), 6))
        _states(8, self.rows, t_s, np.empty(16), state)
        body = self.body
        for b in np.unique(body):
            here = body == b
            state[here] -= self.ephemeris.state_km_km_s(self.names[b], self.epoch, t_s[here])
        return state

    def heights(self, t_s: Array, state: Array) -> Array:
        """Heights (n,) above the surfaces, km: of the Earth with the pole of the day."""
        height, body, day = np.empty(len(t_s)), self.body, np.floor(t_s / DAY_S)
        for b in np.unique(body):
            flattened = self.names[b] == "earth"
            for one in np.unique(day[body == b]) if flattened else [0.0]:
                here = (body == b) & ((day == one) | (not flattened))
                height[here] = height_km(self.names[b], state[here, :3], self.epoch, t_s[here])
        return height


@kernel
def _states(n: int, rows: Array, t_s: Array, weights: Array, state: Array) -> None:
    """Barycentric states (k, 6) of the dense output of each record at its own time; weights (16,) is scratch."""
    for e in range(rows.shape[0]):
        row = rows[e]
        h = row[4]
        s = (t_s[e] - row[3]) / h
        step_weights(n, s, h, weights)
        for i in range(3):
            q, r = weighed(weights, row[12:36], 8 * i)
            state[e, i] = row[6 + i] + (s * h * row[9 + i] + r)
            state[e, 3 + i] = row[9 + i] + q


def nearest(records: Records) -> Seen:
    """Closest approaches: where r.v = 0.

    Notes
    -----
    The slope v^2 - GM/r of r.v is that of two bodies; what is left of other forces makes the convergence linear, a
    factor of 1e-3 a sweep at worst.
    """
    records = records.of(NEAREST)
    rows = records.rows
    low, high = np.sort(np.stack([rows[:, 3], rows[:, 3] + rows[:, 4]]), axis=0)
    slack = BEYOND * np.abs(rows[:, 4])
    t, gm = rows[:, 5].copy(), np.array([records.ephemeris.gm_km3_s2[records.names[b]] for b in records.body])
    if not len(t):
        return Seen.joined([])
    for _ in range(SWEEPS):
        x = records.relative(t)
        r, v2 = np.linalg.norm(x[:, :3], axis=1), np.sum(x[:, 3:] ** 2, axis=1)
        move = -np.sum(x[:, :3] * x[:, 3:], axis=1) / np.maximum(v2 - gm / r, 0.25 * v2)
        t = np.clip(t + move, low - slack, high + slack)
        if np.abs(move).max() < GRAIN_S:
            break
    return Seen(orbit=rows[:, 0].astype(np.int64), body=records.body, t_s=t, state=records.relative(t))


def gates(records: Records, gate_radii: float) -> Seen:
    """Where orbits come within so many radii of the body, on the way in."""
    records = records.of(GATE)
    rows = records.rows
    radius = gate_radii * np.array([SURFACE_KM[records.names[b]] for b in records.body])

    def above(some: Records, t_s: Array, state: Array, which: Integers) -> Array:
        return np.asarray(np.linalg.norm(state[:, :3], axis=1) - radius[which])

    return _crossing(records, above, rows[:, 3] - 0.1 * rows[:, 4], rows[:, 5].copy())


def descents(records: Records, low: Seen, altitudes_km: Sequence[float] = (0.0,)) -> list[Seen]:
    """Where orbits first come down through altitudes above a surface.

    Parameters
    ----------
    low : closest approaches of the same orbits; one between two samples may be all that is below.
    """
    records = records.of(LOW)
    records = records.where(np.lexsort((np.abs(records.rows[:, 3]), records.rows[:, 0])))
    rows, m = records.rows, len(records.rows)
    if not m:
        return [Seen.joined([]) for _ in altitudes_km]
    ahead = np.sign(rows[0, 4])
    times = rows[:, 3, None] + rows[:, 4, None] * np.linspace(0.0, 1.0, SAMPLES)
    times = np.hstack([times, rows[:, 5, None], _lowest(rows, low)])
    times = np.sort(ahead * times, axis=1) * ahead
    width = times.shape[1]
    every = records.where(np.repeat(np.arange(m), width))
    heights = every.heights(times.ravel(), every.relative(times.ravel())).reshape(m, width)
    found = []
    for altitude in altitudes_km:

        def above(some: Records, t_s: Array, state: Array, which: Integers, level: float = altitude) -> Array:
            return some.heights(t_s, state) - level

        below = heights < altitude
        first = np.argmax(below, axis=1)
        falls = np.flatnonzero(below.any(axis=1) & (first > 0))
        falls = falls[np.unique(rows[falls, 0], return_index=True)[1]]  # the first step of each orbit
        found.append(_crossing(records.where(falls), above, times[falls, first[falls] - 1], times[falls, first[falls]]))
    return found


def _crossing(
    records: Records, above: Callable[[Records, Array, Array, Integers], Array], outside: Array, inside: Array
) -> Seen:
    """Where a height falls to zero between two times of each record: Newton's method by the speed towards the centre.

    A step out of the bracket, which shrinks with each, becomes its middle.
    """
    t, open_ = inside.copy(), np.arange(len(inside))
    for _ in range(SWEEPS):
        if not open_.size:
            break
        some, now = records.where(open_), t[open_]
        x = some.relative(now)
        height = above(some, now, x, open_)
        under = height < 0.0
        inside[open_], outside[open_] = np.where(under, now, inside[open_]), np.where(under, outside[open_], now)
        speed = np.sum(x[:, :3] * x[:, 3:], axis=1) / np.linalg.norm(x[:, :3], axis=1)
        new = now - height / np.where(speed == 0.0, 1.0, speed)
        low, high = np.minimum(inside[open_], outside[open_]), np.maximum(inside[open_], outside[open_])
        good = (new >= low) & (new <= high)
        t[open_] = np.where(good, new, 0.5 * (low + high))
        open_ = open_[np.abs(t[open_] - now) > GRAIN_S]
    body = records.body
    return Seen(orbit=records.rows[:, 0].astype(np.int64), body=body, t_s=t, state=records.relative(t))


def _lowest(rows: Array, low: Seen) -> Array:
    """Times (m, 3) about the closest approach inside of each step, where an orbit is lowest; its start without one.

    Over an ellipsoid the lowest point is a second or two from the nearest one.
    """
    found = np.repeat(rows[:, 3, None], 3, axis=1)
    first, last = np.sort(np.stack([rows[:, 3], rows[:, 3] + rows[:, 4]]), axis=0)
    for k in np.flatnonzero(np.isin(rows[:, 0], low.orbit)):
        mine = (low.orbit == rows[k, 0]) & (low.body == rows[k, 2]) & (low.t_s >= first[k]) & (low.t_s <= last[k])
        if mine.any():
            found[k] = np.clip(low.t_s[mine][0] + np.array([-2.0, 0.0, 2.0]), first[k], last[k])
    return found
