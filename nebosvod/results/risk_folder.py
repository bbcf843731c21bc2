"""What `nebosvod risk` leaves behind: rows of virtual impactors, and the drawn orbits with their fates."""

from typing import Any

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.impacts.interval import of_count
from nebosvod.impacts.risk import Risk, VirtualImpactor, Way
from nebosvod.impacts.scales import cumulative
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results import orbit_folder
from nebosvod.results.approaches_folder import row_of
from nebosvod.results.orbit_folder import SCHEMA_VERSION, columns, orbit_row
from nebosvod.results.result import Result

KIND = "risk"
DESCRIPTION = "Virtual impactors: body, time, probability of the recommended way with its 95 % interval, scales"
Row = dict[str, Any]


def way_row(one: Way) -> Row:
    """One way; `bound` where nothing hit: the probability is below `high`, and `probability` is null."""
    return {
        "way": one.name,
        "probability": None if one.is_bound else one.probability,
        "low": one.low,
        "high": one.high,
        "bound": one.is_bound,
        "draws": one.draws,
        "hits": one.hits,
        "effective_hits": one.effective,
        "note": one.note or None,
    }


def impactor_row(one: VirtualImpactor, number: int) -> Row:
    """One virtual impactor; `number` names its arrays."""
    best = way_row(one.way)
    return {
        "number": number,
        "body": one.body,
        "epoch_utc": one.epoch.iso("utc", 0),
        "epoch_tdb": one.epoch.iso(),
        "sigma_time_s": one.sigma_time_s,
        "probability": best["probability"],
        "low": best["low"],
        "high": best["high"],
        "bound": best["bound"],
        "recommended": one.recommended,
        "reason": one.reason,
        "ways": [way_row(way) for way in one.ways],
        "energy_mt": one.energy_mt,
        "palermo": one.palermo,
        "torino": one.torino,
        "approach": row_of(one.approach),
    }


def _sampled(found: Risk) -> Row:
    """Of all bodies together: how many drawn orbits hit anything, and what that says of the probability."""
    hits, draws = int(np.count_nonzero(found.cloud.hit)), len(found.cloud)
    low, high = of_count(hits, draws)
    share = found.cloud.probability(found.cloud.hit)
    return way_row(Way(name="sampling", probability=share, low=low, high=high, draws=draws, hits=hits))


def summarise(orbit: UncertainOrbit, found: Risk, bodies: list[str], seed: int) -> Row:
    """The whole answer."""
    rows = [impactor_row(one, k) for k, one in enumerate(found.impactors)]
    scales = [one.palermo for one in found.impactors if one.palermo is not None]
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"Impact risk of {orbit.name}",
        "object": orbit.name,
        "orbit": orbit_row(orbit),
        "on_utc": found.on.iso("utc", 0),
        "until_utc": found.until.iso("utc", 0),
        "bodies": bodies,
        "seed": seed,
        "n_draws": len(found.cloud),
        "n_virtual_impactors": len(rows),
        "sampling": _sampled(found),
        "virtual_impactors": rows,
        "palermo_cumulative": cumulative(scales),
        "ended": None,
        "warnings": list(orbit.notices),
    }


def risk_result(summary: Row, found: Risk, ephemeris: Ephemeris, path: str, started: float) -> Result:
    """The folder: for each virtual impactor K the arrays `..._K` of the drawn orbits at its encounter.

    Arrays of all draws (n,): deviations (n, 6 + m) from orbit.state_km_km_s and orbit.parameters, weights, hit_body
    (what it hits, "" for nothing), hit_t_s after orbit.epoch_tdb, longitude_deg, latitude_deg, speed_km_s,
    elevation_deg at the surface; of each encounter hits_K, t_s_K, distance_km_K, xi_zeta_km_K (n, 2), axes_K (3, 3),
    capture_radius_km_K and v_infinity_km_s_K.
    """
    cloud = found.cloud
    arrays = {
        "deviations": cloud.deviations, "weights": cloud.weights, "hit_body": cloud.body, "hit_t_s": cloud.t_s,
        "longitude_deg": cloud.longitude_deg, "latitude_deg": cloud.latitude_deg, "speed_km_s": cloud.speed_km_s,
        "elevation_deg": cloud.elevation_deg,
    }  # fmt: skip
    for k, one in enumerate(found.impactors):
        passage = cloud.passages[one.passage]
        arrays |= {
            f"hits_{k}": passage.hits, f"t_s_{k}": passage.t_s, f"distance_km_{k}": passage.distance_km,
            f"xi_zeta_km_{k}": passage.xi_zeta_km, f"axes_{k}": passage.axes,
            f"capture_radius_km_{k}": np.array(passage.capture_radius_km),
            f"v_infinity_km_s_{k}": np.array(passage.v_infinity_km_s),
        }  # fmt: skip
    flat = [{k: v for k, v in row.items() if not isinstance(v, list | dict)} for row in summary["virtual_impactors"]]
    tables = {"virtual_impactors": columns(flat, list(flat[0]), DESCRIPTION)} if flat else {}
    return orbit_folder.result(summary, tables, arrays, ephemeris, path, started)
