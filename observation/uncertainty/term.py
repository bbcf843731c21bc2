"""What a source of uncertainty does to the measurements, as plain arrays: the language estimation is fed in.

Three shapes cover every kind: parameters common to many measurements, a fresh draw at each measurement, and a chain of
draws correlated in time, in state-space form so that its cost stays linear in the number of epochs. A term can draw
its own truth, by the same numbers that describe it to the estimator.
"""

from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Common:
    """Constant parameters shared by many measurements.

    Attributes
    ----------
    name : the source in the error budget.
    names : names of the k parameters.
    H : (n, 2, k) partials of (cos Dec dRA, dDec) by them, over all rows of the observation.
    displacement : (n, 3, k) km, ICRF, how they move the telescope; None where they do not act through its position.
    covariance : (k, k); mean : (k,) their assumed mean.
    true_covariance, true_mean : what they really are; the assumed ones where None.
    """

    name: str
    names: tuple[str, ...]
    H: Array
    displacement: Array | None
    covariance: Array
    mean: Array
    treatment: Treatment
    true_covariance: Array | None = None
    true_mean: Array | None = None

    def draw(self, rng: np.random.Generator, count: int = 1) -> Array:
        """Independent truths (count, k)."""
        covariance = self.covariance if self.true_covariance is None else self.true_covariance
        mean = self.mean if self.true_mean is None else self.true_mean
        return mean + rng.standard_normal((count, mean.size)) @ root(covariance).T


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class White:
    """A fresh, independent draw at each measurement it touches.

    Attributes
    ----------
    rows : (r,) the measurements it touches.
    H : (r, 2, q); displacement : (r, 3, q) km or None, as in `Common`.
    names : names of the q components.
    Q : (r, q, q) covariance of each draw; true_Q : what it really is, the assumed one where None.
    true_mean : (q,) what the draws really are on average, 0 being assumed.
    """

    name: str
    names: tuple[str, ...]
    rows: Rows
    H: Array
    displacement: Array | None
    Q: Array
    treatment: Treatment
    true_Q: Array | None = None
    true_mean: Array | None = None
    _roots: list[Array] = field(default_factory=list, init=False, repr=False)

    def draw(self, rng: np.random.Generator, count: int = 1) -> Array:
        """Independent truths (count, r, q)."""
        normal = rng.standard_normal((count, *self.Q.shape[:2], 1))
        found = (_kept(self._roots, self.Q if self.true_Q is None else self.true_Q) @ normal)[..., 0]
        return found if self.true_mean is None else found + self.true_mean

    @property
    def marginals(self) -> Array:
        """Covariance (r, q, q) at each row by itself."""
        return self.Q


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Markov:
    """A chain z_i = F_i z_(i-1) + w_i, cov(w_i) = Q_i, over the rows it touches, in time order.

    Attributes
    ----------
    rows : (r,) the measurements it touches, by time.
    H : (r, 2, q); displacement : (r, 3, q) km or None, as in `Common`.
    F, Q : (r, q, q) transition into row i and its step noise, which may be singular or zero; F[0], Q[0] are unused.
    P0 : (q, q) covariance at the first row.
    true_F, true_Q, true_P0 : what they really are, the assumed ones where None.
    true_mean : (q,) what the chain really is on average, 0 being assumed.
    """

    name: str
    names: tuple[str, ...]
    rows: Rows
    H: Array
    displacement: Array | None
    F: Array
    Q: Array
    P0: Array
    treatment: Treatment
    true_F: Array | None = None
    true_Q: Array | None = None
    true_P0: Array | None = None
    true_mean: Array | None = None
    _roots: list[Array] = field(default_factory=list, init=False, repr=False)

    def draw(self, rng: np.random.Generator, count: int = 1) -> Array:
        """Independent truths (count, r, q)."""
        F = self.F if self.true_F is None else self.true_F
        normal = rng.standard_normal((count, *self.Q.shape[:2]))
        factor = _kept(self._roots, self.Q if self.true_Q is None else self.true_Q)
        chain = np.empty_like(normal)
        chain[:, 0] = normal[:, 0] @ root(self.P0 if self.true_P0 is None else self.true_P0).T
        for i in range(1, self.rows.size):
            chain[:, i] = chain[:, i - 1] @ F[i].T + normal[:, i] @ factor[i].T
        return chain if self.true_mean is None else chain + self.true_mean

    @property
    def marginals(self) -> Array:
        """Covariance (r, q, q) at each row by itself: P_i = F_i P_(i-1) F_i^T + Q_i."""
        P = np.empty_like(self.Q)
        P[0] = self.P0
        for i in range(1, len(P)):
            P[i] = self.F[i] @ P[i - 1] @ self.F[i].T + self.Q[i]
        return P


Term = Common | White | Markov


def check_treatment(name: str, treatment: str) -> None:
    """Raise InputError unless `treatment` is one of the four."""
    if treatment not in get_args(Treatment):
        raise InputError(f"{name}: treatment must be one of {', '.join(get_args(Treatment))} (got {treatment})")


def _kept(roots: list[Array], covariance: Array) -> Array:
    """The square roots of a term that is drawn many times, found at its first draw."""
    if not roots:
        roots.append(root(covariance))
    return roots[0]


def root(covariance: Array) -> Array:
    """Square roots S (..., q, q), S S^T = covariance, of covariances that may be singular.

    Raises
    ------
    InputError
        If a correlation matrix has an eigenvalue below -1e-12 of its largest; it is never repaired silently.

    Notes
    -----
    The eigenvalues are those of the correlations, so that km and km/s may stand in one matrix.
    """
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    sigma = np.sqrt(np.maximum(variance, 0.0))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    value, vector = np.linalg.eigh(covariance / (unit[..., :, None] * unit[..., None, :]))
    if np.any(value[..., 0] < -1e-12 * np.abs(value[..., -1])):
        raise InputError(
            "covariance is not positive semi-definite "
            f"(smallest eigenvalue of the correlations {value[..., 0].min():.3g})"
        )
    symmetric = (vector * np.sqrt(np.maximum(value, 0.0))[..., None, :]) @ np.swapaxes(vector, -1, -2)
    factor: Array = unit[..., :, None] * symmetric
    return factor
