"""Orbital elements <-> Cartesian states, with Jacobians, for all eccentricities.

The three kinds, in this order:
    cometary    [e, q_km, tp_s, node, peri, i]  any e >= 0; tp: perihelion passage, seconds after the epoch of the state
    keplerian   [a_km, e, i, node, peri, M]     e != 1; a < 0 for hyperbolas
    equinoctial [a_km, h, k, p, q, lambda]      e < 1; h = e sin varpi, k = e cos varpi,
                                                p = tan(i/2) sin node, q = tan(i/2) cos node, lambda = M + varpi
Angles in rad, states in km and km/s, both on the axes of the elements (no rotation here: see frames.py). Of the angles
that follow from a state, node, peri and lambda lie in [0, 2 pi), i in [0, pi], the M of an ellipse within pi of zero.
All three go through perifocal coordinates in universal variables, which lose nothing at e = 1 (twobody.py). Jacobians
of elements -> state are complex-step derivatives, exact to round-off; those of state -> elements solve with them.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import STATE, bordered
from nebosvod.dynamics.twobody import Analytic, fictitious_time, universal
from nebosvod.errors import GeometryError, InputError

Array = npt.NDArray[np.float64]
STEP = 1e-40  # of the complex step: its square vanishes, whatever the unit of the element


@bordered()
def cometary_to_state(elements: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """State (6,) and its Jacobian (6, 6) by [e, q_km, tp_s, node, peri, i]; tp counts from the epoch of the state.

    References
    ----------
    Danby, Fundamentals of Celestial Mechanics, 6.9 (universal variables).
    """
    x = _six(elements, "cometary elements")
    if x[0] < 0.0 or x[1] <= 0.0:
        raise InputError(f"cometary elements: e = {x[0]}, q = {x[1]} km; needs e >= 0 and q > 0")
    return _differentiate(lambda y: _from_cometary(y, gm_km3_s2), x)


@bordered()
def keplerian_to_state(elements: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """State (6,) and its Jacobian (6, 6) by [a_km, e, i, node, peri, M]; a < 0 and the hyperbolic M for e > 1."""
    x = _six(elements, "keplerian elements")
    if x[1] < 0.0 or x[0] * (1.0 - x[1]) <= 0.0:
        raise InputError(f"keplerian elements: a = {x[0]} km, e = {x[1]}; needs e >= 0, e != 1 and a (1 - e) > 0")
    if x[0] > 0.0:
        x[5] = np.remainder(x[5] + np.pi, 2.0 * np.pi) - np.pi
    return _differentiate(lambda y: _from_keplerian(y, gm_km3_s2), x)


@bordered()
def equinoctial_to_state(elements: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """State (6,) and its Jacobian (6, 6) by [a_km, h, k, p, q, lambda]; ellipses only.

    References
    ----------
    Broucke, Cefola 1972, Celestial Mechanics 5, 303.
    """
    x = _six(elements, "equinoctial elements")
    if x[0] <= 0.0 or x[1] ** 2 + x[2] ** 2 >= 1.0:
        raise InputError(f"equinoctial elements: a = {x[0]} km, h = {x[1]}, k = {x[2]}; needs a > 0 and h^2 + k^2 < 1")
    return _differentiate(lambda y: _from_equinoctial(y, gm_km3_s2), x)


@bordered(state=STATE)
def state_to_cometary(state: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """[e, q_km, tp_s, node, peri, i] of a state, and the Jacobian (6, 6) of elements by state.

    Raises
    ------
    GeometryError
        If an element is undefined: a rectilinear orbit, a circle (perihelion), inclination 0 or 180 deg (node).
    """
    return _invert(_to_cometary(_six(state, "state"), gm_km3_s2), cometary_to_state, gm_km3_s2)


@bordered(state=STATE)
def state_to_keplerian(state: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """[a_km, e, i, node, peri, M] of a state, and the Jacobian (6, 6) of elements by state.

    Raises
    ------
    GeometryError
        As `state_to_cometary`, and for a parabola.
    """
    x = _six(state, "state")
    e, _, tp, node, peri, i = _to_cometary(x, gm_km3_s2)
    beta = 2.0 * gm_km3_s2 / float(np.sqrt(x[:3] @ x[:3])) - float(x[3:] @ x[3:])
    if beta == 0.0:
        raise GeometryError("keplerian elements: the orbit is a parabola, a is infinite; use cometary elements")
    motion = abs(beta) ** 1.5 / gm_km3_s2
    return _invert(np.array([gm_km3_s2 / beta, e, i, node, peri, -motion * tp]), keplerian_to_state, gm_km3_s2)


@bordered(state=STATE)
def state_to_equinoctial(state: npt.ArrayLike, gm_km3_s2: float) -> tuple[Array, Array]:
    """[a_km, h, k, p, q, lambda] of an elliptic state, and the Jacobian (6, 6) of elements by state.

    References
    ----------
    Broucke, Cefola 1972, Celestial Mechanics 5, 303.
    """
    x = _six(state, "state")
    position, velocity = x[:3], x[3:]
    r = float(np.sqrt(position @ position))
    beta = 2.0 * gm_km3_s2 / r - float(velocity @ velocity)
    momentum = np.cross(position, velocity)
    h = float(np.sqrt(momentum @ momentum))
    if beta <= 0.0 or h == 0.0 or momentum[2] <= -h * (1.0 - 1e-15):
        raise GeometryError(
            "equinoctial elements need an ellipse that is not rectilinear and not at inclination 180 deg"
        )
    a, w = gm_km3_s2 / beta, momentum / h
    p, q = w[0] / (1.0 + w[2]), -w[1] / (1.0 + w[2])
    f_axis, g_axis = _equinoctial_axes(p, q)
    vector = np.cross(velocity, momentum) / gm_km3_s2 - position / r
    k, hh = float(vector @ f_axis), float(vector @ g_axis)
    x1, x2 = float(position @ f_axis) / a, float(position @ g_axis) / a
    b = 1.0 / (1.0 + np.sqrt(1.0 - hh * hh - k * k))
    root = np.sqrt(1.0 - hh * hh - k * k)
    cos_f = k + ((1.0 - k * k * b) * x1 - hh * k * b * x2) / root
    sin_f = hh + ((1.0 - hh * hh * b) * x2 - hh * k * b * x1) / root
    f = np.arctan2(sin_f, cos_f)
    longitude = f + hh * np.cos(f) - k * np.sin(f)
    return _invert(np.array([a, hh, k, p, q, _turned(longitude)]), equinoctial_to_state, gm_km3_s2)


def _turned(angle: float) -> float:
    """The angle in [0, 2 pi); the remainder of -1e-17 alone would be a whole turn."""
    return float(np.remainder(angle, 2.0 * np.pi)) % (2.0 * np.pi)


def _six(values: npt.ArrayLike, what: str) -> Array:
    """Six finite numbers, copied."""
    x = np.array(values, dtype=np.float64)
    if x.shape != (6,) or not np.isfinite(x).all():
        raise InputError(f"{what}: needs six finite numbers, got {x}")
    return x


def _differentiate(function: Callable[[Analytic], Analytic], x: Array) -> tuple[Array, Array]:
    """Value and Jacobian of an analytic function of six numbers by complex step."""
    jacobian = np.empty((6, 6))
    for column in range(6):
        shifted = x.astype(np.complex128)
        shifted[column] += 1j * STEP
        jacobian[:, column] = np.imag(function(shifted)) / STEP
    return np.asarray(np.real(function(x.astype(np.complex128)))), jacobian


def _invert(elements: Array, forward: Callable[[Array, float], tuple[Array, Array]], gm: float) -> tuple[Array, Array]:
    """Elements with d elements / d state, from the Jacobian of the other direction, scaled before it is solved."""
    jacobian = forward(elements, gm)[1]
    scale = np.linalg.norm(jacobian, axis=0)
    if not np.isfinite(jacobian).all() or not scale.all():
        raise GeometryError(f"elements {elements} are singular here: one of them does not move the state")
    try:
        partials = np.linalg.solve(jacobian / scale, np.eye(6)) / scale[:, None]
    except np.linalg.LinAlgError:
        raise GeometryError(f"elements {elements} are singular here: a circle has no perihelion") from None
    return elements, partials


def _orient(x: Analytic, y: Analytic, node: Analytic, peri: Analytic, i: Analytic) -> Analytic:
    """Perifocal coordinates (x along perihelion) onto the axes of the elements."""
    co, so, cw, sw, ci, si = np.cos(node), np.sin(node), np.cos(peri), np.sin(peri), np.cos(i), np.sin(i)
    p = np.array([co * cw - so * sw * ci, so * cw + co * sw * ci, sw * si])
    q = np.array([-co * sw - so * cw * ci, -so * sw + co * cw * ci, cw * si])
    return x * p + y * q


def _from_cometary(x: Analytic, gm: float) -> Analytic:
    """Perifocal motion from perihelion: X = q - GM U2, Y = q U1 v_q."""
    e, q, tp, node, peri, i = x
    beta = gm * (1.0 - e) / q
    s = fictitious_time(-tp, q, 0.0 * q, beta, gm)
    u0, u1, u2, _ = universal(s, beta)
    r, speed = q * u0 + gm * u2, np.sqrt(gm * (1.0 + e) / q)
    position = _orient(q - gm * u2, q * u1 * speed, node, peri, i)
    velocity = _orient(-gm * u1 / r, (1.0 - gm * u2 / r) * speed, node, peri, i)
    return np.concatenate([position, velocity])


def _from_keplerian(x: Analytic, gm: float) -> Analytic:
    """The cometary form with q = a (1 - e) and tp = -M/n."""
    a, e, i, node, peri, mean = x
    size = a if np.real(a) > 0.0 else -a
    return _from_cometary(np.array([e, a * (1.0 - e), -mean * np.sqrt(size**3 / gm), node, peri, i]), gm)


def _equinoctial_axes(p: Analytic, q: Analytic) -> tuple[Analytic, Analytic]:
    """Unit vectors f, g of the equinoctial frame (Broucke and Cefola 1972)."""
    norm = 1.0 + p * p + q * q
    f = np.array([1.0 - p * p + q * q, 2.0 * p * q, -2.0 * p]) / norm
    g = np.array([2.0 * p * q, 1.0 + p * p - q * q, 2.0 * q]) / norm
    return f, g


def _from_equinoctial(x: Analytic, gm: float) -> Analytic:
    """Eccentric longitude F from lambda = F + h cos F - k sin F, then the coordinates in the (f, g) plane."""
    a, h, k, p, q, longitude = x
    f: Analytic = longitude
    for _ in range(60):  # Newton from F = lambda + |e| side; the last steps carry the complex part
        change = (f + h * np.cos(f) - k * np.sin(f) - longitude) / (1.0 - h * np.sin(f) - k * np.cos(f))
        size = abs(np.real(change))
        f = f - (change if size < 0.5 else 0.5 * change / size)
        if abs(change) < 1e-15:
            break
    root = np.sqrt(1.0 - h * h - k * k)
    b, cf, sf = 1.0 / (1.0 + root), np.cos(f), np.sin(f)
    r = a * (1.0 - h * sf - k * cf)
    x1 = a * ((1.0 - h * h * b) * cf + h * k * b * sf - k)
    x2 = a * ((1.0 - k * k * b) * sf + h * k * b * cf - h)
    rate = np.sqrt(gm * a) / r
    v1 = rate * (h * k * b * cf - (1.0 - h * h * b) * sf)
    v2 = rate * ((1.0 - k * k * b) * cf - h * k * b * sf)
    f_axis, g_axis = _equinoctial_axes(p, q)
    return np.concatenate([x1 * f_axis + x2 * g_axis, v1 * f_axis + v2 * g_axis])


def _to_cometary(x: Array, gm: float) -> Array:
    """Elements from momentum and eccentricity vectors; the time from perihelion in universal variables."""
    position, velocity = x[:3], x[3:]
    r = float(np.sqrt(position @ position))
    momentum = np.cross(position, velocity)
    h = float(np.sqrt(momentum @ momentum))
    if r == 0.0 or h == 0.0:
        raise GeometryError("elements: the orbit is rectilinear (position and velocity are parallel)")
    sigma, beta = float(position @ velocity), 2.0 * gm / r - float(velocity @ velocity)
    vector = np.cross(velocity, momentum) / gm - position / r
    e = float(np.sqrt(vector @ vector))
    q = h * h / (gm * (1.0 + e))
    across = float(np.hypot(momentum[0], momentum[1]))
    if momentum[2] < 0.0 and across < 1e-15 * h:  # numbers near pi are 4e-16 apart, so nothing is left of sin i
        raise GeometryError("elements: at inclination 180 deg there is no node; use other axes")
    if across == 0.0:
        raise GeometryError("elements: at inclination 0 there is no node; use equinoctial elements, or other axes")
    i = np.arctan2(across, momentum[2])
    node = np.arctan2(momentum[0], -momentum[1])
    ahead = np.array([np.cos(node), np.sin(node), 0.0])
    s = _time_from_perihelion(r, sigma, beta, e, gm)
    _, u1, u2, u3 = universal(s, beta)
    # perihelion from the position and the same s, not from the eccentricity vector: its direction has the error
    # 1e-16/e of a small vector, and an error of perihelion that tp does not share would move the state
    latitude = np.arctan2(float(position @ np.cross(momentum / h, ahead)), float(position @ ahead))
    peri = latitude - np.arctan2(u1 * h, q - gm * u2)
    return np.array([e, q, -(q * u1 + gm * u3), _turned(node), _turned(peri), i])


def _time_from_perihelion(r: float, sigma: float, beta: float, e: float, gm: float) -> float:
    """Fictitious time s since perihelion: GM e U1(s) = r.v; a half-angle form where the orbit is nearly a parabola."""
    cos_part = (1.0 - r * beta / gm) / e if e > 0.0 else 1.0
    u1 = sigma / (gm * e) if e > 0.0 else 0.0
    if beta > 0.0 and cos_part < 0.9:
        return float(np.arctan2(sigma * np.sqrt(beta), gm - r * beta) / np.sqrt(beta))
    if beta < 0.0 and cos_part > 1.1:
        return float(np.arcsinh(u1 * np.sqrt(-beta)) / np.sqrt(-beta))
    half = u1 / (1.0 + cos_part)
    z = beta * half * half  # tan^2 of half the eccentric anomaly, small: atan(sqrt z)/sqrt z as a series
    series = sum((-z) ** j / (2 * j + 1) for j in range(16))
    return float(2.0 * half * series)
