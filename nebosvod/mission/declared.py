"""What an error really is, where a mission declares it beside what is assumed: the twins under the key `true`.

Estimators weigh by the assumption. Truth, Monte Carlo, K_true and budgets are by the twin; what a twin does not say is
as assumed. A mean that differs from the assumed one shifts the estimate (Guo, Ivashkin 2018, (3.2)).
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.fields import (
    Acceleration,
    Angle,
    Block,
    Duration,
    Fraction,
    KeyPath,
    Length,
    Offset,
    PositiveAngle,
    PositiveDuration,
    Several,
    Size,
    Speed,
    measured,
)
from nebosvod.units import ACCELERATION, ANGLE, ANGLE_RATE, DENSITY, LENGTH, MASS, RADIUS, SPEED

BiasCorrelation = Literal["constant", "drift", "per_arc", "gauss_markov", "per_zone"]
PositionCorrelation = Literal["white", "constant", "gauss_markov", "orbit_error"]
ThreeOffsets = Annotated[Several[Length], Field(min_length=3, max_length=3)]
ThreeRates = Annotated[Several[Speed], Field(min_length=3, max_length=3)]
_ZERO = "0 or more"
AnySpread = Annotated[float, measured(ANGLE, 0.0, text=_ZERO)]
RateSpread = Annotated[float, measured(ANGLE_RATE, 0.0, text=_ZERO)]
LengthSpread = Annotated[float, measured(LENGTH, 0.0, text=_ZERO)]
SpeedSpread = Annotated[float, measured(SPEED, 0.0, text=_ZERO)]
ThreeSpreads = Annotated[Several[LengthSpread], Field(min_length=3, max_length=3)]
RadiusSpread = Annotated[float, measured(RADIUS, 0.0, text=_ZERO)]
MassSpread = Annotated[float, measured(MASS, 0.0, text=_ZERO)]
DensitySpread = Annotated[float, measured(DENSITY, 0.0, text=_ZERO)]
AccelerationSpread = Annotated[float, measured(ACCELERATION, 0.0, text=_ZERO)]
Spread = Annotated[float, Field(ge=0.0, le=1e3)]
Complaint = tuple[KeyPath, str]


class Twin(Block):
    """What an error really is; keys that are left out are as assumed."""

    def complaints(self) -> list[Complaint]:
        """It says something."""
        return [] if self.said else [((), "says nothing; name what is not as assumed, or remove it")]

    @property
    def said(self) -> Mapping[str, Any]:
        """What it says by its keys."""
        return {key: getattr(self, key) for key in type(self).model_fields if getattr(self, key) is not None}


def _one_or_pair(twin: "TrueNoise | TrueBias") -> list[Complaint]:
    if twin.sigma is not None and (twin.sigma_ra is not None or twin.sigma_dec is not None):
        return [(("sigma",), "stands beside sigma_ra or sigma_dec; keep either sigma or the pair")]
    return []


class TrueNoise(Twin):
    """What the noise of a telescope really is."""

    sigma: PositiveAngle | None = None
    sigma_ra: PositiveAngle | None = None
    sigma_dec: PositiveAngle | None = None
    timing: Duration | None = None
    mean_ra: Angle | None = Field(None, description="Of every measurement")
    mean_dec: Angle | None = None

    def complaints(self) -> list[Complaint]:
        """One form of the sigma."""
        return [*super().complaints(), *_one_or_pair(self)]


class TrueBias(Twin):
    """What a bias really is; with a correlation of its own it has the keys of that."""

    correlation: BiasCorrelation | None = Field(None, description="Where it changes in another way than is assumed")
    sigma: AnySpread | None = None
    sigma_ra: AnySpread | None = None
    sigma_dec: AnySpread | None = None
    mean_ra: Angle | None = None
    mean_dec: Angle | None = None
    drift: RateSpread | None = None
    gap: PositiveDuration | None = Field(None, description="A longer pause begins a new arc, of per_arc")
    time: Duration | None = Field(None, description="Correlation time of gauss_markov")
    zone: PositiveAngle | None = Field(None, description="Side of a zone of the sky, of per_zone")

    def complaints(self) -> list[Complaint]:
        """One form of the sigma; a time is more than none."""
        short = [(("time",), "must be more than 0")] if self.time == 0.0 else []
        return [*super().complaints(), *_one_or_pair(self), *short]


class TruePosition(Twin):
    """What the error of a telescope's position really is, on the axes of the assumption."""

    correlation: PositionCorrelation | None = Field(None, description="Where it changes in another way than is assumed")
    sigma: LengthSpread | None = None
    sigmas: ThreeSpreads | None = None
    velocity_sigma: SpeedSpread | None = None
    mean: ThreeOffsets | None = Field(None, description="On the axes of its frame")
    time: Duration | None = Field(None, description="Correlation time of gauss_markov")

    def complaints(self) -> list[Complaint]:
        """One form of the sigma; a time is more than none."""
        found = super().complaints()
        if self.sigma is not None and self.sigmas is not None:
            found.append((("sigma",), "stands beside sigmas; keep one"))
        if self.time == 0.0:
            found.append((("time",), "must be more than 0"))
        return found


class TrueTiming(Twin):
    """What the offset of a clock really is."""

    sigma: Duration | None = None
    mean: Offset | None = None


class TruePlateScale(Twin):
    """What the error of the plate scale really is."""

    sigma: Annotated[float, Field(ge=0.0, le=0.1)] | None = None
    mean: Annotated[float, Field(ge=-0.1, le=0.1)] | None = None


class TrueProcessNoise(Twin):
    """What the process noise really is."""

    velocity: SpeedSpread | None = None


class TrueValue(Twin):
    """Where a value really lies, and how it scatters about that."""

    value: float | None = None
    sigma: float | None = None


class TrueRadius(TrueValue):
    """Of a radius or a diameter (m)."""

    value: Size | None = None
    sigma: RadiusSpread | None = None


class TrueMass(TrueValue):
    """Of a mass (kg)."""

    value: MassSpread | None = None
    sigma: MassSpread | None = None


class TrueDensity(TrueValue):
    """Of a bulk density (kg/m^3)."""

    value: DensitySpread | None = None
    sigma: DensitySpread | None = None


class TrueAlbedo(TrueValue):
    """Of an albedo."""

    value: Fraction | None = None
    sigma: Spread | None = None


class TrueEmission(TrueValue):
    """Of the share re-emitted on the day side."""

    value: Annotated[float, Field(ge=0.0, le=4.0 / 9.0 + 1e-12)] | None = None
    sigma: Spread | None = None


class TrueAcceleration(TrueValue):
    """Of a non-gravitational parameter (au/d^2)."""

    value: Acceleration | None = None
    sigma: AccelerationSpread | None = None


class TrueMagnitude(TrueValue):
    """Of an absolute magnitude."""

    value: Annotated[float, Field(ge=-5.0, le=40.0)] | None = None
    sigma: Spread | None = None


class TrueAmplitude(TrueValue):
    """Of the amplitude of the photocentre."""

    value: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None
    sigma: Spread | None = None


def misplaced(block: Block, correlation: str, owners: dict[str, tuple[str, bool]]) -> list[Complaint]:
    """Keys that belong to one correlation only: complain where they are missing there, or stand elsewhere.

    owners : key -> (the correlation it belongs to, whether that one needs it).
    """
    found: list[Complaint] = []
    for key, (owner, needed) in owners.items():
        said = getattr(block, key) is not None
        if said and correlation != owner:
            found.append(((key,), f"belongs to {owner} only (got correlation {correlation})"))
        if needed and not said and correlation == owner:
            found.append(((key,), f"is missing; {owner} needs it"))
    return found


def twin_complaints(twin: Twin | None, has_sigma: bool, treatment: Treatment) -> list[Complaint]:
    """A twin stands beside an assumption that something is made of."""
    if twin is None:
        return []
    if treatment == "fixed":
        return [
            (("true",), "means nothing where treatment is fixed: the truth has no error (say ignored to count one)")
        ]
    if not has_sigma:
        return [(("true",), "needs a sigma beside it: where nothing is assumed, nothing can be assumed wrongly")]
    return []


class TrueStateMean(Block):
    """Mean of the true state less that of the prior, ICRF."""

    position: ThreeOffsets = (0.0, 0.0, 0.0)
    velocity: ThreeRates = (0.0, 0.0, 0.0)


class TruePrior(Twin):
    """How wrong the prior orbit really is."""

    scale: float | None = Field(None, ge=0.0, le=1e6, description="Of every sigma, at the epoch of the prior")
    mean: TrueStateMean | None = Field(None, description="True less prior state at the reference epoch, ICRF")
