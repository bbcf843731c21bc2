"""Two-body motion by elements, for spacecraft whose orbit a mission states rather than integrates."""

import numpy as np

from nebosvod.observation.contracts import Array

NEWTON_STEPS = 30


def eccentric_anomaly(M: Array, e: float) -> Array:
    """Solve E - e sin E = M for elliptic motion, to round-off.

    Newton's method from E = M + e sin M / (1 - sin(M + e) + sin M) converges for every M and e < 1.
    """
    M = np.mod(M + np.pi, 2.0 * np.pi) - np.pi
    E = np.where(e > 0.8, np.pi * np.sign(M), M + e * np.sin(M))
    for _ in range(NEWTON_STEPS):
        step = (E - e * np.sin(E) - M) / (1.0 - e * np.cos(E))
        E = E - step
        if np.all(np.abs(step) < 1e-15 * (1.0 + np.abs(E))):
            break
    return np.asarray(E)


def kepler_state(gm_km3_s2: float, a_km: float, e: float, i: float, node: Array, peri: Array, M: Array) -> Array:
    """States (n, 6), km and km/s, in the frame of the elements.

    Parameters
    ----------
    a_km, e, i : semi-major axis, eccentricity in [0, 1), inclination, rad.
    node, peri, M : shape (n,), node, argument of pericentre and mean anomaly at each time, rad.
    """
    E = eccentric_anomaly(M, e)
    root = np.sqrt(1.0 - e * e)
    now = 1.0 - e * np.cos(E)
    n = np.sqrt(gm_km3_s2 / a_km**3)
    plane = np.stack([a_km * (np.cos(E) - e), a_km * root * np.sin(E)], axis=1)
    speed = np.stack([-a_km * n * np.sin(E) / now, a_km * n * root * np.cos(E) / now], axis=1)
    P, Q = perifocal_axes(i, node, peri)
    return np.concatenate([plane[:, :1] * P + plane[:, 1:] * Q, speed[:, :1] * P + speed[:, 1:] * Q], axis=1)


def perifocal_axes(i: float, node: Array, peri: Array) -> tuple[Array, Array]:
    """Unit vectors (n, 3) towards the pericentre and 90 deg ahead of it."""
    cos_n, sin_n, cos_p, sin_p = np.cos(node), np.sin(node), np.cos(peri), np.sin(peri)
    cos_i, sin_i = np.cos(i), np.sin(i)
    node_axis = np.stack([cos_n, sin_n, np.zeros_like(cos_n)], axis=1)
    across = np.stack([-sin_n * cos_i, cos_n * cos_i, np.full_like(cos_n, sin_i)], axis=1)
    P = cos_p[:, None] * node_axis + sin_p[:, None] * across
    Q = cos_p[:, None] * across - sin_p[:, None] * node_axis
    return P, Q
