"""The field of all bodies but the Sun, expanded to first order about the predicted path of a step.

The sweeps of a step move its nodes by metres, so the sum over 10 planets and 16 asteroids need not be formed anew in
each: it is summed once, with its gradient, at the predicted nodes X0, and later sweeps take R + S (X - X0). What that
leaves out is below 3 GM/r^4 |X - X0|^2 for each body. The largest GM/r^4 is kept with the sums, and gives the reach
|X - X0| inside which the remainder is below round-off; beyond it (near a planet, in the first step) the expansion is
renewed at the current nodes, so nothing is ever lost. One pass a step instead of three or four, and the gradient
serves the variational equations: this halves the time of a step.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import inlined_kernel

Array = npt.NDArray[np.float64]


@inlined_kernel
def expand_bodies(n: int, X: Array, P: Array, gm: Array, R: Array, S: Array, tide: Array, bend: Array) -> None:
    """Acceleration R (24,), gradient S (48,) of all bodies but the first; largest GM/r^3 and GM/r^4 of each lane."""
    for i in range(24):
        R[i] = 0.0
    for i in range(48):
        S[i] = 0.0
    for l in range(8):
        tide[l] = 0.0
        bend[l] = 0.0
    # Two bodies at a time: the twelve sums go through memory half as often (a quarter of the time)
    bodies = gm.shape[0]
    for b in range(1, bodies, 2):
        c = min(b + 1, bodies - 1)
        g, h = gm[b], gm[c] if c > b else 0.0
        for l in range(n):
            dx, dy, dz = X[l] - P[b, l], X[8 + l] - P[b, 8 + l], X[16 + l] - P[b, 16 + l]
            ex, ey, ez = X[l] - P[c, l], X[8 + l] - P[c, 8 + l], X[16 + l] - P[c, 16 + l]
            r, s = np.sqrt(dx * dx + dy * dy + dz * dz), np.sqrt(ex * ex + ey * ey + ez * ez)
            both = 1.0 / (r * s)  # one division for two bodies
            ir, jr = both * s, both * r
            ir2, jr2 = ir * ir, jr * jr
            f, q = g * ir2 * ir, h * jr2 * jr
            f3, q3 = 3.0 * f * ir2, 3.0 * q * jr2
            R[l] -= f * dx + q * ex
            R[8 + l] -= f * dy + q * ey
            R[16 + l] -= f * dz + q * ez
            S[l] += (f3 * dx * dx - f) + (q3 * ex * ex - q)
            S[8 + l] += f3 * dx * dy + q3 * ex * ey
            S[16 + l] += f3 * dx * dz + q3 * ex * ez
            S[24 + l] += (f3 * dy * dy - f) + (q3 * ey * ey - q)
            S[32 + l] += f3 * dy * dz + q3 * ey * ez
            S[40 + l] += (f3 * dz * dz - f) + (q3 * ez * ez - q)
            tide[l] = max(tide[l], max(f, q))
            bend[l] = max(bend[l], max(f * ir, q * jr))


@inlined_kernel
def expanded_field(n: int, X: Array, X0: Array, R: Array, S: Array, P: Array, gm: float, A: Array) -> None:
    """A = R + S (X - X0) and the attraction of the Sun (row 0 of P) at X."""
    for l in range(n):
        dx, dy, dz = X[l] - X0[l], X[8 + l] - X0[8 + l], X[16 + l] - X0[16 + l]
        sx, sy, sz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = sx * sx + sy * sy + sz * sz
        f = gm / (r2 * np.sqrt(r2))
        A[l] = (R[l] + (S[l] * dx + S[8 + l] * dy + S[16 + l] * dz)) - f * sx
        A[8 + l] = (R[8 + l] + (S[8 + l] * dx + S[24 + l] * dy + S[32 + l] * dz)) - f * sy
        A[16 + l] = (R[16 + l] + (S[16 + l] * dx + S[32 + l] * dy + S[40 + l] * dz)) - f * sz


@inlined_kernel
def sun_tide(n: int, X: Array, P: Array, gm: float, tide: Array) -> None:
    """Raise tide (8,) to GM/r^3 of the Sun."""
    for l in range(n):
        sx, sy, sz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = sx * sx + sy * sy + sz * sz
        tide[l] = max(tide[l], gm / (r2 * np.sqrt(r2)))


@inlined_kernel
def sun_gradient(n: int, X: Array, P: Array, gm: float, S: Array) -> None:
    """Add the Sun's GM/r^3 (3 d d^T/r^2 - I) to S (48,)."""
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        f = gm / (r2 * np.sqrt(r2))
        f3 = 3.0 * f / r2
        S[l] += f3 * dx * dx - f
        S[8 + l] += f3 * dx * dy
        S[16 + l] += f3 * dx * dz
        S[24 + l] += f3 * dy * dy - f
        S[32 + l] += f3 * dy * dz
        S[40 + l] += f3 * dz * dz - f
