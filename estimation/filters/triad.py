"""TRIAD: a rotation matrix from two directions seen in both frames, with the covariance of its error angles."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError

Array = npt.NDArray[np.float64]
PARALLEL = 1e-9  # sine of the angle between two directions that determine no rotation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Attitude:
    """Rotation and covariance of its error.

    Attributes
    ----------
    R_body_from_reference : shape (3, 3).
    covariance : shape (3, 3), rad^2, of the small rotation about body axes from the true to the found frame.
    """

    R_body_from_reference: Array
    covariance: Array


def triad(body: npt.ArrayLike, reference: npt.ArrayLike, sigma_rad: tuple[float, float] = (0.0, 0.0)) -> Attitude:
    """Find the rotation from two directions; the first is reproduced exactly, the second in its plane.

    Parameters
    ----------
    body, reference : shape (2, 3), the same two directions in body and in reference axes, of any length. The more
        precise goes first.
    sigma_rad : error of each measured direction, in each of the two axes across it.

    Raises
    ------
    GeometryError
        If the two directions are parallel.

    References
    ----------
    Black 1964, AIAA Journal 2, 1350; Shuster, Oh 1981, J. Guidance and Control 4, 70; Platonov, Ivanov 2013, D.5.
    """
    seen, known = (np.asarray(value, dtype=np.float64) for value in (body, reference))
    if seen.shape != (2, 3) or known.shape != (2, 3):
        raise InputError(f"triad: needs two directions of three components, got {seen.shape} and {known.shape}")
    axes = [_axes(pair, what) for pair, what in ((seen, "body"), (known, "reference"))]
    w1, w2 = (one / np.linalg.norm(one) for one in seen)
    cosine, square = float(w1 @ w2), float(np.sum(np.cross(w1, w2) ** 2))
    first, second = sigma_rad[0] ** 2, sigma_rad[1] ** 2
    mixed = first * cosine * (np.outer(w1, w2) + np.outer(w2, w1)) + (second - first) * np.outer(w1, w1)
    return Attitude(
        R_body_from_reference=axes[0] @ axes[1].T,
        covariance=first * np.eye(3) + mixed / square,
    )


def _axes(pair: Array, what: str) -> Array:
    """Orthonormal columns: the first direction, the normal of both, and what completes them."""
    lengths = np.linalg.norm(pair, axis=1)
    if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        raise InputError(f"triad: a {what} direction has no length")
    one, other = pair / lengths[:, None]
    normal = np.cross(one, other)
    sine = float(np.linalg.norm(normal))
    if sine < PARALLEL:
        raise GeometryError(f"triad: the two {what} directions are parallel")
    normal = normal / sine
    return np.column_stack([one, normal, np.cross(one, normal)])
