"""Space telescopes: where they are, how well they measure, what is uncertain about them, what they cannot see."""

from typing import Annotated, Literal

from pydantic import Field

from nebosvod.mission.fields import (
    Angle,
    Azimuth,
    Block,
    Duration,
    KeyPath,
    Lead,
    PositiveAngle,
    PositiveDuration,
    PositiveLength,
    Separation,
    Several,
    Text,
    Treatment,
)

MAX_TELESCOPES = 100
Pair = tuple[float, float]


class Geostationary(Block):
    """A geostationary orbit: fixed above one longitude of the equator."""

    kind: Literal["geostationary"]
    longitude: Azimuth = Field(description="East longitude")


class Heliocentric(Block):
    """On Earth's orbit, ahead of Earth by `lead` (negative: behind)."""

    kind: Literal["heliocentric"]
    lead: Lead = Field(description="Angle ahead of Earth; negative is behind")


class Noise(Block):
    """Random error of one measurement: one sigma for both axes, or one each; timing jitter."""

    sigma: PositiveAngle | None = None
    sigma_ra: PositiveAngle | None = Field(None, description="Along right ascension, times cos Dec")
    sigma_dec: PositiveAngle | None = None
    timing: Duration = Field(0.0, description="Sigma of the time of exposure")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Either sigma, or both of the pair."""
        return _one_or_pair(self.sigma, self.sigma_ra, self.sigma_dec)

    @property
    def sigma_rad(self) -> Pair:
        """Sigma in RA* and Dec, rad."""
        return (self.sigma_ra or self.sigma or 0.0, self.sigma_dec or self.sigma or 0.0)


class Bias(Block):
    """A constant error of a telescope's RA* and Dec: mean expected, sigma about it, and what to do with it."""

    sigma: PositiveAngle | None = None
    sigma_ra: PositiveAngle | None = None
    sigma_dec: PositiveAngle | None = None
    mean_ra: Angle = 0.0
    mean_dec: Angle = 0.0
    treatment: Treatment

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Either sigma or both of the pair; nothing at all only for an estimated bias without a prior."""
        if self.treatment == "estimated" and not (self.sigma or self.sigma_ra or self.sigma_dec):
            return []
        return _one_or_pair(self.sigma, self.sigma_ra, self.sigma_dec)

    @property
    def sigma_rad(self) -> Pair | None:
        """Sigma in RA* and Dec, rad; None = no prior."""
        if not (self.sigma or self.sigma_ra):
            return None
        return (self.sigma_ra or self.sigma or 0.0, self.sigma_dec or self.sigma or 0.0)

    @property
    def mean_rad(self) -> Pair:
        """Expected bias in RA* and Dec, rad."""
        return (self.mean_ra, self.mean_dec)


class Position(Block):
    """Error of the telescope's own position: size on each axis, how it is correlated in time, and its treatment."""

    sigma: PositiveLength | None = Field(None, description="On every axis")
    sigmas: Annotated[Several[PositiveLength], Field(min_length=3, max_length=3)] | None = Field(
        None, description="One for each axis of the frame"
    )
    correlation: Literal["white", "constant", "gauss_markov"]
    time: PositiveDuration | None = Field(None, description="Correlation time of gauss_markov")
    frame: Literal["icrf", "rtn"] = "icrf"
    treatment: Treatment

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """One form of sigma; a correlation time exactly for gauss_markov."""
        found: list[tuple[KeyPath, str]] = []
        if (self.sigma is None) == (self.sigmas is None):
            found.append(((), "needs either sigma (every axis) or sigmas (a list of three)"))
        if self.correlation == "gauss_markov" and self.time is None:
            found.append((("time",), 'is missing; gauss_markov needs its correlation time, for example "6 h"'))
        if self.correlation != "gauss_markov" and self.time is not None:
            found.append((("time",), f"belongs to gauss_markov only (got correlation {self.correlation})"))
        return found

    @property
    def sigma_km(self) -> tuple[float, float, float]:
        """Sigma on the three axes of the frame, km."""
        if self.sigmas is not None:
            return (self.sigmas[0], self.sigmas[1], self.sigmas[2])
        return (self.sigma or 0.0,) * 3


class Exclusion(Block):
    """Where a telescope cannot look: angles from the Sun's centre and from the limb of Earth and Moon."""

    sun: Separation | None = None
    earth: Separation | None = None
    moon: Separation | None = None


TelescopeOrbit = Annotated[Geostationary | Heliocentric, Field(discriminator="kind")]


class Telescope(Block):
    """One space telescope."""

    name: Text
    like: Text | None = Field(None, description="Name of an earlier telescope to take everything from that is not said")
    orbit: TelescopeOrbit
    noise: Noise
    bias: Bias | None = None
    position: Position | None = None
    exclusion: Exclusion = Exclusion()
    limiting_magnitude: Annotated[float, Field(ge=-30.0, le=40.0)] | None = None


def _one_or_pair(one: float | None, ra: float | None, dec: float | None) -> list[tuple[KeyPath, str]]:
    """Complain unless there is exactly `sigma`, or both of sigma_ra and sigma_dec."""
    if one is not None and (ra is not None or dec is not None):
        return [(("sigma",), "stands beside sigma_ra or sigma_dec; keep either sigma or the pair")]
    if one is None and (ra is None or dec is None):
        return [(("sigma",), "is missing (or sigma_ra and sigma_dec)")]
    return []
