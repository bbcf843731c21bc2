"""Non-gravitational acceleration after Marsden: A1 radial, A2 transverse, A3 normal, times g(r).

With heliocentric d, w and h = d x w: a = g(r) (A1 d/r + A2 (h x d)/(|h| r) + A3 h/|h|) and
g(r) = alpha (r/r0)^-m [1 + (r/r0)^n]^-k (Marsden, Sekanina, Yeomans 1973, AJ 78, 211). The default is g = (1 au/r)^2,
the law of JPL's Yarkovsky solutions, in which A1 has the form of radiation pressure; `WATER_ICE` is that of comets.

Left out: the delay of a comet's outgassing (DT), and the seasonal part of a Yarkovsky force: A2 absorbs its average.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered_fields
from nebosvod.dynamics.compilation import inlined_kernel
from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]
PARAMETERS = ("a1_au_d2", "a2_au_d2", "a3_au_d2")
LAW = ("alpha", "r0_au", "m", "n", "k")
# Sublimation of water ice: Nongrav(a1_au_d2=..., **WATER_ICE) (Marsden et al. 1973, table III)
WATER_ICE: Mapping[str, float] = MappingProxyType(
    {"alpha": 0.1112620426, "r0_au": 2.808, "m": 2.15, "n": 5.093, "k": 4.6142}
)


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True)
class Nongrav:
    """Marsden's parameters and law.

    Parameters
    ----------
    a1_au_d2, a2_au_d2, a3_au_d2 : radial, transverse and normal acceleration where g(r) = 1, au/d^2.
    alpha, r0_au, m, n, k : the law g(r) of the module's docstring; by default (1 au/r)^2.

    Raises
    ------
    InputError
        If a value is not finite, or alpha or r0_au not positive.
    """

    a1_au_d2: float = 0.0
    a2_au_d2: float = 0.0
    a3_au_d2: float = 0.0
    alpha: float = 1.0
    r0_au: float = 1.0
    m: float = 2.0
    n: float = 5.093
    k: float = 0.0

    def __post_init__(self) -> None:
        for name in PARAMETERS + LAW:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise InputError(f"non-gravitational acceleration: {name} = {value} is not finite")
            if name in ("alpha", "r0_au") and value <= 0.0:
                raise InputError(f"non-gravitational acceleration: {name} = {value} is not allowed (a positive number)")

    @property
    def law(self) -> Array:
        """alpha, r0 in km, m, n, k: shape (5,)."""
        return np.array([self.alpha, self.r0_au * AU_KM, self.m, self.n, self.k])


@inlined_kernel
def law_factors(n: int, X: Array, P: Array, law: Array, q: Array) -> None:
    """q (16,): g(r) (r/1 au)^2 of each lane, which is 1 for the default law, then its logarithmic slope (r/q) dq/dr.

    Two loops: in one, the powers would be taken in all lanes whatever the law (0.17 us a sweep).
    """
    alpha, r0, m, e, k = law[0], law[1], law[2], law[3], law[4]
    if m == 2.0 and k == 0.0:
        for l in range(n):
            q[l], q[8 + l] = alpha * r0 * r0 / (AU_KM * AU_KM), 0.0
        return
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        x2 = r2 / (r0 * r0)
        xe = x2 ** (0.5 * e)
        q[l] = alpha * x2 ** (-0.5 * m) * (1.0 + xe) ** (-k) * r2 / (AU_KM * AU_KM)
        q[8 + l] = 2.0 - m - k * e * xe / (1.0 + xe)


@inlined_kernel
def nongrav(n: int, X: Array, V: Array, P: Array, VS: Array, strength: Array, q: Array, A: Array) -> None:
    """Add the acceleration; strength (3,) = A1, A2, A3 times (1 au)^2, km^3/s^2; q (16,) from `law_factors`."""
    n1, n2, n3 = strength[0], strength[1], strength[2]
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        hx, hy, hz = dy * wz - dz * wy, dz * wx - dx * wz, dx * wy - dy * wx
        r2, dw = dx * dx + dy * dy + dz * dz, dx * wx + dy * wy + dz * wz
        ir, ih = 1.0 / np.sqrt(r2), 1.0 / np.sqrt(hx * hx + hy * hy + hz * hz)
        g = q[l]
        c1 = g * n1 * ir * ir * ir
        c2 = g * n2 * ir * ir * ir * ih
        c3 = g * n3 * ir * ir * ih
        A[l] += c1 * dx + c2 * (wx * r2 - dx * dw) + c3 * hx
        A[8 + l] += c1 * dy + c2 * (wy * r2 - dy * dw) + c3 * hy
        A[16 + l] += c1 * dz + c2 * (wz * r2 - dz * dw) + c3 * hz


@inlined_kernel
def nongrav_gradient(
    n: int, X: Array, V: Array, P: Array, VS: Array, strength: Array, q: Array, unit: float,
    G: Array, K: Array, F: Array,
) -> None:  # fmt: skip
    """Jacobians of A = c1 d + c2 t + c3 h with t = h x d = r^2 w - (d.w) d, and F = dA/d(A1, A2, A3), three rows of 24.

    dA/dX = (c1 - c2 d.w) I + d u^T + w y^T + t grad(c2)^T + h grad(c3)^T - c3 [w]x, dA/dV likewise, with
    grad_x c2 = -c2 ((3 - e) d/r^2 + q), grad_x c3 = -c3 ((2 - e) d/r^2 + q), q = (w x h)/h^2, e the slope of the law
    (0 by default), grad_v c = -c (h x d)/h^2; unit = (1 au)^2 in km^3/s^2 per au/d^2.
    """
    n1, n2, n3 = strength[0], strength[1], strength[2]
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        hx, hy, hz = dy * wz - dz * wy, dz * wx - dx * wz, dx * wy - dy * wx
        r2, dw = dx * dx + dy * dy + dz * dz, dx * wx + dy * wy + dz * wz
        ir2, ih2 = 1.0 / r2, 1.0 / (hx * hx + hy * hy + hz * hz)
        ir, ih = np.sqrt(ir2), np.sqrt(ih2)
        tx, ty, tz = wx * r2 - dx * dw, wy * r2 - dy * dw, wz * r2 - dz * dw
        g, slope = q[l], q[8 + l]
        k1, k2, k3 = g * ir * ir2, g * ir * ir2 * ih, g * ir2 * ih
        F[l], F[8 + l], F[16 + l] = unit * k1 * dx, unit * k1 * dy, unit * k1 * dz
        F[24 + l], F[32 + l], F[40 + l] = unit * k2 * tx, unit * k2 * ty, unit * k2 * tz
        F[48 + l], F[56 + l], F[64 + l] = unit * k3 * hx, unit * k3 * hy, unit * k3 * hz
        c1, c2, c3 = n1 * k1, n2 * k2, n3 * k3
        qx, qy, qz = (wy * hz - wz * hy) * ih2, (wz * hx - wx * hz) * ih2, (wx * hy - wy * hx) * ih2
        s3, s2 = (3.0 - slope) * ir2, (2.0 - slope) * ir2
        bx, by, bz = -c2 * (s3 * dx + qx), -c2 * (s3 * dy + qy), -c2 * (s3 * dz + qz)
        gx, gy, gz = -c3 * (s2 * dx + qx), -c3 * (s2 * dy + qy), -c3 * (s2 * dz + qz)
        c4 = -s3 * c1
        ux, uy, uz = c4 * dx - c2 * wx, c4 * dy - c2 * wy, c4 * dz - c2 * wz
        yx, yy, yz, i0 = 2.0 * c2 * dx, 2.0 * c2 * dy, 2.0 * c2 * dz, c1 - c2 * dw
        G[l] += i0 + dx * ux + wx * yx + tx * bx + hx * gx
        G[8 + l] += dx * uy + wx * yy + tx * by + hx * gy + c3 * wz
        G[16 + l] += dx * uz + wx * yz + tx * bz + hx * gz - c3 * wy
        G[24 + l] += dy * ux + wy * yx + ty * bx + hy * gx - c3 * wz
        G[32 + l] += i0 + dy * uy + wy * yy + ty * by + hy * gy
        G[40 + l] += dy * uz + wy * yz + ty * bz + hy * gz + c3 * wx
        G[48 + l] += dz * ux + wz * yx + tz * bx + hz * gx + c3 * wy
        G[56 + l] += dz * uy + wz * yy + tz * by + hz * gy - c3 * wx
        G[64 + l] += i0 + dz * uz + wz * yz + tz * bz + hz * gz
        mx, my, mz = -tx * ih2, -ty * ih2, -tz * ih2
        ox, oy, oz = c2 * tx + c3 * hx, c2 * ty + c3 * hy, c2 * tz + c3 * hz
        K[l] += c2 * (r2 - dx * dx) + ox * mx
        K[8 + l] += -c2 * dx * dy + ox * my - c3 * dz
        K[16 + l] += -c2 * dx * dz + ox * mz + c3 * dy
        K[24 + l] += -c2 * dy * dx + oy * mx + c3 * dz
        K[32 + l] += c2 * (r2 - dy * dy) + oy * my
        K[40 + l] += -c2 * dy * dz + oy * mz - c3 * dx
        K[48 + l] += -c2 * dz * dx + oz * mx - c3 * dy
        K[56 + l] += -c2 * dz * dy + oz * my + c3 * dx
        K[64 + l] += c2 * (r2 - dz * dz) + oz * mz
