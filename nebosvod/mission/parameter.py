"""A dynamic parameter as it is estimated, made from a block of the file."""

import math
from dataclasses import dataclass
from typing import Literal

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.values import Uncertain, UncertainPositive

# What is estimated in place of a quantity whose error is lognormal -> the quantity, as the force model names it
MAGNITUDE = "H_mag"  # the absolute magnitude among the parameters; no force feels it
LOGARITHMS = {"ln_radius": "radius_m", "ln_mass": "mass_kg", "ln_albedo": "albedo"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parameter:
    """One dynamic parameter as it is estimated: in the units of the force model, or the natural logarithm of that.

    Attributes
    ----------
    name : the column of zeta: radius_m, mass_kg, albedo, thermal_emission, a1_au_d2, a2_au_d2, a3_au_d2, or one of
        LOGARITHMS.
    group : radius, mass, albedo, thermal_emission, A1, A2, A3 or a1_residual: what `treatment` of an estimator says.
    key : what the mission file gave: the group, or diameter, density, geometric_albedo.
    value, sigma : of what the name says; sigma None = no prior.
    treatment : as the object says; estimators may override it (`Mission.treatment`).
    origin : "orbit" when the value came with an SBDB orbit.
    """

    name: str
    group: str
    key: str
    value: float
    sigma: float | None
    treatment: Treatment
    origin: Literal["object", "orbit"] = "object"

    @property
    def quantity(self) -> tuple[str, float]:
        """Name and value as the force model knows them."""
        physical = LOGARITHMS.get(self.name)
        return (self.name, self.value) if physical is None else (physical, math.exp(self.value))

    @property
    def per_logarithm(self) -> float:
        """The value, or 1 of a logarithm: what a relative error is multiplied by to be one of this parameter."""
        return 1.0 if self.name in LOGARITHMS else self.value

    @property
    def text(self) -> str:
        """Name, value and sigma for the eye."""
        name, value = self.quantity
        if self.sigma is None:
            return f"{name:<18} {value:.6g}"
        if self.name in LOGARITHMS:
            return f"{name:<18} {value:.6g} times or over {math.exp(self.sigma):.4g} (lognormal, {self.sigma:.4g})"
        return f"{name:<18} {value:.6g} +- {self.sigma:.4g}"


def parameter_from(name: str, group: str, item: Uncertain | None, factor: float = 1.0, key: str = "") -> Parameter:
    """A parameter from a block of the file, scaled; its logarithm where that is what is uncertain."""
    source = item if item is not None else Uncertain(value=0.0)
    value, sigma = source.value * factor, None if source.sigma is None else source.sigma * factor
    if isinstance(source, UncertainPositive) and source.distribution == "lognormal" and sigma is not None:
        name, value, sigma = f"ln_{group}", math.log(value), sigma / value
    return Parameter(name=name, group=group, key=key or group, value=value, sigma=sigma, treatment=source.treatment)
