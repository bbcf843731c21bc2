"""From where light comes: compiled loops over orbits and measurements.

Vectors are written out by components: an axis of length 3 costs numpy more than what is done along it.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S

Array = npt.NDArray[np.float64]
LIGHT_TIMES = 4  # corrections; each gains a factor of v/c


@kernel
def fill_lines(
    flown: Array, sun: Array, sun_pull: Array, observer: Array, gm: float, late_s: Array, displaced: Array, line: Array,
    motion: Array,
) -> None:  # fmt: skip
    """Fill lines of sight and their motions (m, n, 3).

    Parameters
    ----------
    flown : (m, n, 6) heliocentric at reception. sun, observer : (n, 6) barycentric. sun_pull : (n, 3).
    late_s, displaced : (m, n) and (m, n, 3), or (0, 0) and (0, 0, 0): by how much each measurement was later than its
        record says, and its observer elsewhere.
    """
    for o in range(flown.shape[0]):
        for e in range(flown.shape[1]):
            x, y, z = flown[o, e, 0], flown[o, e, 1], flown[o, e, 2]
            r2 = x * x + y * y + z * z
            pull = -gm / (r2 * np.sqrt(r2))
            ax, ay, az = pull * x + sun_pull[e, 0], pull * y + sun_pull[e, 1], pull * z + sun_pull[e, 2]
            vx, vy, vz = flown[o, e, 3] + sun[e, 3], flown[o, e, 4] + sun[e, 4], flown[o, e, 5] + sun[e, 5]
            motion[o, e, 0], motion[o, e, 1] = vx - observer[e, 3], vy - observer[e, 4]
            motion[o, e, 2] = vz - observer[e, 5]
            x, y, z = x + sun[e, 0] - observer[e, 0], y + sun[e, 1] - observer[e, 1], z + sun[e, 2] - observer[e, 2]
            if late_s.shape[0] > 0:
                t = late_s[o, e]
                x += t * (vx + 0.5 * t * ax - observer[e, 3])
                y += t * (vy + 0.5 * t * ay - observer[e, 4])
                z += t * (vz + 0.5 * t * az - observer[e, 5])
            if displaced.shape[0] > 0:
                x, y, z = x - displaced[o, e, 0], y - displaced[o, e, 1], z - displaced[o, e, 2]
            lx, ly, lz = x, y, z
            for _ in range(LIGHT_TIMES):
                tau = np.sqrt(lx * lx + ly * ly + lz * lz) / SPEED_OF_LIGHT_KM_S
                lx = x - tau * (vx - 0.5 * tau * ax)
                ly = y - tau * (vy - 0.5 * tau * ay)
                lz = z - tau * (vz - 0.5 * tau * az)
            line[o, e, 0], line[o, e, 1], line[o, e, 2] = lx, ly, lz


@kernel
def fill_offsets(line: Array, axes: Array, distance: Array, offset: Array) -> None:
    """Fill lengths (m, n) of lines (m, n, 3), and their angles (m, n, 2) from the last of axes (n, 3, 3)."""
    for o in range(line.shape[0]):
        for e in range(line.shape[1]):
            x, y, z = line[o, e, 0], line[o, e, 1], line[o, e, 2]
            far = np.sqrt(x * x + y * y + z * z)
            east = (axes[e, 0, 0] * x + axes[e, 0, 1] * y + axes[e, 0, 2] * z) / far
            north = (axes[e, 1, 0] * x + axes[e, 1, 1] * y + axes[e, 1, 2] * z) / far
            deep = (axes[e, 2, 0] * x + axes[e, 2, 1] * y + axes[e, 2, 2] * z) / far
            chord = np.sqrt(east * east + north * north)
            stretch = np.arctan2(chord, deep) / chord if chord > 1e-12 else 1.0
            distance[o, e], offset[o, e, 0], offset[o, e, 1] = far, stretch * east, stretch * north
