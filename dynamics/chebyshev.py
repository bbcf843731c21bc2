"""Chebyshev evaluation of a `Window` at the nodes of a step: positions of all bodies, velocities of some.

Rows of P are bodies in the order of the window: 0 Sun, 3 Earth, 4 Moon, then the rest; each row holds 8 lanes of x, y
and z. Plain scalar loops: the processor overlaps the independent nodes by itself (interleaving four nodes by hand, as
a first version did, gained nothing). `states_of_series` serves the ephemeris itself, at any number of times.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, exact_kernel, kernel
from nebosvod.dynamics.constants import DAY_S

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
SUN, EARTH, MOON, FIRST_ASTEROID = 0, 3, 4, 11


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
    """Barycentric positions P (bodies, 24) in km at the n times t (seconds after the epoch)."""
    for b in range(layout.shape[0]):
        series_at(n, t, coefficients, layout, timing, b, P)
    _assemble(mass_ratio, P)


@kernel
def _assemble(mass_ratio: float, P: Array) -> None:
    """Earth and Moon from their barycentre and the geocentric Moon's share; asteroids from the Sun."""
    share = 1.0 / mass_ratio
    for i in range(3 * LANES):
        barycentre, moon = P[EARTH, i], P[MOON, i]
        P[EARTH, i] = barycentre - share * moon
        P[MOON, i] = barycentre + moon
    for b in range(FIRST_ASTEROID, P.shape[0]):
        for i in range(3 * LANES):
            P[b, i] += P[SUN, i]


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
