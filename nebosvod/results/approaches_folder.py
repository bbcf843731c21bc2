"""What `nebosvod approaches` leaves behind: rows with the units in their names, and the folder of them."""

from typing import Any

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.impacts.approaches import Approach, Approaches
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results import orbit_folder
from nebosvod.results.orbit_folder import SCHEMA_VERSION, columns, orbit_row
from nebosvod.results.result import Result, Table
from nebosvod.timescale import Epoch

KIND = "approaches"
LONG_AU = 0.01  # an ellipse longer than this is bent, or reaches around the orbit
DESCRIPTION = (
    "Approaches to planets and the Moon: 1 sigma of time and distance, smallest distance within 3 sigma, b-plane (xi, "
    "zeta) and its 1 sigma ellipse, linear probability of impact; of an impact the time at the surface and the place"
)
Row = dict[str, Any]


def row_of(one: Approach) -> Row:
    """One approach; null where there is no such number."""
    plane, ellipse = one.plane, one.ellipse
    xi, zeta = (None, None) if plane is None else plane.coordinates_km.tolist()
    axes = [None, None] if ellipse is None else ellipse.semi_axes.tolist()
    place = one.place
    return {
        "body": one.body,
        "impact": one.hits,
        "epoch_utc": one.epoch.iso("utc"),
        "epoch_tdb": one.epoch.iso(),
        "sigma_time_s": one.sigma_time_s,
        "distance_km": one.distance_km,
        "distance_au": one.distance_km / AU_KM,
        "sigma_distance_km": one.sigma_distance_km,
        "least_distance_3_sigma_km": one.least_km,
        "speed_km_s": one.speed_km_s,
        "v_infinity_km_s": None if plane is None else plane.v_infinity_km_s,
        "xi_km": xi,
        "zeta_km": zeta,
        "semi_major_km": axes[0],
        "semi_minor_km": axes[1],
        "angle_deg": None if ellipse is None else float(np.degrees(ellipse.angle_rad)),
        "capture_radius_km": None if plane is None else plane.capture_radius_km,
        "impact_probability_linear": one.probability,
        "no_plane": one.no_plane or None,
        "longitude_deg": None if place is None else float(np.degrees(place.longitude_rad)),
        "latitude_deg": None if place is None else float(np.degrees(place.latitude_rad)),
    }


def summarise(orbit: UncertainOrbit, found: Approaches, first: Epoch, last: Epoch, within_au: float) -> dict[str, Any]:
    """The whole answer."""
    rows = [row_of(one) for one in found.found]
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"Approaches of {orbit.name}",
        "object": orbit.name,
        "orbit": orbit_row(orbit),
        "from_utc": first.iso("utc"),
        "to_utc": last.iso("utc"),
        "within_au": within_au,
        "n_approaches": len(rows),
        "approaches": rows,
        "nearest": None if found.nearest is None else row_of(found.nearest),
        "ended": found.ended or None,
        "warnings": [*orbit.notices, *_long(rows)],
    }


def _long(rows: list[Row]) -> list[str]:
    """Where linear sigmas mislead."""
    return [
        f"{row['body']} on {row['epoch_utc'][:10]}: the ellipse is {row['semi_major_km'] / AU_KM:.2g} au long (1 "
        "sigma), too long for linear sigmas, distances and probabilities to be right"
        for row in rows
        if row["semi_major_km"] is not None and row["semi_major_km"] > LONG_AU * AU_KM
    ]


def table(summary: dict[str, Any]) -> Table:
    """The rows as a table."""
    rows = summary["approaches"]
    return columns(rows, list(rows[0]) if rows else [], DESCRIPTION)


def approaches_result(
    summary: dict[str, Any], found: Approaches, ephemeris: Ephemeris, path: str, started: float
) -> Result:
    """The folder of approaches."""
    planes = [one for one in found.found if one.plane is not None]
    arrays = {
        "epoch_jd_tdb": np.array([(one.epoch.day, one.epoch.fraction) for one in found.found]).reshape(-1, 2),
        "plane_row": np.array([k for k, one in enumerate(found.found) if one.plane is not None], dtype=np.int64),
        "plane_axes": np.array([one.plane.axes for one in planes if one.plane is not None]).reshape(-1, 3, 3),
        "plane_factor_km": np.array([_square(one) for one in planes]).reshape(-1, 2, 2),
    }
    return orbit_folder.result(summary, {KIND: table(summary)}, arrays, ephemeris, path, started)


def _square(one: Approach) -> Any:
    """Lower factor (2, 2) of the covariance in the plane."""
    return np.zeros((2, 2)) if one.factor is None else lower_factor(one.factor)
