"""Solar radiation pressure on a sphere, from radius, mass and albedo; one sensitivity serves all of them.

a = (S0/c) (1 au/r)^2 kappa e_r with kappa = (pi R^2/m) C_R and C_R = 1 + 4 A/9 + f_th (1 - A); A is the Bond albedo, a
Lambert sphere; f_th in [0, 4/9] is the thermal re-emission of the day side (0: isothermal). Radius, mass, albedo and
f_th act through kappa alone, so the kernel integrates dX/dkappa and `kappa_partials` maps it.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]
PARAMETERS = ("radius_m", "mass_kg", "albedo", "thermal_emission")


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


@kernel
def radiation(n: int, X: Array, P: Array, strength: float, A: Array) -> None:
    """Add strength e_r/r^2; strength = (S0/c) (1 au)^2 kappa in km^3/s^2."""
    for l in range(n):
        dx, dy, dz = X[l] - P[0, l], X[8 + l] - P[0, 8 + l], X[16 + l] - P[0, 16 + l]
        r2 = dx * dx + dy * dy + dz * dz
        f = strength / (r2 * np.sqrt(r2))
        A[l] += f * dx
        A[8 + l] += f * dy
        A[16 + l] += f * dz


@kernel
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
