"""Predictions, and encounters that may be impacts, as rows of summary.json, units in the key names."""

from nebosvod.engine.facts import (
    BodyFacts,
    EncounterFacts,
    EntryFacts,
    Facts,
    ImpactFacts,
    SkyFacts,
    StateFacts,
    ValueFacts,
)
from nebosvod.engine.quantity import time_scale
from nebosvod.estimation.accuracy import ellipse
from nebosvod.estimation.accuracy.formed import matrices
from nebosvod.findings.drawn import DrawnSpread, HitShare
from nebosvod.findings.impacts import Impact
from nebosvod.findings.nonlinearity import Nonlinearity
from nebosvod.findings.prediction import Answered, Prediction, Unanswered
from nebosvod.results import rows
from nebosvod.results.outlook import ANSWERED


def prediction(found: Prediction) -> rows.Row:
    """One entry of `predictions`."""
    return _answered(found) if isinstance(found, Answered) else _unanswered(found)


def _answered(found: Answered) -> rows.Row:
    asked, unit = found.quantity, found.quantity.unit
    row: rows.Row = {
        "name": asked.request.name,
        "estimator": found.estimator,
        "status": ANSWERED,
        "reason": None,
        "epoch_tdb": asked.epoch.iso(),
        "epoch_utc": asked.epoch.iso("utc"),
        "time_scale": time_scale(asked.request),
        "plane": asked.request.plane,
        **facts(asked.facts),
        f"semi_axes_{unit}": found.semi_axes.tolist(),
        "angle_deg": found.angle_deg,
        f"sigma_{unit}": found.sigma.tolist(),
        f"sigma_formal_{unit}": found.sigma_formal.tolist(),
        f"mean_error_{unit}": found.mean_error.tolist(),
        f"max_deviation_{unit}": found.max_deviation.tolist(),
        **matrices(**{f"covariance_{unit}2": found.factor, f"covariance_formal_{unit}2": found.factor_formal}),
        f"factor_{unit}": found.factor.tolist(),
        f"factor_formal_{unit}": found.factor_formal.tolist(),
        "probability": ellipse.probability(1.0, len(found.sigma)),
        "ellipse_levels": [{"sigma_level": one.sigma, "probability": one.probability} for one in found.levels],
        "nonlinearity": nonlinearity(found.nonlinearity, unit),
        "budget": [rows.quantity_share(share, unit) for share in found.budget],
    }
    further = {
        "sigma_time_s": found.sigma_time_s,
        "sigma_longitude_deg": found.sigma_longitude_deg,
        "sigma_latitude_deg": found.sigma_latitude_deg,
        f"mean_{unit}": rows.listed(asked.value),
        "impact_probability_linear": found.impact_probability,
        "monte_carlo": None if found.drawn is None else drawn_spread(found.drawn, unit),
        "impact_probability_monte_carlo": None if found.drawn_impacts is None else hit_share(found.drawn_impacts),
    }
    return row | rows.present(further)


def _unanswered(found: Unanswered) -> rows.Row:
    """Status and reason instead of numbers."""
    missing, when = found.missing, found.request.when
    return {
        "name": missing.request.name,
        "estimator": found.estimator,
        "status": missing.status,
        "reason": missing.reason,
        "asked_tdb": when.iso(),
        "asked_utc": when.iso("utc"),
        "time_scale": time_scale(missing.request),
        "plane": missing.request.plane,
        **({} if missing.facts is None else facts(missing.facts)),
        **rows.present({"impact_probability_linear": found.impact_probability}),
    }


def facts(found: Facts) -> rows.Row:
    """What is known of a prediction beside its error."""
    match found:
        case SkyFacts():
            return {
                "telescope": found.telescope,
                "ra_deg": found.ra_deg,
                "dec_deg": found.dec_deg,
                "distance_km": found.distance_km,
            }
        case StateFacts():
            return {"position_km": found.position_km.tolist(), "velocity_km_s": found.velocity_km_s.tolist()}
        case ValueFacts():
            return {"formula": found.formula}
        case EncounterFacts():
            return _encounter(found)
        case EntryFacts():
            return _entry(found)
        case ImpactFacts():
            return {"body": found.body, "impact": True, "closest_approach_tdb": found.epoch.iso()}
        case BodyFacts():
            return {"body": found.body}


def _encounter(found: EncounterFacts) -> rows.Row:
    ground = found.ground
    return {
        "body": found.body,
        "impact": found.impact,
        "closest_approach_tdb": found.closest_approach.iso(),
        "closest_approach_utc": found.closest_approach.iso("utc"),
        "closest_distance_km": found.distance_km,
        "speed_km_s": found.speed_km_s,
    } | rows.present(
        {
            "impact_longitude_deg": None if ground is None else ground.longitude_deg,
            "impact_latitude_deg": None if ground is None else ground.latitude_deg,
            "capture_radius_km": found.capture_radius_km,
        }
    )


def _entry(found: EntryFacts) -> rows.Row:
    row = _encounter(found.encounter) | {
        "evaluated_on": found.evaluated_on,
        "epoch_utc": found.epoch.iso("utc"),
        "altitude_km": found.altitude_km,
        "speed_km_s": found.speed_km_s,
        "path_below_horizon_deg": found.path_below_horizon_deg,
    }
    if found.ground is not None:
        row |= {
            "longitude_deg": found.ground.longitude_deg,
            "latitude_deg": found.ground.latitude_deg,
            "latitude_geocentric_deg": found.ground.latitude_geocentric_deg,
            "path_azimuth_deg": found.path_azimuth_deg,
        }
    return row


def nonlinearity(found: Nonlinearity, unit: str) -> rows.Row:
    """The `nonlinearity` of a prediction."""
    return {
        "method": found.method,
        "orbits": found.orbits,
        **rows.present({"shortest_chord_sigma": found.shortest_chord_sigma}),
        f"mean_shift_{unit}": rows.listed(found.mean_shift),
        f"second_order_sigma_{unit}": rows.listed(found.second_order_sigma),
        "measure": found.measure,
        "misleads": found.misleads,
        "reason": found.reason,
    }


def drawn_spread(found: DrawnSpread, unit: str) -> rows.Row:
    """The `monte_carlo` of a prediction; null where too few orbits have it."""
    row: rows.Row = {"runs": found.runs, "undefined": found.undefined}
    cloud = found.cloud
    if cloud is None:
        sizes = (f"{what}_{unit}" for what in ("mean_shift", "sigma", "semi_axes", "max_deviation"))
        return row | dict.fromkeys((*sizes, "inside_linear_3_sigma", "misleads", "statement"))
    return row | {
        f"mean_shift_{unit}": cloud.mean_shift.tolist(),
        f"sigma_{unit}": cloud.sigma.tolist(),
        f"semi_axes_{unit}": cloud.semi_axes.tolist(),
        f"max_deviation_{unit}": cloud.max_deviation.tolist(),
        "inside_linear_3_sigma": cloud.against.inside_linear_3_sigma,
        "expected_3_sigma": cloud.against.expected_3_sigma,
        "sigma_ratio_largest": cloud.against.sigma_ratio_largest,
        "sigma_ratio_smallest": cloud.against.sigma_ratio_smallest,
        "misleads": cloud.against.misleads,
        "statement": cloud.statement,
    }


def hit_share(found: HitShare) -> rows.Row:
    """The `impact_probability_monte_carlo` of a prediction."""
    return {
        "runs": found.runs,
        "hits": found.hits,
        "probability": found.probability,
        "interval_95": list(found.interval_95),
    }


def impact(found: Impact) -> rows.Row:
    """One entry of `impacts`."""
    encounter, ground = found.encounter, found.encounter.ground
    return {
        "body": encounter.body,
        "estimator": found.estimator,
        "predictions": list(found.predictions),
        "nominal_impact": encounter.impact,
        "impact_probability_linear": found.probability,
        "impact_probability_monte_carlo": None if found.drawn is None else hit_share(found.drawn),
        "sigma_time_s": found.sigma_time_s,
        "time_scale": found.time_scale,
        "impact_longitude_deg": None if ground is None else ground.longitude_deg,
        "impact_latitude_deg": None if ground is None else ground.latitude_deg,
        "closest_distance_km": encounter.distance_km,
        "closest_approach_tdb": encounter.closest_approach.iso(),
        "closest_approach_utc": encounter.closest_approach.iso("utc"),
    }
