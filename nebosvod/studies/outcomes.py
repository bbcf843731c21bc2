"""Tests of a covariance: what each is of, the law of its value when the covariance is right, and how it came out."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Direction:
    """A linear combination of errors that has a name.

    Attributes
    ----------
    group : "position", "velocity", "parameter" or the name of a prediction.
    name : of the direction inside the group, as in "sigma is optimistic by 12 % <name>".
    unit : of the combination.
    weights : (s + s_j,) by estimated parameters, then those left out.
    """

    group: str
    name: str
    unit: str
    weights: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanSquare:
    """The mean of so many squares of unit variance: chi-square over its degrees of freedom."""

    freedom: int

    def interval(self, level: float) -> tuple[float, float]:
        """Where it lies with probability 1 - level."""
        low, high = (float(stats.chi2.ppf(q, self.freedom)) / self.freedom for q in (0.5 * level, 1.0 - 0.5 * level))
        return low, high


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanOfRuns:
    """A mean of 1 whose error the scatter of the runs gives: Student's t."""

    freedom: int
    error: float

    def interval(self, level: float) -> tuple[float, float]:
        """Where it lies with probability 1 - level."""
        reach = float(stats.t.isf(0.5 * level, self.freedom)) * self.error
        return 1.0 - reach, 1.0 + reach


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Share:
    """The share of so many runs inside what holds a fraction of them: binomial."""

    runs: int
    fraction: float

    def interval(self, level: float) -> tuple[float, float]:
        """Where it lies with probability 1 - level."""
        low, high = stats.binom.interval(1.0 - level, self.runs, self.fraction)
        return float(low) / self.runs, float(high) / self.runs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CramerVonMises:
    """The statistic of Cramer and von Mises of many runs."""

    def interval(self, level: float) -> tuple[float, float]:
        """Where it lies with probability 1 - level, for a small level.

        Notes
        -----
        It is sum z_k^2 / (k pi)^2; the tail is that of its first term times prod_(k>1) (1 - 1/k^2)^(-1/2) = sqrt 2.

        References
        ----------
        Anderson, Darling 1952, Annals of Mathematical Statistics 23, 193: its exact law, 0.743 at 1 %.
        """
        return 0.0, float(stats.chi2.isf(level / np.sqrt(2.0), 1)) / float(np.pi) ** 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One test.

    Attributes
    ----------
    value, p : the number tested, and the chance of one so far off when the claim is right.
    law : of the value when the claim is right; interval : where it then lies, at Bonferroni's level of the family.
    rejected : by Holm's rule over the family.
    """

    value: float
    p: float
    law: MeanSquare | MeanOfRuns | Share | CramerVonMises
    rejected: bool = False
    interval: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComponentOutcome(Outcome):
    """Of the variance of one whitened component of the state, numbered from 1."""

    component: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DirectionOutcome(Outcome):
    """Of the variance along one direction; sigmas claimed and seen, and the mean error, in its unit."""

    direction: Direction
    sigma_claimed: float
    sigma_sample: float
    mean_error: float

    @property
    def optimism_percent(self) -> float:
        """By how much the sigma seen exceeds the one claimed."""
        return float(100.0 * (self.value**0.5 - 1.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictionOutcome(Outcome):
    """Of the mean NEES of a prediction of several components, by its name."""

    group: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoverageOutcome(Outcome):
    """Of the share of runs inside the ellipsoid that should hold a fraction of them; its interval of confidence."""

    fraction: float
    value_interval_99: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TelescopeOutcome(Outcome):
    """Of the mean NIS of one telescope."""

    telescope: str
