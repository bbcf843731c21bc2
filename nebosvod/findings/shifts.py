"""Shift by each source: how far an error that is off on average moves the estimate and each prediction.

The mean of truth minus assumption times the gain of the estimator (Guo, Ivashkin 2018, (3.2)); the shifts add up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.scene.prior import STATE_NAMES

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictionShift:
    """Mean (d,) of predicted minus true value by one source, in a unit; in_sigmas : its length against the sigma."""

    prediction: str
    unit: str
    shift: Array
    in_sigmas: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shift:
    """What one source does to one estimator on average.

    Attributes
    ----------
    state : (6,) mean of estimated minus true state, km and km/s.
    in_sigmas : length of that in true sigmas, the correlations counted.
    """

    estimator: str
    source: str
    state: Array
    in_sigmas: float
    predictions: tuple[PredictionShift, ...]


def shifts(fit: Fit, asked: Sequence[Quantity]) -> list[Shift]:
    """Every source whose mean is not as assumed, the largest shift first; empty where all are."""
    if not fit.mean_errors or fit.estimate.solution is None:
        return []
    off, whiten = fit.mean_errors, fit.estimate.factor(STATE_NAMES)
    by_prediction = []
    for quantity in asked:
        W, names = known_partials(quantity, fit.estimate)
        factor = fit.estimate.predict(W, names).factor
        moved = {source: W @ part for source, part in off.by_source(fit.estimate, names).items()}
        by_prediction.append((quantity, factor, moved))
    found = [
        Shift(
            estimator=fit.estimator.name,
            source=source,
            state=state,
            in_sigmas=_length(whiten, state),
            predictions=tuple(
                PredictionShift(
                    prediction=quantity.request.name,
                    unit=quantity.unit,
                    shift=moved[source],
                    in_sigmas=_length(factor, moved[source]),
                )
                for quantity, factor, moved in by_prediction
            ),
        )
        for source, state in off.by_source(fit.estimate, STATE_NAMES).items()
    ]
    return sorted(found, key=lambda shift: -shift.in_sigmas)


def _length(factor: Array, moved: Array) -> float:
    """Length of a shift (d,) in units of an error with factor (d, d)."""
    unit = np.linalg.norm(factor, axis=1)
    if not np.all(unit > 0.0):
        return float("inf") if moved.any() else 0.0
    return float(np.linalg.norm(np.linalg.solve(factor / unit[:, None], moved / unit)))
