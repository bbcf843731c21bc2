"""Covariances as matrices of numbers, where double precision can hold them.

S S^T of a perfect factor fails Cholesky once its condition number nears 1e16. What a program shows must be what it
says, so such a matrix is left out, with the reason beside it, and the factor stands alone.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
MARGIN = 16.0  # units of round-off a component, which another order of sums may cost
REASON = "not positive definite in double precision, its axes differ too much; the factor S with K = S S^T holds it"


def formed(factor: Array) -> list[list[float]] | None:
    """K = S S^T from a factor (k, r), safely positive definite as it stands; None where it would not be."""
    half = factor @ factor.T
    K = 0.5 * (half + half.T)
    return K.tolist() if definite(K) else None


def definite(K: Array) -> bool:
    """Whether a symmetric matrix passes Cholesky whatever the order of the sums, its scales put aside."""
    sigma = np.sqrt(np.maximum(np.diag(K), 0.0))
    if not (np.isfinite(K).all() and np.all(sigma > 0.0)):
        return False
    size = len(K)
    lowered = K / sigma[:, None] / sigma - MARGIN * size * np.finfo(np.float64).eps * np.eye(size)
    try:
        np.linalg.cholesky(K)
        np.linalg.cholesky(lowered)
    except np.linalg.LinAlgError:
        return False
    return True


def matrices(**factors: Array) -> dict[str, Any]:
    """Covariances by key with `covariance_reason`, null where all of them stand."""
    block: dict[str, Any] = {key: formed(factor) for key, factor in factors.items()}
    lost = [key for key, value in block.items() if value is None]
    return block | {"covariance_reason": f"{', '.join(lost)}: {REASON}" if lost else None}


def matrix_of(row: Mapping[str, Any], covariance: str, factor: str) -> Array | None:
    """A covariance of a summary for a figure: from its factor where there is one, which is never lost."""
    if row.get(factor) is not None:
        S = np.atleast_2d(np.asarray(row[factor], dtype=np.float64))
        return np.asarray(S @ S.T)
    return None if row.get(covariance) is None else np.asarray(row[covariance], dtype=np.float64)
