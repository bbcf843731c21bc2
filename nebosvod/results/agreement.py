"""Whether residuals are as large as their weights say: chi squared for each degree of freedom against its interval."""

import math
from dataclasses import dataclass

from nebosvod.estimation.solvers.rejection import Thresholds

LEVEL = 0.99  # of the two-sided interval
LEAST_CHANGE = 0.1  # of sigma: in real records a difference that moves it by less is said, and no caution


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """chi2/dof with the interval that chance leaves it.

    Attributes
    ----------
    ratio, low, high : chi2/dof and its two-sided 99 % interval.
    """

    ratio: float
    low: float
    high: float

    @property
    def where(self) -> str:
        """`inside`, `below` or `above` the interval."""
        return "below" if self.ratio < self.low else "above" if self.ratio > self.high else "inside"

    @property
    def factor(self) -> float:
        """How many times as large as stated the noise is, were nothing else wrong."""
        return math.sqrt(self.ratio)

    @property
    def usable(self) -> bool:
        """Whether sigmas stand as they are: inside of chance, or so near that none would change by a tenth."""
        return self.where == "inside" or abs(self.factor - 1.0) < LEAST_CHANGE


def agreement(chi2: float | None, dof: int | None, rejected: int = 0) -> Agreement | None:
    """How chi2 compares with its degrees of freedom; None where there are none.

    Parameters
    ----------
    rejected : how many measurements an automatic rejection has left out. With any, the squares of the others are those
        of a distribution cut off at the threshold, and are smaller on average.

    Notes
    -----
    Two components of a measurement have chi squared with mean 2; cut off at T, the mean is 2 - T / (exp(T/2) - 1).
    """
    if chi2 is None or not dof or dof < 1 or not math.isfinite(chi2):
        return None
    low, high = chi2_interval(int(dof))
    if rejected:
        cut = Thresholds().reject
        low *= 1.0 - 0.5 * cut / math.expm1(0.5 * cut)
    return Agreement(ratio=chi2 / dof, low=low, high=high)


def chi2_interval(dof: int) -> tuple[float, float]:
    """Two-sided 99 % interval of chi2/dof."""
    from scipy.special import chdtri  # 0.2 s, and free after a run

    return float(chdtri(dof, 0.5 + 0.5 * LEVEL)) / dof, float(chdtri(dof, 0.5 - 0.5 * LEVEL)) / dof
