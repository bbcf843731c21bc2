"""What a campaign judged, as rows of validation.json: the one place where they become dictionaries."""

from typing import Any

import numpy as np
from scipy import stats

from nebosvod.studies.outcomes import (
    ComponentOutcome,
    CoverageOutcome,
    DirectionOutcome,
    Outcome,
    PredictionOutcome,
    TelescopeOutcome,
)
from nebosvod.studies.trust import Judgement

Row = dict[str, Any]
QUANTILES = 99


def judgement(found: Judgement) -> Row:
    """All tests of one covariance, the verdict in words first."""
    grid = np.arange(1, QUANTILES + 1) / (QUANTILES + 1.0)
    return {
        "consistent": found.consistent,
        "verdict": found.verdict,
        "family_level": found.level,
        "n_tests": len(found.outcomes),
        "n_rejected": found.n_rejected,
        "resolution_percent": found.resolution_percent,
        "nees": outcome(found.nees),
        "cramer_von_mises": outcome(found.cramer_von_mises),
        "coverage": [outcome(one) for one in found.coverage],
        "whitened": [outcome(one) for one in found.whitened],
        "directions": [outcome(one) for one in found.directions],
        "predictions": [outcome(one) for one in found.predictions],
        "nis": [outcome(one) for one in found.nis],
        "nees_quantiles": {
            "probability": grid.tolist(),
            "sample": np.quantile(found.squares, grid).tolist(),
            "chi_square": stats.chi2.ppf(grid, found.size).tolist(),
        },
    }


def outcome(found: Outcome) -> Row:
    """One test: what it is of, its value and chance, and where it should lie."""
    told = {"value": found.value, "p": found.p, "rejected": found.rejected, "interval": list(found.interval)}
    match found:
        case ComponentOutcome():
            return {"component": found.component} | told
        case DirectionOutcome():
            return _direction(found) | told | {"optimism_percent": found.optimism_percent}
        case PredictionOutcome():
            return {"group": found.group} | told
        case CoverageOutcome():
            value = {"value": found.value, "value_interval_99": list(found.value_interval_99)}
            return {"fraction": found.fraction} | value | told
        case TelescopeOutcome():
            return {"telescope": found.telescope} | told
    return told


def _direction(found: DirectionOutcome) -> Row:
    return {
        "group": found.direction.group,
        "name": found.direction.name,
        "unit": found.direction.unit,
        "sigma_claimed": found.sigma_claimed,
        "sigma_sample": found.sigma_sample,
        "mean_error": found.mean_error,
    }
