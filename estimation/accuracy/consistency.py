"""Statistics that judge covariances and residuals: NEES, NIS, coverage, and patterns left in the residuals.

They are for any errors and any covariance; a run's own are in `nebosvod.engine.montecarlo.state_nees`.
An estimator is believed when the errors of repeated runs look as its covariance says, in every direction: a 12 %
optimism in one direction of six moves the mean NEES only to 1.04.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, erfc, gammaincc, gammaincinv

from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import solve_square

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Consistency:
    """Verdict over N runs of a d-dimensional error.

    Attributes
    ----------
    nees_mean : mean of e^T iK e over d: 1 when the covariance is right.
    interval : where `nees_mean` lies with probability 1 - level/2: half of the level is for the mean.
    variances : shape (d,), of the whitened components; the other half is for them, `variance_interval` by Bonferroni.
    consistent : all inside.
    """

    nees_mean: float
    interval: tuple[float, float]
    variances: Array
    variance_interval: tuple[float, float]
    consistent: bool


def nees(errors: Array, factor: Array) -> Array:
    """Normalised squared errors (N,) of errors (N, d) through a square factor (d, d) or one for each run (N, d, d).

    References
    ----------
    Bar-Shalom, Li, Kirubarajan 2001, Estimation with Applications to Tracking and Navigation.
    """
    squares: Array = np.sum(_whitened(errors, factor) ** 2, axis=1)
    return squares


def judge(errors: Array, factor: Array, level: float = 0.01) -> Consistency:
    """Judge errors (N, d), estimate minus truth, against the covariance factor factor^T.

    Parameters
    ----------
    factor : shape (d, d) or (N, d, d), nonsingular.
    level : family error of the whole verdict; half for the mean, half shared by the components (Bonferroni).

    References
    ----------
    Bar-Shalom, Li, Kirubarajan 2001, Estimation with Applications to Tracking and Navigation.
    """
    white = _whitened(errors, factor)
    runs, size = white.shape
    interval = chi_square_interval(runs * size, 0.5 * level)
    variance_interval = chi_square_interval(runs, 0.5 * level / size)
    mean = float(np.mean(white**2))
    variances = np.mean(white**2, axis=0)
    inside = interval[0] <= mean <= interval[1]
    every = bool(np.all((variances >= variance_interval[0]) & (variances <= variance_interval[1])))
    return Consistency(
        nees_mean=mean,
        interval=interval,
        variances=variances,
        variance_interval=variance_interval,
        consistent=inside and every,
    )


def coverage(errors: Array, factor: Array, level_sigma: float) -> float:
    """Fraction of errors (N, d) inside the `level_sigma` ellipsoid."""
    return float(np.mean(nees(errors, factor) <= level_sigma**2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pattern:
    """Is a series of residuals random? p-values of the runs test and of the lag correlations (Ljung and Box).

    `lag` is the one whose `correlation` is least likely by chance, and `lag_p` the chance of any as unlikely: where a
    small level must hold, as among many tests, it does, and Ljung's and Box's, which is asymptotic, does not.
    """

    runs: int
    runs_expected: float
    runs_p: float
    whiteness: float
    whiteness_p: float
    lag: int
    correlation: float
    lag_p: float

    def random(self, level: float = 0.01) -> bool:
        """Neither test objects at half the level each."""
        return min(self.runs_p, self.whiteness_p) > 0.5 * level


def residual_pattern(series: npt.ArrayLike, lags: int = 10) -> Pattern:
    """Test a whitened residual series (n,) for runs of one sign and for correlation up to `lags`.

    Notes
    -----
    Runs about zero; Q = n (n + 2) sum r_l^2 / (n - l) is chi-square with `lags` degrees of
    freedom when there is no correlation. Normal places can hide it, so test before compressing.

    References
    ----------
    Wald, Wolfowitz 1940, Annals of Mathematical Statistics 11, 147: runs.
    Ljung, Box 1978, Biometrika 65, 297: Q.
    """
    values = np.asarray(series, dtype=np.float64)
    n = values.size
    if values.ndim != 1 or n < 3 * lags:
        raise InputError(f"residual_pattern: needs a series of at least {3 * lags} values, got shape {values.shape}")
    signs = values > 0.0
    plus = int(signs.sum())
    minus = n - plus
    runs = 1 + int(np.sum(signs[1:] != signs[:-1]))
    expected = 1.0 + 2.0 * plus * minus / n
    spread = np.sqrt(max((expected - 1.0) * (expected - 2.0) / (n - 1.0), 1e-300))
    centred = values - values.mean()
    power = float(centred @ centred)
    lagged = np.array([float(centred[lag:] @ centred[:-lag]) for lag in range(1, lags + 1)])
    r = lagged / power if power > 0.0 else lagged
    normal = np.abs(r) * np.sqrt(n * (n + 2.0) / (n - np.arange(1, lags + 1)))
    best = int(np.argmax(normal))
    q = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return Pattern(
        runs=runs,
        runs_expected=expected,
        runs_p=float(erfc(abs(runs - expected) / spread / np.sqrt(2.0))),
        whiteness=q,
        whiteness_p=_chi_square_tail(q, lags),
        lag=best + 1,
        correlation=float(r[best]),
        lag_p=min(lags * float(erfc(normal[best] / np.sqrt(2.0))), 1.0),
    )


def binomial_interval(successes: int, runs: int, level: float = 0.01) -> tuple[float, float]:
    """Interval of a probability from successes in runs, exact.

    References
    ----------
    Clopper, Pearson 1934, Biometrika 26, 404.
    """
    grid = np.linspace(0.0, 1.0, 20001)
    below = betainc(successes, runs - successes + 1, grid) if successes else np.ones_like(grid)
    above = betainc(successes + 1, runs - successes, grid) if successes < runs else np.zeros_like(grid)
    low = float(grid[np.searchsorted(below, 0.5 * level)]) if successes else 0.0
    high = float(grid[np.minimum(np.searchsorted(above, 1.0 - 0.5 * level), 20000)]) if successes < runs else 1.0
    return low, high


def _whitened(errors: Array, factor: Array) -> Array:
    """Errors (N, d) in units of the factor."""
    if factor.ndim == 2:
        return solve_square(factor, errors.T).T
    return solve_square(factor, errors[:, :, None])[:, :, 0]


def chi_square_interval(freedom: int, level: float) -> tuple[float, float]:
    """Two-sided interval of chi-square over its degrees of freedom."""
    low, high = (2.0 * float(gammaincinv(0.5 * freedom, q)) / freedom for q in (0.5 * level, 1.0 - 0.5 * level))
    return low, high


def _chi_square_tail(value: float, freedom: int) -> float:
    return float(gammaincc(0.5 * freedom, 0.5 * value))
