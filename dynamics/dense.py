"""Dense output: state, Phi and zeta anywhere inside the steps of an integration, without integrating again.

Inside a step the acceleration is the polynomial through the eight nodes; its first and second integrals, written in
shifted Legendre polynomials, give velocity and position.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.chebyshev import position_at, velocity_at
from nebosvod.dynamics.collocation import TO_LEGENDRE_FLAT
from nebosvod.dynamics.compilation import SUN, kernel, straight
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.nodes import nodes_width, tabulate_nodes
from nebosvod.dynamics.stages import weighed
from nebosvod.dynamics.window import Window
from nebosvod.dynamics.workspace import ACCELERATION, LENGTH, NO_STEPS, START, STATE, VARIATION, Steps, memory

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@dataclass(slots=True, eq=False)
class StepTable:
    """Steps in ascending time with their edges (k + 1,), the ephemeris window, and the number of variation columns.

    `legs` are the same steps as integrated, from t = 0 backward and forward; `nodes` the ephemeris at their nodes, once
    another orbit has asked for it (see `guides`).
    """

    edges: Array
    steps: Steps
    window: Window
    count: int
    legs: tuple[Steps | None, Steps | None]
    nodes: list[Array]

    def guides(self, physics: Physics) -> tuple[tuple[Steps, Array], ...]:
        """Steps and tables of nodes of both legs, for orbits that follow this one."""
        guides, tables = tuple(leg or NO_STEPS for leg in self.legs), list(self.nodes)
        if not tables:
            w, bodies = self.window, len(self.window.layout)
            for guide in guides:
                nodes = np.zeros((len(guide.rows), nodes_width(bodies)))
                tabulate_nodes(8, guide, physics, w.coefficients, w.layout, w.timing, memory(bodies, 0), nodes)
                tables.append(nodes)
            self.nodes[:] = tables  # both at once: another thread may be here as well
        return tuple(zip(guides, tables))

    def evaluate(self, t_s: Array, *, variations: bool) -> tuple[Array, Array]:
        """Heliocentric states (n, 6) and, if asked for, variations (n, 6, count) at times inside the edges."""
        state = np.empty((len(t_s), 6))
        partials = np.empty((len(t_s), 6, self.count if variations else 0))
        w = self.window
        straight(_evaluate)(
            8, 1, t_s, self.edges, self.steps, w.coefficients, w.layout, w.timing, np.empty((7, 128)), state, partials
        )
        return state, partials


def join(
    backward: Steps | None, forward: Steps | None, window: Window, count: int, low_s: float,
    nodes: list[Array] | None = None,
) -> StepTable:  # fmt: skip
    """Put the steps of a backward and a forward integration from t = 0 into one ascending table.

    Without a backward one, the first step reaches back to `low_s`.
    """
    first = NO_STEPS if backward is None else backward
    behind = len(first.rows)
    if not behind and forward is not None:
        merged = forward
    elif forward is None:
        merged = Steps(np.ascontiguousarray(first.rows[::-1]))
    else:
        merged = Steps(np.concatenate((first.rows[::-1], forward.rows)))
        forward = Steps(merged.rows[behind:])  # the same numbers once: centuries of them are 40 MB
    rows = merged.rows
    edges = np.empty(len(rows) + 1)
    edges[:-1] = rows[:, START]
    if behind:
        edges[:behind] += rows[:behind, LENGTH]  # a backward step ends at its lower edge
    else:
        edges[0] = low_s
    edges[-1] = rows.item(-1, START) + max(rows.item(-1, LENGTH), 0.0)
    return StepTable(edges, merged, window, count, (backward, forward), [] if nodes is None else nodes)


@kernel
def step_of(t: float, edges: Array) -> int:
    """The step that holds t, by bisection of the ascending edges; the outer ones reach beyond their ends."""
    low, high = 0, edges.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if edges[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@kernel
def step_weights(n: int, s: float, h: float, weights: Array) -> None:
    """Weights of the n = 8 nodal accelerations: for the velocity at the fraction s of a step h, then for the position.

    From 0 to s, P_k(2s - 1) integrates to 2 s (s - 1) P_k'/(k (k + 1)), which is exactly zero at the ends, and that,
    I_k, to (I_(k+1) - I_(k-1)) / (2 (2k + 1)).
    """
    x, edge = 2.0 * s - 1.0, 2.0 * s * (s - 1.0)
    before, here, slope_before, slope = 1.0, x, 0.0, 1.0  # P_(k-1), P_k and their derivatives for k = 1
    once_before, once = s, 0.5 * edge
    for j in range(n):
        weights[j] = h * s * TO_LEGENDRE_FLAT[j]
        weights[8 + j] = 0.5 * h * h * s * s * TO_LEGENDRE_FLAT[j]
    for k in range(1, 8):
        before, here = here, ((2 * k + 1) * x * here - k * before) / (k + 1)
        slope_before, slope = slope, slope_before + (2 * k + 1) * before
        once_after = edge * slope / ((k + 1) * (k + 2))
        twice = (once_after - once_before) / (2.0 * (2 * k + 1))
        for j in range(n):
            weights[j] += h * once * TO_LEGENDRE_FLAT[8 * k + j]
            weights[8 + j] += h * h * twice * TO_LEGENDRE_FLAT[8 * k + j]
        once_before, once = once, once_after


@kernel
def _evaluate(
    n: int, one: int, times: Array, edges: Array, steps: Steps, coefficients: Array, layout: Integers, timing: Array,
    scratch: Array, state: Array, partials: Array,
) -> None:  # fmt: skip
    """Fill heliocentric `state` (n, 6) and `partials` (n, 6, columns); n and one are 8 and 1, scratch is (7, 128)."""
    weights, moment, T, u, record = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    sun, sun_velocity, count = scratch[5], scratch[6], partials.shape[2]
    rows = 3 * count
    for e in range(times.shape[0]):
        k = step_of(times[e], edges)
        step = steps.rows[k]
        h = step[LENGTH]
        s = (times[e] - step[START]) / h
        step_weights(n, s, h, weights)
        moment[0] = times[e]
        position_at(one, moment, coefficients, layout, timing, SUN, T, u, record, sun)
        velocity_at(one, moment, coefficients, layout, timing, SUN, T, u, record, sun_velocity)
        for i in range(3):
            q, r = weighed(weights, step, ACCELERATION + 8 * i)
            state[e, i] = step[STATE + i] + (s * h * step[STATE + 3 + i] + r) - sun[8 * i]
            state[e, 3 + i] = step[STATE + 3 + i] + q - sun_velocity[8 * i]
        for c in range(count):
            for i in range(3):
                o = 3 * c + i
                q, r = weighed(weights, step, VARIATION + 2 * rows + 8 * o)
                slope = step[VARIATION + rows + o]
                partials[e, i, c] = step[VARIATION + o] + s * h * slope + r
                partials[e, 3 + i, c] = slope + q
