"""Point masses and zonal harmonics: each acceleration and its Jacobian as a pair. (Relativity: relativity.py.)

Every function adds to its output at n <= 8 moments ("lanes", see compilation.py). X, V: position and velocity,
barycentric; P: bodies (rows in window order); VS: velocity of the Sun; A: acceleration; S: the symmetric part of
dA/dX in rows xx, xy, xz, yy, yz, zz; G, K: dA/dX and dA/dV, nine rows each, row-major. km, s.

What is left out, and how much it is, for a near-Earth asteroid over one year: other asteroids than the 16, 0.01-0.1 km;
figure of the planets other than the Earth, below 1e-6 km unless closer than ten radii. What can be switched:
post-Newtonian terms of the planets 0.003 km (relativity="eih"); J2 of the Sun 0.01 km; Lense-Thirring effect of the Sun
0.0005 km (off by default).

An encounter multiplies all of it. Apophis passes the Earth at six radii on 2029-04-13 and stands on 2030-01-01 farther
away by: J2 1830 km; precession of the pole since 2000 3.3 km; J3 1.8 km; J4 0.14 km; nutation 0.07 km. Left out there:
tesseral harmonics 12 km (degree 2 order 2 -14.4, 31 +2.5, 32 -0.9, 42 +0.25, 33 +0.14 km: 2.7 m in the b-plane, which
no orbit known today resolves; JPL's orbits leave them out as well); solid tides of the Earth 0.03 km; figure of the
Moon 0.02 km; nutation beyond its four largest terms 1e-3 km.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, inlined_kernel, kernel

Array = npt.NDArray[np.float64]


@kernel
def point_masses(n: int, X: Array, P: Array, gm: Array, A: Array, tide: Array) -> None:
    """Newtonian attraction of all bodies; tide (8,) becomes the largest GM/r^3, s^-2, of each lane."""
    for b in range(gm.shape[0]):
        g = gm[b]
        for l in range(n):
            dx, dy, dz = X[l] - P[b, l], X[8 + l] - P[b, 8 + l], X[16 + l] - P[b, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            f = g / (r2 * np.sqrt(r2))
            A[l] -= f * dx
            A[8 + l] -= f * dy
            A[16 + l] -= f * dz
            tide[l] = f if f > tide[l] else tide[l]


@kernel
def point_masses_gradient(n: int, X: Array, P: Array, gm: Array, S: Array) -> None:
    """dA/dX = GM/r^3 (3 d d^T / r^2 - I), summed over the bodies."""
    for b in range(gm.shape[0]):
        g = gm[b]
        for l in range(n):
            dx, dy, dz = X[l] - P[b, l], X[8 + l] - P[b, 8 + l], X[16 + l] - P[b, 16 + l]
            r2 = dx * dx + dy * dy + dz * dz
            f = g / (r2 * np.sqrt(r2))
            f3 = 3.0 * f / r2
            S[l] += f3 * dx * dx - f
            S[8 + l] += f3 * dx * dy
            S[16 + l] += f3 * dx * dz
            S[24 + l] += f3 * dy * dy - f
            S[32 + l] += f3 * dy * dz
            S[40 + l] += f3 * dz * dz - f


@inlined_kernel
def expand(n: int, S: Array, G: Array) -> None:
    """Write the symmetric rows S into the nine rows of G."""
    for l in range(n):
        G[l] = S[l]
        G[8 + l] = S[8 + l]
        G[16 + l] = S[16 + l]
        G[24 + l] = S[8 + l]
        G[32 + l] = S[24 + l]
        G[40 + l] = S[32 + l]
        G[48 + l] = S[16 + l]
        G[56 + l] = S[32 + l]
        G[64 + l] = S[40 + l]


@inlined_kernel
def zonal_harmonics(n: int, X: Array, P: Array, b: int, gm: float, J: Array, pole: Array, A: Array) -> None:
    """J2, J3, J4 of body b: sum_k w_k [P'_(k+1)(s) d/r - P'_k(s) p], w_k = GM/r^2 J_k (R/r)^k, s = d.p/r.

    J = [R, J2, J3, J4]; pole (3,) is the unit vector p of the rotation axis; P'_k derivatives of Legendre polynomials
    (gradient of the potential with P'_(k+1) = (k+1) P_k + s P'_k).
    """
    p0, p1, p2 = pole[0], pole[1], pole[2]
    radius, j2, j3, j4 = J[0], J[1], J[2], J[3]
    for l in range(n):
        dx, dy, dz = X[l] - P[b, l], X[8 + l] - P[b, 8 + l], X[16 + l] - P[b, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        ir = 1.0 / np.sqrt(r2)
        s, x = (dx * p0 + dy * p1 + dz * p2) * ir, radius * ir
        s2 = s * s
        w2 = gm * j2 * x * x * ir * ir
        w3, w4 = gm * j3 * x * x * x * ir * ir, gm * j4 * x * x * x * x * ir * ir
        d2, d3, d4, d5 = 3.0 * s, 7.5 * s2 - 1.5, (17.5 * s2 - 7.5) * s, (39.375 * s2 - 26.25) * s2 + 1.875
        along = (w2 * d3 + w3 * d4 + w4 * d5) * ir
        axial = w2 * d2 + w3 * d3 + w4 * d4
        A[l] += along * dx - axial * p0
        A[8 + l] += along * dy - axial * p1
        A[16 + l] += along * dz - axial * p2


@inlined_kernel
def zonal_harmonics_gradient(n: int, X: Array, P: Array, b: int, gm: float, J: Array, pole: Array, S: Array) -> None:
    """dA/dX = sum_k w_k/r [P'_(k+1) I - P''_(k+2) e e^T + P''_(k+1) (e p^T + p e^T) - P''_k p p^T], e = d/r."""
    p0, p1, p2 = pole[0], pole[1], pole[2]
    radius, j2, j3, j4 = J[0], J[1], J[2], J[3]
    for l in range(n):
        dx, dy, dz = X[l] - P[b, l], X[8 + l] - P[b, 8 + l], X[16 + l] - P[b, 16 + l]
        ir = 1.0 / np.sqrt(dx * dx + dy * dy + dz * dz)
        e0, e1, e2 = dx * ir, dy * ir, dz * ir
        s, x = e0 * p0 + e1 * p1 + e2 * p2, radius * ir
        s2 = s * s
        w2 = gm * j2 * x * x * ir * ir * ir
        w3, w4 = w2 * x * j3 / j2, w2 * x * x * j4 / j2
        d3, d4, d5 = 7.5 * s2 - 1.5, (17.5 * s2 - 7.5) * s, (39.375 * s2 - 26.25) * s2 + 1.875
        h2, h3, h4, h5 = 3.0, 15.0 * s, 52.5 * s2 - 7.5, (157.5 * s2 - 52.5) * s
        h6 = (433.125 * s2 - 236.25) * s2 + 13.125
        unit, ee = w2 * d3 + w3 * d4 + w4 * d5, -(w2 * h4 + w3 * h5 + w4 * h6)
        ep, pp = w2 * h3 + w3 * h4 + w4 * h5, -(w2 * h2 + w3 * h3 + w4 * h4)
        S[l] += unit + ee * e0 * e0 + 2.0 * ep * e0 * p0 + pp * p0 * p0
        S[8 + l] += ee * e0 * e1 + ep * (e0 * p1 + p0 * e1) + pp * p0 * p1
        S[16 + l] += ee * e0 * e2 + ep * (e0 * p2 + p0 * e2) + pp * p0 * p2
        S[24 + l] += unit + ee * e1 * e1 + 2.0 * ep * e1 * p1 + pp * p1 * p1
        S[32 + l] += ee * e1 * e2 + ep * (e1 * p2 + p1 * e2) + pp * p1 * p2
        S[40 + l] += unit + ee * e2 * e2 + 2.0 * ep * e2 * p2 + pp * p2 * p2


@inlined_kernel
def earth_pole(of_date: bool, centuries: float, pole: Array) -> None:
    """Celestial intermediate pole (3,) in ICRF, or the pole of J2000 = (0, 0, 1) when not `of_date`.

    Precession X, Y of IAU 2006 (Capitaine et al. 2003, eq. 49) and the four largest terms of nutation (IAU 1980,
    Seidelmann 1982: 18.6 and 9.3 years by the double angle, half a year, half a month; what is left is below
    0.25 arcsec). `centuries` are Julian centuries of TDB after J2000.
    """
    if not of_date:
        pole[0], pole[1], pole[2] = 0.0, 0.0, 1.0
        return
    arcsec = 4.848136811095360e-6
    t = centuries
    node, sun2, moon2 = 2.18243920 - 33.7570460 * t, 3.50694 + 1256.66393 * t, 7.62068 + 16799.41822 * t
    s, c = np.sin(node), np.cos(node)
    longitude = (-17.1996 + 0.4124 * c) * s - 1.3187 * np.sin(sun2) - 0.2274 * np.sin(moon2)
    obliquity = 0.0895 + (9.2025 - 0.1790 * c) * c + 0.5736 * np.cos(sun2) + 0.0977 * np.cos(moon2)
    x = (-0.016617 + (2004.191898 + (-0.4297829 - 0.19861834 * t) * t) * t + 0.397777156 * longitude) * arcsec
    y = (-0.006951 + (-0.025896 + (-22.4072747 + 0.00190059 * t) * t) * t + obliquity) * arcsec
    pole[0] = x
    pole[1] = y
    pole[2] = np.sqrt(1.0 - x * x - y * y)


@inlined_kernel
def near(body_distance: float, n: int, X: Array, P: Array, b: int) -> bool:
    """Whether the first lane is within `body_distance` km of body b: the switch of forces that die out fast."""
    dx, dy, dz = X[0] - P[b, 0], X[LANES] - P[b, LANES], X[2 * LANES] - P[b, 2 * LANES]
    return bool(dx * dx + dy * dy + dz * dz < body_distance * body_distance)
