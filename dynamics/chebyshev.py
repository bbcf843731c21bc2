"""Chebyshev evaluation of a `Window` at the nodes of a step: positions of all bodies, velocities of some.

Rows of P are bodies in the order of the window: 0 Sun, 3 Earth, 4 Moon, then the rest; each row holds 8 lanes of x, y
and z. `states_of_series` serves the ephemeris itself, at any number of times.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, exact_kernel, inlined_kernel
from nebosvod.dynamics.constants import DAY_S, MOST_ORDERS

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
SUN, EARTH, MOON, FIRST_ASTEROID = 0, 3, 4, 11


@inlined_kernel
def bodies_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, mass_ratio: float,
    T: Array, u: Array, record: Array, P: Array,
) -> None:  # fmt: skip
    """Barycentric positions P (bodies, 24) in km at the n times t (seconds after the epoch), which are in order.

    Bodies whose records have the same edges share one table of Chebyshev polynomials; a sum over it runs in all lanes
    at once, for each record that the times touch. Measured for 27 bodies at the nodes of a step: 3.1 us body by body
    and node by node, 0.6 us so. T (8 * MOST_ORDERS,), u and record (8,) are scratch.
    """
    first, bodies = 0, layout.shape[0]
    while first < bodies:
        end = first + 1
        while (
            end < bodies
            and layout[end, 2] == layout[first, 2]
            and timing[end, 0] == timing[first, 0]
            and timing[end, 1] == timing[first, 1]
        ):
            end += 1
        _place(n, t, timing[first, 0], timing[first, 1], layout[first, 2], u, record)
        _tabulate(n, u, T)
        for b in range(first, end):
            _sum_series(n, T, coefficients, layout[b, 0], layout[b, 1], record, P[b])
        first = end
    _assemble(mass_ratio, P)


@inlined_kernel
def _place(n: int, t: Array, start: float, length: float, records: int, u: Array, record: Array) -> None:
    """Record of each time and place u in [-1, 1] inside it.

    The place is counted from the record's own beginning, which is exact: from that of the first one, times would be
    rounded by how far away it is, and an orbit near a body would see it shake by what another call has asked for.
    """
    per_record = 1.0 / length
    for l in range(n):
        record[l] = max(0.0, min(np.floor((t[l] - start) * per_record), records - 1.0))
        u[l] = 2.0 * (t[l] - (start + record[l] * length)) * per_record - 1.0


@inlined_kernel
def _tabulate(n: int, u: Array, T: Array) -> None:
    """T[8 j + l] = T_j(u_l) for j < MOST_ORDERS, from T_j = 2 T_a T_b - T_(b-a), a + b = j: a chain of log j, not of j.

    The constant range is unrolled and stays in registers: 20 ns, and 110 ns as a loop up to the order.
    """
    for l in range(n):
        q = np.uint64(l)
        T[q], T[q + np.uint64(8)] = 1.0, u[l]
        for j in range(2, MOST_ORDERS):
            a, b = j // 2, j - j // 2
            T[np.uint64(8 * j) + q] = (
                2.0 * T[np.uint64(8 * a) + q] * T[np.uint64(8 * b) + q] - T[np.uint64(8 * (b - a)) + q]
            )


@inlined_kernel
def _tabulate_slopes(n: int, u: Array, scale: float, T: Array) -> None:
    """T[8 j + l] = scale T_j'(u_l) = scale j U_(j-1)(u_l) for j < MOST_ORDERS."""
    for l in range(n):
        q = np.uint64(l)
        before, now = 0.0, scale
        T[q] = 0.0
        for j in range(1, MOST_ORDERS):
            T[np.uint64(8 * j) + q] = j * now
            before, now = now, 2.0 * u[l] * now - before


@inlined_kernel
def _sum_series(n: int, T: Array, coefficients: Array, offset: int, orders: int, record: Array, out: Array) -> None:
    """Sums (24,) of one series in all lanes, record by record; orders are padded to a multiple of eight."""
    # Unsigned indices: one that could be negative keeps the lanes from being vectorised (65 ns a body instead of 20).
    # The constant range is unrolled, so that sums stay in registers; two of each halve the chain of additions.
    for l in range(n):
        out[l], out[8 + l], out[16 + l] = 0.0, 0.0, 0.0
    for first in range(n):
        if first > 0 and record[first] == record[first - 1]:
            continue  # the times are in order: lanes of one record are neighbours
        k, j = np.uint64(offset + int(record[first]) * 3 * orders), np.uint64(0)
        for _ in range(orders // 8):
            for l in range(n):
                x, y, z, p, q, s = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(0, 8, 2):
                    even, odd = T[j + np.uint64(8 * i) + np.uint64(l)], T[j + np.uint64(8 * i + 8) + np.uint64(l)]
                    at = k + np.uint64(3 * i)
                    x += coefficients[at] * even
                    y += coefficients[at + np.uint64(1)] * even
                    z += coefficients[at + np.uint64(2)] * even
                    p += coefficients[at + np.uint64(3)] * odd
                    q += coefficients[at + np.uint64(4)] * odd
                    s += coefficients[at + np.uint64(5)] * odd
                # Not a branch: a masked store stalls the load that follows it
                here = 1.0 if record[l] == record[first] else 0.0
                out[l] += here * (x + p)
                out[8 + l] += here * (y + q)
                out[16 + l] += here * (z + s)
            k += np.uint64(24)
            j += np.uint64(64)


@inlined_kernel
def _assemble(mass_ratio: float, P: Array) -> None:
    """Earth and Moon from their barycentre and the geocentric Moon's share; asteroids from the Sun, their centre."""
    share = 1.0 / mass_ratio
    for i in range(3 * LANES):
        barycentre, moon = P[EARTH, i], P[MOON, i]
        P[EARTH, i] = barycentre - share * moon
        P[MOON, i] = barycentre + moon
    for b in range(FIRST_ASTEROID, P.shape[0]):
        for i in range(3 * LANES):
            P[b, i] += P[SUN, i]


@inlined_kernel
def major_velocities_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, mass_ratio: float,
    T: Array, u: Array, record: Array, W: Array,
) -> None:  # fmt: skip
    """Barycentric velocities W (11, 24) of Sun, planets, Moon and Pluto in km/s at the n times t."""
    for b in range(FIRST_ASTEROID):
        velocity_at(n, t, coefficients, layout, timing, b, T, u, record, W[b])
    _assemble(mass_ratio, W[:FIRST_ASTEROID])


@inlined_kernel
def position_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, b: int,
    T: Array, u: Array, record: Array, position: Array,
) -> None:  # fmt: skip
    """Position (24,) of series b in km, relative to its own centre, at the n times t; scratch as in `bodies_at`."""
    _place(n, t, timing[b, 0], timing[b, 1], layout[b, 2], u, record)
    _tabulate(n, u, T)
    _sum_series(n, T, coefficients, layout[b, 0], layout[b, 1], record, position)


@inlined_kernel
def velocity_at(
    n: int, t: Array, coefficients: Array, layout: Integers, timing: Array, b: int,
    T: Array, u: Array, record: Array, velocity: Array,
) -> None:  # fmt: skip
    """Velocity (24,) of series b in km/s at the n times t; scratch as in `bodies_at`."""
    _place(n, t, timing[b, 0], timing[b, 1], layout[b, 2], u, record)
    _tabulate_slopes(n, u, 2.0 / timing[b, 1], T)
    _sum_series(n, T, coefficients, layout[b, 0], layout[b, 1], record, velocity)


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
