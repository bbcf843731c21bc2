"""How an error of a spacecraft's orbit grows: the transition matrix along the orbit it actually flies.

One mechanism serves every kind of orbit: the variational equations of free fall in the gravity of Sun, Earth and Moon,
along the track that the spacecraft gives. It needs no elements, so it holds for tables, files and halo orbits alike
(about L1 and L2 it finds their instability by itself). In low orbit the Earth's J2 is in it: a track flown in it and
a gradient without it part by half an e-fold a revolution. Manoeuvres, other harmonics and drag are not in it.
"""

import numpy as np

from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Rows
from nebosvod.observation.earth.constants import EARTH_J2
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs
from nebosvod.observation.spacecraft.kinds import Spacecraft
from nebosvod.timescale import Epoch

ATTRACTORS = ("sun", "earth", "moon")
# Step of the integration in units of 1/sqrt(2 GM/r^3): 444 steps a revolution. The relative error, fourth order, is
# 3e-6 after five revolutions with e = 0.3 (0.05: 1e-4).
STEP_PHASE = 0.02
FLATTENED_KM = 2e4  # from the Earth's centre, below which its J2 (3e-4 of the gradient and more) is counted
SURVEY = 512  # track points that decide the step
MAX_STEPS = 2_000_000
CHUNK = 16_384  # steps held in memory at a time
TAYLOR_ORDER = 8  # of exp(Omega / 16), whose size is 1/16: remainder 1e-16


def transitions(spacecraft: Spacecraft, ephemeris: Ephemeris, epoch: Epoch, start_s: Array, t_s: Array) -> Array:
    """Partials (n, 6, 6) of the spacecraft's state at `t_s` by its state at `start_s`, both (n,), ICRF, km and km/s.

    Times may repeat and come in any order; rows that share a start share the work.

    Raises
    ------
    InputError
        If the orbit is so tight, or the arc so long, that the integration would take over two million steps.

    Notes
    -----
    dPhi/dt = [[0, I], [G(t), 0]] Phi with the gravity gradient G, by the fourth-order Magnus expansion on two Gauss
    points a step: every step is an exact exponential, so a circular orbit keeps its invariants for any length of arc.
    """
    Phi = np.empty((t_s.size, 6, 6))
    stated = getattr(spacecraft, "transitions", None)  # an orbit by elements has them in closed form
    for start in np.unique(start_s):
        mine = np.flatnonzero(start_s == start)
        if stated is not None:
            Phi[mine] = stated(ephemeris, epoch, float(start), t_s[mine])
            continue
        for side in (mine[t_s[mine] >= start], mine[t_s[mine] < start][::-1]):
            if side.size:
                order = side[np.argsort(np.abs(t_s[side] - start), kind="stable")]
                Phi[order] = _march(spacecraft, ephemeris, epoch, float(start), t_s[order])
    return Phi


def _march(spacecraft: Spacecraft, ephemeris: Ephemeris, epoch: Epoch, start: float, stops: Array) -> Array:
    """Transitions (k, 6, 6) from `start` to `stops`, which lie on one side of it, nearest first."""
    edges = np.concatenate([[start], stops])
    survey = np.linspace(edges[0], edges[-1], min(SURVEY, 2 + 8 * stops.size))
    fastest = np.sqrt(np.max(np.abs(_gradient(spacecraft, ephemeris, epoch, survey)))) + 1e-12
    counts = np.ceil(np.abs(np.diff(edges)) * fastest / STEP_PHASE).astype(np.int64)
    if counts.sum() > MAX_STEPS:
        raise InputError(
            f"orbit error: {counts.sum()} integration steps for one interval (allowed {MAX_STEPS}); "
            "give the orbit error a shorter renewal"
        )
    lengths = np.repeat(np.diff(edges) / np.maximum(counts, 1), counts)
    begins = np.repeat(edges[:-1], counts) + lengths * _ranks(counts)
    stop_after = np.cumsum(counts)
    current, found = np.eye(6), np.tile(np.eye(6), (stops.size, 1, 1))
    for place in range(0, lengths.size, CHUNK):
        chunk = slice(place, place + CHUNK)
        for number, step in enumerate(_step_matrices(spacecraft, ephemeris, epoch, begins[chunk], lengths[chunk])):
            current = step @ current
            reached = np.searchsorted(stop_after, place + number + 1)
            if stop_after[reached] == place + number + 1:
                found[stop_after == place + number + 1] = current
    return found


def _ranks(counts: Rows) -> Array:
    """0, 1, ..., counts[0] - 1, 0, 1, ..., counts[1] - 1, ... as floats."""
    ends = np.cumsum(counts)
    return np.arange(ends[-1] if counts.size else 0) - np.repeat(ends - counts, counts).astype(np.float64)


def _step_matrices(spacecraft: Spacecraft, ephemeris: Ephemeris, epoch: Epoch, begins: Array, lengths: Array) -> Array:
    """exp(Omega) (k, 6, 6) of each step; velocities are scaled by the step inside, so that entries are of one size."""
    half, root = 0.5, np.sqrt(3.0) / 6.0
    first = _gradient(spacecraft, ephemeris, epoch, begins + (half - root) * lengths)
    second = _gradient(spacecraft, ephemeris, epoch, begins + (half + root) * lengths)
    h = lengths[:, None, None]
    Omega = np.zeros((lengths.size, 6, 6))
    Omega[:, :3, 3:] = np.eye(3)
    Omega[:, 3:, :3] = h**2 * (first + second) / 2.0
    # sqrt(3)/12 h^2 [A2, A1], and [A2, A1] = diag(G1 - G2, G2 - G1)
    twist = root / 2.0 * h**2 * (first - second)
    Omega[:, :3, :3] = twist
    Omega[:, 3:, 3:] = -twist
    result = _exponential(Omega)
    result[:, :3, 3:] *= h
    result[:, 3:, :3] /= h
    return result


def _exponential(Omega: Array) -> Array:
    """exp of matrices (k, 6, 6) of size 1, mostly the identity in the upper right block: four halvings, Taylor."""
    small = Omega / 16.0
    term = np.broadcast_to(np.eye(6), Omega.shape)
    total = term.copy()
    for order in range(1, TAYLOR_ORDER + 1):
        term = term @ small / order
        total += term
    for _ in range(4):
        total = total @ total
    return total


def _gradient(spacecraft: Spacecraft, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
    """Gravity gradient (n, 3, 3), 1/s^2, at the spacecraft."""
    place = spacecraft.state_km_km_s(ephemeris, epoch, t_s)[:, :3]
    G = np.zeros((t_s.size, 3, 3))
    for body in ATTRACTORS:
        r = place - ephemeris.position_km(body, epoch, t_s)
        distance = np.linalg.norm(r, axis=1)[:, None, None]
        u = r[:, :, None] / distance
        G += ephemeris.gm_km3_s2[body] / distance**3 * (3.0 * u * np.swapaxes(u, 1, 2) - np.eye(3))
        low = distance[:, 0, 0] < FLATTENED_KM
        if body == "earth" and low.any():
            G[low] += ephemeris.gm_km3_s2[body] * _flattening(r[low], R_icrf_from_cirs(epoch, t_s[low])[:, :, 2])
    return G


def _flattening(r: Array, pole: Array) -> Array:
    """Gradient (n, 3, 3), 1/km^3, of the attraction of J2 at r (n, 3) from the centre, over GM.

    The Hessian of -J2 R^2/2 (3 z^2/r^5 - 1/r^3), z along the pole (n, 3).
    """
    one, z = np.eye(3), np.einsum("ni,ni->n", r, pole)[:, None, None]
    d = np.linalg.norm(r, axis=1)[:, None, None]
    rr, pp = (v[:, :, None] * v[:, None, :] for v in (r, pole))
    pr = pole[:, :, None] * r[:, None, :]
    inverse_cube = 15.0 * rr / d**7 - 3.0 * one / d**5
    with_pole = 2.0 * pp / d**5 - 10.0 * z * (pr + np.swapaxes(pr, 1, 2)) / d**7
    with_pole = with_pole + z**2 * (35.0 * rr / d**9 - 5.0 * one / d**7)
    hessian: Array = -0.5 * EARTH_J2 * RADIUS_KM["earth"] ** 2 * (3.0 * with_pole - inverse_cube)
    return hessian
