"""Gauss's method: orbits through three directions, for many triplets at once. Units au and days.

Every positive root of the equation of eighth degree in the Sun's distance is followed (Curtis, Orbital Mechanics for
Engineering Students, section 5.10), then f and g are made exact and the times those of emission, by iteration. The Sun
stays where it is while the light travels: 0.01 arcsec.
"""

import numpy as np

from nebosvod.dynamics.twobody_many import lagrange_coefficients
from nebosvod.observation.contracts import Array, Rows

REFINEMENTS = 25
STEP = 0.75  # of the way to the exact f and g in each refinement: whole steps swing about the answer on long arcs
SETTLED = 1e-9  # relative change of the distances at which refinement ends
WANDERED = 0.05  # relative change of the distance above which refinement has left the root it began with
REAL = 1e-4  # imaginary part, relative, below which a root is real: double roots are split by rounding
SPEED_OF_LIGHT_AU_D = 173.14463267424034
FASTEST_AU_D = 0.06  # 104 km/s: above are no orbits of this Sun


def gauss(u: Array, q: Array, t: Array, gm: float) -> tuple[Array, Array, Rows]:
    """Orbits through triplets of directions.

    Parameters
    ----------
    u : shape (m, 3, 3), unit vectors of the three directions of each triplet.
    q : shape (m, 3, 3), the observers from the Sun at reception, au.
    t : shape (m, 3), reception times, ascending, d.
    gm : of the Sun, au^3/d^2.

    Returns
    -------
    states (k, 6), au and au/d, about the Sun; the times (k,) they hold at, those of the middle emission; number (k,) of
    the triplet each belongs to.

    References
    ----------
    Curtis, Orbital Mechanics for Engineering Students, section 5.10.
    """
    triplet, r2 = _roots(u, q, t, gm)
    u, q, t = u[triplet], q[triplet], t[triplet]
    with np.errstate(all="ignore"):
        span = t - t[:, 1:2]
        curve = (gm / r2**3)[:, None]
        distance, states = _through(u, q, 1.0 - 0.5 * curve * span**2, span - curve * span**3 / 6.0)
        refined = _refined(u, q, t, distance, states, gm)
        # where the iteration wanders off, to another root or nowhere, the root itself is worth a least-squares fit
        astray = np.flatnonzero(~(np.abs(refined[0][:, 1] - distance[:, 1]) < WANDERED * distance[:, 1]))
        distance = np.concatenate([refined[0], distance[astray]])
        states = np.concatenate([refined[1], states[astray]])
        triplet = np.concatenate([triplet, triplet[astray]])
        when = np.concatenate([t, t[astray]])[:, 1] - distance[:, 1] / SPEED_OF_LIGHT_AU_D
        speed = np.linalg.norm(states[:, 3:], axis=1)
        fine = np.isfinite(states).all(axis=1) & (distance[:, 1] > 0.0) & (speed < FASTEST_AU_D)
    kept = np.flatnonzero(fine)
    return states[kept], when[kept], triplet[kept]


def _refined(u: Array, q: Array, t: Array, distance: Array, states: Array, gm: float) -> tuple[Array, Array]:
    """Distances (k, 3) and states (k, 6) with exact f and g at the times of emission, as far as iteration goes."""
    f = g = None
    for _ in range(REFINEMENTS):
        before = distance
        when = t - distance / SPEED_OF_LIGHT_AU_D
        exact = lagrange_coefficients(states[:, None], when - when[:, 1:2], gm)
        f = exact[0] if f is None else f + STEP * (exact[0] - f)
        g = exact[1] if g is None else g + STEP * (exact[1] - g)
        better, moved = _through(u, q, f, g)
        good = np.flatnonzero(np.isfinite(moved).all(axis=1) & (better > 0.0).all(axis=1))
        distance, states = distance.copy(), states.copy()
        distance[good], states[good] = better[good], moved[good]
        if not np.any(np.abs(distance - before) > SETTLED * np.abs(before)):
            break
    return distance, states


def _roots(u: Array, q: Array, t: Array, gm: float) -> tuple[Rows, Array]:
    """Number of the triplet and distance from the Sun of every positive root of the equation of eighth degree."""
    p = np.stack([np.cross(u[:, 1], u[:, 2]), np.cross(u[:, 0], u[:, 2]), np.cross(u[:, 0], u[:, 1])], axis=1)
    volume = np.sum(u[:, 0] * p[:, 0], axis=1)
    D = np.einsum("mik,mjk->mij", q, p)
    before, after = t[:, 0] - t[:, 1], t[:, 2] - t[:, 1]
    span = after - before
    with np.errstate(all="ignore"):
        A = (-D[:, 0, 1] * after / span + D[:, 1, 1] + D[:, 2, 1] * before / span) / volume
        B = D[:, 0, 1] * (after**2 - span**2) * after / span + D[:, 2, 1] * (span**2 - before**2) * before / span
        B = B / (6.0 * volume)
        E, square = np.sum(q[:, 1] * u[:, 1], axis=1), np.sum(q[:, 1] ** 2, axis=1)
        coefficients = -np.stack([A**2 + 2.0 * A * E + square, 2.0 * gm * B * (A + E), (gm * B) ** 2], axis=1)
    usable = np.flatnonzero(np.isfinite(coefficients).all(axis=1) & (np.abs(coefficients) < 1e30).all(axis=1))
    companion = np.zeros((usable.size, 8, 8))
    companion[:, np.arange(1, 8), np.arange(7)] = 1.0
    # x^8 + a x^6 + b x^3 + c = 0
    companion[:, 0, 1], companion[:, 0, 4], companion[:, 0, 7] = -coefficients[usable].T
    roots = np.linalg.eigvals(companion) if usable.size else np.empty((0, 8), dtype=np.complex128)
    real = (np.abs(roots.imag) < REAL * np.abs(roots)) & (roots.real > 1e-3) & (roots.real < 1e3)
    which, place = np.nonzero(real)
    numbers: Rows = usable[which]
    return numbers, np.asarray(roots.real[which, place])


def _through(u: Array, q: Array, f: Array, g: Array) -> tuple[Array, Array]:
    """Distances (k, 3) and middle states (k, 6) for Lagrange coefficients f, g (k, 3) of the three times.

    c1 r1 - r2 + c3 r3 = 0 with c1 = g3 / (f1 g3 - f3 g1), c3 = -g1 / (f1 g3 - f3 g1), and r = q + distance u.
    """
    base = f[:, 0] * g[:, 2] - f[:, 2] * g[:, 0]
    c = np.stack([g[:, 2] / base, np.full(base.size, -1.0), -g[:, 0] / base], axis=1)
    M = np.swapaxes(u * c[:, :, None], 1, 2)
    fine = np.isfinite(M).all(axis=(1, 2))
    fine[fine] = np.abs(np.linalg.det(M[fine])) > 1e-30
    distance = np.full((len(u), 3), np.nan)
    right = -np.sum(q * c[:, :, None], axis=1)
    distance[fine] = np.linalg.solve(M[fine], right[fine][:, :, None])[:, :, 0]
    r = q + distance[:, :, None] * u
    v = (f[:, :1] * r[:, 2] - f[:, 2:] * r[:, 0]) / base[:, None]
    return distance, np.concatenate([r[:, 1], v], axis=1)
