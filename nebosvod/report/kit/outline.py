"""The outline of an ellipse from its covariance."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ANGLES = np.linspace(0.0, 2.0 * np.pi, 121)


def outline(K: Array, level: float) -> Array:
    """Points (121, 2) of the ellipse x^T K^-1 x = level^2, through the symmetric square root (K may be singular)."""
    values, vectors = np.linalg.eigh(K)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    points: Array = level * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1) @ root.T
    return points
