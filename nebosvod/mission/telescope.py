"""Space telescopes: where they are, how well they measure, what is uncertain about them, what they cannot see."""

from typing import Annotated, Literal

from pydantic import Field

from nebosvod.mission.bias import Bias, Pair, one_or_pair, sigma_update
from nebosvod.mission.declared import TrueNoise
from nebosvod.mission.fields import (
    Altitude,
    Block,
    Duration,
    KeyPath,
    PositiveAngle,
    PositiveDuration,
    Separation,
    Several,
    Text,
    When,
)
from nebosvod.mission.position import Position
from nebosvod.mission.spacecraft import Ground, TelescopeOrbit
from nebosvod.mission.uncertainty import PlateScale, Timing

NAUTICAL_TWILIGHT = -12.0 / 57.29577951308232  # rad, altitude of the Sun at its end
LEAST_ALTITUDE = 20.0 / 57.29577951308232  # rad, 2.9 air masses


class ImageNoise(Block):
    """What faintness, a trail and the size of the body add to the noise of a measurement."""

    magnitude: Annotated[float, Field(ge=-30.0, le=40.0, description="V of a star that has this `snr`")]
    snr: Annotated[float, Field(ge=0.1, le=1e5, description="Signal over noise")]
    limited_by: Literal["background", "photons"] = Field("background", description="What the noise of the image is of")


class Noise(Block):
    """Random error of one measurement: one sigma for both axes, or one each; timing jitter."""

    sigma: PositiveAngle | None = None
    sigma_ra: PositiveAngle | None = Field(None, description="Along right ascension, times cos Dec")
    sigma_dec: PositiveAngle | None = None
    timing: Duration = Field(0.0, description="Sigma of the time of exposure")
    image: ImageNoise | None = Field(None, description="Adds what faintness, a trail and the size of the body cost")
    true: TrueNoise | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Either sigma, or both of the pair."""
        return one_or_pair(self.sigma, self.sigma_ra, self.sigma_dec)

    @property
    def sigma_rad(self) -> Pair:
        """Sigma in RA* and Dec, rad."""
        return (self.sigma_ra or self.sigma or 0.0, self.sigma_dec or self.sigma or 0.0)

    @property
    def truth(self) -> "Noise":
        """What it really is, but for its mean."""
        if self.true is None:
            return self
        twin = self.true
        timing = self.timing if twin.timing is None else twin.timing
        pair = sigma_update(self.sigma_rad, twin.sigma, twin.sigma_ra, twin.sigma_dec)
        return self.model_copy(update={**pair, "timing": timing, "true": None})

    @property
    def mean_rad(self) -> Pair:
        """What it really is on average in RA* and Dec, rad; 0 is assumed."""
        return (0.0, 0.0) if self.true is None else (self.true.mean_ra or 0.0, self.true.mean_dec or 0.0)


class Exclusion(Block):
    """Where a telescope cannot look: angles from the Sun's centre, the limb of Earth and Moon, a site's horizon."""

    sun: Separation | None = None
    sun_max: Separation | None = Field(None, description="Farthest angle from the Sun; with sun, a field of regard")
    earth: Separation | None = None
    moon: Separation | None = None
    sun_altitude: Altitude | None = Field(
        None, description="Of kind ground: it observes while the Sun is below this altitude; -12 deg when absent"
    )
    altitude: Altitude | None = Field(
        None, description="Of kind ground: lowest altitude of the object; 20 deg when absent"
    )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The field of regard is not empty."""
        if self.sun is not None and self.sun_max is not None and self.sun_max <= self.sun:
            return [(("sun_max",), "is not beyond sun: nothing is left between the two")]
        return []


class Trailing(Block):
    """A target that trails is fainter for the limiting magnitude."""

    exposure: PositiveDuration
    fwhm: Annotated[PositiveAngle, Field(description="Width of a star image, at most 5 deg")]

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A star image is small."""
        return [(("fwhm",), "is out of range (allowed up to 5 deg)")] if self.fwhm >= 0.09 else []


class Window(Block):
    """A span in which a telescope works."""

    start: When
    end: When

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The end does not precede the start."""
        if self.end < self.start:
            return [(("end",), f"end is before start (got end {self.end}, start {self.start})")]
        return []


class Telescope(Block):
    """One space telescope."""

    name: Text
    like: Text | None = Field(None, description="Name of an earlier telescope to take everything from that is not said")
    orbit: TelescopeOrbit
    noise: Noise
    bias: Bias | None = None
    position: Position | None = None
    timing: Timing | None = Field(None, description="Offset of the clock; its jitter is noise.timing")
    plate_scale: PlateScale | None = None
    exclusion: Exclusion = Exclusion()
    limiting_magnitude: Annotated[float, Field(ge=-30.0, le=40.0)] | None = None
    trailing: Trailing | None = None
    duty: Annotated[Several[Window], Field(max_length=1000, description="Works inside these only")] = ()

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Only a site on the ground has a horizon; the noise of an image needs its width."""
        text = "needs trailing: {exposure: ..., fwhm: ...} of the telescope: how wide an image is, and how long exposed"
        bare: list[tuple[KeyPath, str]] = (
            [(("noise", "image"), text)] if self.noise.image is not None and self.trailing is None else []
        )
        return bare + [
            (("exclusion", key), f"belongs to a telescope of kind ground (this one is {self.orbit.kind}); remove it")
            for key in ("sun_altitude", "altitude")
            if getattr(self.exclusion, key) is not None and not isinstance(self.orbit, Ground)
        ]

    @property
    def night(self) -> tuple[float, float] | tuple[None, None]:
        """Highest altitude of the Sun and lowest of the object, rad; none for a telescope that is not on the ground."""
        if not isinstance(self.orbit, Ground):
            return None, None
        sun, least = self.exclusion.sun_altitude, self.exclusion.altitude
        return NAUTICAL_TWILIGHT if sun is None else sun, LEAST_ALTITUDE if least is None else least
