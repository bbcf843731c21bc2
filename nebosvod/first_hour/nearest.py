"""How near to the Earth orbits come that the Sun alone moves: conics at every look, straight from one to the next."""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.twobody_many import coefficients_from, first_guess
from nebosvod.first_hour.tracklet import Tracklet

Array = npt.NDArray[np.float64]
LOOK_S = 0.5 * DAY_S


def nearest_by_the_sun(tracklet: Tracklet, states: Array, within_d: float) -> Array:
    """The least distance (m,) from the Earth, km, of heliocentric states (m, 6); 0 where it cannot be told."""
    t_s = np.append(np.arange(0.0, within_d * DAY_S, LOOK_S), within_d * DAY_S)
    ephemeris = tracklet.forces.ephemeris
    earth = ephemeris.state_km_km_s("earth", tracklet.epoch, t_s) - ephemeris.state_km_km_s("sun", tracklet.epoch, t_s)
    least2 = np.empty(len(states))
    fill_least(np.ascontiguousarray(states), earth, t_s, ephemeris.gm_km3_s2["sun"], least2)
    return np.where(np.isfinite(least2), np.sqrt(np.maximum(least2, 0.0)), 0.0)


@kernel
def fill_least(states: Array, earth: Array, t_s: Array, gm: float, least2: Array) -> None:
    """Fill squares of least distances (m,); infinite or nan of who cannot be followed.

    Parameters
    ----------
    states : (m, 6). earth : (n, 6) at times (n,) from 0 on.
    """
    for o in range(states.shape[0]):
        x, y, z, vx, vy, vz = states[o, 0], states[o, 1], states[o, 2], states[o, 3], states[o, 4], states[o, 5]
        r0, sigma = math.sqrt(x * x + y * y + z * z), x * vx + y * vy + z * vz
        beta = 2.0 * gm / r0 - (vx * vx + vy * vy + vz * vz)
        period = 2.0 * math.pi * gm / (beta * math.sqrt(beta)) if beta > 0.0 else math.inf
        least, s = math.inf, 0.0
        for e in range(t_s.shape[0]):
            # from where the last look stood, unless a revolution has been taken off since
            begun = s if e > 0 and t_s[e] < 0.45 * period else first_guess(t_s[e], r0, beta, gm)
            s, f, g, f_dot, g_dot = coefficients_from(begun, t_s[e], r0, sigma, beta, gm)
            rx, ry, rz = f * x + g * vx - earth[e, 0], f * y + g * vy - earth[e, 1], f * z + g * vz - earth[e, 2]
            wx, wy, wz = f_dot * x + g_dot * vx, f_dot * y + g_dot * vy, f_dot * z + g_dot * vz
            r = math.sqrt((rx + earth[e, 0]) ** 2 + (ry + earth[e, 1]) ** 2 + (rz + earth[e, 2]) ** 2)
            wx, wy, wz = wx - earth[e, 3], wy - earth[e, 4], wz - earth[e, 5]
            rr, rv, vv = rx * rx + ry * ry + rz * rz, rx * wx + ry * wy + rz * wz, wx * wx + wy * wy + wz * wz
            if not rr < math.inf:
                least = math.nan
                break
            step = min(max(-rv / vv, -LOOK_S), LOOK_S)
            least = min(least, rr + step * (2.0 * rv + step * vv))
            if e + 1 < t_s.shape[0]:
                s += (t_s[e + 1] - t_s[e]) / r  # d s / d t = 1 / r
        least2[o] = least
