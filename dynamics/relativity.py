"""Relativity: the Sun's Schwarzschild term, or the Einstein-Infeld-Hoffmann terms of all planets (beta = gamma = 1).

Conventions as in forces.py. Against each other over one year of a near-Earth asteroid: the Sun's term moves it 84 km,
the planets' part of the EIH terms 0.003 km; through the 2029 encounter of Apophis the latter grows to kilometres. The
rotation of the Sun (Lense-Thirring), which may be added to either, moves it 0.0005 km.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import inlined_kernel

Array = npt.NDArray[np.float64]
MAJOR = 11  # Sun, planets, Moon, Pluto: the bodies whose post-Newtonian terms are summed


@inlined_kernel
def sun_relativity(n: int, X: Array, V: Array, P: Array, VS: Array, gm: float, c2: float, A: Array) -> None:
    """Schwarzschild term of the Sun, beta = gamma = 1 (Moyer 1971; Will 1981): f [(4 GM/r - w^2) d + 4 (d.w) w].

    f = GM/(c^2 r^3); d and w are heliocentric position and velocity; c2 = c^2 in km^2/s^2.
    """
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        r = np.sqrt(r2)
        f = gm / (c2 * r2 * r)
        a = f * (4.0 * gm / r - (wx * wx + wy * wy + wz * wz))
        b = 4.0 * f * (dx * wx + dy * wy + dz * wz)
        A[l] += a * dx + b * wx
        A[8 + l] += a * dy + b * wy
        A[16 + l] += a * dz + b * wz


@inlined_kernel
def sun_relativity_gradient(
    n: int, X: Array, V: Array, P: Array, VS: Array, gm: float, c2: float, G: Array, K: Array
) -> None:
    """dA/dX = a I + d u^T + w y^T and dA/dV = b I + d p^T + w q^T of A = a d + b w.

    u = -(4 GM f/r^3 + 3 a/r^2) d, y = 4 f w - (3 b/r^2) d, p = -2 f w, q = 4 f d.
    """
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        r = np.sqrt(r2)
        f = gm / (c2 * r2 * r)
        a = f * (4.0 * gm / r - (wx * wx + wy * wy + wz * wz))
        b = 4.0 * f * (dx * wx + dy * wy + dz * wz)
        cu, cy, f4 = -(4.0 * gm * f / r + 3.0 * a) / r2, -3.0 * b / r2, 4.0 * f
        yx, yy, yz = f4 * wx + cy * dx, f4 * wy + cy * dy, f4 * wz + cy * dz
        ux, uy, uz, px, py, pz = cu * dx, cu * dy, cu * dz, -2.0 * f * wx, -2.0 * f * wy, -2.0 * f * wz
        G[l] += a + dx * ux + wx * yx
        G[8 + l] += dx * uy + wx * yy
        G[16 + l] += dx * uz + wx * yz
        G[24 + l] += dy * ux + wy * yx
        G[32 + l] += a + dy * uy + wy * yy
        G[40 + l] += dy * uz + wy * yz
        G[48 + l] += dz * ux + wz * yx
        G[56 + l] += dz * uy + wz * yy
        G[64 + l] += a + dz * uz + wz * yz
        K[l] += b + dx * px + wx * f4 * dx
        K[8 + l] += dx * py + wx * f4 * dy
        K[16 + l] += dx * pz + wx * f4 * dz
        K[24 + l] += dy * px + wy * f4 * dx
        K[32 + l] += b + dy * py + wy * f4 * dy
        K[40 + l] += dy * pz + wy * f4 * dz
        K[48 + l] += dz * px + wz * f4 * dx
        K[56 + l] += dz * py + wz * f4 * dy
        K[64 + l] += b + dz * pz + wz * f4 * dz


@inlined_kernel
def lense_thirring(n: int, X: Array, V: Array, P: Array, VS: Array, k: float, pole: Array, A: Array) -> None:
    """Frame dragging by the rotating Sun: (k/r^3) [3 (d.p) (d x w)/r^2 + w x p], k = 2 G S/c^2 in km^3/s.

    d and w are heliocentric position and velocity, p (3,) = `pole` the unit vector of the Sun's angular momentum S.
    References: IERS Conventions 2010, eq. 10.12, second line, with gamma = 1 and G S p in place of GM J.
    """
    px, py, pz = pole[0], pole[1], pole[2]
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        f = k / (r2 * np.sqrt(r2))
        g = 3.0 * f * (dx * px + dy * py + dz * pz) / r2
        A[l] += g * (dy * wz - dz * wy) + f * (wy * pz - wz * py)
        A[8 + l] += g * (dz * wx - dx * wz) + f * (wz * px - wx * pz)
        A[16 + l] += g * (dx * wy - dy * wx) + f * (wx * py - wy * px)


@inlined_kernel
def lense_thirring_gradient(
    n: int, X: Array, V: Array, P: Array, VS: Array, k: float, pole: Array, G: Array, K: Array
) -> None:
    """dA/dX = h y^T - q d^T - g [w x] and dA/dV = g [d x] - f [p x] of A = g h + f (w x p), h = d x w.

    f = k/r^3, g = 3 f (d.p)/r^2, y = (3 f/r^2) [p - 5 (d.p) d/r^2], q = (3 f/r^2) (w x p); [a x] b = a x b.
    """
    px, py, pz = pole[0], pole[1], pole[2]
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        wx, wy, wz = V[l] - VS[l], V[8 + l] - VS[8 + l], V[16 + l] - VS[16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        f = k / (r2 * np.sqrt(r2))
        f3, s = 3.0 * f / r2, dx * px + dy * py + dz * pz
        g, c = f3 * s, -5.0 * f3 * s / r2
        hx, hy, hz = dy * wz - dz * wy, dz * wx - dx * wz, dx * wy - dy * wx
        yx, yy, yz = f3 * px + c * dx, f3 * py + c * dy, f3 * pz + c * dz
        qx, qy, qz = f3 * (wy * pz - wz * py), f3 * (wz * px - wx * pz), f3 * (wx * py - wy * px)
        G[l] += hx * yx - qx * dx
        G[8 + l] += hx * yy - qx * dy + g * wz
        G[16 + l] += hx * yz - qx * dz - g * wy
        G[24 + l] += hy * yx - qy * dx - g * wz
        G[32 + l] += hy * yy - qy * dy
        G[40 + l] += hy * yz - qy * dz + g * wx
        G[48 + l] += hz * yx - qz * dx + g * wy
        G[56 + l] += hz * yy - qz * dy - g * wx
        G[64 + l] += hz * yz - qz * dz
        K[8 + l] += f * pz - g * dz
        K[16 + l] += g * dy - f * py
        K[24 + l] += g * dz - f * pz
        K[40 + l] += f * px - g * dx
        K[48 + l] += f * py - g * dy
        K[56 + l] += g * dx - f * px


@inlined_kernel
def major_fields(n: int, P: Array, gm: Array, accelerations: Array, potentials: Array) -> None:
    """Newtonian accelerations (11, 24) of the major bodies by each other, and the potentials (11, 8) they move in."""
    for j in range(MAJOR):
        for i in range(24):
            accelerations[j, i] = 0.0
        for l in range(8):
            potentials[j, l] = 0.0
        for k in range(MAJOR):
            if k == j:
                continue
            g = gm[k]
            for l in range(n):
                dx, dy, dz = P[k, l] - P[j, l], P[k, 8 + l] - P[j, 8 + l], P[k, 16 + l] - P[j, 16 + l]
                r2 = dx * dx + dy * dy + dz * dz
                u = g / np.sqrt(r2)
                f = u / r2
                potentials[j, l] += u
                accelerations[j, l] += f * dx
                accelerations[j, 8 + l] += f * dy
                accelerations[j, 16 + l] += f * dz


@inlined_kernel
def eih(
    n: int, X: Array, V: Array, P: Array, W: Array, B: Array, U: Array, gm: Array, c2: float, Q: Array, A: Array
) -> None:
    """Post-Newtonian acceleration of a massless body (Moyer 2003, eq. 4-26).

    With d = X - P_j, w, b and u the velocity, acceleration and potential of body j, s = GM_j/(c^2 r^3):
    A = (4 phi/c^2) N + sum_j s [(d.(4 V - 3 w)) (V - w) - beta_j d] + 3.5 GM_j b/(c^2 r),
    beta_j = V^2 + 2 w^2 - 4 V.w - u - 1.5 (d.w)^2/r^2 - d.b/2, phi = sum GM/r, N = sum GM d/r^3. Q (32,) is scratch.
    """
    for i in range(32):
        Q[i] = 0.0
    for j in range(MAJOR):
        g = gm[j]
        for l in range(n):
            dx, dy, dz = X[l] - P[j, l], X[8 + l] - P[j, 8 + l], X[16 + l] - P[j, 16 + l]
            vx, vy, vz, wx, wy, wz = V[l], V[8 + l], V[16 + l], W[j, l], W[j, 8 + l], W[j, 16 + l]
            bx, by, bz = B[j, l], B[j, 8 + l], B[j, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            ir = 1.0 / np.sqrt(r2)
            f = g * ir / r2
            s, dw = f / c2, dx * wx + dy * wy + dz * wz
            beta = vx * vx + vy * vy + vz * vz + 2.0 * (wx * wx + wy * wy + wz * wz)
            beta -= 4.0 * (vx * wx + vy * wy + vz * wz) + U[j, l]
            beta -= 1.5 * dw * dw / r2 + 0.5 * (dx * bx + dy * by + dz * bz)
            c = s * (dx * (4.0 * vx - 3.0 * wx) + dy * (4.0 * vy - 3.0 * wy) + dz * (4.0 * vz - 3.0 * wz))
            b, k = -s * beta, 3.5 * g * ir / c2
            A[l] += b * dx + c * (vx - wx) + k * bx
            A[8 + l] += b * dy + c * (vy - wy) + k * by
            A[16 + l] += b * dz + c * (vz - wz) + k * bz
            Q[l] += g * ir
            Q[8 + l] += f * dx
            Q[16 + l] += f * dy
            Q[24 + l] += f * dz
    for l in range(n):
        q = 4.0 * Q[l] / c2
        A[l] += q * Q[8 + l]
        A[8 + l] += q * Q[16 + l]
        A[16 + l] += q * Q[24 + l]


@inlined_kernel
def eih_gradient(
    n: int,
    X: Array,
    V: Array,
    P: Array,
    W: Array,
    B: Array,
    U: Array,
    gm: Array,
    c2: float,
    Q: Array,
    G: Array,
    K: Array,
) -> None:
    """Of body j: dA/dX = -s beta I + d y^T + (V - w) z^T + b k^T and dA/dV = C I + d p^T + (V - w) q^T, with
    C = s d.(4 V - 3 w), y = s (3 beta d/r^2 - grad beta), z = s (4 V - 3 w) - 3 C d/r^2, k = -3.5 s d,
    grad beta = -3 (d.w) w/r^2 + 3 (d.w)^2 d/r^4 - b/2, p = -s (2 V - 4 w), q = 4 s d. Q (32,) is scratch.
    """
    for j in range(MAJOR):
        g = gm[j]
        for l in range(n):
            dx, dy, dz = X[l] - P[j, l], X[8 + l] - P[j, 8 + l], X[16 + l] - P[j, 16 + l]
            vx, vy, vz, wx, wy, wz = V[l], V[8 + l], V[16 + l], W[j, l], W[j, 8 + l], W[j, 16 + l]
            bx, by, bz = B[j, l], B[j, 8 + l], B[j, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            ir2, ir = 1.0 / r2, 1.0 / np.sqrt(r2)
            s, dw = g * ir * ir2 / c2, dx * wx + dy * wy + dz * wz
            beta = vx * vx + vy * vy + vz * vz + 2.0 * (wx * wx + wy * wy + wz * wz)
            beta -= 4.0 * (vx * wx + vy * wy + vz * wz) + U[j, l]
            beta -= 1.5 * dw * dw * ir2 + 0.5 * (dx * bx + dy * by + dz * bz)
            ex, ey, ez = s * (4.0 * vx - 3.0 * wx), s * (4.0 * vy - 3.0 * wy), s * (4.0 * vz - 3.0 * wz)
            C, unit = dx * ex + dy * ey + dz * ez, -s * beta
            yd, yw, zd = 3.0 * s * ir2 * (beta - dw * dw * ir2), 3.0 * s * dw * ir2, -3.0 * C * ir2
            yx, yy, yz = (
                yd * dx + yw * wx + 0.5 * s * bx,
                yd * dy + yw * wy + 0.5 * s * by,
                yd * dz + yw * wz + 0.5 * s * bz,
            )
            zx, zy, zz, k = ex + zd * dx, ey + zd * dy, ez + zd * dz, -3.5 * s
            ux, uy, uz = vx - wx, vy - wy, vz - wz
            G[l] += unit + dx * yx + ux * zx + k * bx * dx
            G[8 + l] += dx * yy + ux * zy + k * bx * dy
            G[16 + l] += dx * yz + ux * zz + k * bx * dz
            G[24 + l] += dy * yx + uy * zx + k * by * dx
            G[32 + l] += unit + dy * yy + uy * zy + k * by * dy
            G[40 + l] += dy * yz + uy * zz + k * by * dz
            G[48 + l] += dz * yx + uz * zx + k * bz * dx
            G[56 + l] += dz * yy + uz * zy + k * bz * dy
            G[64 + l] += unit + dz * yz + uz * zz + k * bz * dz
            px, py, pz, q = -s * (2 * vx - 4 * wx), -s * (2 * vy - 4 * wy), -s * (2 * vz - 4 * wz), 4.0 * s
            K[l] += C + dx * px + q * ux * dx
            K[8 + l] += dx * py + q * ux * dy
            K[16 + l] += dx * pz + q * ux * dz
            K[24 + l] += dy * px + q * uy * dx
            K[32 + l] += C + dy * py + q * uy * dy
            K[40 + l] += dy * pz + q * uy * dz
            K[48 + l] += dz * px + q * uz * dx
            K[56 + l] += dz * py + q * uz * dy
            K[64 + l] += C + dz * pz + q * uz * dz
    _potential_gradient(n, X, P, gm, c2, Q, G)


@inlined_kernel
def _potential_gradient(n: int, X: Array, P: Array, gm: Array, c2: float, Q: Array, G: Array) -> None:
    """Gradient of (4 phi/c^2) N: (4/c^2) [phi sum GM/r^3 (I - 3 d d^T/r^2) - N N^T]; phi and N go to Q (32,)."""
    for i in range(32):
        Q[i] = 0.0
    for j in range(MAJOR):
        g = gm[j]
        for l in range(n):
            dx, dy, dz = X[l] - P[j, l], X[8 + l] - P[j, 8 + l], X[16 + l] - P[j, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            ir = 1.0 / np.sqrt(r2)
            f = g * ir / r2
            Q[l] += g * ir
            Q[8 + l] += f * dx
            Q[16 + l] += f * dy
            Q[24 + l] += f * dz
    for j in range(MAJOR):
        g = gm[j]
        for l in range(n):
            dx, dy, dz = X[l] - P[j, l], X[8 + l] - P[j, 8 + l], X[16 + l] - P[j, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            f = 4.0 / c2 * Q[l] * g / (r2 * np.sqrt(r2))
            f3 = -3.0 * f / r2
            G[l] += f + f3 * dx * dx
            G[8 + l] += f3 * dx * dy
            G[16 + l] += f3 * dx * dz
            G[24 + l] += f3 * dy * dx
            G[32 + l] += f + f3 * dy * dy
            G[40 + l] += f3 * dy * dz
            G[48 + l] += f3 * dz * dx
            G[56 + l] += f3 * dz * dy
            G[64 + l] += f + f3 * dz * dz
    for a in range(3):
        for b in range(3):
            for l in range(n):
                G[24 * a + 8 * b + l] -= 4.0 / c2 * Q[8 + 8 * a + l] * Q[8 + 8 * b + l]
