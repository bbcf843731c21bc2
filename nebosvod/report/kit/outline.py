"""Ellipses: from axes to covariance, from covariance to outline."""

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


def covariance_of(major: float, minor: float, angle_deg: float) -> Array:
    """The covariance (2, 2) of a 1 sigma ellipse whose long axis lies at an angle from the first coordinate."""
    angle = np.radians(angle_deg)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    return np.asarray(major**2 * np.outer(along, along) + minor**2 * np.outer(across, across))
