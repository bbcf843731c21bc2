"""Where a telescope is: each kind of orbit a mission file can say.

Angles, lengths and times are in internal units; an absent epoch is the mission's reference epoch.
"""

import math
from typing import Annotated, Literal

from pydantic import Field

from nebosvod.mission.fields import (
    Angle,
    Azimuth,
    Block,
    Inclination,
    KeyPath,
    Lead,
    Length,
    LocalTime,
    PositiveLength,
    Text,
    When,
)

EARTH_RADIUS_KM = 6378.137
EARTH_FLATTENING = 1.0 / 298.257223563
SUN_RADIUS_KM = 695700.0
HILL_KM = 1.5e6  # of the Earth: nothing circles it farther out
ATMOSPHERE_KM = 150.0  # below, an orbit decays within a day
FAR_KM = 3.0e5  # from where on the Moon, which is left out of an ellipse, moves a spacecraft by more than a hundredth
LOWEST_KM, HIGHEST_KM = -1.0, 10.0  # of ground above the ellipsoid: the shore of the Dead Sea, Mount Everest
GEOCENTRES = ("244", "248", "500")  # codes of the MPC: for ephemerides, not for telescopes
COARSE_KM = 10.0  # some of the MPC's constants have three digits
# Second order of a halo about L1, L2 in units of the distance to the Earth: Richardson 1980, Celest. Mech. 22, 241
HALO_KM, HALO_K, HALO_A21, HALO_A22 = 1.5e6, 3.229, 2.093, 0.248
RETROGRADE_KM = (3.0e6, 1.5e7)  # sizes for which a distant retrograde orbit is modelled
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
    i: Inclination
    node: Angle = 0.0
    peri: Angle = 0.0
    M: Angle = 0.0
    j2: bool = Field(True, description="Whether the Earth's oblateness turns the orbit")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The perigee is above the ground, the apogee where the Earth holds it."""
        perigee, apogee = self.a * (1.0 - self.e), self.a * (1.0 + self.e)
        if perigee <= EARTH_RADIUS_KM:
            return [(("a",), f"the perigee is inside the Earth (got {perigee:.0f} km from its centre)")]
        if apogee > HILL_KM:
            text = f"the apogee is where the Sun takes it away (got {apogee:.4g} km; allowed {HILL_KM:.2g} km)"
            return [(("a",), f"{text}; say its trajectory by kind table, spk or oem")]
        return []

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where the model is a poor one."""
        perigee, apogee = self.a * (1.0 - self.e), self.a * (1.0 + self.e)
        low = _in_the_air("perigee", perigee - EARTH_RADIUS_KM)
        far = f"its apogee, {apogee:.4g} km, is so far out that the Moon would change the ellipse, which leaves it out"
        return low + ((far,) if apogee > FAR_KM else ())


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

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where the model is a poor one."""
        return _in_the_air("altitude", self.altitude)


class HeliocentricKepler(Block):
    """An ellipse about the Sun, elements in the ecliptic of J2000; with `a` and `M` alone, a circle in the ecliptic."""

    kind: Literal["heliocentric_kepler"]
    epoch: When | None = EPOCH
    a: PositiveLength
    e: Eccentricity = 0.0
    i: Inclination = 0.0
    node: Angle = 0.0
    peri: Angle = 0.0
    M: Angle = Field(0.0, description="Mean anomaly at the epoch; on a circle in the ecliptic, the longitude")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The perihelion is outside the Sun."""
        perihelion = self.a * (1.0 - self.e)
        if perihelion <= SUN_RADIUS_KM:
            return [(("a",), f"the perihelion is inside the Sun (got {perihelion:.6g} km from its centre)")]
        return []


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
        text = "is out of range (got {:.3g} km; allowed 0 km to 1500000 km)"
        return [((key,), text.format(size)) for key, size in pairs if not 0.0 <= size <= HALO_KM]

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where the linear model is off by more than a tenth of the amplitude."""
        across, along = self.amplitude, self.amplitude / HALO_K
        off = {
            "amplitude": (across, HALO_A21 * along**2 / HALO_KM),
            "amplitude_z": (self.amplitude_z, HALO_A22 * self.amplitude_z**2 / HALO_KM),
        }
        return tuple(
            f"{key} {size:.4g} km is beyond the linear model of a halo, which is off by some {error:.1g} km there"
            for key, (size, error) in off.items()
            if error > 0.1 * size
        )


class DistantRetrograde(Block):
    """A distant retrograde orbit: a year round the Earth, against its motion, out of reach of its gravity."""

    kind: Literal["distant_retrograde"]
    epoch: When | None = EPOCH
    size: PositiveLength = Field(description="Largest excursion along the line from the Sun; across it is twice that")
    phase: Angle = Field(0.0, description="At the epoch: 0 outside of the Earth's orbit, 90 deg behind the Earth")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Nearer, the Earth bends it; farther, the Sun."""
        if RETROGRADE_KM[0] <= self.size <= RETROGRADE_KM[1]:
            return []
        low, high = RETROGRADE_KM
        return [(("size",), f"is out of range (got {self.size:.4g} km; allowed {low:.2g} km to {high:.2g} km)")]


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
        """A code, or the three constants of a place on the ground."""
        said = [item is not None for item in (self.longitude, self.rho_cos_phi, self.rho_sin_phi)]
        by_code = self.code is not None and not any(said)
        by_constants = all(said) and self.code is None and self.file is None
        if not (by_code or by_constants):
            return [((), "needs either code, or longitude, rho_cos_phi and rho_sin_phi")]
        if self.rho_cos_phi is not None and self.rho_sin_phi is not None:
            text = underground(self.rho_cos_phi, self.rho_sin_phi)
            return [(("rho_cos_phi",), text)] if text else []
        return []

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where no ground is."""
        if self.code in GEOCENTRES:
            return (
                f"code {self.code} is the centre of the Earth: an observer nobody can be, whom the Earth hides nothing",
            )
        height = _height_km(self.rho_cos_phi or 0.0, self.rho_sin_phi or 0.0)
        if self.code is not None or LOWEST_KM <= height <= HIGHEST_KM:
            return ()
        return (f"its place is {height:.3g} km above the ellipsoid, where there is no ground",)


def _height_km(rho_cos_phi: float, rho_sin_phi: float) -> float:
    """Of a place above the ellipsoid, along its radius, km."""
    rho = math.hypot(rho_cos_phi, rho_sin_phi)
    if rho == 0.0:
        return -EARTH_RADIUS_KM
    polar = 1.0 - EARTH_FLATTENING
    return EARTH_RADIUS_KM * rho * (1.0 - 1.0 / math.hypot(rho_cos_phi, rho_sin_phi / polar))


def underground(rho_cos_phi: float, rho_sin_phi: float) -> str:
    """What is wrong with the parallax constants of a site; empty where it can stand there."""
    depth = -_height_km(rho_cos_phi, rho_sin_phi)
    if depth <= COARSE_KM:
        return ""
    where = "at the centre of the Earth" if depth > 0.99 * EARTH_RADIUS_KM else f"{depth:.4g} km under the ground"
    return f"nothing is seen from there: the place is {where}"


def _in_the_air(what: str, altitude_km: float) -> tuple[str, ...]:
    """That an orbit decays."""
    if altitude_km >= ATMOSPHERE_KM:
        return ()
    return (f"its {what}, {altitude_km:.4g} km, is in the atmosphere, where no orbit lasts a day",)


TelescopeOrbit = Annotated[
    Geostationary
    | Heliocentric
    | Geocentric
    | SunSynchronous
    | HeliocentricKepler
    | Libration
    | DistantRetrograde
    | Tabulated
    | Spk
    | OemFile
    | Ground,
    Field(discriminator="kind"),
]
