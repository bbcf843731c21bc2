"""Two-body motion of many orbits at many times at once, in universal variables (every eccentricity by one formula).

`dynamics.twobody` is the same motion for one orbit, with complex arguments; this one serves the search for a first
orbit, which flies hundreds of candidates. Formulas: Danby, Fundamentals of Celestial Mechanics, 6.9; Kepler's equation
by Laguerre's method of degree five (Conway 1986, Celest. Mech. 39, 199), which converges from any start.
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


ITERATIONS = 30
TOLERANCE = 1e-6  # of the last step, relative: convergence is cubic, so the error after it is 1e-18
SERIES_BELOW = 0.5  # |beta s^2| under which the Stumpff functions are summed as series
SERIES_TERMS = 9  # 0.5^9 / 21! = 4e-23


def fly(state: Array, t: Array, gm: float) -> Array:
    """States (..., 6) a time `t` after `state`, both about the attracting centre.

    Parameters
    ----------
    state : shape (k, ..., 6); t : shape (one axis or more) that broadcasts against state[..., 0]; consistent units.

    Notes
    -----
    An orbit that cannot be followed in finite arithmetic (absurd speed, a state at the centre) gives nan.
    """
    f, g, f_dot, g_dot = lagrange_coefficients(state, t, gm)
    r, v = state[..., :3], state[..., 3:]
    return np.concatenate([f[..., None] * r + g[..., None] * v, f_dot[..., None] * r + g_dot[..., None] * v], axis=-1)


def lagrange_coefficients(state: Array, t: Array, gm: float) -> tuple[Array, Array, Array, Array]:
    """f, g and their rates: r(t) = f r + g v, v(t) = f_dot r + g_dot v; arguments as `fly`."""
    r, v = state[..., :3], state[..., 3:]
    with np.errstate(all="ignore"):
        r0, sigma = np.sqrt(np.sum(r * r, axis=-1)), np.sum(r * v, axis=-1)
        beta = 2.0 * gm / r0 - np.sum(v * v, axis=-1)
        r0, sigma, beta, t = np.broadcast_arrays(r0, sigma, beta, t)
        period = np.where(beta > 0.0, 2.0 * np.pi * gm / np.maximum(beta, 1e-300) ** 1.5, np.inf)
        rest = np.where(np.isfinite(period), t - period * np.round(t / period), t)
        u0, u1, u2, u3 = _solve(rest, r0, sigma, beta, gm)
        now = r0 * u0 + sigma * u1 + gm * u2
        f, g = 1.0 - gm * u2 / r0, r0 * u1 + sigma * u2
        missed = np.abs(g + gm * u3 - rest) > 1e-8 * (np.abs(rest) + np.abs(r0 * u1))
        return np.where(missed, np.nan, f), g, -gm * u1 / (now * r0), 1.0 - gm * u2 / now


def universal(s: Array, beta: Array) -> tuple[Array, Array, Array, Array]:
    """U_0 .. U_3 at the fictitious time s: U_k = s^k c_k(beta s^2)."""
    z = beta * s * s
    c2, c3 = stumpff(z)
    return 1.0 - z * c2, s * (1.0 - z * c3), s * s * c2, s * s * s * c3


def stumpff(z: Array) -> tuple[Array, Array]:
    """c_2 and c_3 of z (n,): by series near 0, by circular or hyperbolic functions elsewhere."""
    c2, c3 = np.zeros_like(z), np.zeros_like(z)
    for j in range(SERIES_TERMS - 1, -1, -1):
        c2 = (1.0 - z * c2) / ((2 * j + 1) * (2 * j + 2))
        c3 = (1.0 - z * c3) / ((2 * j + 2) * (2 * j + 3))
    far = np.abs(z) > SERIES_BELOW
    if far.any():
        bent = z[far]
        root = np.sqrt(np.abs(bent))
        bound = bent > 0.0
        half = np.where(bound, np.sin(0.5 * root), np.sinh(0.5 * root))
        odd = np.where(bound, np.sin(root), np.sinh(root)) / root
        c2[far] = 2.0 * half * half / np.abs(bent)
        c3[far] = (1.0 - odd) / bent
    return c2, c3


def _solve(t: Array, r0: Array, sigma: Array, beta: Array, gm: float) -> tuple[Array, Array, Array, Array]:
    """U_0 .. U_3 where r0 U1 + sigma U2 + gm U3 = t."""
    # an unbound orbit far out moves almost straight: its fictitious time is that of a logarithm
    reach = np.abs(t) / r0
    bend = np.sqrt(np.abs(beta))
    s = np.sign(t) * np.minimum(reach, np.where(bend > 0.0, np.arcsinh(bend * reach) / np.maximum(bend, 1e-300), reach))
    for _ in range(ITERATIONS):
        u0, u1, u2, u3 = universal(s, beta)
        value = r0 * u1 + sigma * u2 + gm * u3 - t
        slope = r0 * u0 + sigma * u1 + gm * u2
        bent = sigma * u0 + (gm - beta * r0) * u1
        root = np.sqrt(np.abs(16.0 * slope * slope - 20.0 * value * bent))
        step = 5.0 * value / (slope + np.where(slope < 0.0, -root, root))
        s = s - np.where(np.isfinite(step), step, 0.0)
        if np.all(np.abs(step) <= TOLERANCE * np.abs(s) + 1e-300) or not np.any(np.isfinite(step)):
            break
    return universal(s, beta)
