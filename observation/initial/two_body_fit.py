"""Least squares of many candidate orbits at once, good enough to tell which of them can be the start of a real fit.

The Sun's gravity is exact (universal variables); Earth, Moon and Jupiter act through their displacement of the orbit,
integrated twice along it (Picard). Units au, days, rad; residuals in units of their sigma, with the weights of a Cauchy
distribution, so that gross errors lose their pull.
"""

from dataclasses import dataclass, replace

import numpy as np

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.initial.arc_rows import fill_displacements, fill_partials, fill_residuals, fill_shifts
from nebosvod.timescale import Epoch

PERTURBERS = ("earth", "moon", "jupiter")
NODES = 65  # at which the pull of the perturbers is taken, evenly over the arc
PICARD = 2
STEPS = 12
KEPT = 0.8  # share of the residuals, the smallest ones, that the rms of a candidate counts
STEP = 1e-6  # of numerical partials, relative to the distance
HOPELESS = 10.0  # damping at which a candidate that gets no better is given up
LEAST_SCALE = 1.0  # of the Cauchy weights, in sigmas
DIVERGED = 1e6  # cost of a candidate that cannot be computed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arc:
    """Directions of one object over a short time, with what is needed to compute them.

    Attributes
    ----------
    t : (m,) reception times, ascending, d; t0 : time the states hold at, within them or near.
    u, east, north : (m, 3) unit vectors of the directions and their tangent axes.
    q : (m, 3) observer from the Sun, au.
    sigma : (m, 2), rad, of RA cos Dec and Dec.
    nodes : (NODES,) times, d; pullers : (NODES, b, 3) perturbers from the Sun there, au; pulls : (b,) their GM.
    gm : of the Sun, au^3/d^2.
    """

    t: Array
    t0: float
    u: Array
    east: Array
    north: Array
    q: Array
    sigma: Array
    nodes: Array
    pullers: Array
    pulls: Array
    gm: float

    @classmethod
    def of(cls, epoch: Epoch, t_s: Array, psi: Array, sigma: Array, observer: Array, ephemeris: Ephemeris) -> "Arc":
        """The arc of directions psi (m, 2) seen at t_s by observers (m, 6), barycentric ICRF, km and km/s."""
        sun = ephemeris.position_km("sun", epoch, t_s)
        cos_ra, sin_ra, cos_dec, sin_dec = np.cos(psi[:, 0]), np.sin(psi[:, 0]), np.cos(psi[:, 1]), np.sin(psi[:, 1])
        zero = np.zeros_like(cos_ra)
        pad = 0.01 * np.ptp(t_s) + 60.0
        nodes_s = np.linspace(t_s.min() - pad, t_s.max() + pad, NODES)
        centre = ephemeris.position_km("sun", epoch, nodes_s)
        places = [ephemeris.position_km(body, epoch, nodes_s) - centre for body in PERTURBERS]
        unit = DAY_S**2 / AU_KM**3
        return cls(
            t=t_s / DAY_S,
            t0=float(0.5 * (t_s.min() + t_s.max()) / DAY_S),
            u=np.stack([cos_dec * cos_ra, cos_dec * sin_ra, sin_dec], axis=1),
            east=np.stack([-sin_ra, cos_ra, zero], axis=1),
            north=np.stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec], axis=1),
            q=(observer[:, :3] - sun) / AU_KM,
            sigma=sigma,
            nodes=nodes_s / DAY_S,
            pullers=np.stack(places, axis=1) / AU_KM,
            pulls=unit * np.array([ephemeris.gm_km3_s2[body] for body in PERTURBERS]),
            gm=unit * ephemeris.gm_km3_s2["sun"],
        )

    def thinned(self, most: int) -> "Arc":
        """The same arc with at most so many of its directions, spread over their times."""
        if self.t.size <= most:
            return self
        rows = np.unique(np.searchsorted(self.t, np.linspace(self.t[0], self.t[-1], most)))
        names = ("t", "u", "east", "north", "q", "sigma")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def displacements(arc: Arc, states: Array) -> tuple[Array, Array]:
    """What the perturbers add to position and velocity of each orbit (k, 6) at the arc's nodes, both (k, NODES, 3).

    Notes
    -----
    The displacement is carried along straight lines, so it holds for arcs short against the orbit (a month of a
    near-Earth orbit: 10 %), and fails within the last hour before an impact.
    """
    step = arc.nodes[1] - arc.nodes[0]
    home = float(np.clip((arc.t0 - arc.nodes[0]) / step, 0.0, NODES - 1.000001))
    states = _filled(states)
    dr, dv = np.empty((2, len(states), NODES, 3))
    path, pull = np.empty((2, 1, NODES, 3))
    times = arc.nodes - arc.t0
    fill_displacements(arc.gm, times, home, arc.pullers, arc.pulls, PICARD, states, path, pull, dr, dv)
    return dr, dv


def _filled(values: Array) -> Array:
    """The same as the loops want it: one layout, one compiled version."""
    return np.require(values, np.float64, ("C", "W"))


def _loops(arc: Arc) -> tuple[float, Array, Array, Array, Array, Array, Array]:
    """What the loops over directions read of an arc."""
    rows = (arc.t - arc.t0, arc.q, arc.u, arc.east, arc.north, arc.sigma)
    t, q, u, east, north, sigma = (_filled(values) for values in rows)
    return arc.gm, t, q, u, east, north, sigma


def residuals(arc: Arc, states: Array, shift: Array) -> Array:
    """Observed minus computed (k, 2 m) in sigmas, RA cos Dec and Dec of each direction in turn.

    Parameters
    ----------
    states : shape (k, 6), about the Sun at `arc.t0`, au and au/d.
    shift : shape (k, m, 3), displacement by the perturbers (`shifts`).
    """
    v = np.empty((len(states), 2 * arc.t.size))
    fill_residuals(*_loops(arc), _filled(states), _filled(shift), v)
    return v


def shifts(arc: Arc, states: Array) -> Array:
    """Displacement (k, m, 3) of each orbit by the perturbers at the arc's times."""
    dr, dv = displacements(arc, states)
    shift = np.empty((len(states), arc.t.size, 3))
    fill_shifts(_filled(arc.t), arc.nodes, dr, dv, shift)
    return shift


def improve(arc: Arc, states: Array, *, free: str = "all", steps: int = STEPS) -> tuple[Array, Array]:
    """Corrected states (k, 6) and the cost (k,) of each, the mean of log(1 + v^2) over the residuals v in sigmas.

    Parameters
    ----------
    free : "all" six numbers of the state, or the direction and its rate alone ("sky"), with distance and range rate
        held.

    Notes
    -----
    Levenberg's damping for each candidate by itself, on parameters scaled to the distance and the arc.
    """
    states = states.copy()
    damping = np.full(len(states), 1e-3)
    with np.errstate(all="ignore"):
        shift = shifts(arc, states)
        v = residuals(arc, states, shift)
        cost = costs(v)
        for _ in range(steps):
            basis = _basis(arc, states, free)
            J, w = _partials(arc, states, basis, v, shift), 1.0 / np.sqrt(1.0 + (v / _scale(v)[:, None]) ** 2)
            p = _damped(J * w[:, :, None], v * w, damping)
            trial = states + np.einsum("kij,kj->ki", basis, p)
            moved_shift = shifts(arc, trial)
            moved = residuals(arc, trial, moved_shift)
            new = costs(moved)
            better = new < cost
            gain = np.where(better, cost - new, 0.0)
            states[better], v[better], shift[better] = trial[better], moved[better], moved_shift[better]
            cost = np.where(better, new, cost)
            damping = np.clip(np.where(better, 0.1 * damping, 10.0 * damping), 1e-12, 1e8)
            if not np.any(gain > 1e-3 * (1e-2 + cost)) and np.all(better | (damping > HOPELESS)):
                break
    return states, cost


def costs(v: Array) -> Array:
    """Mean of log(1 + v^2) of residuals (k, n) in sigmas; DIVERGED where one is not finite."""
    value = np.mean(np.log1p(v * v), axis=1)
    return np.where(np.isfinite(value), value, DIVERGED)


def trimmed_rms(v: Array) -> Array:
    """Root mean square (k,) of the smaller part (KEPT) of the residuals (k, n)."""
    kept = max(1, int(np.ceil(KEPT * v.shape[1])))
    return np.asarray(np.sqrt(np.mean(np.sort(np.abs(v), axis=1)[:, :kept] ** 2, axis=1)))


def _scale(v: Array) -> Array:
    """Scale (k,) of the Cauchy weights: the spread of the inner half."""
    return np.maximum(1.4826 * np.median(np.abs(v), axis=1), LEAST_SCALE)


def _basis(arc: Arc, states: Array, free: str) -> Array:
    """Changes of the state (k, 6, p) by each parameter: a radian of direction at t0, or gained over the arc."""
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    rho = states[:, :3] - arc.q[middle]
    distance = np.linalg.norm(rho, axis=1)
    span = max(np.ptp(arc.t), 1e-3)
    if free == "all":
        axes = np.broadcast_to(np.eye(3), (len(states), 3, 3))
    else:
        axes = np.broadcast_to(np.stack([arc.east[middle], arc.north[middle]], axis=1), (len(states), 3, 2))
    basis = np.zeros((len(states), 6, 2 * axes.shape[2]))
    basis[:, :3, : axes.shape[2]] = distance[:, None, None] * axes
    basis[:, 3:, axes.shape[2] :] = (distance / span)[:, None, None] * axes
    return basis


def _partials(arc: Arc, states: Array, basis: Array, v: Array, shift: Array) -> Array:
    """Partials (k, n, p) of minus the residuals by the scaled parameters; the perturbers' shift is held."""
    k, _, p = basis.shape
    stepped = (states[:, None] + STEP * np.swapaxes(basis, 1, 2)).reshape(k * p, 6)
    J = np.empty((k, v.shape[1], p))
    fill_partials(*_loops(arc), _filled(states), _filled(shift), _filled(v), _filled(stepped), STEP, J)
    return J


def _damped(J: Array, v: Array, damping: Array) -> Array:
    """Steps (k, p) that minimise |v - J p|^2 + damping |D p|^2, D the lengths of the columns; nan stays at home."""
    p = J.shape[2]
    length = np.linalg.norm(J, axis=1)
    fine = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(v).all(axis=1) & (length > 0.0).all(axis=1)
    step = np.zeros((len(J), p))
    if fine.any():
        scaled = J[fine] / length[fine][:, None]
        rows = np.sqrt(damping[fine])[:, None, None] * np.eye(p)
        Q, R = np.linalg.qr(np.concatenate([scaled, rows], axis=1))
        right = np.einsum("kij,ki->kj", Q[:, : J.shape[1]], v[fine])
        step[fine] = np.linalg.solve(R, right[:, :, None])[:, :, 0] / length[fine]
    return step
