"""Covariance matrices as a mission gives them: checked to be positive definite, never repaired, then rescaled."""

from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.mission.fields import Parsed
from nebosvod.units import AU_KM, DAY_S, DEG

Array = npt.NDArray[np.float64]
_LARGEST = 20

# Factors from the units in which JPL prints a covariance (au, d, deg) to internal units (km, s, rad).
COMETARY_SCALE = {"e": 1.0, "q": AU_KM, "tp": DAY_S, "node": DEG, "peri": DEG, "i": DEG}
STATE_SCALE = {"x": 1.0, "y": 1.0, "z": 1.0, "vx": 1.0, "vy": 1.0, "vz": 1.0}  # km, km/s
NONGRAV_SCALE = {"A1": 1.0, "A2": 1.0, "A3": 1.0}  # au/d^2


def read_matrix(value: Any) -> Array:
    """A square symmetric positive definite matrix from lists of numbers (or of numbers in quotes, as JPL prints).

    Raises
    ------
    InputError
        If it is not square, not symmetric, or not positive definite; the message has the smallest
        eigenvalue of the correlation matrix.
    """
    if not isinstance(value, list) or not value or not all(isinstance(row, list) for row in value):
        raise InputError("needs a matrix: a list of rows, each a list of numbers")
    n = len(value)
    if n > _LARGEST or any(len(row) != n for row in value):
        lengths = sorted({len(row) for row in value})
        raise InputError(f"is not square or too large (got {n} rows of {lengths} numbers; at most {_LARGEST})")
    try:
        matrix = np.array([[_strict_float(item) for item in row] for row in value], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"needs numbers only ({error})") from None
    return checked(matrix)


def checked(matrix: Array) -> Array:
    """The matrix itself, read-only, if it is a covariance."""
    variances = np.diag(matrix)
    if not (np.all(np.isfinite(matrix)) and np.all(variances > 0.0)):
        raise InputError(
            f"is not positive definite: every variance must be positive (got smallest {variances.min():g})"
        )
    scale = np.sqrt(variances)
    correlation = matrix / scale[:, None] / scale
    if not np.all(np.isfinite(correlation)):
        raise InputError("has numbers too large or too small to be a covariance")
    skew = np.abs(correlation - correlation.T)
    if skew.max() > 1e-9:
        i, j = np.unravel_index(int(skew.argmax()), skew.shape)
        raise InputError(f"is not symmetric (row {i + 1} column {j + 1}: {matrix[i, j]:g} against {matrix[j, i]:g})")
    smallest = float(np.linalg.eigvalsh(correlation)[0])
    if smallest <= len(matrix) * np.finfo(np.float64).eps:
        own = float(np.linalg.eigvalsh(matrix)[0])
        raise InputError(
            f"is not positive definite (smallest eigenvalue of the correlation matrix {smallest:.3g}, of the matrix "
            f"{own:.3g}; allowed: more than 0); print it with more digits, it is never repaired"
        )
    symmetric: Array = 0.5 * (matrix + matrix.T)
    symmetric.flags.writeable = False
    return symmetric


def _strict_float(item: Any) -> float:
    if isinstance(item, bool) or not isinstance(item, str | int | float):
        raise ValueError(f"got {item!r}")
    return float(item)


MATRIX_SCHEMA: dict[str, Any] = {
    "type": "array",
    "description": "A square matrix, row by row",
    "items": {"type": "array", "items": {"anyOf": [{"type": "number"}, {"type": "string"}]}},
}
Matrix = Annotated[Array, Parsed(read_matrix, MATRIX_SCHEMA, lambda matrix: matrix.tolist())]
