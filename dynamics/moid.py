"""The smallest distance between two osculating orbits (MOID), wherever the bodies are on them.

The distance from a point of one orbit to the other, nearly circular one is a smooth function of the true anomaly: the
nearest point is found by Newton from the direction, then the minima by anomaly are bracketed on a grid and refined.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.ephemeris import Ephemeris
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
GRID = 1440
NEWTON = 30
ZOOMS, ZOOM = 7, 16  # how often, and into how many parts of half a bracket: to 5e-9 rad, where a distance is flat
TOUCHING_KM = 1e-3  # below which the gap has no direction
FARTHEST_KM = 3e10  # 200 au: of an orbit that does not return only so much is looked at


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conic:
    """An orbit as a curve: semi-latus rectum, eccentricity, unit vectors to the perihelion and a quarter turn ahead."""

    p_km: float
    e: float
    axes: Array

    def at(self, anomaly: Array) -> Array:
        """Points (n, 3) at true anomalies (n,)."""
        r = self.p_km / (1.0 + self.e * np.cos(anomaly))
        points: Array = (r * np.cos(anomaly))[:, None] * self.axes[0] + (r * np.sin(anomaly))[:, None] * self.axes[1]
        return points


def conic(state: Array, gm_km3_s2: float) -> Conic:
    """The osculating orbit of a heliocentric state (6,)."""
    r, v = state[:3], state[3:]
    h = np.cross(r, v)
    toward = np.cross(v, h) / gm_km3_s2 - r / np.linalg.norm(r)
    e = float(np.linalg.norm(toward))
    first = toward / e if e > 1e-12 else r / np.linalg.norm(r)
    second = np.cross(h / np.linalg.norm(h), first)
    return Conic(p_km=float(h @ h) / gm_km3_s2, e=e, axes=np.stack([first, second]))


def moid_km(orbit: Conic, other: Conic) -> tuple[float, float]:
    """Smallest distance of two orbits, and the true anomaly of the first where it is; `other` is nearly circular."""
    step = 2.0 * np.pi / GRID
    grid = np.arange(GRID) * step - np.pi
    there = grid[1.0 + orbit.e * np.cos(grid) > orbit.p_km / FARTHEST_KM]
    if not there.size:  # all of it is farther: nearest at its perihelion, as near as one can say
        there = np.zeros(1)
    values = _to_orbit(orbit.at(there), other)
    starts = there[(values <= np.roll(values, 1)) & (values <= np.roll(values, -1))]
    for _ in range(ZOOMS):
        step *= 2.0 / ZOOM
        near = starts[:, None] + step * np.arange(-ZOOM, ZOOM + 1)
        values = _to_orbit(orbit.at(near.ravel()), other).reshape(near.shape)
        best = np.argmin(values, axis=1)
        starts = near[np.arange(len(near)), best]
    least = values.min(axis=1)
    k = int(np.argmin(least))
    return float(least[k]), float(starts[k])


def earth_conic(ephemeris: Ephemeris, epoch: Epoch) -> Conic:
    """The osculating heliocentric orbit of the Earth's centre with the GM of the Sun alone, as JPL and ESA take it.

    The Moon shakes it by 4e-4 au; that is in every published MOID.
    """
    now = np.zeros(1)
    state = ephemeris.state_km_km_s("earth", epoch, now)[0] - ephemeris.state_km_km_s("sun", epoch, now)[0]
    return conic(state, ephemeris.gm_km3_s2["sun"])


def earth_moid_km(state: Array, factor: Array, ephemeris: Ephemeris, epoch: Epoch) -> tuple[float, float]:
    """MOID with the Earth's orbit and its 1 sigma, km.

    Parameters
    ----------
    state : shape (6,), heliocentric ICRF; factor : shape (6, k), of its covariance.

    Notes
    -----
    Where two orbits are nearest, no first-order shift along either changes their distance: its change is that of the
    point in the same direction from the Sun along the common normal, here by differences of half a sigma along each
    column of the factor. The normal keeps the sign of a distance that a sigma carries through zero.
    """
    earth, gm = earth_conic(ephemeris, epoch), ephemeris.gm_km3_s2["sun"]
    orbit = conic(state, gm)
    least, about = moid_km(orbit, earth)
    point = orbit.at(np.array([about]))
    there = _nearest(point, earth)
    normal = (point - earth.at(there))[0]
    if least < TOUCHING_KM:
        normal = np.cross(_tangent(orbit, about), _tangent(earth, float(there[0])))
    normal /= max(np.linalg.norm(normal), 1e-300)
    steps = []
    for column in factor.T:
        ends = [_towards(conic(state + sign * column, gm), point[0]) for sign in (0.5, -0.5)]
        steps.append(float(normal @ (ends[0] - ends[1])))
    return least, float(np.linalg.norm(steps))


def _towards(orbit: Conic, point: Array) -> Array:
    """The point (3,) of an orbit in the direction of another, as far as its plane goes."""
    anomaly = np.arctan2(orbit.axes[1] @ point, orbit.axes[0] @ point)
    found: Array = orbit.at(np.array([anomaly]))[0]
    return found


def _tangent(orbit: Conic, anomaly: float) -> Array:
    """Direction (3,) of an orbit at a true anomaly, of any length: dr/df times (1 + e cos f)^2 / p."""
    along: Array = -np.sin(anomaly) * orbit.axes[0] + (orbit.e + np.cos(anomaly)) * orbit.axes[1]
    return along


def _to_orbit(points: Array, other: Conic) -> Array:
    """Distances (n,) from points (n, 3) to the nearest point of a nearly circular orbit."""
    gap = points - other.at(_nearest(points, other))
    nearest: Array = np.linalg.norm(gap, axis=1)
    return nearest


def _nearest(points: Array, other: Conic) -> Array:
    """True anomalies (n,) of the points of a nearly circular orbit that are nearest to points (n, 3)."""
    x, y = points @ other.axes[0], points @ other.axes[1]
    f: Array = np.arctan2(y, x)
    for _ in range(NEWTON):
        cos, sin = np.cos(f), np.sin(f)
        q = 1.0 + other.e * cos
        r = other.p_km / q
        dr = r * other.e * sin / q
        ddr = dr * other.e * sin / q + r * other.e * cos / q + r * (other.e * sin / q) ** 2
        u, w = x * cos + y * sin, -x * sin + y * cos
        # half the squared distance is (r^2 - 2 r u)/2 + const, u' = w, w' = -u
        slope = r * dr - dr * u - r * w
        bend = dr * dr + r * ddr - ddr * u - 2.0 * dr * w + r * u
        turn = np.where(bend > 0.0, slope / np.where(bend > 0.0, bend, 1.0), np.sign(slope) * 0.1)
        turn = np.clip(turn, -0.3, 0.3)
        f = f - turn
        if np.abs(turn).max() < 1e-14:
            break
    return f
