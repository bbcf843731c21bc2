"""Intervals of a probability: of counted hits, of weighted ones, and the bound where there is none."""

import numpy as np
import numpy.typing as npt
from scipy.special import betaincinv, ndtri

Array = npt.NDArray[np.float64]
LEVEL = 0.95


def of_count(hits: int, draws: float, level: float = LEVEL) -> tuple[float, float]:
    """Interval of a probability from hits among plain draws; without a hit from 0 to the one-sided bound, 3/N at 95 %.

    References
    ----------
    Clopper, Pearson 1934, Biometrika 26, 404.
    """
    if hits == 0:
        return 0.0, float(1.0 - (1.0 - level) ** (1.0 / draws))
    tail = 0.5 * (1.0 - level)
    low = float(betaincinv(hits, draws - hits + 1, tail))
    high = float(betaincinv(hits + 1, draws - hits, 1.0 - tail)) if hits < draws else 1.0
    return low, high


def of_weights(weights: Array, hits: npt.NDArray[np.bool_], level: float = LEVEL) -> tuple[float, float, float]:
    """Probability and interval from weighed draws, by the spread of their products with the hits or the misses.

    The rarer of the two is counted, so that no probability is above 1 by chance; the interval is symmetric in its
    logarithm, so that it reaches neither 0 nor 1. Without a miss it goes down to the one-sided bound for so many
    effective draws.
    """
    if not hits.any():
        return 0.0, 0.0, 1.0
    if hits.all():
        return 1.0, float((1.0 - level) ** (1.0 / effective(weights))), 1.0
    likely = bool(weights[hits].sum() > weights[~hits].sum())
    product = weights * (~hits if likely else hits)
    value = float(product.mean())
    relative = float(product.std(ddof=1)) / np.sqrt(len(product)) / value
    factor = float(np.exp(ndtri(0.5 + 0.5 * level) * relative))
    low, high = value / factor, min(value * factor, 1.0)
    return (1.0 - value, 1.0 - high, 1.0 - low) if likely else (value, low, high)


def effective(weights: Array) -> float:
    """How many draws of equal weight tell as much: (sum w)^2 / sum w^2."""
    total = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / total if total > 0.0 else 0.0
