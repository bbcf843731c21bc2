"""Findings as rows of summary.json, units in the key names; those of predictions in `prediction_rows`.

`d` components of a prediction in a unit have keys that end with it: `sigma_km`. What is infinite or undefined is null.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.filtering import Filtered
from nebosvod.engine.montecarlo import StateNees
from nebosvod.engine.quantity import M_PER_KM
from nebosvod.estimation.accuracy.consistency import chi_square_interval
from nebosvod.findings.blame import QuantityShare, QuantitySigmas, Remedied, Remedies, StateShare, StateSigmas
from nebosvod.findings.comparison import LEVEL, MEANINGS, Accuracies
from nebosvod.findings.curves import Curve
from nebosvod.findings.inside import Inside
from nebosvod.findings.ratio import NoiseRatio, RatioMeans, TelescopeRatio
from nebosvod.findings.required import RequiredPosition
from nebosvod.findings.shifts import Shift

Row = dict[str, Any]
Array = npt.NDArray[np.float64]


def number(value: float) -> float | None:
    """The number, or null where it is infinite or undefined."""
    return float(value) if np.isfinite(value) else None


def numbers(values: Array) -> list[float | None]:
    """The numbers (n,), null where they are infinite or undefined."""
    return [number(value) for value in values]


def listed(values: Array | None) -> list[Any] | None:
    """An array as lists, null where there is none."""
    return None if values is None else values.tolist()


def present(row: Row) -> Row:
    """The row without what a finding of its kind does not have."""
    return {key: value for key, value in row.items() if value is not None}


def innovations(found: Filtered) -> Row:
    """The `innovations` of an estimator: mean normalised square by component, and where it lies if all is right."""
    freedom = found.innovation.size
    low, high = chi_square_interval(freedom, 0.01)
    return {"nis_mean": float(found.nis.sum() / freedom), "nis_interval_99": [low, high]}


def state_share(share: StateShare) -> Row:
    """One entry of `budget`."""
    return {
        "estimator": share.estimator,
        "source": share.source,
        "telescopes": list(share.telescopes),
        **_sigmas(share.sigma, ""),
        "share_position": share.share_position,
        "share_velocity": share.share_velocity,
        "share_parameters": dict(share.share_parameters),
        **remedies(share.remedies, ""),
    }


def quantity_share(share: QuantityShare, unit: str) -> Row:
    """One entry of the `budget` of a prediction."""
    return {
        "source": share.source,
        "telescopes": list(share.telescopes),
        "share": share.share.tolist(),
        "share_total": share.share_total,
        **_sigmas(share.sigma, unit),
        **remedies(share.remedies, unit),
    }


def remedies(found: Remedies[StateSigmas] | Remedies[QuantitySigmas], unit: str) -> dict[str, Row | None]:
    """What each remedy would do, the keys saying with which gain."""
    unknown = found.if_unknown
    return {
        "if_vanished": _remedied(found.if_vanished, unit),
        "if_halved": _remedied(found.if_halved, unit),
        "if_unknown": None if unknown is None else _new_gain(unknown.new_gain, found.if_vanished.same_gain, unit),
    }


def _remedied(one: Remedied[StateSigmas] | Remedied[QuantitySigmas], unit: str) -> Row:
    same = {f"{key}_same_gain": value for key, value in _sigmas(one.same_gain, unit).items()}
    return same | _new_gain(one.new_gain, one.same_gain, unit)


def _new_gain(new: StateSigmas | QuantitySigmas | None, like: StateSigmas | QuantitySigmas, unit: str) -> Row:
    """Sigmas with the gain re-optimised, null where that was not solved."""
    known = dict.fromkeys(_sigmas(like, unit)) if new is None else _sigmas(new, unit)
    return {f"{key}_new_gain": value for key, value in known.items()}


def _sigmas(sigma: StateSigmas | QuantitySigmas, unit: str) -> Row:
    if isinstance(sigma, StateSigmas):
        return {"sigma_position_km": sigma.position_km, "sigma_velocity_m_s": sigma.velocity_m_s}
    return {f"sigma_{unit}": sigma.each.tolist(), f"sigma_total_{unit}": sigma.total}


def shift(found: Shift) -> Row:
    """One entry of `shifts`."""
    return {
        "estimator": found.estimator,
        "source": found.source,
        "shift_position_km": found.state[:3].tolist(),
        "shift_velocity_m_s": (M_PER_KM * found.state[3:]).tolist(),
        "in_sigmas": number(found.in_sigmas),
        "predictions": [
            {
                "prediction": one.prediction,
                f"shift_{one.unit}": one.shift.tolist(),
                "in_sigmas": number(one.in_sigmas),
            }
            for one in found.predictions
        ],
    }


def inside(found: Inside) -> Row:
    """The `inside` block."""
    row: Row = {"estimator": found.estimator, "arrays": list(found.arrays)}
    if found.information is not None:
        told = found.information
        row["information"] = {
            "D0": told.D0.tolist(),
            "sigma_arcsec": told.sigma_arcsec,
            "n_components": told.count,
            "sigma_position_km": number(told.sigma_position_km),
        }
    if found.smallness is not None:
        small = found.smallness
        row["smallness"] = {"largest": number(small.largest), "rms": number(small.rms), "small": small.small}
    if found.bounds is not None:
        row["bounds"] = [
            {
                "prediction": one.prediction,
                f"lower_{one.unit}": None if one.lower is None else one.lower.tolist(),
                f"upper_{one.unit}": None if one.upper is None else one.upper.tolist(),
                "level": LEVEL,
                "inflation": one.inflation,
                "n_measurements": one.measurements,
                "reason": one.reason,
            }
            for one in found.bounds
        ]
    if found.imitations is not None:
        row["imitations"] = [
            {
                "group": one.group,
                "direction": one.direction,
                "condition_number": number(one.condition_number),
            }
            for one in found.imitations
        ]
    return row


def noise_to_nuisance(found: NoiseRatio, needed: Sequence[RequiredPosition]) -> Row:
    """The `noise_to_nuisance` block."""
    return {
        "nuisances": list(found.nuisances),
        "eta_min_db": found.eta_min_db,
        **_means(found.means),
        "mean": "ratio of sums over the measurements",
        "eta_db": numbers(found.eta_db),
        "sigma_z_critical_km": numbers(found.critical_km),
        "by_telescope": [_telescope_ratio(one) for one in found.by_telescope],
        "limit_statistic": "median over the measurements",
        "required_position": [required_position(one) for one in needed],
    }


def _means(found: RatioMeans) -> Row:
    return {
        "eta_db_mean": number(found.eta_db),
        "eta_effective_db_mean": number(found.effective_db),
        "eta_whitened_db_mean": number(found.whitened_db),
        "eta_all_db_mean": number(found.all_eta_db),
        "eta_all_effective_db_mean": number(found.all_effective_db),
        "sigma_nuisance_arcsec": found.sigma_nuisance_arcsec,
        "sigma_equivalent_arcsec": found.sigma_equivalent_arcsec,
        "sigma_z_equivalent_km": found.sigma_z_equivalent_km,
        "sigma_z_limit_km": {f"{db:g}_dB": size for db, size in found.sigma_z_limits_km.items()},
        "n_below_eta_min": found.n_below_eta_min,
    }


def _telescope_ratio(found: TelescopeRatio) -> Row:
    return {
        "telescope": found.telescope,
        **_means(found.means),
        "n_observations": found.n_observations,
        "sigma_z_critical_min_km": found.critical_min_km,
        "sigma_z_critical_median_km": found.critical_median_km,
        "sigma_z_critical_max_km": found.critical_max_km,
    }


def required_position(found: RequiredPosition) -> Row:
    """One entry of `required_position`."""
    position = found.position
    return {
        "telescope": position.telescope,
        "sources": [] if position.assumed else list(position.sources),
        "assumed": "white, 1 sigma on each axis" if position.assumed else None,
        "sigma_position_now_km": None if position.assumed else position.sigma_km,
        "estimator": found.estimator,
        "prediction": found.prediction,
        f"sigma_total_perfect_{found.unit}": found.sigma_total_perfect,
        "limits": [
            {
                "growth_percent": limit.growth_percent,
                "sigma_position_same_gain_km": limit.same_gain_km,
                "sigma_position_new_gain_km": limit.new_gain_km,
                "reason": limit.reason,
            }
            for limit in found.limits
        ],
    }


def curve(found: Curve) -> Row:
    """One entry of `curves`."""
    counted, cadence, noise, unit = found.measurements, found.cadence, found.telescope_noise, found.unit
    return {
        "prediction": found.prediction,
        "estimator": found.estimator,
        "unit": unit,
        "measurements": {
            "count": counted.count.tolist(),
            "days": counted.days.tolist(),
            "expected_slope": counted.expected_slope,
            "slope": dict(counted.slope),
            "slope_arc": dict(counted.slope_arc),
            **{f"{name}_{unit}": numbers(total) for name, total in counted.totals.items()},
            f"prior_only_{unit}": counted.prior_only,
        },
        "cadence": {
            "every": list(cadence.every),
            "count": list(cadence.count),
            f"sigma_total_{unit}": numbers(cadence.total),
            "slope": cadence.slope,
            "expected_slope": cadence.expected_slope,
        },
        "telescope_noise": {
            "factor": list(noise.factor),
            f"sigma_total_{unit}": numbers(noise.total),
            "slope_quiet": noise.slope_quiet,
            "slope_noisy": noise.slope_noisy,
            "expected_slope_noisy": noise.expected_slope_noisy,
        },
    }


def accuracy_comparison(found: Sequence[Accuracies]) -> Row:
    """The `accuracy_comparison` block."""
    return {"meaning": dict(MEANINGS), "guaranteed_level": LEVEL, "rows": [accuracies(row) for row in found]}


def accuracies(found: Accuracies) -> Row:
    """One row of it."""
    interval = found.monte_carlo_interval_99
    return {
        "estimator": found.estimator,
        "prediction": found.prediction,
        "component": found.component,
        "unit": found.unit,
        "formal": found.formal,
        "extended": found.extended,
        "mean_error": found.mean_error,
        "worst_correlation": found.worst_correlation,
        "worst_correlation_period_s": found.worst_period_s,
        "worst_any_correlation": found.worst_any_correlation,
        "guaranteed": found.guaranteed,
        "guaranteed_measurements": found.guaranteed_measurements,
        "guaranteed_reason": found.guaranteed_reason,
        "monte_carlo": found.monte_carlo,
        "monte_carlo_interval_99": None if interval is None else list(interval),
        "monte_carlo_reason": found.monte_carlo_reason,
        "statement": found.statement,
    }


def consistency_block(found: Mapping[str, StateNees]) -> Row:
    """The `consistency` block by estimator, the first one's numbers ahead; empty without runs."""
    rows = [{"estimator": name, **state_nees(one)} for name, one in found.items()]
    return {"consistency": {**rows[0], "by_estimator": rows}} if rows else {}


def state_nees(found: StateNees) -> Row:
    """The numbers of one estimator."""
    return {
        "n_runs": found.runs,
        "n_failed": found.lost,
        "iterated": found.iterated,
        "second_order_sigma": number(found.second_order_sigma),
        "nees_mean": found.nees_mean,
        "nees_interval_99": list(found.nees_interval_99),
        "coverage": {f"{100 * level:g}_percent": share for level, share in found.coverage.items()},
    }
