"""Probability that a normal point of the plane falls inside a disc or an ellipse that need not be its own.

In the principal axes of the covariance the integral along the long axis is a difference of two error functions; what
is left is one smooth integral along the short axis, over the chord that matters. An ellipse becomes the unit disc by
an affine map, so one formula serves every shape.
"""

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.ellipse import Ellipse

Array = npt.NDArray[np.float64]
REACH = 9.5  # sigmas; 2e-21 of the probability lies beyond
PANELS, NODES = 48, 24
THINNEST = 1e-9  # of the radius: a thinner distribution is taken as this thin


def inside_disc(mean: npt.ArrayLike, factor: npt.ArrayLike, radius: float) -> float:
    """Probability that a point mean + factor eta, eta ~ N(0, I), lies within `radius` of the origin.

    Parameters
    ----------
    mean : shape (2,), in the unit of the radius.
    factor : shape (2, r), of the covariance; may be singular.

    Raises
    ------
    InputError
        If something is not finite or the radius is negative.
    """
    m, L = np.asarray(mean, dtype=np.float64), np.asarray(factor, dtype=np.float64)
    if m.shape != (2,) or L.ndim != 2 or len(L) != 2 or not (np.isfinite(m).all() and np.isfinite(L).all()):
        raise InputError(f"inside_disc: needs a finite mean (2,) and factor (2, r), got {m.shape} and {L.shape}")
    if not 0.0 <= radius < np.inf:
        raise InputError(f"inside_disc: needs a radius >= 0, got {radius}")
    if radius == 0.0:
        return 0.0
    axes, lengths, _ = np.linalg.svd(np.hstack([L, np.zeros((2, 2))]), full_matrices=False)
    long, short = (max(float(length) / radius, THINNEST) for length in lengths)
    along, across = (axes.T @ m) / radius
    # y = sin(turn) across, in radii: the ends of the chords need no care then
    low, high = (np.arcsin(np.clip(across + side * REACH * short, -1.0, 1.0)) for side in (-1.0, 1.0))
    if high <= low:
        return 0.0
    turn, weight = _nodes(float(low), float(high))
    half = np.cos(turn)
    density = np.exp(-0.5 * ((np.sin(turn) - across) / short) ** 2) / (np.sqrt(2.0 * np.pi) * short)
    chord = _between((-half - along) / long, (half - along) / long)
    return float(min(np.sum(weight * half * density * chord), 1.0))


def inside_ellipse(
    mean: npt.ArrayLike, factor: npt.ArrayLike, ellipse: Ellipse, centre: npt.ArrayLike = (0.0, 0.0)
) -> float:
    """Probability that a point mean + factor eta lies inside any ellipse, its own or another, about any centre.

    Parameters
    ----------
    mean, factor : as for `inside_disc`, in the unit of the ellipse.
    """
    c, s = np.cos(ellipse.angle_rad), np.sin(ellipse.angle_rad)
    if not (ellipse.semi_axes > 0.0).all():
        return 0.0
    to_disc = np.array([[c, s], [-s, c]]) / ellipse.semi_axes[:, None]
    offset = np.asarray(mean, dtype=np.float64) - np.asarray(centre, dtype=np.float64)
    return inside_disc(to_disc @ offset, to_disc @ np.asarray(factor, dtype=np.float64), 1.0)


def _nodes(low: float, high: float) -> tuple[Array, Array]:
    """Composite Gauss-Legendre nodes and weights between two numbers."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    edges = np.linspace(low, high, PANELS + 1)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (1.0 + x)).ravel(), (half * w).ravel()


def _between(low: Array, high: Array) -> Array:
    """Probability of a unit normal between two numbers, without cancellation in the upper tail."""
    upper = low > 0.0
    first, second = np.where(upper, -high, low), np.where(upper, -low, high)
    chance: Array = ndtr(second) - ndtr(first)
    return chance
