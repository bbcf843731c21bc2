"""Compiled loops over the rows (epochs) of an observation: light time, direction, apparent motion, partials.

The only place where these formulas stand. Each loop reads and fills arrays that its caller made, C-contiguous and
writable (another layout would compile a second version), with the epoch on the first axis; nothing is allocated.
All loops stand in one file, because the disk cache of compiled code notices a change of the file that holds a loop and
of `nebosvod.dynamics`, but not of another file here.
"""

import math

import numpy as np

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.observation.contracts import Array

TURN = 2.0 * np.pi
ROUND_OFF = 1e-15  # of a light time: years, for an object at 1e13 km
CORRECTIONS = 10  # of a light time, along the velocity; each gains a factor V/c


@kernel
def first_light_times(gm_sun: float, heliocentric: Array, sun: Array, telescope: Array, tau: Array) -> None:
    """Light times tau (n,) from the state at reception: r - V tau + a tau^2 / 2 with the Sun's pull.

    `heliocentric` is the target's and `sun`, `telescope` are barycentric states (n, 6), all at reception.
    """
    for e in range(tau.shape[0]):
        rx, ry, rz = heliocentric[e, 0], heliocentric[e, 1], heliocentric[e, 2]
        r2 = rx * rx + ry * ry + rz * rz
        pull = -0.5 * gm_sun / (r2 * math.sqrt(r2))
        x = rx + sun[e, 0] - telescope[e, 0]
        y = ry + sun[e, 1] - telescope[e, 1]
        z = rz + sun[e, 2] - telescope[e, 2]
        Vx, Vy, Vz = heliocentric[e, 3] + sun[e, 3], heliocentric[e, 4] + sun[e, 4], heliocentric[e, 5] + sun[e, 5]
        t = 0.0
        for _ in range(3):  # each gains a factor V/c
            fall = pull * t
            bx, by, bz = x + (fall * rx - Vx) * t, y + (fall * ry - Vy) * t, z + (fall * rz - Vz) * t
            t = math.sqrt(bx * bx + by * by + bz * bz) / SPEED_OF_LIGHT_KM_S
        tau[e] = t


@kernel
def lines_of_sight(
    tau: Array, heliocentric: Array, sun: Array, pull: Array, telescope: Array, near_s: float, settled_s: float,
    target: Array, u: Array, distance: Array, light_time: Array, psi: Array,
) -> float:  # fmt: skip
    """Lines of sight at the light times tau (n,), corrected to first order; returns the largest step not settled, s.

    Reads the target's `heliocentric` state (n, 6) at emission t - tau, and at reception the Sun's barycentric state
    `sun` (n, 6) and acceleration `pull` (n, 3) and the telescope's state (n, 6). Newton's step of tau is
    (|rho| - c tau) / (c + u.V); one below `near_s` is taken at once along the velocity of the target, until a row has
    settled to `settled_s`. A larger one is taken too, but its row has not settled: the state at emission must be asked
    for anew. Fills target (n, 6) barycentric, u (n, 3), distance (n,), light_time (n,) = |rho| / c and psi (n, 2);
    moves tau, and the positions of `heliocentric`, to the last step.
    """
    largest = 0.0
    for e in range(tau.shape[0]):
        step, settled, x, y, z = near_s, settled_s, 0.0, 0.0, 0.0
        for _ in range(CORRECTIONS):
            t = tau[e]
            for i in range(3):
                target[e, i] = heliocentric[e, i] + sun[e, i] - t * (sun[e, 3 + i] - 0.5 * t * pull[e, i])
                target[e, 3 + i] = heliocentric[e, 3 + i] + sun[e, 3 + i] - t * pull[e, i]
            x, y, z = target[e, 0] - telescope[e, 0], target[e, 1] - telescope[e, 1], target[e, 2] - telescope[e, 2]
            d = math.sqrt(x * x + y * y + z * z)
            u[e, 0], u[e, 1], u[e, 2] = x / d, y / d, z / d
            speed = u[e, 0] * target[e, 3] + u[e, 1] * target[e, 4] + u[e, 2] * target[e, 5]
            step = (d - SPEED_OF_LIGHT_KM_S * t) / (SPEED_OF_LIGHT_KM_S + speed)
            distance[e] = d
            light_time[e] = d / SPEED_OF_LIGHT_KM_S
            settled = settled_s + ROUND_OFF * abs(t)
            if abs(step) <= settled:
                break
            tau[e] = t + step
            if not abs(step) < near_s:
                break
            for i in range(3):
                heliocentric[e, i] -= heliocentric[e, 3 + i] * step
        if largest == largest and not abs(step) <= max(largest, settled):  # nan counts as large, and stays
            largest = abs(step)
        psi[e, 0], psi[e, 1] = _ra_dec(x, y, z)
    return largest


@kernel
def _ra_dec(x: float, y: float, z: float) -> tuple[float, float]:
    """Right ascension in [0, 2 pi) and declination of one vector."""
    ra = math.atan2(y, x)
    if ra < 0.0:
        ra += TURN
    # a tiny negative angle plus 2 pi rounds to 2 pi itself, which is outside the interval
    if ra >= TURN:
        ra = 0.0
    return ra, math.atan2(z, math.hypot(x, y))


@kernel
def directions(vectors: Array, psi: Array) -> None:
    """Right ascension and declination psi (n, 2) of vectors (n, 3)."""
    for e in range(psi.shape[0]):
        psi[e, 0], psi[e, 1] = _ra_dec(vectors[e, 0], vectors[e, 1], vectors[e, 2])


@kernel
def sky_partials(target: Array, u: Array, distance: Array, DL: Array) -> None:
    """D L (n, 2, 3): partials of (cos Dec dRA, dDec) by the target's position less the telescope's, rad/km.

    D = (east, north) / distance; L = I - V u^T / (c + u.V) is how rho moves with the target at emission. The axes come
    from u, not from sines of psi: a third of the time, and they stay orthonormal at the poles, where RA is 0.
    """
    for e in range(distance.shape[0]):
        ux, uy, uz = u[e, 0], u[e, 1], u[e, 2]
        Vx, Vy, Vz = target[e, 3], target[e, 4], target[e, 5]
        across = math.sqrt(ux * ux + uy * uy)
        cos_ra, sin_ra = 1.0, 0.0
        if across > 0.0:
            cos_ra, sin_ra = ux / across, uy / across
        nx, ny = -uz * cos_ra, -uz * sin_ra
        scale = 1.0 / (SPEED_OF_LIGHT_KM_S + ux * Vx + uy * Vy + uz * Vz)
        east = (cos_ra * Vy - sin_ra * Vx) * scale
        north = (nx * Vx + ny * Vy + across * Vz) * scale
        per_km = 1.0 / distance[e]
        DL[e, 0, 0], DL[e, 0, 1], DL[e, 0, 2] = (
            (-sin_ra - east * ux) * per_km,
            (cos_ra - east * uy) * per_km,
            -east * uz * per_km,
        )
        DL[e, 1, 0], DL[e, 1, 1], DL[e, 1, 2] = (
            (nx - north * ux) * per_km,
            (ny - north * uy) * per_km,
            (across - north * uz) * per_km,
        )


@kernel
def apparent_rates(DL: Array, target: Array, telescope: Array, rate: Array) -> None:
    """Apparent motion (n, 2) in RA cos Dec and Dec, rad/s: D L (V - v_telescope)."""
    for e in range(rate.shape[0]):
        for a in range(2):
            rate[e, a] = 0.0
            for i in range(3):
                rate[e, a] += DL[e, a, i] * (target[e, 3 + i] - telescope[e, 3 + i])


@kernel
def emission_partials(variations: Array, chain: Array, Phi: Array, zeta: Array) -> None:
    """Partials of the position at emission, Phi (n, 3, 6) and zeta (n, 3, m), from integrated columns.

    variations (n, 6, 6 + q) are the columns of the integration, chain (q, m) maps the last q to the m parameters.
    """
    q, m = chain.shape
    for e in range(Phi.shape[0]):
        for i in range(3):
            for j in range(6):
                Phi[e, i, j] = variations[e, i, j]
            for j in range(m):
                s = 0.0
                for k in range(q):
                    s += variations[e, i, 6 + k] * chain[k, j]
                zeta[e, i, j] = s


@kernel
def measurement_partials(
    gm_sun: float, DL: Array, heliocentric: Array, tau: Array, Phi: Array, zeta: Array,
    H_x: Array, H_z: Array, H: Array,
) -> None:  # fmt: skip
    """H_x (n, 2, 6), H_z (n, 2, 3) and H = [H_x0 | H_c] (n, 2, 6 + m); see `astrometry.observe` for the equations.

    DL (n, 2, 3), the target's heliocentric state (n, 6) at emission, light time tau (n,), Phi (n, 3, 6) and zeta
    (n, 3, m) of the position at emission by the state at the epoch and the parameters.
    """
    m = zeta.shape[2]
    for e in range(tau.shape[0]):
        x, y, z, t = heliocentric[e, 0], heliocentric[e, 1], heliocentric[e, 2], tau[e]
        per_r2 = 1.0 / (x * x + y * y + z * z)
        g = gm_sun * per_r2 * math.sqrt(per_r2)
        once, twice = t * t / 2.0, t * t * t / 6.0
        for a in range(2):
            p, q, s = DL[e, a, 0], DL[e, a, 1], DL[e, a, 2]
            H_z[e, a, 0], H_z[e, a, 1], H_z[e, a, 2] = -p, -q, -s
            for j in range(6):
                H[e, a, j] = p * Phi[e, 0, j] + q * Phi[e, 1, j] + s * Phi[e, 2, j]
            for j in range(m):
                H[e, a, 6 + j] = p * zeta[e, 0, j] + q * zeta[e, 1, j] + s * zeta[e, 2, j]
            # D L G with the Sun's gravity gradient G = g (3 r r^T / r^2 - I)
            along = 3.0 * (p * x + q * y + s * z) * per_r2
            for i in range(3):
                pulled = g * (along * heliocentric[e, i] - DL[e, a, i])
                H_x[e, a, i] = DL[e, a, i] + once * pulled
                H_x[e, a, 3 + i] = -t * DL[e, a, i] - twice * pulled
