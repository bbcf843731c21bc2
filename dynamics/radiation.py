"""Solar radiation pressure on a sphere, from radius, mass and albedo; one sensitivity serves all of them.

a = (S0/c) (1 au/r)^2 kappa e_r with kappa = (pi R^2/m) C_R and C_R = 1 + 4 A/9 + f_th (1 - A); A is the Bond albedo, a
Lambert sphere; f_th in [0, 4/9] is the thermal re-emission of the day side (0: isothermal). Radius, mass, albedo and
f_th act through kappa alone, so the kernel integrates dX/dkappa and `kappa_partials` maps it.

In the Earth's shadow the light is dimmed by the part of the solar disk that the Earth covers (`shade`). Left out: the
atmosphere (it widens the umbra by 1-2 %), limb darkening (it moves the dimming inside the penumbra by up to a tenth),
shadows of other bodies, the antumbra beyond SHADOW_RANGE_KM (dimming below 2 %). The Earth's own reflected and thermal
light is 1e-2 of sunlight at six radii, 1e-5 at the Moon. Poynting-Robertson drag is v/c = 1e-4 of the pressure, solar
wind 3e-4, the variation of the irradiance over the solar cycle 1e-3.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered_fields
from nebosvod.dynamics.compilation import inlined_kernel
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]
PARAMETERS = ("radius_m", "mass_kg", "albedo", "thermal_emission")
SHADOW_RANGE_KM = 1e7
SUN_RADIUS_KM, EARTH_RADIUS_KM = RADIUS_KM["sun"], RADIUS_KM["earth"]


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True)
class RadiationPressure:
    """A sphere in sunlight.

    Parameters
    ----------
    radius_m, mass_kg : positive.
    albedo : Bond albedo, in [0, 1].
    thermal_emission : f_th in [0, 4/9]; 0 (the default) is an isothermal sphere.

    Raises
    ------
    InputError
        If a value lies outside its range.
    """

    radius_m: float
    mass_kg: float
    albedo: float
    thermal_emission: float = 0.0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("radius_m", self.radius_m, 0.0, math.inf),
            ("mass_kg", self.mass_kg, 0.0, math.inf),
            ("albedo", self.albedo, -1e-300, 1.0),
            ("thermal_emission", self.thermal_emission, -1e-300, 4.0 / 9.0),
        ):
            if not (math.isfinite(value) and low < value <= high):
                allowed = "a positive number" if high == math.inf else f"0 to {high:.4g}"
                raise InputError(f"radiation pressure: {name} = {value} is not allowed ({allowed})")

    def moved(self, values: Mapping[str, float]) -> "RadiationPressure":
        """The same sphere with some values elsewhere, also outside their physical range.

        An estimator's step or a Gaussian draw may leave the range (an albedo of 0.05 +- 0.05 does at 1 sigma); kappa
        is smooth there, so it is a point of the model though not a body. Only a radius, mass or C_R of zero is none.

        Raises
        ------
        InputError
            If a value is not finite or kappa and its partials do not exist.
        """
        new = object.__new__(RadiationPressure)
        for field in PARAMETERS:
            object.__setattr__(new, field, float(values.get(field, getattr(self, field))))
        numbers = [getattr(new, field) for field in PARAMETERS]
        if not all(map(math.isfinite, numbers)) or 0.0 in (new.radius_m, new.mass_kg, new.coefficient):
            raise InputError(f"radiation pressure: no kappa at {dict(zip(PARAMETERS, numbers))}")
        return new

    @property
    def coefficient(self) -> float:
        """C_R = 1 + 4 A/9 + f_th (1 - A): 1 for a black isothermal sphere."""
        return 1.0 + 4.0 * self.albedo / 9.0 + self.thermal_emission * (1.0 - self.albedo)

    @property
    def kappa_m2_kg(self) -> float:
        """Area-to-mass ratio times C_R, m^2/kg: the one number that angles can determine."""
        return math.pi * self.radius_m**2 / self.mass_kg * self.coefficient

    def kappa_partials(self) -> dict[str, float]:
        """Partials of kappa by radius_m, mass_kg, albedo and thermal_emission."""
        kappa, c_r = self.kappa_m2_kg, self.coefficient
        return {
            "radius_m": 2.0 * kappa / self.radius_m,
            "mass_kg": -kappa / self.mass_kg,
            "albedo": kappa * (4.0 / 9.0 - self.thermal_emission) / c_r,
            "thermal_emission": kappa * (1.0 - self.albedo) / c_r,
        }


@inlined_kernel
def radiation(n: int, X: Array, P: Array, strength: float, A: Array) -> None:
    """Add strength e_r/r^2; strength = (S0/c) (1 au)^2 kappa in km^3/s^2."""
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        f = strength / (r2 * np.sqrt(r2))
        A[l] += f * dx
        A[8 + l] += f * dy
        A[16 + l] += f * dz


@inlined_kernel
def radiation_gradient(n: int, X: Array, P: Array, strength: float, per_kappa: float, S: Array, F: Array) -> None:
    """dA/dX = f (I - 3 d d^T/r^2) with f = strength/r^3, and F (24,) = dA/dkappa = per_kappa d/r^3."""
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        ir3 = 1.0 / (r2 * np.sqrt(r2))
        f, f3 = strength * ir3, -3.0 * strength * ir3 / r2
        S[l] += f3 * dx * dx + f
        S[8 + l] += f3 * dx * dy
        S[16 + l] += f3 * dx * dz
        S[24 + l] += f3 * dy * dy + f
        S[32 + l] += f3 * dy * dz
        S[40 + l] += f3 * dz * dz + f
        F[l] = per_kappa * ir3 * dx
        F[8 + l] = per_kappa * ir3 * dy
        F[16 + l] = per_kappa * ir3 * dz


@inlined_kernel
def dimming(a: float, b: float, t: float) -> tuple[float, float, float, float]:
    """Covered part of a disk of radius a by one of radius b, centres t apart, and its partials by a, b and t.

    Small angles, as plane disks. The partials of the lens-shaped overlap are its two arcs and its chord; they are
    continuous at every contact of the limbs, so that the force is smooth enough for the integrator once a node is in
    the shadow. A slow passage far behind the Earth may lie between nodes: at 800,000 km and 2 km/s the default
    tolerance sees nothing of it, 0.14 m after 35 days for Apophis and 300 m at 3e-3 m^2/kg; 1e-11 does.
    """
    if t >= a + b:
        return 0.0, 0.0, 0.0, 0.0
    if t <= b - a:
        return 1.0, 0.0, 0.0, 0.0
    if t <= a - b:
        return b * b / (a * a), -2.0 * b * b / (a * a * a), 2.0 * b / (a * a), 0.0
    x = 0.5 * (t + (a - b) * (a + b) / t)
    half_chord = np.sqrt((a - x) * (a + x))
    arc_a, arc_b = a * np.arccos(x / a), b * np.arccos((t - x) / b)
    disk = np.pi * a * a
    covered = (a * arc_a + b * arc_b - t * half_chord) / disk
    return covered, 2.0 * arc_a / disk - 2.0 * covered / a, 2.0 * arc_b / disk, -2.0 * half_chord / disk


@inlined_kernel
def shade(n: int, X: Array, P: Array, strength: float, A: Array) -> None:
    """Take away the sunlight that the Earth (row 3) keeps from the asteroid: A -= covered strength d/r^3."""
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        ex, ey, ez = X[l] - P[3, l], X[8 + l] - P[3, 8 + l], X[16 + l] - P[3, 16 + l]
        e2 = ex * ex + ey * ey + ez * ez
        if dx * ex + dy * ey + dz * ez <= 0.0 or e2 <= EARTH_RADIUS_KM * EARTH_RADIUS_KM:
            continue  # by day, or below the ground
        cx, cy, cz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
        r2 = dx * dx + dy * dy + dz * dz
        r, e = np.sqrt(r2), np.sqrt(e2)
        apart = np.arcsin(np.sqrt(cx * cx + cy * cy + cz * cz) / (r * e))
        covered, _, _, _ = dimming(np.arcsin(SUN_RADIUS_KM / r), np.arcsin(EARTH_RADIUS_KM / e), apart)
        f = covered * strength / (r2 * r)
        A[l] -= f * dx
        A[8 + l] -= f * dy
        A[16 + l] -= f * dz


@inlined_kernel
def shade_gradient(n: int, X: Array, P: Array, strength: float, per_kappa: float, G: Array, F: Array) -> None:
    """dA/dX = -covered f (I - 3 d d^T/r^2) - f d grad(covered)^T with f = strength/r^3, and the same part of F.

    With the apparent radii a, b and the angle t between d and e: grad a = -tan a d/r^2, grad b = -tan b e/|e|^2,
    grad t = (cos t d/r - e/|e|)/(r sin t) + (cos t e/|e| - d/r)/(|e| sin t).
    """
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        ex, ey, ez = X[l] - P[3, l], X[8 + l] - P[3, 8 + l], X[16 + l] - P[3, 16 + l]
        dot, e2 = dx * ex + dy * ey + dz * ez, ex * ex + ey * ey + ez * ez
        if dot <= 0.0 or e2 <= EARTH_RADIUS_KM * EARTH_RADIUS_KM:
            continue
        cx, cy, cz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
        r2 = dx * dx + dy * dy + dz * dz
        r, e = np.sqrt(r2), np.sqrt(e2)
        sine = np.sqrt(cx * cx + cy * cy + cz * cz) / (r * e)
        a, b = np.arcsin(SUN_RADIUS_KM / r), np.arcsin(EARTH_RADIUS_KM / e)
        covered, by_a, by_b, by_t = dimming(a, b, np.arcsin(sine))
        u = by_t / (r * e * sine) if by_t != 0.0 else 0.0  # centres in line: a maximum, no slope
        along_d = -by_a * np.tan(a) / r2 + u * (dot / r2 - 1.0)
        along_e = -by_b * np.tan(b) / e2 + u * (dot / e2 - 1.0)
        f = strength / (r2 * r)
        gx, gy, gz = along_d * dx + along_e * ex, along_d * dy + along_e * ey, along_d * dz + along_e * ez
        h, c = 3.0 * covered * f / r2, covered * f
        qx, qy, qz = h * dx - f * gx, h * dy - f * gy, h * dz - f * gz
        G[l] += dx * qx - c
        G[8 + l] += dx * qy
        G[16 + l] += dx * qz
        G[24 + l] += dy * qx
        G[32 + l] += dy * qy - c
        G[40 + l] += dy * qz
        G[48 + l] += dz * qx
        G[56 + l] += dz * qy
        G[64 + l] += dz * qz - c
        k = covered * per_kappa / (r2 * r)
        F[l] -= k * dx
        F[8 + l] -= k * dy
        F[16 + l] -= k * dz
