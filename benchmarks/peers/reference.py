"""An independent propagation in long double: what the integration errors of all programs are measured against.

Gauss-Legendre collocation of order 16 in 64-bit mantissas, steps of a fraction of the shortest time in which the
geometry changes (free fall or fly-by), far below what any program takes; halving the fraction moves its ends by
micrometres, Atira's by millimetres. The forces are switches, so that each program is compared with its own forces:
what is left is its integration and its rounding.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM, DAY_S, SPEED_OF_LIGHT_KM_S
from nebosvod.timescale import Epoch

Long = npt.NDArray[np.longdouble]
LD = np.longdouble
FRACTION = 0.05  # of the shortest time scale
LARGEST_STEP_S = 12.0 * DAY_S  # of the Moon's month: less than half


def legendre_values(x: Long, highest: int) -> list[Long]:
    """P_0 ... P_highest at x."""
    values = [np.ones_like(x), x]
    for k in range(1, highest):
        values.append(((2 * k + 1) * x * values[k] - k * values[k - 1]) / LD(k + 1))
    return values


def gauss_tables() -> tuple[Long, Long, Long]:
    """Nodes (8,), weights (8,) and integration matrix (8, 8) of a unit step (Hairer, Lubich, Wanner 2006, II.1.3)."""
    x = legendre.leggauss(8)[0].astype(LD)
    for _ in range(4):
        p = legendre_values(x, 8)
        slope = 8 * (x * p[8] - p[7]) / (x * x - 1)
        x = x - p[8] / slope
    p = legendre_values(x, 9)
    slope = 8 * (x * p[8] - p[7]) / (x * x - 1)
    weights = 2 / ((1 - x * x) * slope * slope)
    matrix = np.zeros((8, 8), LD)
    for k in range(8):
        integral = x + 1 if k == 0 else (p[k + 1] - p[k - 1]) / LD(2 * k + 1)
        matrix += LD(2 * k + 1) / 2 * np.outer(integral, weights * p[k])
    return (x + 1) / 2, weights / 2, matrix / 2


NODES, WEIGHTS, INTEGRAL = gauss_tables()


@dataclass(frozen=True, kw_only=True, eq=False)
class Forces:
    """What pulls: point masses, first-order relativity and J2 of some of them, A1-A3 with r^-2.

    Parameters
    ----------
    ephemeris : positions of the bodies.
    gm : km^3/s^2 by name; the Sun among them.
    relativistic : bodies with a Schwarzschild term.
    oblate : by name J2, radius in km, pole (3,).
    a123 : au/d^2.
    """

    ephemeris: Ephemeris
    gm: dict[str, float]
    relativistic: tuple[str, ...] = ("sun",)
    oblate: dict[str, tuple[float, float, Any]]
    a123: tuple[float, float, float]

    def bodies(self, epoch: Epoch, t_s: npt.ArrayLike) -> Long:
        """Barycentric states at the times, shape (n, bodies, 6)."""
        times = np.asarray(t_s, dtype=np.float64)
        return np.stack([self.ephemeris.state_km_km_s(name, epoch, times) for name in self.gm], axis=1).astype(LD)

    def acceleration(self, x: Long, v: Long, bodies: Long) -> Long:
        """Acceleration (n, 3) in km/s^2 at n positions and velocities."""
        names, gm = list(self.gm), np.array(list(self.gm.values()), LD)
        d = x[:, None] - bodies[:, :, :3]
        r = np.sqrt((d * d).sum(axis=-1))
        pull = gm / r**3
        total: Long = -(pull[:, :, None] * d).sum(axis=1)
        for name in self.relativistic:
            k = names.index(name)
            w, dk = v - bodies[:, k, 3:], d[:, k]
            along, across = 4 * gm[k] / r[:, k] - (w * w).sum(axis=-1), 4 * (dk * w).sum(axis=-1)
            total += (pull[:, k] / LD(SPEED_OF_LIGHT_KM_S) ** 2)[:, None] * (along[:, None] * dk + across[:, None] * w)
        for name, (j2, radius, axis) in self.oblate.items():
            k, pole = names.index(name), np.array(axis, LD)
            z = d[:, k] @ pole
            size = LD(1.5) * LD(j2) * pull[:, k] * (LD(radius) / r[:, k]) ** 2
            total += size[:, None] * ((5 * (z / r[:, k]) ** 2 - 1)[:, None] * d[:, k] - (2 * z)[:, None] * pole)
        k = names.index("sun")
        h = np.cross(d[:, k], v - bodies[:, k, 3:])
        for size, direction in zip(self.a123, (d[:, k], np.cross(h, d[:, k]), h)):
            scale = LD(size) * LD(AU_KM) ** 3 / LD(DAY_S) ** 2 / r[:, k] ** 2 / np.sqrt((direction**2).sum(axis=-1))
            total += scale[:, None] * direction
        return total


def step_s(forces: Forces, x: Long, v: Long, bodies: Long, fraction: float) -> float:
    """A fraction of the shortest free-fall time, or time of passing one of the bodies that matter."""
    gm = np.array(list(forces.gm.values()))
    d, w = (np.sqrt((part**2).sum(axis=-1)).astype(float) for part in (x - bodies[:, :3], v - bodies[:, 3:]))
    fall = np.sqrt(d**3 / np.maximum(gm, 1e-30))
    strong = gm / d**2 > 1e-3 * float(gm[list(forces.gm).index("sun")] / d[list(forces.gm).index("sun")] ** 2)
    return float(min(fraction * fall.min(), 2.0 * fraction * (d / w)[strong].min(), LARGEST_STEP_S))


def extrapolated(a: Long, ratio: float) -> Long:
    """The collocation polynomial of the last step at the nodes of one `ratio` times as long."""
    if ratio > 3.0:
        return np.repeat(a[-1:], 8, axis=0)
    nodes = NODES.astype(float)
    at, matrix = 1.0 + ratio * nodes, np.zeros((8, 8))
    for j in range(8):
        others = np.delete(nodes, j)
        matrix[:, j] = np.prod((at[:, None] - others) / (nodes[j] - others), axis=1)
    return matrix.astype(LD) @ a


def propagate(
    forces: Forces, start: npt.ArrayLike, epoch: Epoch, end_s: float, fraction: float = FRACTION
) -> npt.NDArray[np.float64]:
    """Heliocentric state (6,) at end_s > 0 of a heliocentric start (6,), km, km/s."""

    def sun(t: float) -> Long:
        return forces.ephemeris.state_km_km_s("sun", epoch, t)[0].astype(LD)

    state = np.array(start, LD) + sun(0.0)
    x, v, t, end, before = state[:3], state[3:], LD(0), LD(end_s), LD(0)
    a = np.zeros((8, 3), LD)
    while t < end:
        here = forces.bodies(epoch, [float(t)])
        h = LD(step_s(forces, x, v, here[0], fraction))
        last = t + h * LD(1.001) >= end
        h = end - t if last else h
        bodies = forces.bodies(epoch, (t + h * NODES).astype(np.float64))
        a = (
            extrapolated(a, float(h / before))
            if before
            else np.repeat(forces.acceleration(x[None], v[None], here), 8, 0)
        )
        change = np.inf
        for sweep in range(40):
            speeds = INTEGRAL @ a
            new = forces.acceleration(x + h * NODES[:, None] * v + h * h * (INTEGRAL @ speeds), v + h * speeds, bodies)
            change, previous = float(abs(new - a).max() / abs(new).max()), change
            a = new
            if change < 1e-18 or (sweep > 3 and previous <= change < 1e-15):
                break
        x, v = x + h * v + h * h * (WEIGHTS @ (INTEGRAL @ a)), v + h * (WEIGHTS @ a)
        t, before = end if last else t + h, h
    return (np.concatenate([x, v]) - sun(end_s)).astype(np.float64)
