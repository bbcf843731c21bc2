"""Compiled loops over orbits and directions of the search for a first orbit: displacements, residuals, partials.

Each reads and fills arrays that its caller made, C-contiguous and writable; nothing is allocated. Units au, days, rad.
"""

import math

import numpy as np

from nebosvod.dynamics.compilation import inlined_kernel, kernel
from nebosvod.dynamics.twobody_many import coefficients_from, first_guess
from nebosvod.observation.contracts import Array
from nebosvod.observation.initial.gauss import SPEED_OF_LIGHT_AU_D

CLOSEST_AU = 5e-5  # to a perturber: nearer, its pull grows no more
LIGHT_TIMES = 3


@kernel
def fill_displacements(
    gm: float, times: Array, home: float, pullers: Array, pulls: Array, rounds: int,
    states: Array, path: Array, pull: Array, dr: Array, dv: Array,
) -> None:  # fmt: skip
    """Fill dr and dv (k, n, 3) with what perturbers add to orbits (k, 6) at evenly spaced times (n,) from theirs.

    `home` is the place of the orbits' own time among the times, in steps; `pullers` (n, b, 3) are positions and
    `pulls` (b,) their GM; path and pull (1, n, 3) are room to work in. Integrated twice, `rounds` times (Picard).
    """
    step = times[1] - times[0]
    for k in range(states.shape[0]):
        r0, sigma, beta = _invariants(gm, states, k)
        for e in range(times.shape[0]):
            _, f, g, _, _ = coefficients_from(first_guess(times[e], r0, beta, gm), times[e], r0, sigma, beta, gm)
            for i in range(3):
                path[0, e, i] = f * states[k, i] + g * states[k, 3 + i]
                dr[k, e, i] = 0.0
        for _ in range(rounds):
            for e in range(times.shape[0]):
                _pull(e, pullers, pulls, path, k, dr, pull)
            _integrate(step, home, 0, pull, k, dv)
            _integrate(step, home, k, dv, k, dr)


@inlined_kernel
def _invariants(gm: float, states: Array, k: int) -> tuple[float, float, float]:
    """Distance, r.v and 2 gm / r - v.v of an orbit."""
    x, y, z, vx, vy, vz = states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4], states[k, 5]
    r0 = math.sqrt(x * x + y * y + z * z)
    return r0, x * vx + y * vy + z * vz, 2.0 * gm / r0 - (vx * vx + vy * vy + vz * vz)


@inlined_kernel
def _pull(e: int, pullers: Array, pulls: Array, path: Array, k: int, dr: Array, pull: Array) -> None:
    """Acceleration about the Sun by the perturbers, on the displaced orbit at one time."""
    ax = ay = az = 0.0
    for b in range(pulls.shape[0]):
        px, py, pz = pullers[e, b, 0], pullers[e, b, 1], pullers[e, b, 2]
        x, y, z = px - path[0, e, 0] - dr[k, e, 0], py - path[0, e, 1] - dr[k, e, 1], pz - path[0, e, 2] - dr[k, e, 2]
        gap, far = max(math.sqrt(x * x + y * y + z * z), CLOSEST_AU), math.sqrt(px * px + py * py + pz * pz)
        direct, indirect = 1.0 / (gap * gap * gap), 1.0 / (far * far * far)
        ax += pulls[b] * (x * direct - px * indirect)
        ay += pulls[b] * (y * direct - py * indirect)
        az += pulls[b] * (z * direct - pz * indirect)
    pull[0, e, 0], pull[0, e, 1], pull[0, e, 2] = ax, ay, az


@inlined_kernel
def _integrate(step: float, home: float, source: int, values: Array, target: int, total: Array) -> None:
    """Integral of values[source] (n, 3) from `home` into total[target]: trapezium corrected by the end slopes."""
    n = values.shape[1]
    low = int(home)
    part = home - low
    for i in range(3):
        total[target, 0, i], sum_ = 0.0, 0.0
        slope = values[source, 1, i] - values[source, 0, i]
        for e in range(1, n):
            new = values[source, e, i] - values[source, e - 1, i]
            if e < n - 1:
                new = 0.5 * (values[source, e + 1, i] - values[source, e - 1, i])
            sum_ += step * (0.5 * (values[source, e, i] + values[source, e - 1, i]) + (slope - new) / 12.0)
            total[target, e, i], slope = sum_, new
        start = (1.0 - part) * total[target, low, i] + part * total[target, low + 1, i]
        for e in range(n):
            total[target, e, i] -= start


@kernel
def fill_shifts(t: Array, nodes: Array, dr: Array, dv: Array, shift: Array) -> None:
    """Fill shift (k, m, 3) at times (m,) from values and rates (k, n, 3) at the nodes, by cubics of Hermite."""
    step = nodes[1] - nodes[0]
    for e in range(t.shape[0]):
        low = min(max(int((t[e] - nodes[0]) / step), 0), nodes.shape[0] - 2)
        s = (t[e] - nodes[low]) / step
        h00, h10 = (1.0 + 2.0 * s) * (1.0 - s) ** 2, s * (1.0 - s) ** 2 * step
        h01, h11 = s * s * (3.0 - 2.0 * s), s * s * (s - 1.0) * step
        for k in range(dr.shape[0]):
            for i in range(3):
                left = h00 * dr[k, low, i] + h10 * dv[k, low, i]
                shift[k, e, i] = left + h01 * dr[k, low + 1, i] + h11 * dv[k, low + 1, i]


@kernel
def fill_residuals(
    gm: float, t: Array, q: Array, u: Array, east: Array, north: Array, sigma: Array,
    states: Array, shift: Array, v: Array,
) -> None:  # fmt: skip
    """Fill v (k, 2 m), observed minus computed in sigmas, of orbits (k, 6) a time t (m,) on, displaced by shift."""
    for k in range(states.shape[0]):
        r0, rv, beta = _invariants(gm, states, k)
        for e in range(t.shape[0]):
            _, f, g, fd, gd = coefficients_from(first_guess(t[e], r0, beta, gm), t[e], r0, rv, beta, gm)
            a, b = _residual(k, e, f, g, fd, gd, states, k, shift, q, u, east, north)
            v[k, 2 * e], v[k, 2 * e + 1] = a / sigma[e, 0], b / sigma[e, 1]


@kernel
def fill_partials(
    gm: float, t: Array, q: Array, u: Array, east: Array, north: Array, sigma: Array,
    states: Array, shift: Array, v: Array, stepped: Array, width: float, J: Array,
) -> None:  # fmt: skip
    """Fill J (k, 2 m, p) with (v - v') / width, v' the residuals of the stepped orbits (k p, 6).

    An orbit hardly moved has hardly another fictitious time: the search for it begins at that of the orbit itself.
    """
    parameters = J.shape[2]
    for k in range(states.shape[0]):
        r0, rv, beta = _invariants(gm, states, k)
        for e in range(t.shape[0]):
            s, _, _, _, _ = coefficients_from(first_guess(t[e], r0, beta, gm), t[e], r0, rv, beta, gm)
            for j in range(parameters):
                n = k * parameters + j
                moved_r0, moved_rv, moved_beta = _invariants(gm, stepped, n)
                _, f, g, fd, gd = coefficients_from(s, t[e], moved_r0, moved_rv, moved_beta, gm)
                a, b = _residual(n, e, f, g, fd, gd, stepped, k, shift, q, u, east, north)
                J[k, 2 * e, j] = (v[k, 2 * e] - a / sigma[e, 0]) / width
                J[k, 2 * e + 1, j] = (v[k, 2 * e + 1] - b / sigma[e, 1]) / width


@inlined_kernel
def _residual(
    n: int, e: int, f: float, g: float, fd: float, gd: float, states: Array,
    k: int, shift: Array, q: Array, u: Array, east: Array, north: Array,
) -> tuple[float, float]:  # fmt: skip
    """Observed minus computed angle, rad, east and north, of orbit n displaced by shift[k] at row e."""
    vx = fd * states[n, 0] + gd * states[n, 3]
    vy = fd * states[n, 1] + gd * states[n, 4]
    vz = fd * states[n, 2] + gd * states[n, 5]
    px = f * states[n, 0] + g * states[n, 3] + shift[k, e, 0] - q[e, 0]
    py = f * states[n, 1] + g * states[n, 4] + shift[k, e, 1] - q[e, 1]
    pz = f * states[n, 2] + g * states[n, 5] + shift[k, e, 2] - q[e, 2]
    x, y, z, distance, light = px, py, pz, 0.0, 0.0
    for _ in range(LIGHT_TIMES):
        # straight back along the orbit, with a Sun at rest: 0.01 arcsec at most
        x, y, z = px - vx * light, py - vy * light, pz - vz * light
        distance = math.sqrt(x * x + y * y + z * z)
        light = distance / SPEED_OF_LIGHT_AU_D
    x, y, z = x / distance, y / distance, z / distance
    a = x * east[e, 0] + y * east[e, 1] + z * east[e, 2]
    b = x * north[e, 0] + y * north[e, 1] + z * north[e, 2]
    # the chord's share in the tangent plane, stretched to the whole angle so that a direction far off counts as far
    chord = math.sqrt(a * a + b * b)
    stretch = 1.0
    if chord > 1e-12:
        stretch = np.arctan2(chord, x * u[e, 0] + y * u[e, 1] + z * u[e, 2]) / chord
    return -a * stretch, -b * stretch
