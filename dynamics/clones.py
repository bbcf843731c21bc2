"""propagate_many(...): many near orbits at once, on the steps and the ephemeris of one.

The middle of the cloud, the mean of its states, is integrated with its own step control; every clone takes the same
steps, reads the bodies at their nodes from a table, starts its iteration from the accelerations of the middle, and
checks its own last Legendre coefficient in every step. A clone that fails the check, or comes near a surface, is
propagated alone.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import integrator
from nebosvod.dynamics.collision import IMPACT_TIDE
from nebosvod.dynamics.dense import StepTable, step_of, step_weights
from nebosvod.dynamics.model import ForceModel
from nebosvod.dynamics.propagator import TOLERANCE, propagate
from nebosvod.dynamics.workspace import Samples
from nebosvod.errors import EventError, InputError, listed
from nebosvod.quantities import bordered
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
NO_COLUMNS: Integers = np.empty(0, dtype=np.int64)


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
    """

    epoch: Epoch
    t_s: Array
    state: Array
    alone: npt.NDArray[np.bool_]
    lost: Mapping[int, str]


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
    threads : how many at a time, 1 or more; None: one for each processor. The result does not depend on it.

    Raises
    ------
    InputError, CoverageError
        If shapes are wrong or numbers not finite, naming the clone; if the force does not exist with the parameters of
        a clone or with their mean; if `threads` is below 1; if a time is outside the ephemeris.
    EventError
        If the middle of the cloud, the mean of its states with the mean of its parameters, runs into a body. (A clone
        that does so is `lost`.)

    Notes
    -----
    The result is that of `propagate` for each clone to rounding, below 1 mm after a year. An encounter multiplies
    that as it does any difference: of 2 mm after four years, Apophis' of 2029 makes 20 m two years later.
    """
    if threads is not None and (not isinstance(threads, int | np.integer) or threads < 1):
        raise InputError(f"threads: needs a positive number (got {threads})")
    starts, values = _checked(states_km_km_s, forces, parameters)
    strengths = _strengths(forces, epoch, values, len(starts))
    middle = forces if values is None else _with(forces, values.mean(axis=0), "the mean of the clones")
    nominal = propagate(starts.mean(axis=0), epoch, t_s, middle, False, tolerance=tolerance, margin_s=0.0)
    middle = nominal.forces  # without the asteroid that these clones may be
    order = _order(nominal._table, nominal.t_s)
    sun = forces.ephemeris.state_km_km_s("sun", epoch, np.append(nominal.t_s, 0.0))
    state = np.full((len(starts), len(nominal.t_s), 6), np.nan)
    good = np.zeros(len(starts), dtype=np.bool_)
    physics = middle.physics(epoch)
    guides = nominal._table.guides(physics)

    def fly(part: slice) -> None:
        window, tide = nominal._table.window, np.zeros(part.stop - part.start)
        good[part] = True
        for leg, end_s in enumerate(nominal.span_s):
            chosen = np.flatnonzero(order.leg == leg)
            chosen = chosen[np.argsort(order.step[chosen], kind="stable")]
            if chosen.size:
                samples = Samples(chosen, order.step, order.weights, sun, state[part], tide)
                integrator.integrate(
                    8, starts[part] + sun[-1], strengths[part], end_s, window.coefficients, window.layout,
                    window.timing, physics, NO_COLUMNS, False, float(tolerance), *guides[leg], samples,
                )  # fmt: skip
                good[part] &= tide <= IMPACT_TIDE

    count = threads or os.cpu_count() or 1
    edges = np.linspace(0, len(starts), min(len(starts), 4 * count) + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges.tolist())]
    if count == 1:
        fly(slice(0, len(starts)))
    else:
        with ThreadPoolExecutor(count) as pool:
            list(pool.map(fly, parts))
    lost = {}
    for k in np.flatnonzero(~good):
        own = forces if values is None else _with(forces, values[k], f"clone {k}")
        try:
            state[k] = propagate(starts[k], epoch, t_s, own, False, tolerance=tolerance, margin_s=0.0).state
        except EventError as error:
            state[k] = np.nan
            lost[int(k)] = str(error)
    return Clones(epoch=epoch, t_s=nominal.t_s, state=state, alone=~good, lost=lost)


@dataclass(frozen=True, slots=True)
class _Order:
    """Where the times lie: leg (n,) and step in it (n,), and the weights (n, 17): 16 of the nodes, then s h."""

    leg: Integers
    step: Integers
    weights: Array


def _order(table: StepTable, t_s: Array) -> _Order:
    """Find the step of each time and the weights of its nodes: the same for all clones."""
    behind = 0 if table.legs[0] is None else len(table.legs[0].start)
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


def _strengths(forces: ForceModel, epoch: Epoch, values: Array | None, count: int) -> Array:
    """What the kernels need of each clone's parameters, shape (count, 4): radiation, then A1, A2, A3."""
    rows = np.empty((count, 4))
    for k in range(count if values is not None else 1):
        physics = (forces if values is None else _with(forces, values[k], f"clone {k}")).physics(epoch)
        rows[k] = physics.strength
    if values is None:
        rows[:] = rows[0]
    return rows
