"""Close approaches, target planes and the smallest distance.

Target planes pass through the centre of the body. `b_plane`: normal = incoming asymptote S of the osculating hyperbola
at closest approach, coordinates of the impact vector B = S x h/|v_inf|. `mtp`: normal = relative velocity at closest
approach, coordinates of the crossing point. In both, axis zeta points against the projection of the body's
heliocentric velocity and xi = normal x zeta (Milani et al. 2002, Icarus 159, 284; Valsecchi et al. 2003, A&A 408,
1179). The axes stay those of the nominal orbit in the partials; the crossing time is eliminated (in the mtp it has no
effect: the orbit crosses at right angles).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.ephemeris import Ephemeris
from nebosvod.dynamics.surface import height_km, radius_km
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.twobody import Analytic
from nebosvod.errors import GeometryError, InputError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Plane = Literal["b_plane", "mtp"]
SAMPLING_S = 0.5 * DAY_S  # at least this dense: a fifth of a day's motion is far below the period of the Moon


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Encounter:
    """A local minimum of the distance to a body.

    Attributes
    ----------
    body : its name.
    epoch, t_s : when, and the same in TDB seconds after the trajectory's epoch.
    distance_km, speed_km_s : from the body's centre, relative to it.
    state : shape (6,), planetocentric ICRF position and velocity, km, km/s.
    """

    body: str
    epoch: Epoch
    t_s: float
    distance_km: float
    speed_km_s: float
    state: Array

    @property
    def impact(self) -> bool:
        """Whether the closest point lies below the surface: the Earth's ellipsoid, of another body a sphere."""
        lowest = self.distance_km * self.state[None, :3] / np.linalg.norm(self.state[:3])
        return bool(height_km(self.body, lowest, self.epoch, np.zeros(1))[0] < 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetPlane:
    """Where an orbit crosses a plane through the centre of a body.

    Attributes
    ----------
    kind, body, t_s : which plane, of what, at which closest approach.
    coordinates_km : shape (2,), xi and zeta.
    partials_state : shape (2, 6), by the state at the trajectory's epoch.
    partials_parameters : shape (2, m), by the trajectory's parameters.
    axes : shape (3, 3), rows xi, normal, zeta, ICRF.
    v_infinity_km_s : speed at infinity, or nan for a captured orbit (mtp only).
    capture_radius_km : orbits crossing the plane closer than this hit the body: its radius, in the b-plane times the
        gravitational focusing sqrt(1 + v_esc^2/v_inf^2).

    References
    ----------
    Milani et al. 2002, Icarus 159, 284; Valsecchi et al. 2003, A&A 408, 1179.
    """

    kind: Plane
    body: str
    t_s: float
    coordinates_km: Array
    partials_state: Array
    partials_parameters: Array
    axes: Array
    v_infinity_km_s: float
    capture_radius_km: float


@bordered()
def find_encounters(trajectory: Trajectory, body: str, within_km: float = np.inf) -> tuple[Encounter, ...]:
    """All local minima of the distance to `body` inside the span of the trajectory, in time order.

    Parameters
    ----------
    trajectory : any; its dense output is searched, not its times.
    body : a planet, "moon", "sun", or an asteroid.
    within_km : ignore minima farther than this.
    """
    relative = relative_state(trajectory, body)
    first, last = trajectory.span_s
    regular = np.linspace(first, last, max(2, int(np.ceil((last - first) / SAMPLING_S)) + 1))
    times = np.union1d(regular, _refined(trajectory.step_edges_s))
    found = []
    for t, state in closest_approaches(relative, times):
        distance = float(np.linalg.norm(state[:3]))
        if distance <= within_km:
            found.append(
                Encounter(
                    body=body,
                    epoch=trajectory.epoch + t,
                    t_s=t,
                    distance_km=distance,
                    speed_km_s=float(np.linalg.norm(state[3:])),
                    state=state,
                )
            )
    return tuple(found)


def closest_approaches(relative: Callable[[Array], Array], times: Array) -> list[tuple[float, Array]]:
    """Local minima of |r| of a relative state function (n,) s -> (n, 6), bracketed by ascending `times`.

    A minimum is where r.v passes from negative to positive; it is refined by a bracketed secant (Illinois) to 1e-6 s.
    """
    states = relative(times)
    rate = np.einsum("ij,ij->i", states[:, :3], states[:, 3:])
    turns = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    if not turns.size:
        return []
    least = _roots(relative, times[turns], times[turns + 1], rate[turns], rate[turns + 1])
    return list(zip(least.tolist(), relative(least)))


def target_plane(trajectory: Trajectory, encounter: Encounter, kind: Plane = "b_plane") -> TargetPlane:
    """Coordinates of an encounter in a target plane and their partials.

    Raises
    ------
    GeometryError
        If the b-plane is asked for and the orbit is captured (no incoming asymptote).
    InputError
        For an unknown kind, or a trajectory without sensitivities.

    References
    ----------
    Milani et al. 2002, Icarus 159, 284; Valsecchi et al. 2003, A&A 408, 1179.
    """
    if kind not in ("b_plane", "mtp"):
        raise InputError(f'target plane "{kind}" is unknown (allowed: b_plane, mtp)')
    ephemeris, x = trajectory.forces.ephemeris, encounter.state
    gm = ephemeris.gm_km3_s2[encounter.body]
    v_infinity2 = float(x[3:] @ x[3:]) - 2.0 * gm / encounter.distance_km
    if kind == "b_plane" and v_infinity2 <= 0.0:
        raise GeometryError(
            f"b-plane at {encounter.body} on {encounter.epoch.iso()}: the orbit is captured (v_inf^2 = "
            f"{v_infinity2:.4g} km^2/s^2), it has no incoming asymptote; use mtp"
        )
    normal = _asymptote(x, gm) if kind == "b_plane" else x[3:] / encounter.speed_km_s
    axes = _axes(normal, _heliocentric_velocity(ephemeris, encounter.body, trajectory.epoch, encounter.t_s))
    v_infinity = float(np.sqrt(v_infinity2)) if v_infinity2 > 0.0 else float("nan")
    radius = radius_km(encounter.body, x[:3], trajectory.epoch, encounter.t_s)
    if kind == "b_plane":
        point, gradient = _complex_step(lambda y: axes[[0, 2]] @ _impact_vector(y, gm), x)
        gradient = _without_time(trajectory, encounter, gradient, np.concatenate([x[3:], x[:3]]))
        capture = float(np.sqrt(radius**2 + 2.0 * gm * radius / v_infinity2))
    else:
        point, gradient = axes[[0, 2]] @ x[:3], np.hstack([axes[[0, 2]], np.zeros((2, 3))])
        capture = radius
    at = trajectory.at([encounter.t_s])
    return TargetPlane(
        kind=kind,
        body=encounter.body,
        t_s=encounter.t_s,
        coordinates_km=point,
        partials_state=gradient @ at.Phi[0],
        partials_parameters=gradient @ at.zeta[0],
        axes=axes,
        v_infinity_km_s=v_infinity,
        capture_radius_km=capture,
    )


def perigee_distance(trajectory: Trajectory, encounter: Encounter) -> tuple[float, Array, Array]:
    """Smallest distance in km, its partials (6,) by the state at the epoch and (m,) by the parameters.

    The time of the minimum does not enter: d|r|/dt is zero there.
    """
    at = trajectory.at([encounter.t_s])
    gradient = encounter.state[:3] / encounter.distance_km
    return encounter.distance_km, gradient @ at.Phi[0, :3], gradient @ at.zeta[0, :3]


def relative_state(trajectory: Trajectory, body: str) -> Callable[[Array], Array]:
    """States (n, 6) relative to a body, ICRF, at any times (n,) of the span of a trajectory."""

    def state(t: Array) -> Array:
        return from_body(trajectory, body, t, trajectory.state_at(t))

    return state


def from_body(trajectory: Trajectory, body: str, t_s: Array, heliocentric: Array) -> Array:
    """States (n, 6) relative to a body, ICRF, of heliocentric ones (n, 6) at times (n,)."""
    if body == "sun":
        return heliocentric
    ephemeris, epoch = trajectory.forces.ephemeris, trajectory.epoch
    sun = ephemeris.state_km_km_s("sun", epoch, t_s)
    return np.asarray(heliocentric - (ephemeris.state_km_km_s(body, epoch, t_s) - sun))


def _heliocentric_velocity(ephemeris: Ephemeris, body: str, epoch: Epoch, t: float) -> Array:
    """Velocity of a body relative to the Sun, km/s."""
    moving = ephemeris.state_km_km_s(body, epoch, t) - ephemeris.state_km_km_s("sun", epoch, t)
    velocity: Array = moving[0, 3:]
    return velocity


def _refined(edges: Array) -> Array:
    """Four points to each integration step: the steps are short where the motion is fast."""
    fractions = np.arange(4) / 4.0
    inner: Array = (edges[:-1, None] + np.diff(edges)[:, None] * fractions).ravel()
    return inner


def _roots(relative: Callable[[Array], Array], low: Array, high: Array, f_low: Array, f_high: Array) -> Array:
    """Zeros (n,) of r.v, each between low and high (f_low < 0 <= f_high), all together.

    Illinois secant with bisection in reserve.
    """
    found, open_ = 0.5 * (low + high), np.arange(len(low))
    for sweep in range(100):
        a, b, f_a, f_b = low[open_], high[open_], f_low[open_], f_high[open_]
        t = (a * f_b - b * f_a) / (f_b - f_a) if sweep < 50 else 0.5 * (a + b)
        states = relative(t)
        value = np.einsum("ij,ij->i", states[:, :3], states[:, 3:])
        up = value >= 0.0
        f_low[open_] = np.where(up, np.where(value > 0.5 * f_b, 0.5 * f_a, f_a), value)
        f_high[open_] = np.where(up, value, np.where(value < 0.5 * f_a, 0.5 * f_b, f_b))
        low[open_], high[open_] = np.where(up, a, t), np.where(up, t, b)
        found[open_] = t
        speed2 = np.einsum("ij,ij->i", states[:, 3:], states[:, 3:])
        still = (high[open_] - low[open_] >= 1e-6) & (np.abs(value) >= 1e-9 * speed2)
        open_ = open_[still]
        if not open_.size:
            return found
    found[open_] = 0.5 * (low[open_] + high[open_])
    return found


def _norm(a: Analytic) -> Analytic:
    return np.sqrt(a @ a)


def _asymptote(x: Analytic, gm: float) -> Analytic:
    """Unit vector of the incoming asymptote: S = P/e + sqrt(e^2 - 1)/e Q in perifocal axes."""
    r, v = x[:3], x[3:]
    h = np.cross(r, v)
    vector = np.cross(v, h) / gm - r / _norm(r)
    e = _norm(vector)
    p = vector / e
    q = np.cross(h / _norm(h), p)
    return p / e + np.sqrt(e * e - 1.0) / e * q


def _impact_vector(x: Analytic, gm: float) -> Analytic:
    """B = S x h/v_inf of the osculating hyperbola."""
    r, v = x[:3], x[3:]
    return np.cross(_asymptote(x, gm), np.cross(r, v)) / np.sqrt(v @ v - 2.0 * gm / _norm(r))


def _axes(normal: Array, velocity: Array) -> Array:
    """Rows xi, normal, zeta; zeta against the projection of the body's heliocentric velocity."""
    zeta = -(velocity - (velocity @ normal) * normal)
    zeta /= np.linalg.norm(zeta)
    return np.stack([np.cross(normal, zeta), normal, zeta])


def plane_axes(ephemeris: Ephemeris, body: str, epoch: Epoch, t_s: float, state: Array, gm: float) -> Array:
    """Axes (3, 3) of the b-plane of a planetocentric state (6,); of a captured orbit those of its velocity."""
    bound = float(state[3:] @ state[3:]) <= 2.0 * gm / float(np.linalg.norm(state[:3]))
    normal = state[3:] / np.linalg.norm(state[3:]) if bound else _asymptote(state, gm)
    return _axes(normal, _heliocentric_velocity(ephemeris, body, epoch, t_s))


def _complex_step(function: Callable[[Analytic], Analytic], x: Array) -> tuple[Array, Array]:
    """Value and Jacobian of an analytic function of a state."""
    columns = [np.imag(function(x + 1e-40j * unit)) / 1e-40 for unit in np.eye(6)]
    return np.asarray(np.real(function(x.astype(np.complex128)))), np.stack(columns, axis=1)


def _without_time(trajectory: Trajectory, encounter: Encounter, gradient: Array, condition: Array) -> Array:
    """Partials at the perturbed orbit's own crossing: g - (g X') c/(c X'), c = gradient of the crossing condition.

    X' is the rate of the relative state under all forces, by a central difference of the dense output over 2 s (error
    1e-8 of the change it corrects).
    """
    around = relative_state(trajectory, encounter.body)(np.array([encounter.t_s - 1.0, encounter.t_s + 1.0]))
    rate = (around[1] - around[0]) / 2.0
    result: Array = gradient - np.outer(gradient @ rate, condition) / float(condition @ rate)
    return result
