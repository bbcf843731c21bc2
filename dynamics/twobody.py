"""Kepler motion in universal variables: every eccentricity by one formula. Oracle of tests and starting guess.

With beta = 2 GM/r - v^2 and the fictitious time s (dt = r ds): U_k = s^k c_k(beta s^2), c_k the Stumpff functions,
r = r0 U0 + (r.v) U1 + GM U2, t = r0 U1 + (r.v) U2 + GM U3 (Danby, Fundamentals of Celestial Mechanics, 6.9).
All functions take complex arguments too, so that Jacobians come by complex step, exact to round-off.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import STATE, bordered
from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]
# A real or complex number or array: the same formula serves values and complex-step derivatives
Analytic = Any

_FACTORIAL = np.cumprod(np.concatenate([[1.0], np.arange(1.0, 40.0)]))


def stumpff(z: Analytic) -> tuple[Analytic, Analytic, Analytic, Analytic]:
    """c_0 .. c_3 of z (scalar, real or complex): c_k(z) = sum over j of (-z)^j / (k + 2 j)!."""
    if abs(z) < 1.0:
        c2 = c3 = 0.0 * z
        for j in range(9, -1, -1):
            c2, c3 = c2 * (-z) + 1.0 / _FACTORIAL[2 + 2 * j], c3 * (-z) + 1.0 / _FACTORIAL[3 + 2 * j]
        return 1.0 - z * c2, 1.0 - z * c3, c2, c3
    if np.real(z) > 0.0:
        root = np.sqrt(z)
        c0, c1 = np.cos(root), np.sin(root) / root
        half = np.sin(0.5 * root)
        return c0, c1, 2.0 * half * half / z, (1.0 - c1) / z
    root = np.sqrt(-z)
    c0, c1 = np.cosh(root), np.sinh(root) / root
    half = np.sinh(0.5 * root)
    return c0, c1, -2.0 * half * half / z, (1.0 - c1) / z


def universal(s: Analytic, beta: Analytic) -> tuple[Analytic, Analytic, Analytic, Analytic]:
    """U_0 .. U_3 at the fictitious time s.

    References
    ----------
    Danby, Fundamentals of Celestial Mechanics, 6.9.
    """
    c0, c1, c2, c3 = stumpff(beta * s * s)
    return c0, s * c1, s * s * c2, s * s * s * c3


def fictitious_time(t: Analytic, r: Analytic, sigma: Analytic, beta: Analytic, gm: Analytic) -> Analytic:
    """Solve t = r U1 + sigma U2 + gm U3 for s; sigma = r.v. Bracketed Newton on the real part, then complex.

    Raises
    ------
    InputError
        If the equation has no solution in finite arithmetic (absurd elements).
    """
    real = _solve_real(float(np.real(t)), float(np.real(r)), float(np.real(sigma)), float(np.real(beta)), float(gm))
    s: Analytic = real
    for _ in range(2):  # two complex Newton steps carry the derivative to round-off
        u0, u1, u2, u3 = universal(s, beta)
        s = s - (r * u1 + sigma * u2 + gm * u3 - t) / (r * u0 + sigma * u1 + gm * u2)
    return s


def _solve_real(t: float, r: float, sigma: float, beta: float, gm: float) -> float:
    """Monotone equation, so a bracket always holds the root; Newton inside it, bisection outside."""
    if t == 0.0:
        return 0.0
    sign = 1.0 if t > 0.0 else -1.0
    reach = abs(t) / r if beta == 0.0 else min(abs(t) / r, 1.0 / np.sqrt(abs(beta)))
    low, high = 0.0, sign * max(float(reach), 1e-300)
    for _ in range(200):
        _, u1, u2, u3 = universal(high, beta)
        value = r * u1 + sigma * u2 + gm * u3 - t
        if not np.isfinite(value) or sign * value >= 0.0:
            break
        low, high = high, 2.0 * high
    s = 0.5 * (low + high)
    for _ in range(200):
        u0, u1, u2, u3 = universal(s, beta)
        value, slope = r * u1 + sigma * u2 + gm * u3 - t, r * u0 + sigma * u1 + gm * u2
        if not np.isfinite(value) or sign * value > 0.0:
            high = s
        else:
            low = s
        step = s - value / slope if np.isfinite(value) and slope > 0.0 else np.nan
        new = step if min(low, high) <= step <= max(low, high) else 0.5 * (low + high)
        if abs(new - s) <= 4e-16 * abs(new):
            return float(new)
        s = new
    return float(s)


@bordered(state=STATE)
def kepler(state: npt.ArrayLike, t_s: npt.ArrayLike, gm_km3_s2: float) -> Array:
    """Propagate a two-body state.

    Parameters
    ----------
    state : shape (6,), km, km/s, relative to the attracting centre.
    t_s : shape (n,), seconds after the state, either sign.
    gm_km3_s2 : gravitational parameter.

    Returns
    -------
    shape (n, 6), km, km/s.

    Raises
    ------
    InputError
        If the state is not six finite numbers or at the centre.

    References
    ----------
    Danby, Fundamentals of Celestial Mechanics, 6.9.
    """
    x = np.asarray(state, dtype=np.float64)
    if x.shape != (6,) or not np.isfinite(x).all() or not x[:3].any():
        raise InputError(f"two-body state: needs six finite numbers off the centre, got {x}")
    position, velocity = x[:3], x[3:]
    r0 = float(np.sqrt(position @ position))
    sigma, beta = float(position @ velocity), float(2.0 * gm_km3_s2 / r0 - velocity @ velocity)
    times = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
    period = 2.0 * np.pi * gm_km3_s2 / beta**1.5 if beta > 0.0 else np.inf
    result = np.empty((len(times), 6))
    for row, time in enumerate(times):
        rest = time if np.isinf(period) else time - period * np.round(time / period)
        s = fictitious_time(rest, r0, sigma, beta, gm_km3_s2)
        u0, u1, u2, _ = universal(s, beta)
        r = r0 * u0 + sigma * u1 + gm_km3_s2 * u2
        f, g = 1.0 - gm_km3_s2 * u2 / r0, r0 * u1 + sigma * u2
        fdot, gdot = -gm_km3_s2 * u1 / (r * r0), 1.0 - gm_km3_s2 * u2 / r
        result[row, :3] = f * position + g * velocity
        result[row, 3:] = fdot * position + gdot * velocity
    return result
