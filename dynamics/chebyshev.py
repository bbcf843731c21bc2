"""Chebyshev evaluation of a `Window` at the nodes of a step: positions of all bodies, velocities of some.

Rows of P are bodies in the order of the window: 0 Sun, 3 Earth, 4 Moon, then the rest; each row holds 8 lanes of x, y
and z. Plain scalar loops: the processor overlaps the independent nodes by itself (interleaving four nodes by hand, as
a first version did, gained nothing).
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, kernel

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
