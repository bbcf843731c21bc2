"""The asteroid: its orbit, brightness, body and non-gravitational parameters."""

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.declared import TrueMagnitude, twin_complaints
from nebosvod.mission.fields import (
    Block,
    KeyPath,
    PositiveNumber,
    Several,
    Text,
)
from nebosvod.mission.found import FileOrbit, parameter_of
from nebosvod.mission.nongrav import Law, Nongrav
from nebosvod.mission.orbit import (
    INVERSE_SQUARE,
    WATER_ICE,
    CometaryOrbit,
    EquinoctialOrbit,
    ImpactOrbit,
    KeplerianOrbit,
    SbdbOrbit,
    StateOrbit,
)
from nebosvod.mission.parameter import LOGARITHMS, MAGNITUDE, Parameter, parameter_from
from nebosvod.mission.uncertainty import Photocentre, ProcessNoise
from nebosvod.mission.values import (
    Uncertain,
    UncertainAlbedo,
    UncertainDensity,
    UncertainEmission,
    UncertainMass,
    UncertainRadius,
)

Correlated = Literal["radius", "mass", "albedo", "thermal_emission", "A1", "A2", "A3", "a1_residual", "H"]
FOUR_THIRDS_PI = 4.1887902047863905
Orbit = Annotated[
    CometaryOrbit | KeplerianOrbit | EquinoctialOrbit | StateOrbit | ImpactOrbit | SbdbOrbit | FileOrbit,
    Field(discriminator="kind"),
]


WITH_COVARIANCE = (SbdbOrbit, FileOrbit)  # orbits that bring one, and perhaps A1..A3 and their law


class Magnitude(Block):
    """Brightness by the H, G law (Bowell et al. 1989)."""

    H: Annotated[float, Field(ge=-5.0, le=40.0, description="Absolute magnitude")]
    G: Annotated[float, Field(ge=-0.5, le=1.0, description="Slope parameter")] = 0.15
    sigma: PositiveNumber | None = Field(None, description="Of H; it matters where H is correlated with what is seen")
    treatment: Treatment = "fixed"
    true: TrueMagnitude | None = Field(None, description="What H really is, where that is not as assumed")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A sigma asks for a treatment, and a treatment for a sigma."""
        if self.sigma is not None and "treatment" not in self.model_fields_set:
            return [(("treatment",), "is missing beside a sigma")]
        if self.sigma is None and self.treatment != "fixed":
            return [(("sigma",), f"is missing; {self.treatment} needs it")]
        return twin_complaints(self.true, self.sigma is not None, self.treatment)

    @property
    def truth(self) -> "Magnitude":
        """What it really is."""
        if self.true is None:
            return self
        said = {("H" if key == "value" else key): value for key, value in self.true.said.items()}
        return self.model_copy(update={**said, "true": None})

    @property
    def phase_integral(self) -> float:
        """q = 0.290 + 0.684 G (Bowell et al. 1989): Bond albedo = q times geometric albedo."""
        return 0.290 + 0.684 * self.G


class Correlation(Block):
    """How the errors of two parameters go together, beside their own sigmas."""

    between: Annotated[Several[Correlated], Field(min_length=2, max_length=2)]
    value: Annotated[float, Field(gt=-1.0, lt=1.0, description="Of the logarithms where a distribution is lognormal")]

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Two of them."""
        return [(("between",), "names one parameter twice")] if self.between[0] == self.between[1] else []


class Body(Block):
    """The asteroid; its orbit may not be known yet."""

    name: Text
    orbit: Orbit | None = None
    magnitude: Magnitude | None = None
    radius: UncertainRadius | None = None
    diameter: UncertainRadius | None = None
    mass: UncertainMass | None = None
    density: UncertainDensity | None = None
    albedo: UncertainAlbedo | None = Field(None, description="Bond albedo")
    geometric_albedo: UncertainAlbedo | None = Field(None, description="Geometric albedo; needs magnitude.G")
    thermal_emission: UncertainEmission | None = None
    nongrav: Nongrav | None = None
    photocentre: Photocentre | None = None
    process_noise: ProcessNoise | None = None
    correlations: Annotated[Several[Correlation], Field(max_length=36)] = ()

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """One of each pair; all three of the body or none; A1 against radiation pressure; correlations of what errs."""
        return self._pair_complaints() or self._force_complaints() or self._correlation_complaints()

    def _pair_complaints(self) -> list[tuple[KeyPath, str]]:
        found: list[tuple[KeyPath, str]] = []
        pairs = (("radius", "diameter"), ("mass", "density"), ("albedo", "geometric_albedo"))
        for one, other in pairs:
            if getattr(self, one) is not None and getattr(self, other) is not None:
                found.append(((other,), f"{one} and {other} say the same thing; keep one of the two"))
        given = [one if getattr(self, one) is not None else other for one, other in pairs if self._either(one, other)]
        if given and len(given) < len(pairs):
            missing = [f"{one} (or {other})" for one, other in pairs if not self._either(one, other)]
            needs = f"radiation pressure also needs {' and '.join(missing)}; how bright it is says magnitude.H alone"
            found.append(((given[0],), needs))
        if self.thermal_emission is not None and not given:
            found.append((("thermal_emission",), "needs radius, mass and albedo: it is a part of radiation pressure"))
        if self.geometric_albedo is not None and self.magnitude is None:
            found.append(
                (("geometric_albedo",), "needs magnitude with G: Bond albedo = (0.290 + 0.684 G) geometric albedo")
            )
        if self.photocentre is not None and self.photocentre.radius is None and not self._either("radius", "diameter"):
            found.append((("photocentre", "radius"), "is missing, and the object has none; the offset is a part of it"))
        if self.density is not None:
            found += self._density_complaints(self.density, self.radius or self.diameter)
        return found

    def _either(self, one: str, other: str) -> bool:
        return getattr(self, one) is not None or getattr(self, other) is not None

    @staticmethod
    def _density_complaints(density: UncertainDensity, radius: UncertainRadius | None) -> list[tuple[KeyPath, str]]:
        """The mass that a density implies is correlated with the radius: both need the same treatment."""
        if radius is None or radius.treatment == "fixed" == density.treatment:
            return []
        if radius.treatment not in ("fixed", density.treatment):
            text = f"radius is {radius.treatment} and density {density.treatment}; give both one treatment: the mass "
            return [(("density",), text + "they imply is correlated with the radius (or give the mass itself)")]
        if radius.treatment != "fixed" and (radius.sigma is None or density.sigma is None):
            return [(("density",), "density and radius need a sigma each (or give the mass itself)")]
        if radius.treatment != "fixed" and radius.distribution != density.distribution:
            text = f"radius is {radius.distribution} and density {density.distribution}; give both one distribution"
            return [(("density", "distribution"), f"{text}: the mass follows from both (or give the mass itself)")]
        return []

    def _force_complaints(self) -> list[tuple[KeyPath, str]]:
        """A1 and radiation pressure are one column of the sensitivities (both fall as r^-2)."""
        nongrav = self.nongrav or Nongrav()
        if self.has_radiation and isinstance(self.orbit, FileOrbit) and self.orbit.sphere:
            return [(("orbit", "file"), "brings radius, mass and albedo of its own; remove those of the object")]
        absent = self._values_absent(nongrav)
        if absent:
            text = f"has {', '.join(absent)} but no value of it; paste model_pars too, or give object.nongrav"
            return [(("orbit", "covariance"), text)]
        if "law" in nongrav.model_fields_set and isinstance(self.orbit, WITH_COVARIANCE) and self.orbit.law is not None:
            return [(("nongrav", "law"), "the orbit's model_pars say the law of its A1..A3; remove one of the two")]
        if not self.has_radiation:
            if nongrav.a1_residual is not None:
                return [(("nongrav", "a1_residual"), "needs radius, mass and albedo; without them say A1")]
            return []
        one = "act through one combination, so at most one of them may lack a sigma"
        advice = "; remove radius, mass and albedo to run with A1, or replace A1 by a1_residual with a sigma"
        like_radiation = self.nongrav_law["m"] == 2.0 and self.nongrav_law["k"] == 0.0
        if nongrav.A1 is not None and like_radiation:
            return [(("nongrav", "A1"), "A1 repeats the radiation pressure of radius, mass and albedo" + advice)]
        from_orbit = (
            isinstance(self.orbit, WITH_COVARIANCE) and self.orbit.a1 is not None and nongrav.a1_residual is None
        )
        if from_orbit and like_radiation:
            return [(("orbit",), "the orbit carries A1, which repeats the radiation pressure of the body" + advice)]
        diffuse = [p.key for p in self.radiation_parameters if p.treatment == "estimated" and p.sigma is None]
        if len(diffuse) > 1:
            return [((diffuse[1],), f"{' and '.join(diffuse)} {one}")]
        return []

    def _values_absent(self, nongrav: Nongrav) -> list[str]:
        """A1..A3 in the covariance of an SBDB orbit whose values nobody says."""
        if not isinstance(self.orbit, WITH_COVARIANCE):
            return []
        said = [n for n in ("A1", "A2", "A3") if getattr(nongrav, n) or self.orbit.nongrav_value(n) is not None]
        said += ["A1"] if nongrav.a1_residual else []
        labels = self.orbit.labels if isinstance(self.orbit, FileOrbit) else self.orbit.covariance.labels
        return [n for n in labels if n in ("A1", "A2", "A3") and n not in said]

    @property
    def truth(self) -> Self:
        """The body as it really is; itself where nothing is declared beside what is assumed."""
        found = {key: getattr(self, key) for key in type(self).model_fields}
        changed: dict[str, Any] = {
            key: value.truth
            for key, value in found.items()
            if isinstance(value, Uncertain | Magnitude)
            and not isinstance(value, Photocentre)
            and value.true is not None
        }
        if self.nongrav is not None and (own := self.nongrav.declared):
            changed["nongrav"] = self.nongrav.model_copy(update=own)
        return self.model_copy(update=changed) if changed else self

    @property
    def has_radiation(self) -> bool:
        """Whether radiation pressure acts (radius, mass and albedo are given)."""
        return self._either("radius", "diameter")

    @property
    def photocentre_radius_km(self) -> float:
        """Radius on which the photocentre's offset is measured."""
        own = self.photocentre.radius if self.photocentre is not None else None
        return (own if own is not None else self._radius().quantity[1]) / 1000.0

    @property
    def radiation_parameters(self) -> tuple[Parameter, ...]:
        """radius_m, mass_kg, albedo (Bond), thermal_emission; empty without radiation pressure."""
        if not self.has_radiation:
            return self._sphere_of_orbit()
        emission = self.thermal_emission or UncertainEmission(value=0.0)
        heat = parameter_from("thermal_emission", "thermal_emission", emission)
        return (self._radius(), self._mass(), self._albedo(), heat)

    def _sphere_of_orbit(self) -> tuple[Parameter, ...]:
        """The same of a sphere that came with the orbit's file."""
        sphere = self.orbit.sphere if isinstance(self.orbit, FileOrbit) else {}
        return tuple(
            Parameter(
                name=parameter_of(group), group=group, key=group, value=value, sigma=None, treatment="fixed",
                origin="orbit",
            )
            for group, value in sphere.items()
        )  # fmt: skip

    @property
    def nongrav_parameters(self) -> tuple[Parameter, ...]:
        """a1_au_d2, a2_au_d2, a3_au_d2 as far as given here or by an SBDB orbit; A1 is its residual with radiation."""
        block = self.nongrav or Nongrav()
        given = {"A1": block.A1, "A2": block.A2, "A3": block.A3}
        found = []
        for label, item in given.items():
            name = f"{label.lower()}_au_d2"
            residual = block.a1_residual
            if label == "A1" and residual is not None:
                parameter = Parameter(
                    name=name,
                    group="a1_residual",
                    key="a1_residual",
                    value=residual.value,
                    sigma=residual.sigma,
                    treatment=residual.treatment,
                )
                found.append(parameter)
            elif item is not None:
                found.append(parameter_from(name, label, item))
            elif isinstance(self.orbit, WITH_COVARIANCE) and self.orbit.nongrav_value(label) is not None:
                value = self.orbit.nongrav_value(label) or 0.0
                found.append(
                    Parameter(
                        name=name, group=label, key=label, value=value, sigma=None, treatment="fixed", origin="orbit"
                    )
                )
        return tuple(found)

    @property
    def nongrav_law(self) -> dict[str, float]:
        """Constants of g(r) by the keywords of the force model: alpha, r0_au, m, n, k."""
        if isinstance(self.orbit, WITH_COVARIANCE) and self.orbit.law is not None:
            return self.orbit.law
        said = self.nongrav.law if self.nongrav is not None else "inverse_square"
        if isinstance(said, Law):
            return said.constants
        return dict(WATER_ICE if said == "water_ice" else INVERSE_SQUARE)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every dynamic parameter that acts, fixed ones included."""
        return self.radiation_parameters + self.nongrav_parameters

    @property
    def radius_mass_covariance(self) -> float:
        """Covariance of these two parameters: not zero when the mass comes from a density and an uncertain radius."""
        radius = self._radius() if self.has_radiation else None
        if radius is None or self.density is None or radius.treatment == "fixed" or radius.sigma is None:
            return 0.0
        return 3.0 * self._mass().per_logarithm / radius.per_logarithm * radius.sigma**2

    @property
    def statements(self) -> tuple[str, ...]:
        """Conversions made on the way, in words for the report."""
        said = []
        if self.geometric_albedo is not None and self.magnitude is not None:
            q = self.magnitude.phase_integral
            said.append(
                f"Bond albedo {self._albedo().quantity[1]:.4g} = q x geometric albedo {self.geometric_albedo.value:g}, "
                f"q = 0.290 + 0.684 G = {q:.4f} at G = {self.magnitude.G:g}; the uncertainty of G is not counted"
            )
        if self.density is not None:
            mass = self._mass().quantity[1]
            said.append(f"mass {mass:.4g} kg from density {self.density.value:g} kg/m^3 and the radius")
        if self.has_radiation and self.thermal_emission is None:
            said.append("thermal re-emission 0: an isothermal body")
        for p in self.radiation_parameters:
            if p.name in LOGARITHMS and p.treatment != "fixed":
                text = f"the error of the {p.group} is lognormal: {p.quantity[1]:.4g} is the median"
                said.append(f"{text}, its natural logarithm has a sigma of {p.sigma:.4g}")
        return tuple(said)

    def _radius(self) -> Parameter:
        if self.diameter is None:
            return parameter_from("radius_m", "radius", self.radius)
        return parameter_from("radius_m", "radius", self.diameter, 0.5, key="diameter")

    def _albedo(self) -> Parameter:
        if self.geometric_albedo is None or self.magnitude is None:
            return parameter_from("albedo", "albedo", self.albedo)
        return parameter_from(
            "albedo", "albedo", self.geometric_albedo, self.magnitude.phase_integral, key="geometric_albedo"
        )

    def _mass(self) -> Parameter:
        if self.density is None:
            return parameter_from("mass_kg", "mass", self.mass)
        radius = self._radius()
        mass = FOUR_THIRDS_PI * radius.quantity[1] ** 3 * self.density.value
        by_radius = 3.0 * (radius.sigma or 0.0) / radius.per_logarithm * (radius.treatment != "fixed")
        by_density = (self.density.sigma or 0.0) / self.density.value
        sigma = math.hypot(by_radius, by_density) * mass or None
        given = self.density.model_copy(update={"value": mass, "sigma": sigma})
        return parameter_from("mass_kg", "mass", given, key="density")

    @property
    def correlated(self) -> dict[tuple[str, str], float]:
        """Correlations by pairs of groups, either way."""
        pairs = [(one.between, one.value) for one in self.correlations]
        return {pair: value for (a, b), value in pairs for pair in ((a, b), (b, a))}

    def _correlation_complaints(self) -> list[tuple[KeyPath, str]]:
        found: list[tuple[KeyPath, str]] = []
        live = {p.group: p for p in self.parameters if p.sigma is not None and p.treatment != "fixed"}
        for i, one in enumerate(self.correlations):
            for name in one.between:
                if name not in live:
                    found.append((("correlations", i, "between"), f"{name} has no error here: it needs a sigma"))
            if any(set(one.between) == set(other.between) for other in self.correlations[:i]):
                found.append((("correlations", i), "says a pair again"))
            if self.radius_mass_covariance and {"radius", "mass"} & set(one.between):
                found.append((("correlations", i), "stands against density, which ties mass to radius; give the mass"))
        if found or not self.correlations:
            return found
        names: list[str] = list(dict.fromkeys(name for one in self.correlations for name in one.between))
        matrix = np.eye(len(names))
        for (a, b), value in self.correlated.items():
            matrix[names.index(a), names.index(b)] = value
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least <= 1e-12:
            text = f"cannot all be so: no covariance has them (smallest eigenvalue {least:.3g})"
            return [(("correlations",), text)]
        return []


class Target(Body):
    """The asteroid."""

    orbit: Orbit

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every dynamic parameter that acts, fixed ones included, and an uncertain absolute magnitude."""
        magnitude = self.magnitude
        if magnitude is None or magnitude.sigma is None:
            return super().parameters
        H = Parameter(
            name=MAGNITUDE, group="H", key="magnitude", value=magnitude.H, sigma=magnitude.sigma,
            treatment=magnitude.treatment,
        )  # fmt: skip
        return (*super().parameters, H)
