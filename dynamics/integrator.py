"""The compiled integrator: X, Phi and zeta in one sweep by 8-stage Gauss-Legendre collocation (order 16).

One step: extrapolate the accelerations of the last step to the new nodes; iterate x -> acceleration -> x to round-off
(about three sweeps); then solve the linear variational equations, whose Jacobians are evaluated once, by the same
iteration. Perturbers do not depend on the state, so the ephemeris is read once per step. The step size follows the last
Legendre coefficient of the acceleration, relative to the acceleration.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.chebyshev import bodies_at, major_velocities_at, velocity_at
from nebosvod.dynamics.collocation import A_FLAT, AA_FLAT, BARYCENTRIC, LAST_ROW, NODES, POSITION_WEIGHTS, WEIGHTS
from nebosvod.dynamics.compilation import inlined_kernel, is_compiled, kernel
from nebosvod.dynamics.expansion import expand_bodies, expanded_field, largest_shift, sun_gradient, sun_tide
from nebosvod.dynamics.forces import earth_pole, expand, near, zonal_harmonics, zonal_harmonics_gradient
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.nongrav import law_factors, nongrav, nongrav_gradient
from nebosvod.dynamics.radiation import radiation, radiation_gradient, shade, shade_gradient
from nebosvod.dynamics.relativity import (
    MAJOR,
    eih,
    eih_gradient,
    major_fields,
    sun_relativity,
    sun_relativity_gradient,
)
from nebosvod.dynamics.workspace import Samples, Steps, Work, make_steps, make_work, resized

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

OK, STALLED, TOO_MANY_STEPS, OFF_GRID = 0, 1, 2, 3
LARGEST_STEP_S = 200.0 * 86400.0
SMALLEST_STEP_S = 1e-3
MOST_STEPS = 2_000_000
EPSILON = 2.2e-16
SUN, EARTH = 0, 3


@inlined_kernel
def add_small_forces(n: int, w: Work, p: Physics, A: Array) -> None:
    """Add what is neither a point mass nor the figure of the Earth: evaluated in every sweep, at w.X, w.V."""
    if p.sun_oblate:
        zonal_harmonics(n, w.X, w.P, SUN, p.gm[SUN], p.sun_zonal, p.sun_pole, A)
    if p.relativity == 1:
        sun_relativity(n, w.X, w.V, w.P, w.VS, p.gm[SUN], p.c2, A)
    elif p.relativity == 2:
        eih(n, w.X, w.V, w.P, w.W, w.WA, w.U, p.gm, p.c2, w.Q, A)
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
    for i in range(24):
        w.X0[i] = w.X[i]
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
    if 15.0 * largest(w.bend) * largest_shift(n, w.X, w.X0) > 1e-13 * largest(w.tide):
        expand_here(n, w, p)
    for i in range(48):
        w.S[i] = w.S0[i]
    sun_gradient(n, w.X, w.P, p.gm[SUN], w.S)
    add_small_gradients(n, w, p)


@inlined_kernel
def add_small_gradients(n: int, w: Work, p: Physics) -> None:
    """Add the gradients of `add_small_forces` to those of the point masses in w.S."""
    for i in range(72):
        w.K[i] = 0.0
    if p.sun_oblate:
        zonal_harmonics_gradient(n, w.X, w.P, SUN, p.gm[SUN], p.sun_zonal, p.sun_pole, w.S)
    if p.radiation_on:
        radiation_gradient(n, w.X, w.P, w.strength[0], p.radiation_unit, w.S, w.F[:24])
    expand(n, w.S, w.G)
    if p.relativity == 1:
        sun_relativity_gradient(n, w.X, w.V, w.P, w.VS, p.gm[SUN], p.c2, w.G, w.K)
    elif p.relativity == 2:
        eih_gradient(n, w.X, w.V, w.P, w.W, w.WA, w.U, p.gm, p.c2, w.Q, w.G, w.K)
    if p.radiation_on and p.shadow_range > 0.0 and near(p.shadow_range, n, w.X, w.P, EARTH):
        shade_gradient(n, w.X, w.P, w.strength[0], p.radiation_unit, w.G, w.F[:24])
    if p.nongrav_on:
        nongrav_gradient(n, w.X, w.V, w.P, w.VS, w.strength[1:], w.law, p.nongrav_unit, w.G, w.K, w.F[24:])


@kernel
def largest(values: Array) -> float:
    """Largest of eight lanes."""
    most = values[0]
    for l in range(1, 8):
        most = max(most, values[l])
    return float(most)


@kernel
def size_of(A: Array) -> float:
    """Largest component."""
    size = 0.0
    for i in range(24):
        size = max(size, abs(A[i]))
    return size


@kernel
def weigh(n: int, M: Array, a: Array, rows: int, scale: float, out: Array) -> None:
    """out[r, i] = scale sum_j M[j, i] a[r, j] for `rows` rows of 8 lanes: the 8 x 8 table times each row."""
    for r in range(rows):
        k = 8 * r
        a0, a1, a2, a3 = scale * a[k], scale * a[k + 1], scale * a[k + 2], scale * a[k + 3]
        a4, a5, a6, a7 = scale * a[k + 4], scale * a[k + 5], scale * a[k + 6], scale * a[k + 7]
        for i in range(n):
            out[k + i] = (a0 * M[i] + a1 * M[8 + i] + a2 * M[16 + i] + a3 * M[24 + i]) + (
                a4 * M[32 + i] + a5 * M[40 + i] + a6 * M[48 + i] + a7 * M[56 + i]
            )


@kernel
def extrapolation(h: float, h_before: float, E: Array) -> None:
    """E[j, i]: Lagrange polynomial j of the last nodes at the new node i; zero after no step."""
    if h_before == 0.0:
        for i in range(64):
            E[i] = 0.0
        return
    ratio = h / h_before
    for i in range(8):
        x = 1.0 + ratio * NODES[i]
        product = 1.0
        for j in range(8):
            product *= x - NODES[j]
        for j in range(8):
            E[8 * j + i] = product * BARYCENTRIC[j] / (x - NODES[j])


@inlined_kernel
def read_ephemeris(
    n: int, t: float, h: float, w: Work, p: Physics, coefficients: Array, layout: Integers, timing: Array
) -> None:
    """Bodies, the Sun's velocity and the Earth's pole at the nodes of the step from t to t + h."""
    for i in range(8):
        w.t[i] = t + h * NODES[i]
    bodies_at(n, w.t, coefficients, layout, timing, p.mass_ratio, w.P)
    velocity_at(n, w.t, coefficients, layout, timing, 0, w.VS)
    if p.relativity == 2:
        major_velocities_at(n, w.t, coefficients, layout, timing, p.mass_ratio, w.W)
        major_fields(n, w.P, p.gm, w.WA, w.U)
    earth_pole(p.earth_pole_of_date, p.century + (t + 0.5 * h) / 3155760000.0, w.pole)


@kernel
def nodes_width(bodies: int) -> int:
    """Numbers of one row of a table of nodes."""
    return 24 * bodies + 27 + MAJOR * 56


@inlined_kernel
def keep_nodes(w: Work, row: Array) -> None:
    """Write what `read_ephemeris` has found into a row of a table of nodes."""
    bodies, k = w.P.shape[0], 0
    for b in range(bodies):
        for i in range(24):
            row[k + i] = w.P[b, i]
        k += 24
    for i in range(24):
        row[k + i] = w.VS[i]
    for i in range(3):
        row[k + 24 + i] = w.pole[i]
    k += 27
    for j in range(MAJOR):
        for i in range(24):
            row[k + i], row[k + 24 + i] = w.W[j, i], w.WA[j, i]
        for i in range(8):
            row[k + 48 + i] = w.U[j, i]
        k += 56


@inlined_kernel
def recall_nodes(n: int, w: Work, row: Array, velocities: bool) -> None:
    """The other way round; the velocities and fields of the major bodies only if they are needed (EIH).

    The trip count 3 n and not 24: a constant is unrolled into single moves (0.3 us a step).
    """
    bodies, k = w.P.shape[0], np.uint64(0)
    for b in range(bodies):
        for i in range(3 * n):
            w.P[b, i] = row[k + np.uint64(i)]
        k += np.uint64(24)
    for i in range(3 * n):
        w.VS[i] = row[k + np.uint64(i)]
    for i in range(3):
        w.pole[i] = row[k + np.uint64(24 + i)]
    k += np.uint64(27)
    if velocities:
        for j in range(MAJOR):
            for i in range(24):
                w.W[j, i], w.WA[j, i] = row[k + np.uint64(i)], row[k + np.uint64(24 + i)]
            for i in range(8):
                w.U[j, i] = row[k + np.uint64(48 + i)]
            k += np.uint64(56)


@kernel
def tabulate_nodes(
    n: int, guide: Steps, p: Physics, coefficients: Array, layout: Integers, timing: Array, nodes: Array
) -> None:
    """Read the ephemeris at the nodes of all steps of a guide into `nodes` (steps, nodes_width)."""
    w = make_work(layout.shape[0], 0)
    for k in range(guide.start.shape[0]):
        read_ephemeris(n, guide.start[k], guide.length[k], w, p, coefficients, layout, timing)
        keep_nodes(w, nodes[k])


@inlined_kernel
def follow_guide(n: int, w: Work, p: Physics, guide: Steps, nodes: Array, k: int) -> float:
    """Set up step k of a guide: bodies at its nodes, its accelerations as the first guess; returns its length."""
    recall_nodes(n, w, nodes[k], p.relativity == 2)
    for i in range(3 * n):
        w.known[i] = guide.acceleration[k, i]
    if guide.variation_acceleration.shape[1] == w.D.shape[0]:
        for i in range(w.D.shape[0]):
            w.D_known[i] = guide.variation_acceleration[k, i]
    return float(guide.length[k])


@inlined_kernel
def solve_state(n: int, w: Work, p: Physics, x: Array, v: Array, h: float) -> tuple[bool, float, float]:
    """Iterate the stage accelerations w.A to round-off.

    Returns whether they converged, their round-off floor relative to their size (near a perturber the rounding of the
    position is amplified by GM/r^3: without it the step control would chase noise), and their size.
    """
    weigh(n, w.extrapolation, w.before, 3, 1.0, w.A)
    for i in range(3 * n):
        w.A[i] += w.known[i]
    last, noise, size, reach = 1e300, 0.0, 1.0, -1.0
    for sweep in range(14):
        weigh(n, AA_FLAT, w.A, 3, h * h, w.X)
        weigh(n, A_FLAT, w.A, 3, h, w.V)
        for k in range(3):
            for i in range(8):
                w.X[8 * k + i] += x[k] + h * NODES[i] * v[k]
                w.V[8 * k + i] += v[k]
        if largest_shift(n, w.X, w.X0) > reach or sweep == 0:
            expand_here(n, w, p)
            reach = np.sqrt(0.02 * EPSILON * size_of(w.A) / largest(w.bend))
        expanded_field(n, w.X, w.X0, w.R0, w.S0, w.P, p.gm[SUN], w.B)
        add_small_forces(n, w, p, w.B)
        change, size = 0.0, 0.0
        for i in range(24):
            change = max(change, abs(w.B[i] - w.A[i]))
            size = max(size, abs(w.B[i]))
            w.A[i] = w.B[i]
        if sweep == 0:
            blur = (
                8.0 * EPSILON * (abs(x[0]) + abs(x[1]) + abs(x[2]) + abs(w.t[7]) * (abs(v[0]) + abs(v[1]) + abs(v[2])))
            )
            noise = largest(w.tide) * blur / size
        change /= size
        if change < EPSILON + noise or (change < 1e-13 + noise and change > 0.3 * last):
            return True, noise, size
        if sweep > 0 and change * change / last < 1e-16:  # the next change, by the contraction seen
            return True, noise, size
        if sweep > 1 and change > 0.5 * last and change > 1e-9:
            return False, noise, size
        last = change
    return False, noise, size


@inlined_kernel
def variational(n: int, columns: Integers, px: Array, pv: Array, h: float, w: Work) -> None:
    """Right-hand side of the variational equations: w.E = G dx + K dv (+ F for a parameter column)."""
    G, K, DX, DV, E = w.G, w.K, w.DX, w.DV, w.E
    for c in range(6 + columns.shape[0]):
        k, o = 3 * c, 24 * c
        x0, x1, x2, v0, v1, v2 = px[k], px[k + 1], px[k + 2], pv[k], pv[k + 1], pv[k + 2]
        for i in range(n):
            s = h * NODES[i]
            a0, a1, a2 = DX[o + i] + x0 + s * v0, DX[o + 8 + i] + x1 + s * v1, DX[o + 16 + i] + x2 + s * v2
            b0, b1, b2 = DV[o + i] + v0, DV[o + 8 + i] + v1, DV[o + 16 + i] + v2
            E[o + i] = G[i] * a0 + G[8 + i] * a1 + G[16 + i] * a2 + K[i] * b0 + K[8 + i] * b1 + K[16 + i] * b2
            E[o + 8 + i] = (
                G[24 + i] * a0 + G[32 + i] * a1 + G[40 + i] * a2 + K[24 + i] * b0 + K[32 + i] * b1 + K[40 + i] * b2
            )
            E[o + 16 + i] = (
                G[48 + i] * a0 + G[56 + i] * a1 + G[64 + i] * a2 + K[48 + i] * b0 + K[56 + i] * b1 + K[64 + i] * b2
            )
        if c >= 6:
            f = 24 * columns[c - 6]
            for i in range(24):
                E[o + i] += w.F[f + i]


@inlined_kernel
def solve_variations(n: int, w: Work, columns: Integers, px: Array, pv: Array, h: float) -> None:
    """Iterate the accelerations w.D of all variation columns to round-off; the Jacobians are those of the state."""
    count = 6 + columns.shape[0]
    weigh(n, w.extrapolation, w.D_before, 3 * count, 1.0, w.D)
    for i in range(24 * count):
        w.D[i] += w.D_known[i]
    last = 1e300
    for sweep in range(14):
        weigh(n, AA_FLAT, w.D, 3 * count, h * h, w.DX)
        weigh(n, A_FLAT, w.D, 3 * count, h, w.DV)
        variational(n, columns, px, pv, h, w)
        worst = 0.0
        for c in range(count):
            change, size = 0.0, 1e-300
            for r in range(24 * c, 24 * c + 24, 8):
                change = max(change, abs(w.E[r] - w.D[r]), abs(w.E[r + 7] - w.D[r + 7]))
                size = max(size, abs(w.E[r]), abs(w.E[r + 7]))
            worst = max(worst, change / size)
        for i in range(24 * count):
            w.D[i] = w.E[i]
        if worst < 1e-14 or (sweep > 0 and worst * worst / last < 1e-14):  # the next change, by the contraction seen
            return
        last = worst


@kernel
def add_compensated(x: Array, lost: Array, k: int, term: float) -> None:
    """x[k] += term, with the rounding error kept in lost[k] (Kahan)."""
    y = term + lost[k]
    z = x[k] + y
    lost[k] = y - (z - x[k])
    x[k] = z


@inlined_kernel
def advance(n: int, w: Work, x: Array, v: Array, lost_x: Array, lost_v: Array, h: float) -> None:
    """Move the state to the end of the step."""
    for k in range(3):
        s, q = 0.0, 0.0
        for i in range(8):
            s += POSITION_WEIGHTS[i] * w.A[8 * k + i]
            q += WEIGHTS[i] * w.A[8 * k + i]
        add_compensated(x, lost_x, k, h * v[k] + h * h * s + h * lost_v[k])
        add_compensated(v, lost_v, k, h * q)
    for i in range(3 * n):
        w.before[i] = w.A[i] - w.known[i]


@inlined_kernel
def advance_variations(w: Work, px: Array, pv: Array, h: float) -> None:
    """Move the variations to the end of the step."""
    for r in range(px.shape[0]):
        s, q = 0.0, 0.0
        for i in range(8):
            s += POSITION_WEIGHTS[i] * w.D[8 * r + i]
            q += WEIGHTS[i] * w.D[8 * r + i]
        px[r] += h * pv[r] + h * h * s
        pv[r] += h * q
    for i in range(w.D.shape[0]):
        w.D_before[i] = w.D[i] - w.D_known[i]


@kernel
def last_coefficient(A: Array) -> float:
    """Largest component of the degree 7 Legendre coefficient of the acceleration."""
    largest = 0.0
    for k in range(0, 24, 8):
        s = 0.0
        for i in range(8):
            s += LAST_ROW[i] * A[k + i]
        largest = max(largest, abs(s))
    return largest


@inlined_kernel
def first_step(w: Work, p: Physics, x: Array, tolerance: float) -> float:
    """A quarter of the shortest free-fall time to any body, w.P being the bodies at the start."""
    shortest = 1e300
    for b in range(p.gm.shape[0]):
        r2 = (x[0] - w.P[b, 0]) ** 2 + (x[1] - w.P[b, 8]) ** 2 + (x[2] - w.P[b, 16]) ** 2
        shortest = min(shortest, np.sqrt(r2 * np.sqrt(r2) / p.gm[b]))
    return float(min(LARGEST_STEP_S, 0.25 * shortest * (tolerance / 1e-11) ** (1.0 / 7.0)))


@kernel
def next_step(h: float, error: float, limit: float) -> float:
    """The length after an accepted step: the error goes with the seventh power."""
    growth = 2.0 if error == 0.0 else 0.9 * (limit / error) ** (1.0 / 7.0)
    return float(np.copysign(min(LARGEST_STEP_S, abs(h) * min(2.0, max(0.3, growth))), h))


@inlined_kernel
def store(n: int, s: Steps, k: int, t: float, h: float, x: Array, v: Array, px: Array, pv: Array, w: Work) -> None:
    """Write step k."""
    s.start[k], s.length[k], s.tide[k] = t, h, largest(w.tide)
    for i in range(3):
        s.state[k, i], s.state[k, 3 + i] = x[i], v[i]
    for i in range(3 * n):
        s.acceleration[k, i] = w.A[i]
    rows = px.shape[0]
    for i in range(rows):
        s.variation[k, i], s.variation[k, rows + i] = px[i], pv[i]
    for i in range(w.D.shape[0]):
        s.variation_acceleration[k, i] = w.D[i]


@kernel
def begin(starts: Array, px: Array, pv: Array) -> Array:
    """What is known of each orbit, shape (k, 36): its start, no rounding lost, no accelerations; Phi = I, zeta = 0."""
    orbits = np.zeros((starts.shape[0], 36))
    for o in range(starts.shape[0]):
        for i in range(6):
            orbits[o, i] = starts[o, i]
    for i in range(min(3, px.shape[0])):
        px[4 * i], pv[9 + 4 * i] = 1.0, 1.0
    return orbits


@inlined_kernel
def take_up(n: int, w: Work, orbit: Array, strength: Array, x: Array, v: Array, lost_x: Array, lost_v: Array) -> None:
    """Put what is known of one orbit, a row of `orbits`, where a step works."""
    for i in range(4):
        w.strength[i] = strength[i]
    for i in range(3):
        x[i], v[i], lost_x[i], lost_v[i] = orbit[i], orbit[3 + i], orbit[6 + i], orbit[9 + i]
    for i in range(3 * n):
        w.before[i] = orbit[12 + i]


@inlined_kernel
def put_down(n: int, w: Work, orbit: Array, x: Array, v: Array, lost_x: Array, lost_v: Array) -> None:
    """The other way round, after the step."""
    for i in range(3):
        orbit[i], orbit[3 + i], orbit[6 + i], orbit[9 + i] = x[i], v[i], lost_x[i], lost_v[i]
    for i in range(3 * n):
        orbit[12 + i] = w.before[i]


@inlined_kernel
def sample(o: int, taken: int, first: int, w: Work, x: Array, v: Array, samples: Samples) -> int:
    """States of orbit o at the times, from the first, that lie in the step in hand; returns the first that does not."""
    if samples.tide.shape[0] == 0:
        return first
    while first < samples.chosen.shape[0] and samples.step[samples.chosen[first]] == taken:
        e = samples.chosen[first]
        for i in range(3):
            q, r = 0.0, 0.0
            for l in range(8):
                q += samples.weights[e, l] * w.A[8 * i + l]
                r += samples.weights[e, 8 + l] * w.A[8 * i + l]
            samples.states[o, e, i] = x[i] + (samples.weights[e, 16] * v[i] + r) - samples.sun[e, i]
            samples.states[o, e, 3 + i] = v[i] + q - samples.sun[e, 3 + i]
        first += 1
    samples.tide[o] = max(samples.tide[o], largest(w.tide))
    return first


@kernel
def integrate(
    n: int, starts: Array, strengths: Array, end_s: float, coefficients: Array, layout: Integers, timing: Array,
    p: Physics, columns: Integers, variations: bool, tolerance: float, guide: Steps, nodes: Array, samples: Samples,
) -> tuple[int, Steps]:  # fmt: skip
    """Integrate one orbit, or many on the grid of a guide, from t = 0 to end_s (either sign).

    Parameters
    ----------
    n : number of lanes, 8. A run-time number on purpose: a constant is unrolled before it can be vectorised.
    starts : shape (k, 6), barycentric position and velocity at t = 0, km, km/s.
    strengths : shape (k, 4), of radiation pressure, A1, A2 and A3, as in `Physics.strength`.
    end_s : TDB seconds after the epoch.
    coefficients, layout, timing : the ephemeris window.
    p : the forces.
    columns, variations : which of kappa, A1, A2, A3 (q,) are integrated; whether they and Phi are at all.
    tolerance : limit of the last Legendre coefficient of the acceleration, relative.
    guide, nodes : steps of a near orbit over the same span and the ephemeris at their nodes: the orbits take the same
        steps, and iterate their difference from the guide; no steps if there is none.
    samples : where to evaluate many orbits, which needs a guide and brings no steps and no variations; empty for one
        orbit, of which the steps are wanted.

    Returns a status (OK, STALLED, TOO_MANY_STEPS, or OFF_GRID if the guide's steps do not suit) and the accepted steps.
    """
    count, sampled = 6 + columns.shape[0] if variations else 0, samples.tide.shape[0] > 0
    w, guided = make_work(layout.shape[0], count), guide.start.shape[0] > 0
    steps = make_steps(1 if sampled else max(64, guide.start.shape[0]), count)
    x, v, lost_x, lost_v = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    px, pv = np.zeros(3 * count), np.zeros(3 * count)
    orbits = begin(starts, px, pv)
    taken, shown, following, sign, status = 0, 0, 0, 1.0 if end_s > 0.0 else -1.0, OK
    t, h, h_before, converged, error, limit = 0.0, 0.0, 0.0, True, 0.0, 0.0
    if not guided:
        read_ephemeris(n, 0.0, 0.0, w, p, coefficients, layout, timing)
        h = sign * first_step(w, p, starts[0], tolerance)
    while sign * (end_s - t) > 0.0:
        if guided:
            h = follow_guide(n, w, p, guide, nodes, taken)
            t_next = end_s if taken == guide.start.shape[0] - 1 else t + h
        else:
            ends = sign * (t + h - end_s) >= -1e-9 * abs(h)
            t_next = end_s if ends else t + h
            h = t_next - t
            if abs(h) < SMALLEST_STEP_S and not ends:
                status = STALLED
                break
            read_ephemeris(n, t, h, w, p, coefficients, layout, timing)
        extrapolation(h, h_before, w.extrapolation)
        for o in range(starts.shape[0]):  # orbits inside steps: the bodies of a step are fetched once for all
            if sampled and samples.tide[o] == np.inf:
                continue
            take_up(n, w, orbits[o], strengths[o], x, v, lost_x, lost_v)
            converged, noise, size = solve_state(n, w, p, x, v, h)
            error, limit = last_coefficient(w.A) / size, max(tolerance, noise)
            if not converged or error > 20.0 * limit:
                if sampled:
                    samples.tide[o] = np.inf
                continue
            if variations:
                expanded_jacobian(n, w, p)
                solve_variations(n, w, columns, px, pv, h)
            following = sample(o, taken, shown, w, x, v, samples)
            if not sampled:
                if taken == steps.start.shape[0]:
                    steps = resized(steps, taken, 2 * taken, count)
                store(n, steps, taken, t, h, x, v, px, pv, w)
            advance(n, w, x, v, lost_x, lost_v, h)
            advance_variations(w, px, pv, h)
            put_down(n, w, orbits[o], x, v, lost_x, lost_v)
        shown = following
        if not sampled and (not converged or error > 20.0 * limit):
            if guided:
                status = OFF_GRID
                break
            h *= max(0.2, 0.9 * (limit / error) ** (1.0 / 7.0)) if converged else 0.4
            h_before = h_before if converged else 0.0
            continue
        t, h_before, taken = t_next, h, taken + 1
        if taken >= MOST_STEPS:
            status = TOO_MANY_STEPS
            break
        h = next_step(h, error, limit)
    taken = 0 if sampled else taken
    return status, resized(steps, taken, taken, count)


def is_compiled_cache_present() -> bool:
    """Whether `integrate` will start at once; if not, its first call compiles for some 25 s (a program may say so)."""
    return is_compiled(integrate)
