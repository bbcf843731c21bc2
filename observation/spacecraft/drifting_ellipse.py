"""How an error of an orbit grows on an ellipse that turns: the closed form for orbits stated by elements.

The variational equations along the track of such an orbit have no answer: with the rates of J2 put on by hand it is no
orbit of any force, and they take the mismatch of mean motion and radius, a part in a thousand in low orbit, for an
instability (half an e-fold a revolution). The model itself knows better: its partials by its own elements.
"""

from collections.abc import Callable

import numpy as np

from nebosvod.dynamics.kepler import kepler_state
from nebosvod.observation.contracts import Array

# steps of a/a, e cos peri, e sin peri; of a small, for n t is thousands of radians
STEPS = (1e-7, 1e-5, 1e-5)


def transitions(
    a_km: float, e: float, M_rad: float, rate_rad_s: float, since_s: Array, R_icrf_from_plane: Callable[[Array], Array]
) -> Array:
    """Partials (n, 6, 6) of the state at times `since_s` (n,) after a start by the state at the start, km and km/s.

    Parameters
    ----------
    M_rad, rate_rad_s : mean anomaly at the start and its rate.
    R_icrf_from_plane : rotations (n, 3, 3) at times after the start, from the axes of the ellipse (pericentre, across,
        normal), which node and pericentre carry along.

    Notes
    -----
    Phi = A(t) J(t) J(0)^-1 A(0)^T, J the partials of the planar Kepler state by a, e cos and e sin of the pericentre,
    mean longitude, and two rotations of the plane, which stay regular for a circle. The rates themselves are held.
    """
    gm = rate_rad_s**2 * a_km**3
    M = M_rad + rate_rad_s * since_s

    def plane(a: float, h: float, k: float, longitude: Array) -> Array:
        eccentricity, peri = float(np.hypot(h, k)), float(np.arctan2(k, h))
        ahead = longitude + (np.sqrt(gm / a**3) - rate_rad_s) * since_s
        zero = np.zeros(since_s.size)
        return kepler_state(gm, a, eccentricity, 0.0, zero, zero + peri, ahead - peri)

    J = np.empty((since_s.size, 6, 6))
    for column, (step, size) in enumerate(zip(np.diag((a_km, 1.0, 1.0)), STEPS)):
        up, down = (plane(a_km + s * step[0], e + s * step[1], s * step[2], M) for s in (size, -size))
        J[:, :, column] = (up - down) / (2.0 * size)
    J[:, :, 3] = (plane(a_km, e, 0.0, M + 1e-5) - plane(a_km, e, 0.0, M - 1e-5)) / 2e-5
    x = plane(a_km, e, 0.0, M).reshape(-1, 2, 3)
    for column, axis in ((4, (1.0, 0.0, 0.0)), (5, (0.0, 1.0, 0.0))):
        J[:, :, column] = np.cross(axis, x).reshape(-1, 6)
    return J if since_s.size == 0 else _turned(J, R_icrf_from_plane(since_s))


def _turned(J: Array, R: Array) -> Array:
    """A(t) J(t) J(0)^-1 A(0)^T; the first time is the start."""
    unit = 1.0 / np.abs(J).max(axis=(0, 2))  # position and velocity differ by the mean motion
    scaled = J * unit[:, None]
    whole = np.zeros_like(J)
    whole[:, :3, :3] = whole[:, 3:, 3:] = R
    in_plane = np.linalg.solve(scaled[0].T, np.swapaxes(scaled, 1, 2)).swapaxes(1, 2)  # J(t) J(0)^-1
    turned: Array = whole @ (in_plane * unit / unit[:, None]) @ whole[0].T
    return turned
