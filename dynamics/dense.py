"""Dense output: state, Phi and zeta anywhere inside the steps of an integration, without integrating again.

Inside a step the acceleration is the polynomial through the eight nodes; its first and second integrals, written in
shifted Legendre polynomials, give velocity and position.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.chebyshev import series_at, velocity_at
from nebosvod.dynamics.collocation import TO_LEGENDRE_FLAT
from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.ephemeris import Window
from nebosvod.dynamics.integrator import nodes_width, tabulate_nodes
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.workspace import NO_STEPS, Steps

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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
        w = self.window
        if not self.nodes:
            for leg in self.legs:
                guide = leg or NO_STEPS
                nodes = np.empty((len(guide.start), int(nodes_width(w.layout.shape[0]))))
                tabulate_nodes(8, guide, physics, w.coefficients, w.layout, w.timing, nodes)
                self.nodes.append(nodes)
        return tuple((leg or NO_STEPS, nodes) for leg, nodes in zip(self.legs, self.nodes))

    def evaluate(self, t_s: Array, *, variations: bool) -> tuple[Array, Array]:
        """Heliocentric states (n, 6) and, if asked for, variations (n, 6, count) at times inside the edges."""
        state = np.empty((len(t_s), 6))
        partials = np.empty((len(t_s), 6, self.count if variations else 0))
        w = self.window
        _evaluate(1, t_s, self.edges, self.steps, w.coefficients, w.layout, w.timing, state, partials)
        return state, partials


def join(
    backward: Steps | None, forward: Steps | None, window: Window, count: int, nodes: list[Array] | None = None
) -> StepTable:
    """Put the steps of a backward and a forward integration from t = 0 into one ascending table."""
    if backward is None and forward is not None:
        merged, behind = forward, 0
    else:
        parts = [Steps(*(np.ascontiguousarray(field[::-1]) for field in backward or NO_STEPS))]
        behind = len(parts[0].start)
        parts += [] if forward is None else [forward]
        merged = parts[0] if len(parts) == 1 else Steps(*(np.concatenate(fields) for fields in zip(*parts)))
    edges = np.empty(len(merged.start) + 1)
    edges[:-1] = merged.start
    edges[:behind] += merged.length[:behind]  # a backward step ends at its lower edge
    edges[-1] = merged.start[-1] + max(float(merged.length[-1]), 0.0)
    return StepTable(
        edges=edges,
        steps=merged,
        window=window,
        count=count,
        legs=(backward, forward),
        nodes=[] if nodes is None else nodes,
    )


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
def step_weights(s: float, h: float, weights: Array) -> None:
    """Weights (16,) of the nodal accelerations: first for the velocity at the fraction s of a step h, then position."""
    x = 2.0 * s - 1.0
    P = np.empty(10)
    P[0], P[1] = 1.0, x
    for k in range(1, 9):
        P[k + 1] = ((2 * k + 1) * x * P[k] - k * P[k - 1]) / (k + 1)
    once = np.empty(9)
    once[0] = s
    for k in range(1, 9):
        once[k] = (P[k + 1] - P[k - 1]) / (2.0 * (2 * k + 1))
    for j in range(16):
        weights[j] = 0.0
    for k in range(8):
        twice = 0.5 * s * s if k == 0 else (once[k + 1] - once[k - 1]) / (2.0 * (2 * k + 1))
        for j in range(8):
            weights[j] += h * once[k] * TO_LEGENDRE_FLAT[8 * k + j]
            weights[8 + j] += h * h * twice * TO_LEGENDRE_FLAT[8 * k + j]


@kernel
def _evaluate(
    n: int, times: Array, edges: Array, steps: Steps, coefficients: Array, layout: Integers, timing: Array,
    state: Array, partials: Array,
) -> None:  # fmt: skip
    """Fill heliocentric `state` (n, 6) and `partials` (n, 6, columns)."""
    weights, sun, sun_velocity, moment = np.empty(16), np.empty((1, 24)), np.empty(24), np.empty(8)
    count = partials.shape[2]
    rows = 3 * count
    for e in range(times.shape[0]):
        k = step_of(times[e], edges)
        h = steps.length[k]
        s = (times[e] - steps.start[k]) / h
        step_weights(s, h, weights)
        moment[0] = times[e]
        series_at(n, moment, coefficients, layout, timing, 0, sun)
        velocity_at(n, moment, coefficients, layout, timing, 0, sun_velocity)
        for i in range(3):
            q, r = 0.0, 0.0
            for j in range(8):
                q += weights[j] * steps.acceleration[k, 8 * i + j]
                r += weights[8 + j] * steps.acceleration[k, 8 * i + j]
            state[e, i] = steps.state[k, i] + (s * h * steps.state[k, 3 + i] + r) - sun[0, 8 * i]
            state[e, 3 + i] = steps.state[k, 3 + i] + q - sun_velocity[8 * i]
        for c in range(count):
            for i in range(3):
                q, r, o = 0.0, 0.0, 3 * c + i
                for j in range(8):
                    q += weights[j] * steps.variation_acceleration[k, 8 * o + j]
                    r += weights[8 + j] * steps.variation_acceleration[k, 8 * o + j]
                slope = steps.variation[k, rows + o]
                partials[e, i, c] = steps.variation[k, o] + s * h * slope + r
                partials[e, 3 + i, c] = slope + q
