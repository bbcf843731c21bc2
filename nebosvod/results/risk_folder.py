"""What `nebosvod risk` leaves behind: rows of virtual impactors, and the drawn orbits with their fates."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.estimation.accuracy.elasticity import ProbabilityBudget
from nebosvod.impacts.bend import Bend
from nebosvod.impacts.budget import budget_of, why_none
from nebosvod.impacts.cloud import Cloud, Passage
from nebosvod.impacts.corridor import Corridor, Level, corridor_of
from nebosvod.impacts.interval import of_count
from nebosvod.impacts.left_out import left_out_words
from nebosvod.impacts.line import Line
from nebosvod.impacts.risk import Risk, VirtualImpactor, passage_of
from nebosvod.impacts.scales import Size, cumulative, energy_mt, palermo, torino
from nebosvod.impacts.ways import Way
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results import orbit_folder
from nebosvod.results.ahead_words import CALLED
from nebosvod.results.approaches_folder import row_of
from nebosvod.results.orbit_folder import SCHEMA_VERSION, columns, orbit_row
from nebosvod.results.result import Result
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import AU_KM

KIND = "risk"
DESCRIPTION = "Virtual impactors: body, time, probability of the recommended way with its 95 % interval, scales"
CUT_SIGMAS = 5.0  # of the time of the hits: an end so near to them cuts some off
YEAR_S = 365.25 * SECONDS_PER_DAY
Row = dict[str, Any]
Arrays = dict[str, npt.NDArray[Any]]


def way_row(one: Way) -> Row:
    """One way; `bound` where nothing hit: the probability is below `high`, and `probability` is null."""
    unknown = one.is_bound or one.probability is None
    return {
        "way": one.name,
        "probability": None if unknown else one.probability,
        "low": one.low,
        "high": one.high,
        "bound": unknown,
        "draws": one.draws,
        "hits": one.hits,
        "effective_hits": one.effective,
        "note": one.note or None,
    }


def impactor_row(found: Risk, one: VirtualImpactor, number: int, size: Size | None) -> Row:
    """One virtual impactor; `number` names its arrays. Scales are of the Earth alone."""
    best = way_row(one.way)
    corridor, budget = corridor_of(one), budget_of(found.orbit, one)
    energy = scale = step = None
    if one.body == "earth" and size is not None and corridor.ground is not None:
        years = (one.epoch - found.on) / YEAR_S
        energy = energy_mt(size.diameter_km, corridor.ground.speed_km_s, size.density_kg_m3)
        if best["probability"]:
            scale = palermo(best["probability"], energy, years)
            step = torino(best["probability"], energy, years)
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
        "energy_mt": energy,
        "palermo": scale,
        "torino": step,
        "sigmas": one.sigmas_line,
        "stretching_km": one.stretching_km,
        "bend": None if one.bend is None else _bend_row(one.bend),
        "v_infinity_km_s": _finite(one.passage.v_infinity_km_s),
        "corridor": _corridor_row(corridor),
        "budget": None if budget is None else _budget_row(budget),
        "no_budget": why_none(found.orbit, one) if budget is None else None,
        "approach": None if one.approach is None else row_of(one.approach),
    }


def _line_row(line: Line) -> Row:
    """Of which kind the line of variations is, and over how many sigmas it was flown."""
    return {
        "kind": "curved" if line.string.curved else "straight",
        "why_straight": line.why_straight or None,
        "from_sigmas": float(line.sigmas[0]),
        "to_sigmas": float(line.sigmas[-1]),
    }


def _bend_row(one: Bend) -> Row:
    return {"aside_km": one.aside_km, "along_sigmas": one.along_sigmas, "matters": one.matters}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _corridor_row(one: Corridor) -> Row:
    """Entry at 100 km and on the ground."""
    return {
        "entry_100_km": None if one.entry is None else _level_row(one.entry),
        "ground": None if one.ground is None else _level_row(one.ground),
        "grazing_probability": one.grazing,
    }


def _level_row(one: Level) -> Row:
    axes = [None, None] if one.ellipse is None else one.ellipse.semi_axes.tolist()
    return {
        "epoch_utc": one.epoch.iso("utc"),
        "sigma_time_s": one.sigma_time_s,
        "longitude_deg": _finite(one.longitude_deg),
        "latitude_deg": _finite(one.latitude_deg),
        "semi_major_km": axes[0],
        "semi_minor_km": axes[1],
        "angle_from_east_deg": None if one.ellipse is None else float(np.degrees(one.ellipse.angle_rad)),
        "no_ellipse": one.no_ellipse or None,
        "speed_km_s": one.speed_km_s,
        "below_horizon_deg": one.elevation_deg,
    }


def _budget_row(one: ProbabilityBudget) -> Row:
    return {
        "probability": one.probability,
        "effective_hits": one.effective_hits,
        "enough": one.enough,
        "sigmas": one.sigmas,
        "rows": [
            {
                "source": row.source,
                "elasticity": row.value,
                "elasticity_error": row.error,
                "elasticity_reoptimised": row.reoptimised,
                "elasticity_reoptimised_error": row.reoptimised_error,
                "log_odds": row.log_odds,
                "log_odds_error": row.log_odds_error,
                "share": row.share,
                "probability_if_halved": row.halved,
                "probability_if_halved_error": row.halved_error,
            }
            for row in one.rows
        ],
    }


def _sampled(found: Risk, bodies: list[str]) -> Row:
    """Of all bodies together: how many plain draws hit one, and what that says of the probability."""
    hit = np.isin(found.cloud.body, bodies)
    hits, draws = int(np.count_nonzero(hit)), len(found.cloud)
    low, high = of_count(hits, draws)
    return way_row(
        Way(name="sampling", probability=hits / draws, low=low, high=high, draws=draws, hits=hits, effective=hits)
    )


def summarise(found: Risk, bodies: list[str], seed: int, size: Size | None) -> Row:
    """The whole answer."""
    rows = [impactor_row(found, one, k, size) for k, one in enumerate(found.impactors)]
    orbit = found.orbit
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
        "coordinates": found.coordinates,
        "line": None if found.line is None else _line_row(found.line),
        "diameter_km": None if size is None else size.diameter_km,
        "density_kg_m3": None if size is None else size.density_kg_m3,
        "size_from": None if size is None else size.said,
        "n_virtual_impactors": len(rows),
        "sampling": _sampled(found, bodies),
        "virtual_impactors": rows,
        "palermo_cumulative": cumulative([row["palermo"] for row in rows if row["palermo"] is not None]),
        "history": None,
        "ended": None,
        "warnings": _warnings(orbit, found, bodies),
    }


def _warnings(orbit: UncertainOrbit, found: Risk, bodies: list[str]) -> list[str]:
    """What limits the answer."""
    said, cloud = [*orbit.notices], found.cloud
    if found.no_line:
        said.append(f"no line of variations: {found.no_line}")
    if found.line is not None and found.line.coarse:
        said.append(
            f"orbits of the line of variations are up to {found.line.spacing_km / AU_KM:.2g} au apart: it may step "
            "over an impact that no drawn orbit has"
        )
    if cloud.lost:
        first = next(iter(cloud.lost.values()))
        said.append(
            f"{len(cloud.lost)} of {len(cloud)} drawn orbits could not be flown to the end and count as no hit (the "
            f"first: {first})"
        )
    other = sorted(set(cloud.body.tolist()) - {"", *bodies})
    if other:
        count = int(np.count_nonzero(np.isin(cloud.body, other)))
        said.append(f"{count} of {len(cloud)} drawn orbits end on another body ({', '.join(other)})")
    said += [
        f"{CALLED.get(one.body, one.body.capitalize())} on {one.epoch.iso('utc', 0)[:10]}: {one.bend.said}"
        for one in found.impactors if one.bend is not None and one.bend.matters
    ]  # fmt: skip
    said += [
        f"{CALLED.get(one.body, one.body.capitalize())} on {one.epoch.iso('utc', 0)[:10]}: {words}"
        for one in found.impactors if (words := left_out_words(one.left_out_sigmas, one.sigmas_line))
    ]  # fmt: skip
    said += [
        f"{CALLED.get(one.body, one.body.capitalize())} on {one.epoch.iso('utc', 0)[:10]}: --until is amid the "
        "encounter; drawn orbits count where they hit before it, the linear target plane and the line count all"
        for one in found.impactors if found.until - one.epoch < CUT_SIGMAS * one.sigma_time_s
    ]  # fmt: skip
    return said


def risk_result(summary: Row, found: Risk, ephemeris: Ephemeris, path: str, started: float) -> Result:
    """The folder, with the drawn orbits.

    Arrays of the plain draws (n,): deviations (n, 6 + m) from orbit.state_km_km_s and orbit.parameters, weights,
    hit_body (what it hits, "" for nothing), hit_t_s after orbit.epoch_tdb, longitude_deg, latitude_deg, speed_km_s,
    elevation_deg at the surface, entry_... the same at 100 km; of virtual impactor K hits_K, grazes_K, t_s_K,
    distance_km_K, xi_zeta_km_K (n, 2) and, of its encounter, axes_K (3, 3), capture_radius_km_K, v_infinity_km_s_K,
    line_xi_zeta_km_K (k, 2) with line_sigmas (k,) and line_deviations (k, 6 + m). Where importance sampling knows more
    of K, weighed_K_... are the same arrays of its own draws, with their weights.
    """
    arrays = _members(found.cloud, "")
    if found.line is not None:
        arrays |= {"line_sigmas": found.line.sigmas, "line_deviations": found.line.cloud.deviations}
    for k, one in enumerate(found.impactors):
        drawn = passage_of(found.cloud, one.body, one.epoch)
        arrays |= {
            f"axes_{k}": one.passage.axes, f"capture_radius_km_{k}": np.array(one.passage.capture_radius_km),
            f"v_infinity_km_s_{k}": np.array(one.passage.v_infinity_km_s),
            **_passing(drawn, found.cloud, f"_{k}"),
        }  # fmt: skip
        along = None if found.line is None else passage_of(found.line.cloud, one.body, one.epoch)
        if along is not None:
            arrays[f"line_xi_zeta_km_{k}"] = along.xi_zeta_km
        if one.cloud is not found.cloud:
            mine = {**_members(one.cloud, ""), **_passing(one.passage, one.cloud, "")}
            arrays |= {f"weighed_{k}_{name}": value for name, value in mine.items()}
    rows = summary["virtual_impactors"]
    flat = [key for key in (rows[0] if rows else ()) if not any(isinstance(row[key], list | dict) for row in rows)]
    tables = {"virtual_impactors": columns(rows, flat, DESCRIPTION)} if rows else {}
    return orbit_folder.result(summary, tables, arrays, ephemeris, path, started)


def _members(cloud: Cloud, prefix: str) -> Arrays:
    """Deviations, weights and fates of drawn orbits."""
    found: Arrays = {
        "deviations": cloud.deviations, "weights": cloud.weights, "hit_body": cloud.body, "hit_t_s": cloud.ground.t_s
    }  # fmt: skip
    for level, at in (("", cloud.ground), ("entry_", cloud.entry)):
        for name in ("longitude_deg", "latitude_deg", "speed_km_s", "elevation_deg"):
            found[f"{level}{name}"] = getattr(at, name)
    found["entry_t_s"] = cloud.entry.t_s
    return {f"{prefix}{name}": value for name, value in found.items()}


def _passing(passage: Passage | None, cloud: Cloud, end: str) -> Mapping[str, npt.NDArray[Any]]:
    """The encounter of drawn orbits; nan where none of them has it."""
    n = len(cloud)
    if passage is None:
        none = np.full(n, np.nan)
        return {
            f"hits{end}": np.zeros(n, dtype=np.bool_), f"grazes{end}": np.zeros(n, dtype=np.bool_), f"t_s{end}": none,
            f"distance_km{end}": none, f"xi_zeta_km{end}": np.full((n, 2), np.nan),
        }  # fmt: skip
    return {
        f"hits{end}": passage.hits, f"grazes{end}": cloud.grazes & np.isfinite(passage.t_s), f"t_s{end}": passage.t_s,
        f"distance_km{end}": passage.distance_km, f"xi_zeta_km{end}": passage.xi_zeta_km,
    }  # fmt: skip
