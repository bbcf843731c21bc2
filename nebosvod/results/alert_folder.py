"""What `nebosvod alert` leaves behind: the answer of the first hour, and the draws behind it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.alert import KNOWN, Alert
from nebosvod.first_hour.corridor import ENTRY_KM, HIGHEST_END_KM, Corridor
from nebosvod.first_hour.decision import Decision
from nebosvod.first_hour.falls import Chance, epoch_of
from nebosvod.first_hour.grid import ENOUGH, HEADLINE
from nebosvod.first_hour.history import Moment
from nebosvod.first_hour.look import Field
from nebosvod.first_hour.possible import Possible
from nebosvod.first_hour.posterior import LEVELS, boxes, levels_of, quantiles, scores
from nebosvod.results import orbit_folder
from nebosvod.results.orbit_folder import SCHEMA_VERSION, columns
from nebosvod.results.result import Result
from nebosvod.units import ARCSEC, DEG

KIND = "alert"
CIRCLING = 0.1  # share of orbits bound to the Earth from which it is said
NAMES = ("q025", "q16", "median", "q84", "q975")
DESCRIPTION = "Probability of impact by prior with its 95 % interval, after each observation"
Row = dict[str, Any]


def chance_row(one: Chance) -> Row:
    """A probability; `bound` where none or too few orbits hit: it is below `high`, and `probability` is null."""
    return {
        "probability": None if one.bound else min(one.probability, 1.0),
        "low": one.low,
        "high": min(one.high, 1.0),
        "bound": one.bound,
        "hits": one.hits,
    }


def spread_row(values: npt.NDArray[np.float64], weight: npt.NDArray[np.float64]) -> Row:
    """Median and the ends of 68 and 95 %."""
    return dict(zip(NAMES, quantiles(values, weight, LEVELS), strict=True))


def fall_row(found: Alert) -> Row | None:
    """When and where the orbits that hit the Earth come down; None where none does, or those weigh next to nothing."""
    place, when = found.corridor, epoch_of(found.falls, found.tracklet)
    if place is None or when is None or found.headline.bound:
        return None
    epoch, half_s = when
    return {"body": "earth", "epoch_utc": epoch.iso("utc", 0), "half_68_s": half_s, **corridor_row(place)}


def corridor_row(place: Corridor) -> Row:
    """Quantiles of the ends of orbits, at heights in `end_km`; longitudes run on beyond 180 across the date line."""
    return {
        "longitude_deg": spread_row(place.longitude_deg, place.weight),
        "latitude_deg": spread_row(place.place_deg[:, 1], place.weight),
        "end_km": [0.0, HIGHEST_END_KM],
        "entry_km": ENTRY_KM,
        "speed_km_s": spread_row(place.speed_km_s, place.weight),
        "elevation_deg": spread_row(place.elevation_deg, place.weight),
        "n_points": len(place.weight),
        "contours_deg": {share: [edge.tolist() for edge in edges] for share, edges in place.contours_deg.items()},
    }


def field_row(one: Field) -> Row:
    """Where one telescope would look at one time."""
    return {
        "telescope": one.telescope,
        "epoch_utc": one.epoch.iso("utc", 0),
        "ra_deg": float(np.degrees(one.middle[0])),
        "dec_deg": float(np.degrees(one.middle[1])),
        "semi_major_arcsec": float(one.sigma_rad[0] / ARCSEC),
        "semi_minor_arcsec": float(one.sigma_rad[1] / ARCSEC),
        "V": one.magnitude,
        "fallen": one.fallen,
        **sight_row(one.possible),
        "contours_deg": {share: [np.degrees(edge).tolist() for edge in edges] for share, edges in one.contours.items()},
    }


def sight_row(one: Possible) -> Row:
    """Whether a telescope can look there."""
    return {
        "altitude_deg": None if one.altitude_rad is None else one.altitude_rad / DEG,
        "sun_altitude_deg": None if one.sun_altitude_rad is None else one.sun_altitude_rad / DEG,
        "elongation_deg": one.elongation_rad / DEG,
        "visible": one.visible,
        "not_seen": ", ".join(one.reasons) or None,
    }


def moment_row(one: Moment) -> Row:
    """What was known after some of the observations."""
    return {
        "n_observations": one.number,
        "epoch_utc": one.epoch.iso("utc", 0),
        "effective_nodes": one.effective,
        "sigma_log_range": one.sigma_log_range,
        "range_au": one.range_au,
        "chances": {prior: chance_row(chance) for prior, chance in one.chances.items()},
        "corridor": None if one.corridor is None or one.chances[HEADLINE].bound else corridor_row(one.corridor),
    }


def decision_row(one: Decision, fields: Sequence[Field]) -> Row:
    """What an observation would do to the probability, and whether it can be made."""
    when = one.epoch.iso("utc", 0)
    sights = [
        field.possible for field in fields if (field.telescope, field.epoch.iso("utc", 0)) == (one.telescope, when)
    ]
    return {
        "telescope": one.telescope,
        "epoch_utc": one.epoch.iso("utc", 0),
        "sigma_arcsec": one.sigma_rad / ARCSEC,
        "n_truths": len(one.outcomes),
        "quantiles": dict(zip(NAMES, quantiles(one.outcomes, np.full(len(one.outcomes), 1.0 / len(one.outcomes))))),
        "falls_below": {"threshold": one.low, "chance": float(np.mean(one.outcomes < one.low))},
        "rises_above": {"threshold": one.high, "chance": float(np.mean(one.outcomes > one.high))},
        "settles": one.settles,
        "settles_low": one.interval[0],
        "settles_high": one.interval[1],
        "visible": sights[0].visible if sights else None,
    }


def message_of(found: Alert) -> str:
    """What is known of the range, in a sentence."""
    sigma, best = found.sigma_log_range, spread_row(found.numbers.range_au, found.draws.weight())
    if sigma < KNOWN:
        return f"the range is {best['median']:.4g} au, known to {100.0 * sigma:.2g} %"
    factor = max(best["q84"] / best["median"], best["median"] / best["q16"])
    return (
        f"not observable as an orbit: the range is {best['median']:.3g} au within a factor of {factor:.2g} (68 %)"
        if factor < 100.0
        else "not observable as an orbit: nothing is known of the range"
    )


def _warnings(found: Alert, notices: Sequence[str]) -> list[str]:
    said = list(notices)
    if not found.enough:
        said.append(
            f"only {found.grid.effective():.0f} nodes of the grid carry the weight, of {ENOUGH:.0f} that are needed: "
            "the numbers are rough"
        )
    circling = scores(found.numbers, found.draws)["earth_satellite"]
    if circling >= CIRCLING:
        said.append(
            f"{100.0 * circling:.0f} % of the weight is on orbits bound to the Earth, as satellites, spent stages and "
            "temporarily captured asteroids are: compare with catalogues of artificial objects before an alarm"
        )
    if len(found.tracklet) == 2:
        said.append(
            "two observations tell a direction and a motion, nothing of range and range rate: the probability is that "
            "of the prior"
        )
    return said


def summarise(
    found: Alert, *, notices: Sequence[str] = (), rejected: Sequence[Row] = (), stations: Sequence[str] = (),
    history: Sequence[Moment] = (), decisions: Sequence[Decision] = (), truth: Row | None = None,
) -> Row:  # fmt: skip
    """The whole answer."""
    tracklet, w = found.tracklet, found.draws.weight()
    t_s = tracklet.exposures.t_s
    moon = found.moon
    equal, ahead = found.equivalent, found.ahead
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"First hour of {tracklet.name}",
        "object": tracklet.name,
        "n_observations": len(tracklet),
        "rejected": list(rejected),
        "stations": list(stations),
        "first_utc": (tracklet.epoch + float(t_s.min())).iso("utc", 0),
        "last_utc": (tracklet.epoch + float(t_s.max())).iso("utc", 0),
        "arc_h": tracklet.arc_s / 3600.0,
        "status": "answered" if found.enough else "few_nodes",
        "orbit_status": "observable" if found.sigma_log_range < KNOWN else "not_observable",
        "message": message_of(found),
        "reference_epoch_tdb": tracklet.epoch.iso(),
        "within_d": found.question.within_d,
        "bound_to_the_sun": found.question.region.bound,
        "smallest_m": found.question.region.smallest_m,
        "V": tracklet.magnitude,
        "headline": HEADLINE,
        **chance_row(found.headline),
        "by_prior": {prior: chance_row(one) for prior, one in found.chances.items()},
        "moon": None if moon.bound else chance_row(moon),
        "impact": fall_row(found),
        "scores": scores(found.numbers, found.draws),
        "quantities": {name: spread_row(values, w) for name, values in found.numbers.quantities.items()},
        "regions": boxes(found.grid),
        "grid": {
            "n_nodes": len(found.grid.nodes),
            "effective": {prior: found.grid.effective(prior) for prior in found.grid.priors},
            "chi2": found.grid.best_chi2,
            "sigma_log_range": found.sigma_log_range,
        },
        "draws": {
            "n": len(found.draws), "effective": found.draws.effective(), "flown": int(found.falls.flown.sum()),
            "seed": found.question.seed,
        },
        "equivalent": {"y": equal.y.tolist(), "H": equal.H.tolist(), "R": equal.R.tolist()},
        "fields": [field_row(one) for one in found.fields],
        "next_visible": None if ahead is None else {"telescope": ahead[0], "epoch_utc": ahead[1].iso("utc", 0)},
        "history": [moment_row(one) for one in history],
        "decisions": [decision_row(one, found.fields) for one in decisions],
        "truth": truth,
        "ended": None,
        "warnings": _warnings(found, notices),
    }  # fmt: skip


def arrays_of(found: Alert) -> dict[str, npt.NDArray[Any]]:
    """Nodes with their weights, draws with their fates, points of fall, directions of every field."""
    grid, falls, draws = found.grid, found.falls, found.draws
    arrays: dict[str, npt.NDArray[Any]] = {
        "epoch_jd_tdb": np.array([found.tracklet.epoch.day, found.tracklet.epoch.fraction]),
        "node_ln_range_au": grid.nodes.coordinates[:, 0],
        "node_rate_km_s": grid.nodes.coordinates[:, 1],
        "node_chi2": grid.nodes.chi2,
        "node_level": levels_of(grid),
        **{f"node_weight_{prior}": grid.weight(prior) for prior in grid.priors},
        "draw_state_km_km_s": draws.states,
        "draw_ln_range_au": draws.coordinates[:, 0],
        "draw_rate_km_s": draws.coordinates[:, 1],
        **{f"draw_weight_{prior}": draws.weight(prior) for prior in grid.priors},
        "draw_body": falls.body,
        "draw_t_s": falls.t_s,
        "draw_miss_km": falls.miss_km,
        "bound_ln_range_au": found.bounds[:, 0],
        "bound_rate_km_s": found.bounds[:, 1:],
    }
    if found.corridor is not None:
        place = found.corridor
        arrays |= {
            "fall_weight": place.weight, "fall_t_s": place.t_s, "fall_place_deg": place.place_deg,
            "fall_height_km": place.height_km,
            "entry_t_s": place.entry_t_s, "entry_place_deg": place.entry_deg, "entry_speed_km_s": place.speed_km_s,
            "entry_elevation_deg": place.elevation_deg,
        }  # fmt: skip
    return arrays | {f"field_psi_{k}": one.psi for k, one in enumerate(found.fields)}


def alert_result(summary: Mapping[str, Any], found: Alert, ephemeris: Ephemeris, path: str, started: float) -> Result:
    """The folder of an alert."""
    rows = [_flat(row) for row in summary["history"]] or [_flat({**summary, "epoch_utc": summary["last_utc"]})]
    tables = {KIND: columns(rows, list(rows[0]), DESCRIPTION)}
    return orbit_folder.result(summary, tables, arrays_of(found), ephemeris, path, started)


def _flat(row: Mapping[str, Any]) -> Row:
    """A row of the table of probabilities."""
    found: Row = {"n_observations": row["n_observations"], "epoch_utc": row["epoch_utc"]}
    for prior, one in (row.get("chances") or row["by_prior"]).items():
        found |= {f"{prior}_{name}": one[name] for name in ("probability", "low", "high")}
    return found
