"""Chebyshev evaluation of a `Window` at the nodes of a step: positions of all bodies, velocities of some.

Rows of P are bodies in the order of the window: 0 Sun, 3 Earth, 4 Moon, then the rest; each row holds 8 lanes of x, y
and z. `states_of_series` serves the ephemeris itself, at any number of times.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, exact_kernel, kernel
from nebosvod.dynamics.constants import DAY_S

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
SUN, EARTH, MOON, FIRST_ASTEROID = 0, 3, 4, 11
MOST_RECORDS = 8  # a step over more records than this (main belt, the Moon's 4 days) is summed node by node


@kernel
def series_at(n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, b: int, P: Array) -> None:
    """Position of series b, relative to its own centre, into row b of P (bodies, 24), km."""
    offset, order, records = layout[b, 0], layout[b, 1], layout[b, 2]
    start, per_record = timing[b, 0], 1.0 / timing[b, 1]
    for l in range(n):
        place = (t[l] - start) * per_record
        record = max(0, min(int(place), records - 1))
        u = 2.0 * (place - record) - 1.0
        k = np.uint64(offset + record * 3 * order)
        x, y, z = coefficients[k], coefficients[k + np.uint64(1)], coefficients[k + np.uint64(2)]
        before, now = 1.0, u
        for _ in range(1, order):
            k += np.uint64(3)
            x += now * coefficients[k]
            y += now * coefficients[k + np.uint64(1)]
            z += now * coefficients[k + np.uint64(2)]
            before, now = now, 2.0 * u * now - before
        P[b, l], P[b, LANES + l], P[b, 2 * LANES + l] = x, y, z


@kernel
def bodies_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, mass_ratio: float, P: Array
) -> None:
    """Barycentric positions P (bodies, 24) in km at the n times t (seconds after the epoch).

    Bodies whose records have the same edges share one table of Chebyshev polynomials; a sum over it runs in all lanes
    at once, for each record that the times touch. Measured for 27 bodies at the nodes of a step: 3.1 us body by body
    and node by node, 0.7 us so.
    """
    T, M, u, record = np.empty(128), np.empty(128), np.empty(8), np.empty(8, np.int64)
    first, bodies = 0, layout.shape[0]
    while first < bodies:
        end, order = first + 1, layout[first, 1]
        while (
            end < bodies
            and layout[end, 2] == layout[first, 2]
            and timing[end, 0] == timing[first, 0]
            and timing[end, 1] == timing[first, 1]
        ):
            order = max(order, layout[end, 1])
            end += 1
        low, high = _place(n, t, timing[first, 0], timing[first, 1], layout[first, 2], u, record)
        if high - low > MOST_RECORDS or order > 16:
            for b in range(first, end):
                series_at(n, t, coefficients, layout, timing, b, P)
                if b >= FIRST_ASTEROID:
                    for i in range(24):
                        P[b, i] += P[SUN, i]
        else:
            _tabulate(n, u, order, T)
            for b in range(first, end):
                for i in range(24):
                    P[b, i] = P[SUN, i] if b >= FIRST_ASTEROID else 0.0  # asteroids are relative to the Sun
            for r in range(low, high + 1):
                if low < high:
                    _mask(n, T, record, r, order, M)
                for b in range(first, end):
                    start = layout[b, 0] + r * 3 * layout[b, 1]
                    _add_record(n, T if low == high else M, coefficients, start, layout[b, 1], P[b])
        first = end
    _assemble(mass_ratio, P)


@kernel
def _place(n: int, t: Array, start: float, length: float, records: int, u: Array, record: Integers) -> tuple[int, int]:
    """Record of each time and place u in [-1, 1] inside it; returns the first and the last record."""
    per_record, low, high = 1.0 / length, records, 0
    for l in range(n):
        place = (t[l] - start) * per_record
        record[l] = max(0, min(int(place), records - 1))
        u[l] = 2.0 * (place - record[l]) - 1.0
        low, high = min(low, record[l]), max(high, record[l])
    return low, high


@kernel
def _tabulate(n: int, u: Array, order: int, T: Array) -> None:
    """T[8 j + l] = T_j(u_l) for j < order."""
    for l in range(n):
        T[l], T[8 + l] = 1.0, u[l]
    j = np.uint64(0)
    for _ in range(2, order):
        for l in range(n):
            q = j + np.uint64(l)
            T[q + np.uint64(16)] = 2.0 * u[l] * T[q + np.uint64(8)] - T[q]
        j += np.uint64(8)


@kernel
def _mask(n: int, T: Array, record: Integers, r: int, order: int, M: Array) -> None:
    """The table with zeros in the lanes that lie in other records than r."""
    j = np.uint64(0)
    for _ in range(order):
        for l in range(n):
            q = j + np.uint64(l)
            M[q] = T[q] if record[l] == r else 0.0
        j += np.uint64(8)


@kernel
def _add_record(n: int, T: Array, coefficients: Array, start: int, order: int, row: Array) -> None:
    """Add the sums of one record to row (24,); orders are padded to a multiple of four by the window."""
    # Unsigned indices: one that could be negative keeps the lanes from being vectorised (65 ns a body instead of 20)
    k, j = np.uint64(start), np.uint64(0)
    for _ in range(order // 4):
        x0, y0, z0 = coefficients[k], coefficients[k + np.uint64(1)], coefficients[k + np.uint64(2)]
        x1, y1, z1 = coefficients[k + np.uint64(3)], coefficients[k + np.uint64(4)], coefficients[k + np.uint64(5)]
        x2, y2, z2 = coefficients[k + np.uint64(6)], coefficients[k + np.uint64(7)], coefficients[k + np.uint64(8)]
        x3, y3, z3 = coefficients[k + np.uint64(9)], coefficients[k + np.uint64(10)], coefficients[k + np.uint64(11)]
        for l in range(n):
            q = j + np.uint64(l)
            t0, t1, t2, t3 = T[q], T[q + np.uint64(8)], T[q + np.uint64(16)], T[q + np.uint64(24)]
            row[l] += (x3 * t3 + x2 * t2) + (x1 * t1 + x0 * t0)
            row[8 + l] += (y3 * t3 + y2 * t2) + (y1 * t1 + y0 * t0)
            row[16 + l] += (z3 * t3 + z2 * t2) + (z1 * t1 + z0 * t0)
        k += np.uint64(12)
        j += np.uint64(32)


@kernel
def _assemble(mass_ratio: float, P: Array) -> None:
    """Earth and Moon from their barycentre and the geocentric Moon's share."""
    share = 1.0 / mass_ratio
    for i in range(3 * LANES):
        barycentre, moon = P[EARTH, i], P[MOON, i]
        P[EARTH, i] = barycentre - share * moon
        P[MOON, i] = barycentre + moon


@kernel
def major_velocities_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, mass_ratio: float, W: Array
) -> None:
    """Barycentric velocities W (11, 24) of Sun, planets, Moon and Pluto in km/s at the n times t."""
    for b in range(FIRST_ASTEROID):
        velocity_at(n, t, coefficients, layout, timing, b, W[b])
    _assemble(mass_ratio, W)


@kernel
def velocity_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, b: int, velocity: Array
) -> None:
    """Velocity (24,) of series b in km/s at the n times t: the derivative sum of k c_k U_(k-1)."""
    offset, order, records = layout[b, 0], layout[b, 1], layout[b, 2]
    start, per_record = timing[b, 0], 1.0 / timing[b, 1]
    for l in range(n):
        place = (t[l] - start) * per_record
        record = max(0, min(int(place), records - 1))
        u = 2.0 * (place - record) - 1.0
        k = np.uint64(offset + record * 3 * order)
        x, y, z = 0.0, 0.0, 0.0
        before, now = 0.0, 1.0
        for j in range(1, order):
            k += np.uint64(3)
            slope = 2.0 * per_record * j * now
            x += slope * coefficients[k]
            y += slope * coefficients[k + np.uint64(1)]
            z += slope * coefficients[k + np.uint64(2)]
            before, now = now, 2.0 * u * now - before
        velocity[l], velocity[LANES + l], velocity[2 * LANES + l] = x, y, z


@exact_kernel
def states_of_series(
    t: Array, records: Array, first_day: float, record_days: float, fraction: float, states: Array
) -> None:
    """Position and velocity (n, 6) of one series at t (n,) seconds after an epoch `fraction` into its day, km, km/s.

    `records` (k, 2 + 3 orders) are those of the file. Operation by operation what `ephemeris.evaluate_series` does in
    numpy, so that an answer does not depend on whether the compiler is loaded.
    """
    order, count = (records.shape[1] - 2) // 3, records.shape[0]
    half_s = 0.5 * record_days * DAY_S
    for e in range(t.shape[0]):
        days = (t[e] / DAY_S + fraction - first_day) / record_days
        record = max(0, min(int(np.floor(days)), count - 1))
        u = (t[e] - (first_day + record * record_days - fraction) * DAY_S) / half_s - 1.0
        row = records[record]
        x, y, z = row[2] + u * row[3], row[2 + order] + u * row[3 + order], row[2 + 2 * order] + u * row[3 + 2 * order]
        vx, vy, vz = row[3], row[3 + order], row[3 + 2 * order]
        before, now, slope_before, slope = 1.0, u, 0.0, 1.0
        for j in range(4, 2 + order):
            slope_before, slope = slope, 2.0 * now + 2.0 * u * slope - slope_before
            before, now = now, 2.0 * u * now - before
            x, y, z = x + now * row[j], y + now * row[j + order], z + now * row[j + 2 * order]
            vx, vy, vz = vx + slope * row[j], vy + slope * row[j + order], vz + slope * row[j + 2 * order]
        states[e, 0], states[e, 1], states[e, 2] = x, y, z
        states[e, 3], states[e, 4], states[e, 5] = vx / half_s, vy / half_s, vz / half_s
