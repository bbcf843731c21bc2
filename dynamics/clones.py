"""propagate_many(...): many near orbits at once, on the steps and the ephemeris of one.

Forward in time, or backward, a cloud flies in flocks (flock.py). Over times on both sides of the epoch the middle of
the cloud, the mean of its states, is integrated with its own step control; every clone takes the same steps, reads the
bodies at their nodes from a table, starts its iteration from the accelerations of the middle, and checks its own last
Legendre coefficient in every step. The middle flies through a body it hits, as through a point. A clone that fails the
check, or comes near a surface, is propagated alone, from shortly before the first deep encounter of the middle where it
flew well until then.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics import integrator
from nebosvod.dynamics.collision import IMPACT_TIDE
from nebosvod.dynamics.constants import DAY_S, RADIUS_KM
from nebosvod.dynamics.dense import StepTable, step_of, step_weights
from nebosvod.dynamics.fates import Fates, arrival_of, passage, passages, window_of
from nebosvod.dynamics.flock import Flyer
from nebosvod.dynamics.model import Arc, ForceModel
from nebosvod.dynamics.nongrav import PARAMETERS
from nebosvod.dynamics.propagator import TOLERANCE, propagate
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.workspace import NO_WATCH, Samples, first_steps
from nebosvod.errors import EventError, ImpactError, InputError, listed
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
NO_COLUMNS: Integers = np.empty(0, dtype=np.int64)
WIDEST_KM = 1e9  # every closest approach counts
DEEP_TIDE = 1e-10  # s^-2: GM/r^3 at 25 radii of the Earth
SUBSTITUTES = 5  # orbits that are tried as the middle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clones:
    """Orbits of many clones.

    Attributes
    ----------
    epoch : t = 0.
    t_s : shape (n,), TDB seconds after `epoch`, in the order asked for.
    state : shape (k, n, 6), heliocentric ICRF position and velocity of each clone, km, km/s; nan where it was lost.
    alone : shape (k,), which clones needed steps of their own.
    lost : why a clone has no states, by its number: it ran into a body.
    fates : what becomes of each: the impact, or the encounter asked about.
    """

    epoch: Epoch
    t_s: Array
    state: Array
    alone: npt.NDArray[np.bool_]
    lost: Mapping[int, str]
    fates: Fates


@bordered()
def propagate_many(
    states_km_km_s: npt.ArrayLike,
    epoch: Epoch,
    t_s: npt.ArrayLike,
    forces: ForceModel,
    parameters: npt.ArrayLike | None = None,
    *,
    tolerance: float = TOLERANCE,
    threads: int | None = None,
    body: str | None = None,
) -> Clones:
    """Integrate a cloud of near orbits.

    Parameters
    ----------
    states_km_km_s : shape (k, 6), heliocentric ICRF states at `epoch`, km, km/s.
    epoch, t_s : the reference epoch; times (n,), TDB seconds after it, any order, either sign.
    forces : the force model of all.
    parameters : shape (k, m), values of `forces.parameters` for each clone; None: all as in `forces`. They may leave
        the physical range, as Gaussian draws do (`RadiationPressure.moved`).
    tolerance : as in `propagate`.
    body : a planet or "moon": tell of each clone its approach to it, about the deepest one of the middle. Impacts are
        told of without it.
    threads : how many at a time, 1 or more; None: one for each processor. The result does not depend on it.

    Raises
    ------
    InputError, CoverageError
        If shapes are wrong or numbers not finite, naming the clone; if the force does not exist with the parameters of
        a clone or with their mean; if `threads` is below 1; if a time is outside the ephemeris.
    EventError
        If neither the middle of the cloud, the mean of its states with the mean of its parameters, nor one of its first
        clones can be integrated with bodies as points. (A clone that runs into a body is `lost`.)

    Notes
    -----
    The result is that of `propagate` for each clone to rounding, below 1 mm after a year. An encounter multiplies
    that as it does any difference: of 2 mm after four years, Apophis' of 2029 makes 20 m two years later.
    """
    if threads is not None and (not isinstance(threads, int | np.integer) or threads < 1):
        raise InputError(f"threads: needs a positive number (got {threads})")
    starts, values = _checked(states_km_km_s, forces, parameters)
    if body is not None and body not in SURFACE_KM:
        raise InputError(f'body "{body}" is unknown (allowed: {", ".join(RADIUS_KM)})')
    middle = forces if values is None else _with(forces, values.mean(axis=0), "the mean of the clones")
    times = np.array(t_s, dtype=np.float64, ndmin=1)
    if times.ndim == 1 and np.isfinite(times).all() and _one_sided(times):
        return _in_flocks(starts, epoch, times, forces, values, tolerance, threads or os.cpu_count() or 1, body)
    nominal = _middle(starts, epoch, t_s, middle, tolerance)
    window = window_of(nominal, body)
    cloud = _Cloud(
        starts=starts, strengths=strengths_of(forces, epoch, values, len(starts)), nominal=nominal,
        sun=forces.ephemeris.sun_at(epoch), tolerance=float(tolerance),
    )  # fmt: skip
    seen, tide = cloud.fly(
        np.arange(len(starts)), np.concatenate([nominal.t_s, window]), threads or os.cpu_count() or 1
    )
    n, good = len(nominal.t_s), tide <= IMPACT_TIDE
    fates, untold = Fates.unknown(len(starts)), np.zeros(len(starts), dtype=np.bool_)
    if body is not None:
        untold = np.ones(len(starts), dtype=np.bool_)
        if window.size:
            untold = passages(seen[:, n:], window, body, forces.ephemeris, epoch, fates)
    alone, lost = ~good | untold, {}
    state = seen[:, :n].copy()
    restart = cloud.restart(np.flatnonzero(alone))
    about = float(window.mean()) if window.size else 0.0
    for k in np.flatnonzero(alone):
        own = forces if values is None else _with(forces, values[k], f"clone {k}")
        try:
            state[k] = _fly_alone(int(k), restart[int(k)], nominal, own, tolerance, body, about, fates)
        except EventError as error:
            state[k] = np.nan
            lost[int(k)] = str(error)
    return Clones(epoch=epoch, t_s=nominal.t_s, state=state, alone=alone, lost=lost, fates=fates)


def _one_sided(times: Array) -> bool:
    """Whether times (n,) lie on one side of 0, not all at it."""
    return bool(len(times) and (times.min() >= 0.0) != (times.max() <= 0.0))


def _in_flocks(
    starts: Array, epoch: Epoch, times: Array, forces: ForceModel, values: Array | None, tolerance: float,
    threads: int, body: str | None,
) -> Clones:  # fmt: skip
    """The same on one side of the epoch, where clones that drift apart fly on together with their neighbours."""
    flight = Flyer(
        epoch=epoch, end_s=float(times[np.argmax(np.abs(times))]), forces=forces, values=values,
        strengths=strengths_of(forces, epoch, values, len(starts)), watch=() if body is None else (body,),
        within_km=WIDEST_KM, times=times, tolerance=float(tolerance), threads=threads,
    ).fly(starts)  # fmt: skip
    fates, lost = Fates.unknown(len(starts)), dict(flight.lost)
    if body is not None and len(flight.near.t_s):
        distance = np.linalg.norm(flight.near.state[:, :3], axis=1)
        about = float(flight.near.t_s[np.argmin(distance)])
        for k in np.argsort(-np.abs(flight.near.t_s - about), kind="stable"):  # the last one written is the nearest
            fates.set(int(flight.near.orbit[k]), body, False, float(flight.near.t_s[k]), flight.near.state[k])
    for k, row, t, x in zip(flight.impact.orbit, flight.impact.body, flight.impact.t_s, flight.impact.state):
        hit = forces.bodies[row]
        fates.set(int(k), hit, True, float(t), x)
        lost[int(k)] = (
            f"the asteroid hits {hit} at about {(epoch + float(t)).iso(digits=0)}: {np.linalg.norm(x[:3]):.0f} km from "
            f"its centre, radius {SURFACE_KM[hit]:.0f} km"
        )
    state = flight.state
    state[list(lost)] = np.nan
    return Clones(epoch=epoch, t_s=times, state=state, alone=flight.left, lost=lost, fates=fates)


def _middle(starts: Array, epoch: Epoch, t_s: npt.ArrayLike, forces: ForceModel, tolerance: float) -> Trajectory:
    """The orbit whose steps all clones take: the mean, or, where that ends at a singularity, one of the clones."""
    for start in (starts.mean(axis=0), *starts[: SUBSTITUTES - 1]):
        try:
            return propagate(start, epoch, t_s, forces, False, tolerance=tolerance, margin_s=0.0, solid=False)
        except EventError as found:
            error = found
    raise error


class _Start(NamedTuple):
    """From where a clone flies alone: its state (6,), when, and its states at the times before (early, 6)."""

    state: Array
    t_s: float
    early: Array


def _fly_alone(
    k: int, start: _Start, nominal: Trajectory, forces: ForceModel, tolerance: float, body: str | None, about_s: float,
    fates: Fates,
) -> Array:  # fmt: skip
    """States (n, 6) of clone k on steps of its own, and its fate.

    Raises
    ------
    EventError
        If it hits a body; its fate is written all the same.
    """
    late = (nominal.t_s > start.t_s) | (start.t_s == 0.0)
    epoch, times = nominal.epoch + start.t_s, nominal.t_s[late] - start.t_s
    try:
        orbit = propagate(start.state, epoch, times, forces, False, tolerance=tolerance, margin_s=0.0)
    except ImpactError as hit:
        end = [hit.t_s]
        way = propagate(start.state, epoch, end, forces, False, tolerance=tolerance, margin_s=0.0, solid=False)
        arrival_of(k, way, hit.body, hit.t_s, start.t_s, fates)
        raise
    passage(k, orbit, body, about_s, start.t_s, fates)
    state = start.early.copy()
    state[late] = orbit.state
    return state


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cloud:
    """Starts (k, 6), strengths (k, 4) and the middle of a cloud; the Sun's barycentric state (6,) at the epoch."""

    starts: Array
    strengths: Array
    nominal: Trajectory
    sun: Array
    tolerance: float

    def fly(self, which: Integers, t_s: Array, threads: int, steps: int | None = None) -> tuple[Array, Array]:
        """States (len(which), n, 6) at times and the largest tide (len(which),) of some clones on the shared steps.

        Parameters
        ----------
        steps : fly so many forward steps only, and none backward; all by default.
        """
        nominal, epoch = self.nominal, self.nominal.epoch
        table, physics = nominal._table, nominal.forces.physics(epoch)
        order, arc = _order(table, t_s), Arc(*nominal.span_s, table.window, self.sun, physics)
        sun = nominal.forces.ephemeris.state_km_km_s("sun", epoch, t_s)
        state, tide = np.full((len(which), len(t_s), 6), np.nan), np.zeros(len(which))
        guides, ends = table.guides(physics), nominal.span_s
        if steps is not None:
            guide, nodes = guides[1]
            short = first_steps(guide, steps)
            guides, ends = (guides[0], (short, nodes[:steps])), (0.0, float(guide.start[steps]))

        def part(some: slice) -> None:
            for leg, end_s in enumerate(ends):
                chosen = np.flatnonzero(order.leg == leg)
                chosen = chosen[np.argsort(order.step[chosen], kind="stable")]
                if chosen.size:
                    own = np.zeros(some.stop - some.start)
                    samples = Samples(chosen, order.step, order.weights, sun, state[some], own, NO_WATCH)
                    integrator.integrate(
                        arc, self.starts[which[some]], self.strengths[which[some]], end_s, NO_COLUMNS, False,
                        self.tolerance, *guides[leg], samples,
                    )  # fmt: skip
                    tide[some] = np.maximum(tide[some], own)

        edges = np.linspace(0, len(which), min(len(which), 4 * threads) + 1).astype(int)
        parts = [slice(a, b) for a, b in pairwise(edges.tolist())]
        if threads == 1 or len(which) == 1:
            part(slice(0, len(which)))
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, parts))
        return state, tide

    def restart(self, which: Integers) -> dict[int, _Start]:
        """From where each of some clones flies alone: the epoch, or a day before the middle's first deep encounter."""
        none = np.full((len(self.nominal.t_s), 6), np.nan)
        found = {int(k): _Start(self.starts[k], 0.0, none) for k in which}
        steps = self._steps_before_encounter()
        if not which.size or steps == 0:
            return found
        edge = float(self.nominal._table.legs[1].start[steps])  # type: ignore[union-attr]
        split = edge - 1.0
        times = np.where(self.nominal.t_s <= split, self.nominal.t_s, 0.0)
        state, tide = self.fly(which, np.append(times, split), 1, steps)
        for row, k in enumerate(which):
            if tide[row] <= IMPACT_TIDE:
                found[int(k)] = _Start(state[row, -1], split, state[row, :-1])
        return found

    def _steps_before_encounter(self) -> int:
        """How many forward steps end a day before the first in a strong tide; 0 if none is, or times lie before 0."""
        forward = self.nominal._table.legs[1]
        if forward is None or self.nominal.t_s.min() < 0.0:
            return 0
        deep = np.flatnonzero(forward.tide > DEEP_TIDE)
        if not deep.size:
            return 0
        return max(int(np.searchsorted(forward.start, forward.start[deep[0]] - DAY_S, side="right")) - 1, 0)


@dataclass(frozen=True, slots=True)
class _Order:
    """Where the times lie: leg (n,) and step in it (n,), and the weights (n, 17): 16 of the nodes, then s h."""

    leg: Integers
    step: Integers
    weights: Array


def _order(table: StepTable, t_s: Array) -> _Order:
    """Find the step of each time and the weights of its nodes: the same for all clones."""
    behind = 0 if table.legs[0] is None else len(table.legs[0].rows)
    leg, step, weights = np.empty(len(t_s), np.int64), np.empty(len(t_s), np.int64), np.empty((len(t_s), 17))
    for e, t in enumerate(t_s):
        k = int(step_of(float(t), table.edges))
        h = float(table.steps.length[k])
        s = float((t - table.steps.start[k]) / h)
        step_weights(8, s, h, weights[e])
        weights[e, 16] = s * h
        leg[e], step[e] = (0, behind - 1 - k) if k < behind else (1, k - behind)
    return _Order(leg, step, weights)


def _checked(
    states_km_km_s: npt.ArrayLike, forces: ForceModel, parameters: npt.ArrayLike | None
) -> tuple[Array, Array | None]:
    """States (k, 6) and parameters (k, m) as arrays, refused if they cannot be used."""
    starts = np.asarray(states_km_km_s, dtype=np.float64)
    if starts.ndim != 2 or starts.shape[1:] != (6,) or not len(starts):
        raise InputError(f"states: need finite numbers of shape (k, 6) (km, km/s), got shape {starts.shape}")
    _require_finite("states", starts)
    if parameters is None:
        return starts, None
    values, wanted = np.asarray(parameters, dtype=np.float64), (len(starts), len(forces.parameters))
    if values.shape != wanted:
        raise InputError(f"parameters: need finite numbers of shape {wanted}, got shape {values.shape}")
    _require_finite("parameters", values)
    return starts, values


def _require_finite(what: str, rows: Array) -> None:
    """Refuse rows (k, n) that hold nan or infinity, naming the clones."""
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        which = "clone " + str(bad[0]) if len(bad) == 1 else "clones " + listed([str(k) for k in bad])
        raise InputError(f"{what}: {which} {'is' if len(bad) == 1 else 'are'} not finite (got {rows[bad[0]].tolist()})")


def _with(forces: ForceModel, values: Array, whose: str) -> ForceModel:
    """The model with its parameters at `values` (m,), of the clone that a message should name."""
    try:
        return forces.with_values(dict(zip(forces.parameters, values.tolist())))
    except InputError as error:
        raise InputError(f"parameters: {whose}: {error}") from None


def strengths_of(forces: ForceModel, epoch: Epoch, values: Array | None, count: int) -> Array:
    """What the kernels need of each clone's parameters, shape (count, 4): radiation, then A1, A2, A3."""
    rows = np.tile(forces.physics(epoch).strength, (count, 1))
    if values is not None and set(forces.parameters) <= set(PARAMETERS):  # linear: 20,000 in no time
        for name, column in zip(forces.parameters, values.T):
            rows[:, 1 + PARAMETERS.index(name)] = forces.physics(epoch).nongrav_unit * column
        return rows
    for k in range(count if values is not None else 0):
        rows[k] = _with(forces, values[k], f"clone {k}").physics(epoch).strength  # type: ignore[index]
    return rows
