"""Orbits in flocks: many near orbits on the steps of one of them, those that drift away in flocks of their own.

One member leads: it is integrated with its own step control, and the others take its steps (integrator.march). Whoever
fails the error check of a step leaves before it; those that left at the same step are the next flocks, led by one of
them. So a cloud flies through an encounter that tears it apart, and each member to its own end.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import integrator
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.dense import StepTable, step_of, step_weights
from nebosvod.dynamics.model import Arc, ForceModel
from nebosvod.dynamics.passages import Records, Seen, descents, gates, nearest
from nebosvod.dynamics.propagator import propagate
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.watch import RECORD
from nebosvod.dynamics.workspace import Samples, Watch
from nebosvod.errors import EventError, ImpactError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
NO_COLUMNS: Integers = np.empty(0, dtype=np.int64)
AT_ONCE = 256  # orbits whose memory stays in the cache
LARGEST = 2048  # of a flock that has left another
GATE_RADII = 10.0  # where an encounter is described by its osculating hyperbola
LOW, STOP = 1.03, 0.99  # of the radius: steps lower than the first are searched; below the second nobody flies on
MOST_STEPS = 20_000  # of one flock, some centuries
FARTHER, SHORTEST_S = 4.0, 20.0 * DAY_S  # a flock's horizon: so many times how long the last one served
BELOW_S = 4.0  # a leader that hits is followed so far below the surface
ROOM = 16  # records for each orbit, at first


@dataclass(slots=True, kw_only=True, eq=False)
class Flight:
    """What becomes of every member.

    Attributes
    ----------
    near, gate, entry, impact : closest approaches to watched bodies; where members come within ten radii of them; where
        they come down through `entry_km` above a surface; where they reach it.
    state : (k, n, 6) heliocentric, at the times asked for; nan after an impact.
    left : (k,) who left the first flock.
    lost : why a member could not be flown, by its number.
    flocks : how many there were.
    """

    near: Seen
    gate: Seen
    entry: Seen
    impact: Seen
    state: Array
    left: npt.NDArray[np.bool_]
    lost: dict[int, str]
    flocks: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flock:
    """Members (k,) by number, their heliocentric states (k, 6) at one time and their last distances (k, 2 b).

    `horizon_s` is how far their leader is flown at first: far beyond where they are expected to part it is in vain.
    """

    members: Integers
    t_s: float
    states: Array
    last2: Array
    horizon_s: float = np.inf


@dataclass(slots=True, kw_only=True, eq=False)
class Flyer:
    """Flies a cloud flock by flock.

    Parameters
    ----------
    epoch, end_s : from t = 0 to here, TDB seconds after the epoch.
    forces : of all; values (k, m) of its parameters for each member, or None.
    strengths : (k, 4), as `Physics.strength`, of each member.
    watch : bodies to be watched; within_km : how near.
    times : (n,) when states are wanted.
    """

    epoch: Epoch
    end_s: float
    forces: ForceModel
    values: Array | None
    strengths: Array
    watch: Sequence[str]
    within_km: float
    times: Array
    tolerance: float
    threads: int = 1
    entry_km: float = 100.0
    flight: Flight = field(init=False)
    parts: list[tuple[Seen, Seen, Seen, Seen]] = field(default_factory=list)

    def fly(self, starts: Array) -> Flight:
        """Fly members from heliocentric states (k, 6) at the epoch."""
        count, none = len(starts), Seen.joined([])
        state = np.full((count, len(self.times), 6), np.nan)
        self.flight = Flight(
            near=none, gate=none, entry=none, impact=none, state=state, left=np.zeros(count, dtype=np.bool_), lost={},
            flocks=0,
        )  # fmt: skip
        rest = [
            Flock(members=np.arange(count), t_s=0.0, states=starts, last2=np.full((count, 2 * len(self.watch)), -1.0))
        ]
        while rest:
            flock = rest.pop()
            new = self._fly(flock)
            if len(flock.members) == 1 and new and new[0].t_s == flock.t_s:  # cannot follow its own steps
                self.flight.lost[int(flock.members[0])] = f"no steps suit the orbit at {(self.epoch + flock.t_s).iso()}"
                new = []
            if self.flight.flocks == 0:
                self.flight.left[[k for one in new for k in one.members]] = True
            self.flight.flocks += 1
            rest += new
        for name, parts in zip(("near", "gate", "entry", "impact"), zip(*self.parts)):
            setattr(self.flight, name, Seen.joined(list(parts)))
        return self.flight

    def _fly(self, flock: Flock) -> list[Flock]:
        """Fly one flock as far as its leader's steps serve; who has to go on is in the flocks returned."""
        epoch, end = self.epoch + flock.t_s, self.end_s - flock.t_s
        if len(flock.members) > 1:
            end = float(np.copysign(min(abs(end), flock.horizon_s), end))
        leader = _middle_one(flock.states)
        try:
            led = self._led(flock, leader, epoch, end)
        except EventError as error:
            self.flight.lost[int(flock.members[leader])] = str(error)
            others = np.arange(len(flock.members)) != leader
            return [_some(flock, others)] if others.any() else []

        def part(first: int) -> Watch:
            some = _some(flock, slice(first, first + AT_ONCE))
            watch = self._flown(some, led, epoch, ROOM * len(some.members))
            if watch.written[0] > len(watch.records):
                watch = self._flown(some, led, epoch, int(watch.written[0]))
            watch.records[: watch.written[0], 0] += first
            return watch

        firsts = range(0, len(flock.members), AT_ONCE)
        if self.threads == 1 or len(firsts) == 1:
            parts = [part(first) for first in firsts]
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                parts = list(pool.map(part, firsts))
        if len(flock.members) == 1:  # the leader alone: the bytes of its own flight
            within = _within(self.times - flock.t_s, led.span_s[1 if self.end_s > 0.0 else 0])
            self.flight.state[flock.members[0], within] = led.state_at(self.times[within] - flock.t_s)
        return self._looked_at(flock, led, parts)

    def _led(self, flock: Flock, leader: int, epoch: Epoch, end: float) -> Trajectory:
        """The orbit of the leader, to the end or to just below the surface that it hits."""
        own = self.forces
        if self.values is not None:
            row = self.values[flock.members[leader]]
            own = own.with_values(dict(zip(own.parameters, row.tolist())))
        start = flock.states[leader]
        try:
            return propagate(
                start, epoch, [end], own, False, tolerance=self.tolerance, margin_s=0.0, most_steps=MOST_STEPS
            )
        except ImpactError as hit:
            if hit.t_s == 0.0:
                raise
            to = np.copysign(min(abs(hit.t_s) + BELOW_S, abs(end)), end)
        return propagate(start, epoch, [to], own, False, tolerance=self.tolerance, margin_s=0.0, solid=False)

    def _looked_at(self, flock: Flock, led: Trajectory, parts: list[Watch]) -> list[Flock]:
        """Look at what was seen of a flock, and tell who has to go on."""
        forces, epoch = led.forces, led.epoch
        rows = np.concatenate([one.records[: one.written[0]] for one in parts])
        records = Records(rows=rows, names=forces.bodies, ephemeris=forces.ephemeris, epoch=epoch)
        near = nearest(records)
        entry, impact = descents(records, near, (self.entry_km, 0.0))
        seen = (near, gates(records, GATE_RADII), entry, impact)
        self.parts.append(tuple(self._numbered(one, flock) for one in seen))  # type: ignore[arg-type]
        down = np.zeros(len(flock.members), dtype=np.bool_)
        down[impact.orbit] = True
        left, last2 = (np.concatenate([getattr(one, name) for one in parts]) for name in ("left", "last2"))
        on = np.flatnonzero(~down & (np.abs(self.end_s - flock.t_s - left[:, 1]) > 1e-6))
        t = left[on, 1]
        sun = forces.ephemeris.state_km_km_s("sun", epoch, t) if on.size else np.empty((0, 6))
        found = []
        for when in np.unique(t):
            now = t == when
            who = on[now]
            found += _cut(
                Flock(
                    members=flock.members[who], t_s=flock.t_s + float(when), states=left[who, 2:] - sun[now],
                    last2=last2[who], horizon_s=FARTHER * max(abs(float(when)), SHORTEST_S),
                )
            )  # fmt: skip
        return found

    def _flown(self, flock: Flock, led: Trajectory, epoch: Epoch, room: int) -> Watch:
        """Fly members on a leader's steps: what was seen, and where each had to leave."""
        table, physics = led._table, led.forces.physics(epoch)
        leg = 1 if self.end_s > 0.0 else 0
        last = led.span_s[leg]
        count = len(flock.members)
        wanted = self.times - flock.t_s
        within = _within(wanted, last)
        watch = self._watch(led.forces.bodies, flock.last2, room)
        sun = led.forces.ephemeris.state_km_km_s("sun", epoch, wanted[within])
        step, weights = places(table, wanted[within])
        states = np.full((count, len(within), 6), np.nan)
        order = np.argsort(step, kind="stable")
        samples = Samples(order, step, weights, sun, states, np.zeros(count), watch)
        arc = Arc(*led.span_s, table.window, led.forces.ephemeris.sun_at(epoch), physics)
        integrator.integrate(
            arc, flock.states, self.strengths[flock.members], last, NO_COLUMNS, False, self.tolerance,
            *table.guides(physics)[leg], samples,
        )  # fmt: skip
        sampled, got = self.flight.state[np.ix_(flock.members, within)], np.isfinite(states[:, :, 0])
        sampled[got] = states[got]
        self.flight.state[np.ix_(flock.members, within)] = sampled
        return watch

    def _watch(self, bodies: Sequence[str], last2: Array, room: int) -> Watch:
        """What is watched, and room for it."""
        radius = np.array([SURFACE_KM[body] for body in bodies])
        mine = np.array([bodies.index(body) for body in self.watch], dtype=np.int64)
        return Watch(
            mine, np.full(len(mine), self.within_km**2), (GATE_RADII * radius[mine]) ** 2, (LOW * radius) ** 2,
            (STOP * radius) ** 2, last2.copy(), np.empty((room, RECORD)), np.zeros(1, np.int64),
            np.zeros((len(last2), 8)),
        )  # fmt: skip

    def _numbered(self, seen: Seen, flock: Flock) -> Seen:
        """With the numbers of members, and times from the epoch of the cloud."""
        return Seen(orbit=flock.members[seen.orbit], body=seen.body, t_s=flock.t_s + seen.t_s, state=seen.state)


def _within(t_s: Array, last: float) -> Integers:
    """Which times lie between 0 and the last one, which may be negative."""
    sign = np.copysign(1.0, last)
    return np.flatnonzero((sign * t_s >= 0.0) & (sign * t_s <= sign * last))


def places(table: StepTable, t_s: Array) -> tuple[Integers, Array]:
    """Step (n,) of each time on the one leg there is, as it was integrated, and the weights (n, 17) of its nodes."""
    behind = 0 if table.legs[0] is None else len(table.legs[0].rows)
    step, weights = np.empty(len(t_s), np.int64), np.empty((len(t_s), 17))
    for e, t in enumerate(t_s.tolist()):
        k = int(step_of(t, table.edges))
        h = float(table.steps.length[k])
        s = float((t - table.steps.start[k]) / h)
        step_weights(8, s, h, weights[e])
        step[e], weights[e, 16] = (behind - 1 - k if k < behind else k - behind), s * h
    return step, weights


def _some(flock: Flock, which: npt.NDArray[np.bool_] | Integers | slice) -> Flock:
    return replace(flock, members=flock.members[which], states=flock.states[which], last2=flock.last2[which])


def _cut(flock: Flock) -> list[Flock]:
    """Parts of a flock, neighbours along its longest axis together."""
    count = len(flock.members)
    pieces = max(2, -(-count // LARGEST)) if count > 8 else 1
    order = np.argsort(_along(flock.states), kind="stable")
    return [_some(flock, some) for some in np.array_split(order, pieces)]


def _along(states: Array) -> Array:
    """Place (k,) of each state along the longest axis of their positions."""
    moved = states[:, :3] - states[:, :3].mean(axis=0)
    place: Array = moved @ np.linalg.svd(moved, full_matrices=False)[2][0]
    return place


def _middle_one(states: Array) -> int:
    """Which one is amid the others."""
    return int(np.argsort(_along(states), kind="stable")[len(states) // 2])
