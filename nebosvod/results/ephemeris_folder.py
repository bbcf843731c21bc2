"""What `nebosvod ephemeris` leaves behind: rows with the units in their names, and the folder of them."""

from typing import Any

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.ephemerides.sky import Sky
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results import orbit_folder
from nebosvod.results.orbit_folder import SCHEMA_VERSION, columns, orbit_row
from nebosvod.results.result import Result, Table
from nebosvod.timescale import SECONDS_PER_DAY, utc_jd
from nebosvod.units import ARCSEC, AU_KM

KIND = "ephemeris"
PER_HOUR = ARCSEC / 3600.0
TWILIGHT = ((-0.833, "day"), (-6.0, "civil"), (-12.0, "nautical"), (-18.0, "astronomical"))  # Sun above so many deg
DESCRIPTION = (
    "Astrometric RA and Dec (ICRF) at times of reception, UTC; rates and sigmas in RA cos Dec and Dec; 1 sigma "
    "ellipse, position angle of its long axis from north to east; elongation and phase apparent; altitudes without "
    "refraction"
)
Row = dict[str, Any]


def rows_of(found: Sky) -> list[Row]:
    """One row for each time; null where there is no such number."""
    columns_ = {
        "epoch_utc": [(found.epoch + t).iso("utc") for t in found.t_s.tolist()],
        "epoch_jd_utc": np.sum(utc_jd(found.epoch, found.t_s), axis=0).tolist(),
        "ra_deg": np.degrees(found.psi[:, 0]).tolist(),
        "dec_deg": np.degrees(found.psi[:, 1]).tolist(),
        "rate_ra_arcsec_h": (found.rate[:, 0] / PER_HOUR).tolist(),
        "rate_dec_arcsec_h": (found.rate[:, 1] / PER_HOUR).tolist(),
        "sigma_ra_arcsec": (np.linalg.norm(found.factor[:, 0], axis=1) / ARCSEC).tolist(),
        "sigma_dec_arcsec": (np.linalg.norm(found.factor[:, 1], axis=1) / ARCSEC).tolist(),
        "semi_major_arcsec": (found.semi_axes[:, 0] / ARCSEC).tolist(),
        "semi_minor_arcsec": (found.semi_axes[:, 1] / ARCSEC).tolist(),
        "position_angle_deg": np.degrees(found.position_angle).tolist(),
        "distance_au": (found.distance_km / AU_KM).tolist(),
        "sigma_distance_km": found.sigma_distance_km.tolist(),
        "r_au": (found.r_sun_km / AU_KM).tolist(),
        "phase_deg": np.degrees(found.phase).tolist(),
        "elongation_deg": np.degrees(found.elongation).tolist(),
        "V": _finite(found.magnitude),
        "altitude_deg": _finite(np.degrees(found.altitude)),
        "sun_altitude_deg": _finite(np.degrees(found.sun_altitude)),
        "twilight": [twilight_of(value) for value in np.degrees(found.sun_altitude).tolist()],
        "not_seen": [reason or None for reason in found.reason.tolist()],
    }
    return [dict(zip(columns_, values, strict=True)) for values in zip(*columns_.values(), strict=True)]


def twilight_of(sun_altitude_deg: float) -> str | None:
    """day, civil, nautical, astronomical, or night, by the altitude of the Sun; None without a horizon."""
    if np.isnan(sun_altitude_deg):
        return None
    return next((name for limit, name in TWILIGHT if sun_altitude_deg > limit), "night")


def _finite(values: Any) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]


def summarise(orbit: UncertainOrbit, found: Sky, step_s: float) -> dict[str, Any]:
    """The whole answer."""
    rows = rows_of(found)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"Ephemeris of {orbit.name} from {found.observer.name}",
        "object": orbit.name,
        "orbit": orbit_row(orbit),
        "observer": found.observer.name,
        "from_utc": found.epoch.iso("utc"),
        "step_d": step_s / SECONDS_PER_DAY,
        "n_times": len(rows),
        "rows": rows,
        "ended": found.ended or None,
        "warnings": list(found.notices),
    }


def table(summary: dict[str, Any]) -> Table:
    """The rows as a table."""
    rows = summary["rows"]
    return columns(rows, list(rows[0]) if rows else [], DESCRIPTION)


def ephemeris_result(summary: dict[str, Any], found: Sky, ephemeris: Ephemeris, path: str, started: float) -> Result:
    """The folder of an ephemeris."""
    arrays = {
        "epoch_jd_tdb": np.array([found.epoch.day, found.epoch.fraction]),
        "t_s": found.t_s,
        "psi": found.psi,
        "rate": found.rate,
        "factor": found.factor,
        "distance_km": found.distance_km,
    }
    return orbit_folder.result(summary, {KIND: table(summary)}, arrays, ephemeris, path, started)
