"""What is known of some components when others are given: conditional sigmas and regression lines.

A marginal sigma says how well a component is known whatever the others are; a conditional one, how well if they were
known. The marginal covariance is a block of K; the conditional one, the inverse of a block of K^-1. Both come from a
factor here, so nothing is inverted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem.square_root import left_inverse, lower_factor, row_units

Array = npt.NDArray[np.float64]
SINGULAR = 1e-13  # of a sigma: what is left of it, given the components before


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regression:
    """Regression of components a on components b: a = mean + slope (b - b mean) + e.

    Attributes
    ----------
    mean, mean_given : shapes (a,) and (b,), of the joint belief.
    slope : shape (a, b), K_ab K_bb^-1; for two numbers, the slope of the regression line of one on the other.
    factor : shape (a, a), of the covariance of e: what is left of a when b is known.
    """

    mean: Array
    mean_given: Array
    slope: Array
    factor: Array

    def at(self, values: npt.ArrayLike) -> Belief:
        """The belief of a when b has these values (b,)."""
        given = np.atleast_1d(np.asarray(values, dtype=np.float64))
        if given.shape != self.mean_given.shape:
            raise InputError(f"Regression.at: needs {len(self.mean_given)} values, got {given.size}")
        return Belief(mean=self.mean + self.slope @ (given - self.mean_given), factor=self.factor)


def regress(belief: Belief, of: Sequence[int], on: Sequence[int]) -> Regression:
    """Regress components `of` on components `on` of a Gaussian belief.

    Raises
    ------
    InputError
        If a component is in both.
    GeometryError
        If the components `on` are not independent of each other: their values cannot be chosen freely.

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, pp. 11-16.
    """
    if set(of) & set(on):
        raise InputError(f"regress: components {sorted(set(of) & set(on))} are on both sides")
    rows = belief.factor[[*on, *of]]
    L, b = lower_factor(rows), len(on)
    if not (np.diag(L)[:b] > SINGULAR * row_units(rows)[:b]).all():
        raise GeometryError("regress: the given components depend on each other")
    return Regression(
        mean=belief.mean[list(of)],
        mean_given=belief.mean[list(on)],
        slope=L[b:, :b] @ left_inverse(L[:b, :b]),
        factor=L[b:, b:],
    )


def conditional_sigmas(factor: npt.ArrayLike) -> Array:
    """Sigma (s,) of each component if all others were known, for a covariance factor (s, r): 1 / sqrt((K^-1)_ii).

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, pp. 11-16; p. 28 takes a block of K for it.
    """
    S = np.atleast_2d(np.asarray(factor, dtype=np.float64))
    size = len(S)
    last = [lower_factor(S[[*range(k), *range(k + 1, size), k]])[-1, -1] for k in range(size)]
    return np.array(last)
