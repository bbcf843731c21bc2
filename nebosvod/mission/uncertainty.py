"""What is uncertain, each with its treatment: clocks, plate scale, photocentre, process noise; the words for all."""

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.bias import Bias
from nebosvod.mission.declared import (
    Complaint,
    TrueAmplitude,
    TruePlateScale,
    TrueProcessNoise,
    TrueTiming,
    twin_complaints,
)
from nebosvod.mission.fields import (
    Block,
    Offset,
    PositiveAngle,
    PositiveDuration,
    PositiveNumber,
    PositiveSpeed,
    Size,
)
from nebosvod.mission.position import Position
from nebosvod.mission.values import Uncertain
from nebosvod.units import ARCSEC, DEG

# What is uncertain about telescopes; an estimator's treatment, the budget and the mean ratio go by these words
Group = Literal["bias", "position", "timing", "plate_scale", "photocentre", "process_noise"]
GROUPS: tuple[Group, ...] = get_args(Group)
# A line that makes it uncertain, and where the line belongs
EXAMPLES: Mapping[str, tuple[str, str]] = {
    "bias": ("bias: {sigma: 0.05 arcsec, treatment: considered}", "a telescope"),
    "position": ("position: {sigma: 3 km, correlation: white, treatment: considered}", "a telescope"),
    "timing": ("timing: {sigma: 1 s, treatment: considered}", "a telescope"),
    "plate_scale": ("plate_scale: {sigma: 1e-5, field: 10 arcmin, treatment: considered}", "a telescope"),
    "photocentre": ("photocentre: {sigma: 0.1, radius: 10 m, treatment: considered}", "object"),
    "process_noise": ("process_noise: {velocity: 0.1 mm/s, over: 30 d, treatment: considered}", "object"),
}
WIDEST_FIELD = 10.0 * DEG + 1e-12  # of a telescope; beyond, a field is no plane


class Timing(Block):
    """A clock that is wrong by the same time in all exposures; positive: exposed later than recorded."""

    sigma: PositiveDuration | None = None
    mean: Offset = 0.0
    treatment: Treatment
    true: TrueTiming | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """What is wrong in truth must say how much."""
        if self.sigma is None and self.treatment in ("considered", "ignored"):
            return [(("sigma",), f"is missing; {self.treatment} needs it")]
        return twin_complaints(self.true, self.sigma is not None, self.treatment)

    @property
    def truth(self) -> "Timing":
        """What it really is."""
        return self if self.true is None else self.model_copy(update={**self.true.said, "true": None})

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average, s; None where that is not declared."""
        return None if self.true is None or self.true.mean is None else (self.true.mean,)

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return () if self.sigma is None else (f"{self.sigma:.3g} s",)

    @property
    def has_sigma(self) -> bool:
        """Whether something is said about its size."""
        return self.sigma is not None


class PlateScale(Block):
    """A relative error of the plate scale, the same in all exposures, which put the object all over the field."""

    sigma: Annotated[float, Field(ge=1e-12, le=0.1, description="Of the relative error; its mean is 0")]
    field: PositiveAngle = Field(description="Side of the square field, at most 10 deg; its axes are RA* and Dec")
    treatment: Treatment
    true: TruePlateScale | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """A field is a plane."""
        wide = [(("field",), "is out of range (allowed up to 10 deg)")] if self.field > WIDEST_FIELD else []
        return [*wide, *twin_complaints(self.true, True, self.treatment)]

    @property
    def truth(self) -> "PlateScale":
        """What it really is; its mean is in `true_mean`."""
        sigma = self.sigma if self.true is None or self.true.sigma is None else self.true.sigma
        return self.model_copy(update={"sigma": sigma, "true": None})

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average; None where that is not declared."""
        return None if self.true is None or self.true.mean is None else (self.true.mean,)

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return (f"{self.sigma:.3g} over {self.field / ARCSEC:.4g} arcsec",)

    @property
    def has_sigma(self) -> bool:
        """It always has one."""
        return True


class Photocentre(Uncertain):
    """The light of a partly lit body lies off its centre: the amplitude, 1 being that of a Lambert sphere."""

    value: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0
    sigma: PositiveNumber | None = None
    radius: Size | None = Field(None, description="Of the body; the object's own when absent")
    true: TrueAmplitude | None = None

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return () if self.sigma is None else (f"amplitude {self.value:.3g} +- {self.sigma:.3g}",)

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average; None where that is not declared."""
        return None if self.true is None or self.true.value is None else (self.true.value,)

    @property
    def has_sigma(self) -> bool:
        """Whether something is said about its size."""
        return self.sigma is not None


MOST_INTERVALS = 100  # of process noise; 200 took a run to minutes
AT_MOST_100 = Field(json_schema_extra={"maximum": MOST_INTERVALS})  # told below with its reason


class ProcessNoise(Block):
    """White accelerations of the object that no force model has; they let its velocity walk."""

    velocity: PositiveSpeed = Field(description="Sigma of the change of velocity on each axis in the time `over`")
    over: PositiveDuration
    intervals: Annotated[
        int, AT_MOST_100, Field(ge=3, description="Of constant acceleration, over the measurements")
    ] = 24
    treatment: Treatment
    true: TrueProcessNoise | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """A twin stands beside something uncertain, and a run ends within a minute or so."""
        found = twin_complaints(self.true, True, self.treatment)
        if self.intervals > MOST_INTERVALS:
            why = "each adds three parameters, and the time of a run grows as their cube: 24 are enough for most arcs"
            found.append(
                (("intervals",), f"is out of range (got {self.intervals}; allowed {MOST_INTERVALS} or less); {why}")
            )
        return found

    @property
    def density_km2_s3(self) -> float:
        """Density of its spectrum on each axis."""
        return self.velocity**2 / self.over

    @property
    def truth(self) -> "ProcessNoise":
        """What it really is."""
        velocity = self.velocity if self.true is None or self.true.velocity is None else self.true.velocity
        return self.model_copy(update={"velocity": velocity, "true": None})

    @property
    def true_mean(self) -> None:
        """Its mean is zero."""
        return None

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return (f"{1e6 * self.velocity:.3g} mm/s over {self.over / 86400.0:.3g} d",)

    @property
    def has_sigma(self) -> bool:
        """It always has one."""
        return True


Error = Bias | Position | Timing | PlateScale | Photocentre | ProcessNoise
