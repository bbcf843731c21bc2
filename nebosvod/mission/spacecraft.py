"""Where a telescope is: each kind of orbit a mission file can say.

Angles, lengths and times are in internal units; an absent epoch is the mission's reference epoch.
"""

from typing import Annotated, Literal

from pydantic import Field

from nebosvod.mission.fields import (
    Angle,
    Azimuth,
    Block,
    KeyPath,
    Lead,
    Length,
    LocalTime,
    PositiveLength,
    Text,
    When,
)

EARTH_RADIUS_KM = 6378.137
Eccentricity = Annotated[float, Field(ge=0.0, lt=1.0)]
EPOCH = Field(None, description="Epoch of the elements; the reference epoch when absent")
FILE = Field(description="A file beside the mission")


class Geostationary(Block):
    """A geostationary orbit: fixed above one longitude of the equator."""

    kind: Literal["geostationary"]
    longitude: Azimuth = Field(description="East longitude")


class Heliocentric(Block):
    """On Earth's orbit, ahead of Earth by `lead` (negative: behind)."""

    kind: Literal["heliocentric"]
    lead: Lead = Field(description="Angle ahead of Earth; negative is behind")


class Geocentric(Block):
    """An ellipse about Earth, elements in the true equator of date, with the secular drift that J2 causes."""

    kind: Literal["geocentric"]
    epoch: When | None = EPOCH
    a: PositiveLength
    e: Eccentricity = 0.0
    i: Angle
    node: Angle = 0.0
    peri: Angle = 0.0
    M: Angle = 0.0
    j2: bool = Field(True, description="Whether the Earth's oblateness turns the orbit")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The perigee is above the ground."""
        perigee = self.a * (1.0 - self.e)
        if perigee <= EARTH_RADIUS_KM:
            return [(("a",), f"the perigee is inside the Earth (got {perigee:.0f} km from its centre)")]
        return []


class SunSynchronous(Block):
    """A circular orbit about Earth whose plane follows the mean Sun."""

    kind: Literal["sun_synchronous"]
    epoch: When | None = EPOCH
    altitude: PositiveLength = Field(description="Above the equator, up to 5974 km")
    local_time: LocalTime = Field(description="Mean solar time of the ascending node: 6 h or 18 h is dawn-dusk")
    M: Angle = Field(0.0, description="Angle from the node at the epoch")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Beyond some altitude no inclination turns the node fast enough."""
        if self.altitude > 5974.0:
            return [(("altitude",), f"is too high (got {self.altitude:.0f} km; allowed up to 5974 km)")]
        return []


class HeliocentricKepler(Block):
    """An ellipse about the Sun, elements in the ecliptic of J2000; with `a` and `M` alone, a circle in the ecliptic."""

    kind: Literal["heliocentric_kepler"]
    epoch: When | None = EPOCH
    a: PositiveLength
    e: Eccentricity = 0.0
    i: Angle = 0.0
    node: Angle = 0.0
    peri: Angle = 0.0
    M: Angle = Field(0.0, description="Mean anomaly at the epoch; on a circle in the ecliptic, the longitude")


class Libration(Block):
    """A halo-like orbit about the libration point L1 (sunward of Earth) or L2."""

    kind: Literal["libration"]
    point: Literal["L1", "L2"]
    epoch: When | None = EPOCH
    amplitude: Length = Field(0.0, description="Largest excursion in the ecliptic, across the Sun-Earth line")
    amplitude_z: Length = Field(0.0, description="Largest excursion out of the ecliptic")
    phase: Angle = 0.0
    phase_z: Angle = 0.0

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The linear model of the halo holds near the point only."""
        pairs = (("amplitude", self.amplitude), ("amplitude_z", self.amplitude_z))
        text = "is out of range (got {:.3g} km; allowed 0 km to 2000000 km)"
        return [((key,), text.format(size)) for key, size in pairs if not 0.0 <= size <= 2e6]


class Tabulated(Block):
    """States in a text file: epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s, ICRF axes about `origin`."""

    kind: Literal["table"]
    file: Text = FILE
    origin: Literal["sun", "earth", "moon", "emb", "barycentre"]


class Spk(Block):
    """An SPK file of type 2, 3, 9 or 13."""

    kind: Literal["spk"]
    file: Text = FILE
    target: int | None = Field(None, description="NAIF number; needed where the file holds several")


class OemFile(Block):
    """A CCSDS OEM file in keyword notation."""

    kind: Literal["oem"]
    file: Text = FILE


class Ground(Block):
    """A site on the ground by the MPC's observatory code, or by the parallax constants it stands for."""

    kind: Literal["ground"]
    longitude: Azimuth | None = Field(None, description="East longitude")
    rho_cos_phi: Annotated[float, Field(ge=0.0, le=1.01)] | None = None
    rho_sin_phi: Annotated[float, Field(ge=-1.01, le=1.01)] | None = None
    code: Text | None = Field(None, description="Observatory code, such as X05")
    file: Text | None = Field(None, description="Another obscodes_extended.json of the MPC, beside the mission")
    extrapolate: bool = Field(
        False,
        description="Go on outside of the Earth-orientation tables: 0.5 m worse for each day after their end, 50 m "
        "before 1962",
    )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A code, or the three constants."""
        said = [item is not None for item in (self.longitude, self.rho_cos_phi, self.rho_sin_phi)]
        by_code = self.code is not None and not any(said)
        by_constants = all(said) and self.code is None and self.file is None
        if not (by_code or by_constants):
            return [((), "needs either code, or longitude, rho_cos_phi and rho_sin_phi")]
        return []


TelescopeOrbit = Annotated[
    Geostationary
    | Heliocentric
    | Geocentric
    | SunSynchronous
    | HeliocentricKepler
    | Libration
    | Tabulated
    | Spk
    | OemFile
    | Ground,
    Field(discriminator="kind"),
]
