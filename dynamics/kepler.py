"""Two-body motion by elements, for spacecraft whose orbit a mission states rather than integrates."""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel

Array = npt.NDArray[np.float64]


NEWTON_STEPS = 30


@kernel
def eccentric_anomaly(M: float, e: float) -> float:
    """Solve E - e sin E = M for elliptic motion, to round-off; E within [-pi, pi].

    Newton's method from M + e sin M, or from pi where e > 0.8, converges for every M and e < 1.
    """
    M = M - 2.0 * math.pi * math.floor((M + math.pi) / (2.0 * math.pi))
    E = M + e * math.sin(M)
    if e > 0.8:
        E = math.copysign(math.pi, M) if M != 0.0 else 0.0
    for _ in range(NEWTON_STEPS):
        step = (E - e * math.sin(E) - M) / (1.0 - e * math.cos(E))
        E -= step
        if abs(step) < 1e-15 * (1.0 + abs(E)):
            break
    return E


def kepler_state(gm_km3_s2: float, a_km: float, e: float, i: float, node: Array, peri: Array, M: Array) -> Array:
    """States (n, 6), km and km/s, in the frame of the elements.

    Parameters
    ----------
    a_km, e, i : semi-major axis, eccentricity in [0, 1), inclination, rad.
    node, peri, M : shape (n,), node, argument of pericentre and mean anomaly at each time, rad.
    """
    states = np.empty((M.size, 6))
    # one layout of arrays, one compiled version
    node, peri, M = (np.require(angle, np.float64, ("C", "W")) for angle in (node, peri, M))
    _states(gm_km3_s2, a_km, e, i, node, peri, M, states)
    return states


@kernel
def _states(gm: float, a: float, e: float, i: float, node: Array, peri: Array, M: Array, states: Array) -> None:
    """Fill states (n, 6) from position and velocity in the plane, along P (towards the pericentre) and Q."""
    root, n = math.sqrt(1.0 - e * e), math.sqrt(gm / (a * a * a))
    cos_i, sin_i = math.cos(i), math.sin(i)
    for k in range(states.shape[0]):
        E = eccentric_anomaly(M[k], e)
        cos_E, sin_E = math.cos(E), math.sin(E)
        p, q = a * (cos_E - e), a * root * sin_E
        rate = a * n / (1.0 - e * cos_E)
        p_rate, q_rate = -rate * sin_E, rate * root * cos_E
        cos_n, sin_n, cos_p, sin_p = math.cos(node[k]), math.sin(node[k]), math.cos(peri[k]), math.sin(peri[k])
        Px, Py, Pz = cos_p * cos_n - sin_p * sin_n * cos_i, cos_p * sin_n + sin_p * cos_n * cos_i, sin_p * sin_i
        Qx, Qy, Qz = -sin_p * cos_n - cos_p * sin_n * cos_i, -sin_p * sin_n + cos_p * cos_n * cos_i, cos_p * sin_i
        states[k, 0], states[k, 1], states[k, 2] = p * Px + q * Qx, p * Py + q * Qy, p * Pz + q * Qz
        states[k, 3], states[k, 4], states[k, 5] = (
            p_rate * Px + q_rate * Qx,
            p_rate * Py + q_rate * Qy,
            p_rate * Pz + q_rate * Qz,
        )
