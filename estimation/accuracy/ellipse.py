"""Covariance to ellipse, ellipsoid, probability, and sigma along a direction; all through a factor.

A sigma level is part of every statement: the 3-sigma ellipse holds 98.9 % of a plane normal distribution, while
one component stays inside 3 sigma with 99.7 %.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammainc, gammaincinv

from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import covariance_factor, solve_square

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipse:
    """Ellipse of a plane covariance at a sigma level.

    Attributes
    ----------
    semi_axes : shape (2,), major and minor, at `level` sigmas, in the unit of the coordinates.
    angle_rad : direction of the major axis from the first coordinate axis, in (-pi/2, pi/2].
    level : number of sigmas.
    """

    semi_axes: Array
    angle_rad: float
    level: float

    @classmethod
    def of_factor(cls, factor: npt.ArrayLike, level: float = 1.0) -> "Ellipse":
        """Ellipse of the covariance factor factor^T, factor (2, r); singular covariances give a segment."""
        L = _factor(factor, 2)
        left, values, _ = np.linalg.svd(np.hstack([L, np.zeros((2, 2))]), full_matrices=False)
        direction = left[:, 0]
        angle = float(np.arctan2(direction[1], direction[0]))
        if angle <= -np.pi / 2:
            angle += np.pi
        elif angle > np.pi / 2:
            angle -= np.pi
        return cls(semi_axes=level * values[:2], angle_rad=angle, level=level)

    @classmethod
    def of_covariance(cls, covariance: npt.ArrayLike, level: float = 1.0) -> "Ellipse":
        """Ellipse of a covariance (2, 2); one that is not positive semidefinite raises InputError."""
        return cls.of_factor(covariance_factor(np.asarray(covariance, dtype=np.float64), "ellipse"), level)

    @property
    def probability(self) -> float:
        """Probability that the point lies inside."""
        return probability(self.level, 2)

    def at(self, level: float) -> "Ellipse":
        """The same ellipse at another sigma level."""
        return Ellipse(semi_axes=self.semi_axes * (level / self.level), angle_rad=self.angle_rad, level=level)

    def points(self, count: int = 181) -> Array:
        """Closed outline (count, 2) about the origin, for drawing."""
        turn = np.linspace(0.0, 2.0 * np.pi, count)
        along, across = self.semi_axes[0] * np.cos(turn), self.semi_axes[1] * np.sin(turn)
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        return np.column_stack([c * along - s * across, s * along + c * across])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """Ellipsoid of a covariance in d dimensions: semi-axes (d,), largest first, and unit directions as columns."""

    semi_axes: Array
    directions: Array
    level: float

    @classmethod
    def of_factor(cls, factor: npt.ArrayLike, level: float = 1.0) -> "Ellipsoid":
        """Ellipsoid of the covariance factor factor^T, factor (d, r)."""
        L = np.atleast_2d(np.asarray(factor, dtype=np.float64))
        size = L.shape[0]
        left, values, _ = np.linalg.svd(np.hstack([L, np.zeros((size, size))]), full_matrices=False)
        return cls(semi_axes=level * values[:size], directions=left, level=level)

    @property
    def probability(self) -> float:
        """Probability that the point lies inside."""
        return probability(self.level, len(self.semi_axes))


def probability(level: float, dimension: int = 2) -> float:
    """Probability of a normal point inside its `level`-sigma ellipsoid; 1 - exp(-level^2/2) in the plane."""
    if level < 0.0 or dimension < 1:
        raise InputError(f"probability: needs level >= 0 and dimension >= 1, got {level} and {dimension}")
    return float(gammainc(0.5 * dimension, 0.5 * level**2))


def level_of(inside: float, dimension: int = 2) -> float:
    """Sigma level whose ellipsoid holds the probability `inside` (0 <= inside < 1)."""
    if not 0.0 <= inside < 1.0 or dimension < 1:
        raise InputError(f"level_of: needs 0 <= probability < 1 and dimension >= 1, got {inside} and {dimension}")
    return float(np.sqrt(2.0 * gammaincinv(0.5 * dimension, inside)))


def sigma_along(factor: npt.ArrayLike, direction: npt.ArrayLike) -> float:
    """Standard deviation along a direction (d,) of any length, for a factor (d, r)."""
    d = np.asarray(direction, dtype=np.float64)
    length = float(np.linalg.norm(d))
    if length == 0.0:
        raise InputError("sigma_along: the direction has no length")
    return float(np.linalg.norm(np.asarray(factor, dtype=np.float64).T @ (d / length)))


def normalized_distance(factor: npt.ArrayLike, offset: npt.ArrayLike) -> float:
    """Mahalanobis distance of an offset (d,), in sigmas, through a nonsingular factor (d, r)."""
    L = np.atleast_2d(np.asarray(factor, dtype=np.float64))
    r = np.asarray(np.linalg.qr(L.T, mode="r"))
    return float(np.linalg.norm(solve_square(r.T, np.asarray(offset, dtype=np.float64))))


def maximum_deviation(mean: npt.ArrayLike, sigma: npt.ArrayLike, level: float = 3.0) -> Array:
    """Largest deviation to expect: |mean| + level sigma, component by component.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (3.5).
    """
    return np.abs(np.asarray(mean, dtype=np.float64)) + level * np.asarray(sigma, dtype=np.float64)


def _factor(factor: npt.ArrayLike, size: int) -> Array:
    L = np.asarray(factor, dtype=np.float64)
    if L.ndim != 2 or L.shape[0] != size or not np.isfinite(L).all():
        raise InputError(f"ellipse: needs a finite factor of shape ({size}, r), got {L.shape}")
    return L
