"""Many planetocentric states as points of one b-plane: where their osculating hyperbolas would pass."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def b_plane_points(states: Array, gm_km3_s2: float, axes: Array) -> tuple[Array, Array, Array]:
    """Points (n, 2) of impact vectors on common axes, speeds at infinity (n,) and smallest distances (n,).

    Parameters
    ----------
    states : shape (n, 6), planetocentric, km, km/s.
    axes : shape (3, 3), rows xi, normal, zeta (see `encounter.TargetPlane`).

    Notes
    -----
    b = S x h / v_inf, S the incoming asymptote of each; nan for a captured orbit.

    References
    ----------
    Valsecchi et al. 2003, A&A 408, 1179.
    """
    r, v = states[:, :3], states[:, 3:]
    h = np.cross(r, v)
    vector = np.cross(v, h) / gm_km3_s2 - r / np.linalg.norm(r, axis=1)[:, None]
    e = np.linalg.norm(vector, axis=1)
    energy = np.sum(v * v, axis=1) - 2.0 * gm_km3_s2 / np.linalg.norm(r, axis=1)
    speed = np.sqrt(np.where(energy > 0.0, energy, np.nan))
    p = vector / e[:, None]
    q = np.cross(h / np.linalg.norm(h, axis=1)[:, None], p)
    asymptote = p / e[:, None] + (np.sqrt(np.where(e > 1.0, e * e - 1.0, np.nan)) / e)[:, None] * q
    b = np.cross(asymptote, h) / speed[:, None]
    lowest = np.sum(h * h, axis=1) / gm_km3_s2 / (1.0 + e)
    return b @ axes[[0, 2]].T, speed, lowest


def capture_radius_km(radius_km: float, gm_km3_s2: float, v_infinity_km_s: float) -> float:
    """Impact parameter of the orbit that touches a surface: gravity focuses."""
    return float(np.sqrt(radius_km**2 + 2.0 * gm_km3_s2 * radius_km / v_infinity_km_s**2))
