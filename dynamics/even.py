"""Many orbits over hours, on even steps that none of them leads: what least squares asks for a hundred times.

Between the first and the last of a few observations nearly every orbit is done in one step, however far apart they are.
A flock (flock.py) would be led, searched for a surface and watched for that. Here the steps and the ephemeris at their
nodes are made once; who fails the check of a step, or comes low, tries finer ones, and is left to others after that.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import integrator
from nebosvod.dynamics.dense import StepTable, join
from nebosvod.dynamics.flock import AT_ONCE, LOW, NO_COLUMNS, STOP, places
from nebosvod.dynamics.model import ForceModel, arc_of
from nebosvod.dynamics.propagator import TOLERANCE
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.dynamics.watch import DOWN, RECORD
from nebosvod.dynamics.workspace import Samples, Watch, make_steps
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
COUNTS = (1, 4, 16, 64)  # of steps, tried in turn; who needs more is sooner there on steps of its own
ROOM = 16  # records of low steps for each orbit
LONGEST_S = 5.0 * 86400.0  # of a step


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Level:
    """Steps to the last time, and where in them the times lie."""

    table: StepTable
    order: Integers
    step: Integers
    weights: Array


class EvenSteps:
    """Times on one side of an epoch, and the steps that lead to them."""

    def __init__(self, epoch: Epoch, t_s: Array, forces: ForceModel, tolerance: float = TOLERANCE) -> None:
        """Make the coarsest steps.

        Parameters
        ----------
        t_s : (n,) TDB seconds after the epoch, all positive or all negative.

        Raises
        ------
        CoverageError
            If a time is outside the ephemeris.
        """
        self.epoch, self.t_s, self.forces, self.tolerance = epoch, t_s, forces, tolerance
        self.end_s = float(t_s[np.argmax(np.abs(t_s))])
        self.arc = arc_of(forces, epoch, min(self.end_s, 0.0), max(self.end_s, 0.0), 0.0)
        ephemeris = forces.ephemeris
        self.sun = ephemeris.state_km_km_s("sun", epoch, t_s)
        self.radius_km = np.array([SURFACE_KM[body] for body in forces.bodies])
        places_km = [ephemeris.position_km(body, epoch, 0.0)[0] for body in forces.bodies]
        self.bodies = np.stack(places_km) - self.arc.sun[:3]
        self.levels: dict[int, _Level] = {}

    def fly(self, states_km_km_s: Array) -> tuple[Array, Flags]:
        """Fly orbits.

        Parameters
        ----------
        states_km_km_s : (m, 6) heliocentric ICRF at the epoch.

        Returns
        -------
        Heliocentric states (m, n, 6) at the times, km and km/s, nan of who has come down before; and of which orbits
        (m,) they are known. The others need finer steps, or are low at one of the times.
        """
        m = len(states_km_km_s)
        states, known = np.full((m, len(self.t_s), 6), np.nan), np.zeros(m, dtype=np.bool_)
        above = np.linalg.norm(states_km_km_s[:, None, :3] - self.bodies, axis=2) / self.radius_km
        known[(above < STOP).any(axis=1)] = True
        left = np.flatnonzero((above > LOW).all(axis=1) & np.isfinite(states_km_km_s).all(axis=1))
        for count in COUNTS:
            for first in range(0, len(left), AT_ONCE):
                some = left[first : first + AT_ONCE]
                states[some], known[some] = self._on(self._level(count), states_km_km_s[some])
            left = left[~known[left]]
            if not left.size:
                break
        states[~known] = np.nan
        return states, known

    def _level(self, count: int) -> _Level:
        """So many steps for each that may not be longer."""
        if count not in self.levels:
            k = count * int(np.ceil(abs(self.end_s) / LONGEST_S))
            edges = np.linspace(0.0, self.end_s, k + 1)
            steps = make_steps(k, 0)
            steps.rows[:] = 0.0
            steps.start[:], steps.length[:] = edges[:-1], np.diff(edges)
            ahead = self.end_s > 0.0
            table = join(None if ahead else steps, steps if ahead else None, self.arc.window, 0, 0.0)
            step, weights = places(table, self.t_s)
            self.levels[count] = _Level(
                table=table, order=np.argsort(step, kind="stable"), step=step, weights=weights
            )  # fmt: skip
        return self.levels[count]

    def _on(self, level: _Level, starts: Array) -> tuple[Array, Flags]:
        """The same of starts above every surface, on some steps."""
        m = len(starts)
        watch = Watch(
            np.empty(0, np.int64), np.empty(0), np.empty(0), (LOW * self.radius_km) ** 2, (STOP * self.radius_km) ** 2,
            np.empty((m, 0)), np.empty((ROOM * m, RECORD)), np.zeros(1, np.int64),
            np.zeros((m, 8)),
        )  # fmt: skip
        states = np.full((m, len(self.t_s), 6), np.nan)
        samples = Samples(level.order, level.step, level.weights, self.sun, states, np.zeros(m), watch)
        integrator.integrate(
            self.arc, starts, np.repeat(self.arc.physics.strength[None], m, axis=0), self.end_s, NO_COLUMNS, False,
            self.tolerance, *level.table.guides(self.arc.physics)[1 if self.end_s > 0.0 else 0], samples,
        )  # fmt: skip
        down = watch.left[:, 0] == DOWN
        low_from, low_to = np.full(m, np.inf), np.where(down, np.abs(watch.left[:, 1]), np.inf)
        low = watch.records[: watch.written[0]]
        np.minimum.at(low_from, low[:, 0].astype(np.int64), np.abs(low[:, 3]))
        after, t_s = low_to[:, None] <= np.abs(self.t_s), np.abs(self.t_s)
        states[after] = np.nan
        if watch.written[0] > len(watch.records):  # nobody knows whose the others are
            return states, np.zeros(m, dtype=np.bool_)
        unclear = ((low_from[:, None] <= t_s) & ~after).any(axis=1)
        return states, (down | np.isfinite(samples.tide)) & ~unclear
