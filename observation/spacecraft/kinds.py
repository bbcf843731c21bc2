"""Where a telescope is: each kind of orbit answers with barycentric ICRF states.

`centre` names the body whose direction defines the radial axis of the spacecraft's RTN frame.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.dynamics.constants import OBLIQUITY_J2000_RAD
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.earth.constants import EARTH_ROTATION_RAD_S
from nebosvod.observation.earth.earth_rotation import earth_rotation_angle, rotating_to_icrf
from nebosvod.timescale import Epoch


class Spacecraft(Protocol):
    """Anything that carries a telescope."""

    @property
    def centre(self) -> str:
        """The body the orbit goes round, "earth" or "sun"."""

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6), km and km/s, at `t_s` (n,) TDB seconds after `epoch`."""


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Geostationary:
    """A spacecraft held over one longitude of the equator.

    Parameters
    ----------
    longitude_rad : terrestrial longitude, east positive.

    Notes
    -----
    The ring lies in the true equator of date (celestial intermediate pole) and turns with the Earth rotation angle,
    UT1 = UTC (see `earth_rotation_angle`) and no polar motion (0.5" at most: 0.1 km); its radius is where the two-body
    period equals the sidereal day, 42164.17 km. A real spacecraft is kept within about 0.05 deg (37 km) of its
    longitude.
    """

    longitude_rad: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.longitude_rad):
            raise InputError(f"geostationary: longitude must be a finite angle (got {self.longitude_rad} rad)")

    @property
    def centre(self) -> str:
        return "earth"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        radius_km = (ephemeris.gm_km3_s2["earth"] / EARTH_ROTATION_RAD_S**2) ** (1.0 / 3.0)
        fixed = radius_km * np.array([np.cos(self.longitude_rad), np.sin(self.longitude_rad), 0.0])
        turning = rotating_to_icrf(fixed, earth_rotation_angle(epoch, t_s), epoch, t_s)
        return ephemeris.state_km_km_s("earth", epoch, t_s) + turning


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeliocentricCompanion:
    """A spacecraft on the Earth's own orbit, ahead of the Earth or behind it.

    Parameters
    ----------
    lead_rad : angle ahead (+) of the Earth or behind (-) it.

    Notes
    -----
    The Earth's heliocentric state at the same instant, turned about the pole of the J2000 ecliptic. The monthly
    wobble of the Earth about the barycentre with the Moon (4670 km) is turned with it.
    """

    lead_rad: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.lead_rad):
            raise InputError(f"heliocentric companion: lead must be a finite angle (got {self.lead_rad} rad)")

    @property
    def centre(self) -> str:
        return "sun"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        sun = ephemeris.state_km_km_s("sun", epoch, t_s)
        # positions and velocities as rows of one matrix: many 2 x 3 products would cost ten times as much
        relative = (ephemeris.state_km_km_s("earth", epoch, t_s) - sun).reshape(-1, 3)
        return sun + (relative @ turn_about_ecliptic_pole(self.lead_rad).T).reshape(-1, 6)


def turn_about_ecliptic_pole(angle_rad: float) -> Array:
    """Matrix (3, 3) that turns ICRF vectors by an angle about the pole of the J2000 ecliptic (Rodrigues)."""
    k = np.array([0.0, -np.sin(OBLIQUITY_J2000_RAD), np.cos(OBLIQUITY_J2000_RAD)])
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    turned: Array = np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * (cross @ cross)
    return turned


def rtn_axes(relative_state: Array) -> Array:
    """Radial, transverse and normal axes as columns, R_icrf_from_rtn (n, 3, 3).

    Parameters
    ----------
    relative_state : shape (n, 6), position and velocity about the central body.
    """
    r, v = relative_state[:, :3], relative_state[:, 3:]
    radial = r / np.linalg.norm(r, axis=1, keepdims=True)
    normal = np.cross(r, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([radial, np.cross(normal, radial), normal], axis=2)
