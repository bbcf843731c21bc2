"""Which orbits circle the Earth so that neither Moon nor Sun brings them down: they need not be flown.

A hundred days of a satellite are a hundred revolutions; a cloud of a thousand such took one to four seconds to say that
none falls. What moves a perigee is the pull of Moon and Sun, averaged over a revolution: a vector of eccentricity and
one of angular momentum, which go by steps of two days. To what these say is added what an average leaves out.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.constants import DAY_S, EARTH_RADIUS_KM
from nebosvod.first_hour.tracklet import Tracklet

Array = npt.NDArray[np.float64]
NEAREST_KM = {"moon": 356_400.0, "sun": 147.09e6}  # from the Earth
HIGHEST = 0.5  # of the Moon's least distance, to which an apogee may grow: beyond, averages say little
SAFE = 1.02  # radii, above which a perigee is high
FLAT_KM = 30.0  # by which J2 and J3 move it within a revolution and within a year, and more
J2 = 1.0826e-3
STEP_S = 2.0 * DAY_S
# Left out of de/dt, which is at most 15/2 sum(GM / d^3) / n e sqrt(1 - e^2): a whole revolution of that, for what goes
# on within one; for the Moon's parallax, a / d of it, half a month, after which it has the other sign.
STRONGEST, FORTNIGHT_S = 7.5, 13.7 * DAY_S


def lowest_perigee(tracklet: Tracklet, states: Array, within_d: float) -> Array:
    """The least perigee (m,), km, that heliocentric states (m, 6) may come to; nan where it may be on the ground.

    References
    ----------
    Tremaine, Touma and Namouni 2009, Astronomical Journal 137, 3706, on averaged perturbations by vectors.
    """
    ephemeris, now = tracklet.forces.ephemeris, np.zeros(1)
    earth, sun = (ephemeris.state_km_km_s(body, tracklet.epoch, now)[0] for body in ("earth", "sun"))
    away, gm = states - (earth - sun), ephemeris.gm_km3_s2["earth"]
    r, v = away[:, :3], away[:, 3:]
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(r, axis=1)
        a = 1.0 / (2.0 / distance - np.sum(v**2, axis=1) / gm)
        h = np.cross(r, v)
        e = np.cross(v, h) / gm - r / distance[:, None]
        n = np.sqrt(gm / a**3)
        j = h / (n * a**2)[:, None]
        pulls = {body: ephemeris.gm_km3_s2[body] / far**3 for body, far in NEAREST_KM.items()}
        within_one = STRONGEST * 2.0 * np.pi * sum(pulls.values()) / n**2
        parallax = STRONGEST * pulls["moon"] / n * a / NEAREST_KM["moon"] * FORTNIGHT_S
        left_out = within_one + parallax + FLAT_KM / a
        eccentricity = np.linalg.norm(e, axis=1)
        some = np.flatnonzero(_stays(a, eccentricity + left_out))
    found = np.full(len(states), np.nan)
    if some.size:
        most = np.empty(some.size)
        flat = J2 * (EARTH_RADIUS_KM / a[some]) ** 2
        fill_largest(e[some], j[some], n[some], flat, *_pulling(tracklet, within_d), most)
        most += left_out[some]
        found[some] = np.where(_stays(a[some], most), a[some] * (1.0 - most), np.nan)
    return found


def _stays(a: Array, e: Array) -> npt.NDArray[np.bool_]:
    """Which orbits (m,) of these semi-major axes and largest eccentricities are above the ground and below the Moon."""
    found: npt.NDArray[np.bool_] = (a > 0.0) & (a * (1.0 + e) < HIGHEST * NEAREST_KM["moon"])
    return found & (a * (1.0 - e) > SAFE * EARTH_RADIUS_KM)


def _pulling(tracklet: Tracklet, within_d: float) -> tuple[Array, Array, float]:
    """Directions (b, s, 3) and 3/2 GM / d^3 (b, s) of Moon and Sun at ends and middles of steps, and their length."""
    count = max(int(np.ceil(within_d * DAY_S / STEP_S)), 1)
    t_s = np.linspace(0.0, within_d * DAY_S, 2 * count + 1)
    ephemeris = tracklet.forces.ephemeris
    earth = ephemeris.position_km("earth", tracklet.epoch, t_s)
    away = np.stack([ephemeris.position_km(body, tracklet.epoch, t_s) - earth for body in NEAREST_KM])
    far = np.linalg.norm(away, axis=2)
    gm = np.array([ephemeris.gm_km3_s2[body] for body in NEAREST_KM])
    return away / far[..., None], 1.5 * gm[:, None] / far**3, within_d * DAY_S / count


@kernel
def fill_largest(e: Array, j: Array, n: Array, flat: Array, u: Array, pull: Array, step_s: float, most: Array) -> None:
    """Fill the largest eccentricities (m,) of orbits on the way, by Runge and Kutta.

    Parameters
    ----------
    e, j : (m, 3) vectors of eccentricity and of angular momentum, this in parts of that of a circle of the same axis.
        They are changed.
    n : (m,) mean motions. flat : (m,) J2 R^2 / a^2, about the pole of ICRF.
    u, pull : (b, 2 s + 1, 3) and (b, 2 s + 1) of the bodies that pull, as of `_pulling`.
    """
    for o in range(e.shape[0]):
        most[o] = 0.0
        for s in range((pull.shape[1] - 1) // 2):
            x = (e[o, 0], e[o, 1], e[o, 2], j[o, 0], j[o, 1], j[o, 2])
            a = slope(x, n[o], flat[o], u, pull, 2 * s)
            b = slope(moved(x, a, 0.5 * step_s), n[o], flat[o], u, pull, 2 * s + 1)
            c = slope(moved(x, b, 0.5 * step_s), n[o], flat[o], u, pull, 2 * s + 1)
            d = slope(moved(x, c, step_s), n[o], flat[o], u, pull, 2 * s + 2)
            x = moved(moved(moved(moved(x, a, step_s / 6.0), b, step_s / 3.0), c, step_s / 3.0), d, step_s / 6.0)
            e[o, 0], e[o, 1], e[o, 2], j[o, 0], j[o, 1], j[o, 2] = x
            most[o] = max(most[o], np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]))


Six = tuple[float, float, float, float, float, float]


@kernel
def moved(x: Six, rate: Six, t: float) -> Six:
    """A time further on."""
    return (
        x[0] + t * rate[0], x[1] + t * rate[1], x[2] + t * rate[2],
        x[3] + t * rate[3], x[4] + t * rate[4], x[5] + t * rate[5],
    )  # fmt: skip


@kernel
def slope(x: Six, n: float, flat: float, u: Array, pull: Array, at: int) -> Six:
    """Rates of both vectors: of the flat Earth and of the quadrupole of each body."""
    ex, ey, ez, jx, jy, jz = x
    j2 = jx * jx + jy * jy + jz * jz
    k = 0.25 * n * flat / (j2 * j2 * np.sqrt(j2))
    along = k * (15.0 * jz * jz / j2 - 3.0)  # of e x j; and of the pole
    pole = 6.0 * k * jz
    dex, dey, dez = pole * ey - along * (ey * jz - ez * jy), -pole * ex - along * (ez * jx - ex * jz), 0.0
    dez -= along * (ex * jy - ey * jx)
    djx, djy, djz = pole * jy, -pole * jx, 0.0
    for b in range(pull.shape[0]):
        w, ux, uy, uz = pull[b, at] / n, u[b, at, 0], u[b, at, 1], u[b, at, 2]
        eu, ju = ex * ux + ey * uy + ez * uz, jx * ux + jy * uy + jz * uz
        ax, ay, az = jy * uz - jz * uy, jz * ux - jx * uz, jx * uy - jy * ux  # j x u
        bx, by, bz = ey * uz - ez * uy, ez * ux - ex * uz, ex * uy - ey * ux  # e x u
        dex -= w * (2.0 * (jy * ez - jz * ey) - 5.0 * eu * ax + ju * bx)
        dey -= w * (2.0 * (jz * ex - jx * ez) - 5.0 * eu * ay + ju * by)
        dez -= w * (2.0 * (jx * ey - jy * ex) - 5.0 * eu * az + ju * bz)
        djx -= w * (ju * ax - 5.0 * eu * bx)
        djy -= w * (ju * ay - 5.0 * eu * by)
        djz -= w * (ju * az - 5.0 * eu * bz)
    return dex, dey, dez, djx, djy, djz
