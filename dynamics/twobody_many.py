"""Two-body motion of many orbits at many times at once, in universal variables (every eccentricity by one formula).

`dynamics.twobody` is the same motion for one orbit, with complex arguments; this one serves the search for a first
orbit, which flies hundreds of candidates. Formulas: Danby, Fundamentals of Celestial Mechanics, 6.9; Kepler's equation
by Laguerre's method of degree five (Conway 1986, Celest. Mech. 39, 199), which converges from any start.
"""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel

Array = npt.NDArray[np.float64]


ITERATIONS = 30
TOLERANCE = 1e-6  # of the last step, relative: convergence is cubic, so the error after it is 1e-18
SERIES_BELOW = 0.5  # |beta s^2| under which the Stumpff functions are summed as series
SHORT_BELOW = 0.01  # under which half of the terms do: 0.01^5 / 12! = 2e-19
C2 = tuple((-1.0) ** j / math.factorial(2 * j + 2) for j in range(9))  # 0.5^9 / 21! = 4e-23
C3 = tuple((-1.0) ** j / math.factorial(2 * j + 3) for j in range(9))


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
    shape = np.broadcast_shapes(r0.shape, np.shape(t))
    arguments = np.empty((4, *shape))
    for row, value in zip(arguments, (r0, sigma, beta, t)):
        row[...] = value
    found = np.empty_like(arguments)
    _fill_coefficients(arguments.reshape(4, -1), gm, found.reshape(4, -1))
    return found[0], found[1], found[2], found[3]


def stumpff(z: Array) -> tuple[Array, Array]:
    """c_2 and c_3 of z (n,): by series near 0, by circular or hyperbolic functions elsewhere."""
    found = np.empty((2, z.size))
    _fill_stumpff(np.require(z, np.float64, ("C", "W")), found)
    return found[0], found[1]


@kernel
def _fill_coefficients(arguments: Array, gm: float, found: Array) -> None:
    """Fill found (4, n) with Lagrange's coefficients of r0, sigma, beta and t (4, n)."""
    for k in range(arguments.shape[1]):
        r0, sigma, beta, t = arguments[0, k], arguments[1, k], arguments[2, k], arguments[3, k]
        _, f, g, f_dot, g_dot = coefficients_from(first_guess(t, r0, beta, gm), t, r0, sigma, beta, gm)
        found[0, k], found[1, k], found[2, k], found[3, k] = f, g, f_dot, g_dot


@kernel
def _fill_stumpff(z: Array, found: Array) -> None:
    for k in range(z.shape[0]):
        found[0, k], found[1, k] = _stumpff(z[k])


@kernel
def _stumpff(z: float) -> tuple[float, float]:
    size = abs(z)
    if size > SERIES_BELOW:
        root = math.sqrt(size)
        half = np.sin(0.5 * root) if z > 0.0 else np.sinh(0.5 * root)
        odd = (np.sin(root) if z > 0.0 else np.sinh(root)) / root
        return 2.0 * half * half / size, (1.0 - odd) / z
    c2 = c3 = 0.0
    if size > SHORT_BELOW:
        for j in range(8, 4, -1):
            c2, c3 = C2[j] + z * c2, C3[j] + z * c3
    for j in range(4, -1, -1):
        c2, c3 = C2[j] + z * c2, C3[j] + z * c3
    return c2, c3


@kernel
def _within_a_revolution(t: float, beta: float, gm: float) -> float:
    """The time less whole revolutions."""
    if beta > 0.0:
        period = 2.0 * math.pi * gm / (max(beta, 1e-300) * math.sqrt(max(beta, 1e-300)))
        if period < math.inf:
            return float(t - period * np.rint(t / period))
    return t


@kernel
def first_guess(t: float, r0: float, beta: float, gm: float) -> float:
    """Fictitious time from which `coefficients_from` may begin."""
    rest = _within_a_revolution(t, beta, gm)
    # an unbound orbit far out moves almost straight: its fictitious time is that of a logarithm
    reach, bend = abs(rest) / r0, math.sqrt(abs(beta))
    if bend > 0.0:
        reach = min(reach, np.arcsinh(bend * reach) / bend)
    return math.copysign(reach, rest)


@kernel
def coefficients_from(
    s: float, t: float, r0: float, sigma: float, beta: float, gm: float
) -> tuple[float, float, float, float, float]:
    """Fictitious time, f, g, f_dot, g_dot a time t on, the search for the first begun at s.

    `r0` is the distance, `sigma` = r.v, `beta` = 2 gm / r0 - v.v. The fictitious time solves
    r0 U1 + sigma U2 + gm U3 = t with U_k = s^k c_k(beta s^2); f is nan where it was not found.
    """
    rest = _within_a_revolution(t, beta, gm)
    for _ in range(ITERATIONS):
        c2, c3 = _stumpff(beta * s * s)
        u0, u1, u2, u3 = 1.0 - beta * s * s * c2, s * (1.0 - beta * s * s * c3), s * s * c2, s * s * s * c3
        value = r0 * u1 + sigma * u2 + gm * u3 - rest
        slope = r0 * u0 + sigma * u1 + gm * u2
        bent = sigma * u0 + (gm - beta * r0) * u1
        root = math.sqrt(abs(16.0 * slope * slope - 20.0 * value * bent))
        step = 5.0 * value / (slope + (-root if slope < 0.0 else root))
        if not abs(step) < math.inf:
            break
        s = s - step
        if abs(step) <= TOLERANCE * abs(s) + 1e-300:
            break
    c2, c3 = _stumpff(beta * s * s)
    u0, u1, u2, u3 = 1.0 - beta * s * s * c2, s * (1.0 - beta * s * s * c3), s * s * c2, s * s * s * c3
    now = r0 * u0 + sigma * u1 + gm * u2
    f, g = 1.0 - gm * u2 / r0, r0 * u1 + sigma * u2
    if abs(g + gm * u3 - rest) > 1e-8 * (abs(rest) + abs(r0 * u1)):
        f = math.nan
    return s, f, g, -gm * u1 / (now * r0), 1.0 - gm * u2 / now
