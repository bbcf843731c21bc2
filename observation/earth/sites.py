"""Observatories on the ground: Earth rotation by erfa, UT1 and polar motion of `earth_orientation`."""

from dataclasses import dataclass

import erfa
import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.errors import CoverageError, InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.earth.earth_orientation import Orientation, orientation, table_span
from nebosvod.observation.earth.earth_rotation import rotating_to_icrf, tt_days
from nebosvod.timescale import Epoch

MPC_EARTH_RADIUS_KM = 6378.137  # unit of the MPC's parallax constants (WGS84 equatorial radius)


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundSite:
    """A telescope that stands on the Earth.

    Parameters
    ----------
    itrf_km : shape (3,), geocentric position in ITRF.
    extrapolate : go on outside of the Earth-orientation tables instead of raising. After their end the last values are
        held: 1 ms of UT1, 0.5 m at the equator, for each day beyond; before 1962 the site is good to about 50 m.

    Raises
    ------
    InputError
        If the position is not three finite numbers.
    """

    itrf_km: Array
    extrapolate: bool = False

    def __post_init__(self) -> None:
        position = np.array(self.itrf_km, dtype=np.float64)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise InputError(f"ground site: the position must be three finite numbers, km (got {self.itrf_km})")
        position.flags.writeable = False
        object.__setattr__(self, "itrf_km", position)

    @classmethod
    @bordered()
    def from_parallax(
        cls, longitude_rad: float, rho_cos_phi: float, rho_sin_phi: float, extrapolate: bool = False
    ) -> "GroundSite":
        """A site by the MPC's constants: east longitude, rho cos phi', rho sin phi' (Earth radii)."""
        place = np.array([rho_cos_phi * np.cos(longitude_rad), rho_cos_phi * np.sin(longitude_rad), rho_sin_phi])
        return cls(itrf_km=MPC_EARTH_RADIUS_KM * place, extrapolate=extrapolate)

    @property
    def centre(self) -> str:
        return "earth"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError
            If a time is outside the tables and `extrapolate` is off, or outside the ephemeris.
        """
        geocentric, earth = ground_states(self.itrf_km, epoch, t_s)
        outside = earth.before | earth.after
        if outside.any() and not self.extrapolate:
            first, last = (moment.iso(digits=0)[:10] for moment in table_span())
            asked = (epoch + float(t_s[np.argmax(outside)])).iso(digits=0)
            raise CoverageError(
                f"ground site: the Earth-rotation table covers {first} to {last}, asked for {asked}; update "
                "astropy-iers-data for a later end, or allow extrapolation (0.5 m a day after it; 50 m before 1962)"
            )
        return ephemeris.state_km_km_s("earth", epoch, t_s) + geocentric

    @property
    def has_horizon(self) -> bool:
        """Whether the place is on the ground: the Earth's centre (code 500) sees everything at all times."""
        return bool(np.linalg.norm(self.itrf_km) > MPC_EARTH_RADIUS_KM / 2.0)

    @bordered()
    def zenith(self, epoch: Epoch, t_s: Array) -> Array:
        """Unit vectors (n, 3), ICRF, along the geodetic vertical (WGS84) of the site, upwards."""
        longitude, latitude, _ = erfa.gc2gd(1, 1e3 * self.itrf_km)
        across = np.cos(latitude)
        up = np.array([across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude)])
        turned: Array = ground_states(up, epoch, t_s)[0][:, :3]
        return turned

    @bordered()
    def notices(self, epoch: Epoch, t_s: Array) -> tuple[str, ...]:
        """What stands in for the Earth-orientation tables at these times (n,), if anything does."""
        return ground_states(self.itrf_km, epoch, t_s)[1].notices()


def ground_states(itrf_km: Array, epoch: Epoch, t_s: Array) -> tuple[Array, Orientation]:
    """Geocentric ICRF states (n, 6) of places (n, 3) or (3,) on the Earth, and the orientation they were turned by.

    Notes
    -----
    Without the celestial pole offsets (0.3 mas: 1 cm) and the daily tides of pole and
    UT1 (0.5 mas, 0.05 ms: 2 cm).

    References
    ----------
    Petit, Luzum (eds.) 2010, IERS Conventions, Technical Note 36, eq. 5.1.
    """
    day, tt = np.full(t_s.size, epoch.day), tt_days(epoch, t_s)
    earth = orientation(day, tt)
    itrf_from_tirs = erfa.pom00(earth.x_pole_rad, earth.y_pole_rad, erfa.sp00(day, tt))
    fixed = np.einsum("nji,nj->ni", itrf_from_tirs, np.broadcast_to(itrf_km, (t_s.size, 3)))
    return rotating_to_icrf(fixed, erfa.era00(*earth.ut1_jd), epoch, t_s), earth
