"""One step of 8-stage Gauss-Legendre collocation: the accelerations at its nodes, of the state and of its variations.

The accelerations of the last step are extrapolated to the new nodes, and x -> acceleration -> x is iterated to
round-off (about three sweeps). The variational equations are linear: their Jacobians are evaluated once, at the
converged nodes, and every column is solved by the same iteration.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.collocation import A_FLAT, AA_FLAT, BARYCENTRIC, NODES
from nebosvod.dynamics.compilation import EARTH, STATE_ROWS, SUN, inlined_kernel
from nebosvod.dynamics.expansion import expand_bodies, expanded_field, sun_gradient, sun_tide
from nebosvod.dynamics.forces import expand, near, zonal_harmonics, zonal_harmonics_gradient
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.nongrav import law_factors, nongrav, nongrav_gradient
from nebosvod.dynamics.radiation import radiation, radiation_gradient, shade, shade_gradient
from nebosvod.dynamics.relativity import (
    eih,
    eih_gradient,
    lense_thirring,
    lense_thirring_gradient,
    sun_relativity,
    sun_relativity_gradient,
)
from nebosvod.dynamics.workspace import Work

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

EPSILON = 2.2e-16


@inlined_kernel
def add_small_forces(n: int, w: Work, p: Physics, A: Array) -> None:
    """Add what is neither a point mass nor the figure of the Earth: evaluated in every sweep, at w.X, w.V."""
    if p.sun_oblate:
        zonal_harmonics(n, w.X, w.P, SUN, p.gm[SUN], p.sun_zonal, p.sun_pole, A)
    if p.relativity == 1:
        sun_relativity(n, w.X, w.V, w.P, w.VS, p.gm[SUN], p.c2, A)
    elif p.relativity == 2:
        eih(n, w.X, w.V, w.P, w.W, w.WA, w.U, p.gm, p.c2, w.Q, A)
    if p.lense_thirring > 0.0:
        lense_thirring(n, w.X, w.V, w.P, w.VS, p.lense_thirring, p.sun_pole, A)
    if p.radiation_on:
        radiation(n, w.X, w.P, w.strength[0], A)
        if p.shadow_range > 0.0 and near(p.shadow_range, n, w.X, w.P, EARTH):
            shade(n, w.X, w.P, w.strength[0], A)
    if p.nongrav_on:
        law_factors(n, w.X, w.P, p.nongrav_law, w.law)
        nongrav(n, w.X, w.V, w.P, w.VS, w.strength[1:], w.law, A)


@inlined_kernel
def expand_here(n: int, w: Work, p: Physics) -> None:
    """Expand the field of the bodies but the Sun, and of the Earth's figure, about w.X; w.tide of all bodies."""
    for i in range(3 * n):
        w.X0[i] = w.X[i]
    for i in range(n):
        w.change[16 + i] = 0.0
    expand_bodies(n, w.X, w.P, p.gm, w.R0, w.S0, w.tide, w.bend)
    sun_tide(n, w.X, w.P, p.gm[SUN], w.tide)
    if p.earth_range > 0.0 and near(p.earth_range, n, w.X, w.P, EARTH):
        zonal_harmonics(n, w.X, w.P, EARTH, p.gm[EARTH], p.earth_zonal, w.pole, w.R0)
        zonal_harmonics_gradient(n, w.X, w.P, EARTH, p.gm[EARTH], p.earth_zonal, w.pole, w.S0)


@inlined_kernel
def expanded_jacobian(n: int, w: Work, p: Physics) -> None:
    """dA/dX, dA/dV and dA/d(parameters) after `solve_state`, at w.X, w.V, into w.G, w.K, w.F.

    The bodies but the Sun come from the gradient that the expansion has summed. Its own change over the shift from X0,
    15 GM/r^4 |X - X0|, must vanish beside the Sun's gradient; else it is expanded anew.
    """
    if 15.0 * largest(w.bend) * largest(w.change[16:]) > 1e-13 * largest(w.tide):
        expand_here(n, w, p)
    for i in range(6 * n):
        w.S[i] = w.S0[i]
    sun_gradient(n, w.X, w.P, p.gm[SUN], w.S)
    add_small_gradients(n, w, p)


@inlined_kernel
def add_small_gradients(n: int, w: Work, p: Physics) -> None:
    """Add the gradients of `add_small_forces` to those of the point masses in w.S."""
    for r in range(9):
        for l in range(n):
            w.K[8 * r + l] = 0.0
    if p.sun_oblate:
        zonal_harmonics_gradient(n, w.X, w.P, SUN, p.gm[SUN], p.sun_zonal, p.sun_pole, w.S)
    if p.radiation_on:
        radiation_gradient(n, w.X, w.P, w.strength[0], p.radiation_unit, w.S, w.F[:24])
    expand(n, w.S, w.G)
    if p.relativity == 1:
        sun_relativity_gradient(n, w.X, w.V, w.P, w.VS, p.gm[SUN], p.c2, w.G, w.K)
    elif p.relativity == 2:
        eih_gradient(n, w.X, w.V, w.P, w.W, w.WA, w.U, p.gm, p.c2, w.Q, w.G, w.K)
    if p.lense_thirring > 0.0:
        lense_thirring_gradient(n, w.X, w.V, w.P, w.VS, p.lense_thirring, p.sun_pole, w.G, w.K)
    if p.radiation_on and p.shadow_range > 0.0 and near(p.shadow_range, n, w.X, w.P, EARTH):
        shade_gradient(n, w.X, w.P, w.strength[0], p.radiation_unit, w.G, w.F[:24])
    if p.nongrav_on:
        nongrav_gradient(n, w.X, w.V, w.P, w.VS, w.strength[1:], w.law, p.nongrav_unit, w.G, w.K, w.F[24:])


@inlined_kernel
def largest(values: Array) -> float:
    """Largest of eight lanes."""
    a, b = max(values[0], values[1]), max(values[2], values[3])
    c, d = max(values[4], values[5]), max(values[6], values[7])
    return float(max(max(a, b), max(c, d)))


@inlined_kernel
def extrapolation(n: int, h: float, h_before: float, E: Array) -> None:
    """E[j, i]: Lagrange polynomial j of the last nodes at the new node i; zero after no step."""
    if h_before == 0.0:
        for i in range(64):
            E[i] = 0.0
        return
    step = h / h_before
    for i in range(n):  # the factors before j times those behind it, in registers
        x = 1.0 + step * NODES[i]
        d0, d1, d2, d3 = x - NODES[0], x - NODES[1], x - NODES[2], x - NODES[3]
        d4, d5, d6, d7 = x - NODES[4], x - NODES[5], x - NODES[6], x - NODES[7]
        low, high, front, rear = d0 * d1, d6 * d7, d2 * d3, d4 * d5
        E[i], E[8 + i] = d1 * front * rear * high * BARYCENTRIC[0], d0 * front * rear * high * BARYCENTRIC[1]
        E[16 + i], E[24 + i] = low * d3 * rear * high * BARYCENTRIC[2], low * d2 * rear * high * BARYCENTRIC[3]
        E[32 + i], E[40 + i] = low * front * d5 * high * BARYCENTRIC[4], low * front * d4 * high * BARYCENTRIC[5]
        E[48 + i], E[56 + i] = low * front * rear * d7 * BARYCENTRIC[6], low * front * rear * d6 * BARYCENTRIC[7]


@inlined_kernel
def predict(n: int, E: Array, before: Array, known: Array, rows: int, out: Array) -> None:
    """First guess of `rows` rows of accelerations: those of the guide, and the rest of the last step extrapolated."""
    for r in range(rows):
        k = 8 * r
        a0, a1, a2, a3 = before[k], before[k + 1], before[k + 2], before[k + 3]
        a4, a5, a6, a7 = before[k + 4], before[k + 5], before[k + 6], before[k + 7]
        for i in range(n):
            out[k + i] = known[k + i] + (
                (a0 * E[i] + a1 * E[8 + i] + a2 * E[16 + i] + a3 * E[24 + i])
                + (a4 * E[32 + i] + a5 * E[40 + i] + a6 * E[48 + i] + a7 * E[56 + i])
            )


@inlined_kernel
def remember(n: int, A: Array, known: Array, rows: int, before: Array) -> None:
    """After a step: what the next one extrapolates."""
    for i in range(n * rows):
        before[i] = A[i] - known[i]


@inlined_kernel
def stage_states(n: int, a: Array, x: Array, v: Array, h: float, X: Array, V: Array) -> None:
    """Positions X (24,) and velocities V (24,) at the nodes, from the accelerations a (24,) there."""
    for r in range(3):
        k, x0, v0 = 8 * r, x[r], v[r]
        a0, a1, a2, a3, a4, a5, a6, a7 = a[k], a[k + 1], a[k + 2], a[k + 3], a[k + 4], a[k + 5], a[k + 6], a[k + 7]
        for i in range(n):
            once = (a0 * A_FLAT[i] + a1 * A_FLAT[8 + i] + a2 * A_FLAT[16 + i] + a3 * A_FLAT[24 + i]) + (
                a4 * A_FLAT[32 + i] + a5 * A_FLAT[40 + i] + a6 * A_FLAT[48 + i] + a7 * A_FLAT[56 + i]
            )
            twice = (a0 * AA_FLAT[i] + a1 * AA_FLAT[8 + i] + a2 * AA_FLAT[16 + i] + a3 * AA_FLAT[24 + i]) + (
                a4 * AA_FLAT[32 + i] + a5 * AA_FLAT[40 + i] + a6 * AA_FLAT[48 + i] + a7 * AA_FLAT[56 + i]
            )
            V[k + i] = v0 + h * once
            X[k + i] = x0 + h * (NODES[i] * v0 + h * twice)


@inlined_kernel
def shifts(n: int, X: Array, X0: Array, most: Array) -> None:
    """Largest component of X - X0 in each lane, km."""
    for i in range(n):
        a, b, c = abs(X[i] - X0[i]), abs(X[8 + i] - X0[8 + i]), abs(X[16 + i] - X0[16 + i])
        most[i] = max(max(a, b), c)


@inlined_kernel
def replace(n: int, A: Array, B: Array, change: Array) -> None:
    """A = B; the largest change and the largest component of each lane into change (16,)."""
    for i in range(n):
        a, b, c = abs(B[i] - A[i]), abs(B[8 + i] - A[8 + i]), abs(B[16 + i] - A[16 + i])
        change[i], change[8 + i] = max(max(a, b), c), max(max(abs(B[i]), abs(B[8 + i])), abs(B[16 + i]))
        A[i], A[8 + i], A[16 + i] = B[i], B[8 + i], B[16 + i]


@inlined_kernel
def solve_state(n: int, w: Work, p: Physics, h: float) -> tuple[bool, float, float]:
    """Iterate the stage accelerations w.A to round-off.

    Returns whether they converged, their round-off floor relative to their size (near a perturber the rounding of the
    position is amplified by GM/r^3: without it the step control would chase noise), and their size.
    """
    predict(n, w.extrapolation, w.before, w.known, STATE_ROWS, w.A)
    last, noise, size, valid_km, x, v = 1e300, 0.0, 1.0, -1.0, w.x, w.v
    # The rounding of position and time, km
    blur = abs(x[0]) + abs(x[1]) + abs(x[2]) + abs(w.t[7]) * (abs(v[0]) + abs(v[1]) + abs(v[2]))
    for sweep in range(14):
        stage_states(n, w.A, w.x, w.v, h, w.X, w.V)
        shifts(n, w.X, w.X0, w.change[16:])
        if sweep == 0 or largest(w.change[16:]) > valid_km:
            expand_here(n, w, p)
        expanded_field(n, w.X, w.X0, w.R0, w.S0, w.P, p.gm[SUN], w.B)
        add_small_forces(n, w, p, w.B)
        replace(n, w.A, w.B, w.change)
        size = largest(w.change[8:])
        change = largest(w.change) / size
        valid_km = np.sqrt(0.02 * EPSILON * size / largest(w.bend))  # how far the expansion holds
        noise = largest(w.tide) * 8.0 * EPSILON * blur / size
        if change < EPSILON + noise or (change < 1e-13 + noise and change > 0.3 * last):
            return True, noise, size
        # The next change, by the contraction seen. It moves velocities by a tenth of that: less than they are rounded
        if sweep > 0 and change * change / last < 1e-15:
            return True, noise, size
        if sweep > 1 and change > 0.5 * last and change > 1e-9:
            return False, noise, size
        last = change
    return False, noise, size


@inlined_kernel
def variational(n: int, G: Array, K: Array, DX: Array, DV: Array, E: Array) -> None:
    """Right-hand side of the variational equations of one column: E = G dx + K dv."""
    for i in range(n):
        x, y, z, u, v, w = DX[i], DX[8 + i], DX[16 + i], DV[i], DV[8 + i], DV[16 + i]
        E[i] = G[i] * x + G[8 + i] * y + G[16 + i] * z + K[i] * u + K[8 + i] * v + K[16 + i] * w
        E[8 + i] = G[24 + i] * x + G[32 + i] * y + G[40 + i] * z + K[24 + i] * u + K[32 + i] * v + K[40 + i] * w
        E[16 + i] = G[48 + i] * x + G[56 + i] * y + G[64 + i] * z + K[48 + i] * u + K[56 + i] * v + K[64 + i] * w


@inlined_kernel
def solve_variations(n: int, w: Work, p: Physics, columns: Integers, h: float) -> None:
    """Iterate the accelerations w.D of all variation columns to round-off, with the Jacobians where the state is."""
    if w.D.shape[0] == 0:  # the state alone is wanted
        return
    expanded_jacobian(n, w, p)
    count = 6 + columns.shape[0]
    predict(n, w.extrapolation, w.D_before, w.D_known, 3 * count, w.D)
    last = 1e300
    for sweep in range(14):
        worst = 0.0
        for c in range(count):  # columns inside sweeps: they do not wait for each other, as the sweeps of one do
            D = w.D[24 * c : 24 * c + 24]
            stage_states(n, D, w.px[3 * c : 3 * c + 3], w.pv[3 * c : 3 * c + 3], h, w.DX, w.DV)
            variational(n, w.G, w.K, w.DX, w.DV, w.B)
            if c >= 6:
                f = 24 * columns[c - 6]
                for i in range(3 * n):
                    w.B[i] += w.F[f + i]
            replace(n, D, w.B, w.change)
            worst = max(worst, largest(w.change) / max(largest(w.change[8:]), 1e-300))
        if worst < 1e-13 or (sweep > 0 and worst * worst / last < 1e-13):  # the next change, by the contraction seen
            return
        last = worst


@inlined_kernel
def weighed(weights: Array, a: Array, at: int) -> tuple[float, float]:
    """Sums over eight nodal accelerations, with the weights for the velocity and with those for the position."""
    q, r = 0.0, 0.0
    for j in range(8):
        q += weights[j] * a[at + j]
        r += weights[8 + j] * a[at + j]
    return q, r
