"""Values that are uncertain: how wrong they may be, what an estimator does about it, and what they really are."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from nebosvod.borders.treatment import TREATMENTS, Treatment
from nebosvod.mission.declared import (
    TrueAcceleration,
    TrueAlbedo,
    TrueDensity,
    TrueEmission,
    TrueMass,
    TrueRadius,
    TrueValue,
    twin_complaints,
)
from nebosvod.mission.fields import (
    Acceleration,
    Block,
    DensityKgM3,
    Fraction,
    KeyPath,
    MassKg,
    PositiveAcceleration,
    PositiveNumber,
    Size,
)


class Uncertain(Block):
    """A value, how uncertain it is, and what an estimator does about it. A bare value is fixed."""

    value: float
    sigma: float | None = None
    treatment: Treatment = "fixed"
    true: TrueValue | None = Field(None, description="What it really is, where that is not as assumed")

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, data: Any) -> Any:
        return data if isinstance(data, dict) else {"value": data}

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A sigma asks for a treatment; a treatment that needs a sigma must have one."""
        if self.sigma is not None and "treatment" not in self.model_fields_set:
            return [(("treatment",), f"is missing beside a sigma (allowed: {', '.join(TREATMENTS)})")]
        if self.sigma is None and self.treatment in ("considered", "ignored"):
            return [(("treatment",), f"{self.treatment} needs a sigma: how wrong may the value be?")]
        return twin_complaints(self.true, self.sigma is not None, self.treatment)

    @property
    def truth(self) -> Self:
        """What it really is: the value and the sigma of its twin where that has them."""
        return self if self.true is None else self.model_copy(update={**self.true.said, "true": None})

    @classmethod
    def __get_pydantic_json_schema__(cls, source: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """A block, or the bare value as its short form."""
        block = handler.resolve_ref_schema(handler(source))
        bare = dict(block["properties"]["value"])
        whole = dict(block) | {"dependentRequired": {"sigma": ["treatment"]}}
        return {"anyOf": [bare, whole], "description": block.get("description", "")}


class UncertainPositive(Uncertain):
    """A positive value: its error may be one of its logarithm, so that no draw and no step makes it negative."""

    distribution: Literal["normal", "lognormal"] = Field(
        "normal", description="lognormal: the logarithm is uncertain, by sigma / value; the value is the median"
    )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A logarithm needs a positive value and a sigma below it."""
        found = super().complaints()
        if self.distribution == "lognormal":
            if self.sigma is None:
                found.append((("distribution",), "lognormal needs a sigma: how wrong may the value be?"))
            elif not self.value > 0.0:
                found.append((("value",), f"must be positive where distribution is lognormal (got {self.value:g})"))
            elif self.sigma > self.value:
                text = "must not exceed the value where distribution is lognormal: sigma / value is the sigma of its"
                found.append((("sigma",), f"{text} natural logarithm (got {self.sigma:g}, value {self.value:g})"))
        return found


class UncertainRadius(UncertainPositive):
    """A radius (m)."""

    value: Size
    sigma: Size | None = None
    true: TrueRadius | None = None


class UncertainMass(UncertainPositive):
    """A mass (kg)."""

    value: MassKg
    sigma: MassKg | None = None
    true: TrueMass | None = None


class UncertainDensity(UncertainPositive):
    """A bulk density (kg/m^3)."""

    value: DensityKgM3
    sigma: DensityKgM3 | None = None
    true: TrueDensity | None = None


class UncertainAlbedo(UncertainPositive):
    """An albedo, 0 to 1."""

    value: Fraction
    sigma: PositiveNumber | None = None
    true: TrueAlbedo | None = None


class UncertainEmission(Uncertain):
    """The share re-emitted on the day side, 0 (isothermal) to 4/9 (no rotation, no conduction)."""

    value: Annotated[float, Field(ge=0.0, le=4.0 / 9.0 + 1e-12)]
    sigma: PositiveNumber | None = None
    true: TrueEmission | None = None


class UncertainAcceleration(Uncertain):
    """A non-gravitational parameter (au/d^2)."""

    value: Acceleration
    sigma: PositiveAcceleration | None = None
    true: TrueAcceleration | None = None
