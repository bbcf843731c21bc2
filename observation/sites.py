"""Observatories on the ground: Earth rotation by erfa and the IERS table that astropy ships; nothing is fetched."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import erfa
import numpy as np

from nebosvod.errors import CoverageError, InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.earth_rotation import rotating_to_icrf
from nebosvod.timescale import Epoch, utc_jd

MPC_EARTH_RADIUS_KM = 6378.137  # unit of the MPC's parallax constants (WGS84 equatorial radius)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundSite:
    """A telescope that stands on the Earth.

    Parameters
    ----------
    itrf_km : shape (3,), geocentric position in ITRF.
    extrapolate : after the end of the IERS table hold its last values instead of raising; the day of the Earth is
        then uncertain by about 1 ms a day, 0.5 m of position at the equator for each day beyond the table.

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
    def from_parallax(
        cls, longitude_rad: float, rho_cos_phi: float, rho_sin_phi: float, extrapolate: bool = False
    ) -> "GroundSite":
        """A site by the MPC's constants: east longitude, rho cos phi', rho sin phi' (Earth radii)."""
        place = np.array([rho_cos_phi * np.cos(longitude_rad), rho_cos_phi * np.sin(longitude_rad), rho_sin_phi])
        return cls(itrf_km=MPC_EARTH_RADIUS_KM * place, extrapolate=extrapolate)

    @property
    def centre(self) -> str:
        return "earth"

    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError
            If a time is outside the IERS table and `extrapolate` is off.
        """
        day, fraction = utc_jd(epoch, t_s)
        ut1_minus_utc, x_pole, y_pole = earth_orientation(day, fraction, self.extrapolate)
        tio = erfa.sp00(epoch.day, epoch.fraction + t_s / 86400.0)
        itrf_from_tirs = erfa.pom00(x_pole, y_pole, tio)
        fixed = np.einsum("nji,j->ni", itrf_from_tirs, self.itrf_km)
        geocentric = rotating_to_icrf(fixed, epoch, t_s, ut1_minus_utc)
        return ephemeris.state_km_km_s("earth", epoch, t_s) + geocentric


def earth_orientation(day: Array, fraction: Array, extrapolate: bool) -> tuple[Array, Array, Array]:
    """UT1 - UTC (s) and pole x, y (rad), each (n,), at two-part UTC Julian dates.

    Raises
    ------
    CoverageError
        If a date is outside the table; past its end only when `extrapolate` is off.
    """
    table = _iers()
    # the table answers up to, not at, its last day
    first, last = float(table["MJD"][0].value), float(table["MJD"][-1].value) - 1e-6
    mjd = day - 2400000.5 + fraction
    if np.any(mjd < first) or (np.any(mjd > last) and not extrapolate):
        raise CoverageError(
            f"ground site: the Earth-rotation table covers UTC MJD {first:.0f} to {last:.0f}, asked for "
            f"{mjd.min():.1f} to {mjd.max():.1f}; update astropy-iers-data, or allow extrapolation (0.5 m a day)"
        )
    beyond = mjd > last
    day, fraction = np.where(beyond, 2400000.5, day), np.where(beyond, last, fraction)
    ut1_minus_utc = table.ut1_utc(day, fraction)
    x_pole, y_pole = table.pm_xy(day, fraction)
    return ut1_minus_utc.to_value("s"), x_pole.to_value("rad"), y_pole.to_value("rad")


@cache
def _iers() -> Any:
    """The IERS-A table shipped with astropy: final values, then a year of predictions. Imported on first use."""
    from astropy.utils import iers

    return iers.IERS_A.open(iers.IERS_A_FILE)
