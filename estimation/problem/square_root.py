"""Triangular factors: what every estimator computes with instead of covariances and their inverses.

A covariance formed from a good factor can fail Cholesky when its condition number passes 1e16; the factor
itself never does. So estimates carry S with K = S S^T, rows are reduced by orthogonal transformations, and a
matrix is formed only to be shown.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError

Array = npt.NDArray[np.float64]
N = TypeVar("N", np.float64, np.complex128)

EPS = float(np.finfo(np.float64).eps)
ALIKE = 64.0  # rows and columns of a matrix whose largest elements differ less need no balancing
STACKED = 16  # chunks of rows that are reduced in one call
SMALL = 240_000  # multiplications of real numbers for which OpenBLAS wakes no threads (it does from 262,144 on)
LEAST_COLUMNS = 4  # of a product taken some columns at a time; in fewer, rows are added up
OBSERVABLE_CONDITION = 1e13  # above this the smallest singular value is round-off of the largest


def covariance_factor(covariance: Array, what: str) -> Array:
    """Factor a positive semidefinite covariance as L L^T, without repairing one that is not.

    Parameters
    ----------
    covariance : shape (k, k), symmetric; zero or singular is allowed.
    what : name of the quantity, for the message.

    Returns
    -------
    L : shape (k, r), r = rank; lower triangular when the covariance is positive definite.

    Raises
    ------
    InputError
        If the matrix is not symmetric or has a negative eigenvalue beyond round-off; names the eigenvalue.

    Notes
    -----
    The correlation matrix is factored, not the covariance: units that differ by 1e12 then cost nothing.
    """
    size = covariance.shape[0]
    variances = np.diag(covariance)
    if (variances < 0.0).any():
        raise InputError(f"{what}: covariance has a negative variance ({variances.min():.6g})")
    sigma = np.sqrt(variances)
    if size and np.count_nonzero(covariance) == size == np.count_nonzero(variances) and np.isfinite(sigma).all():
        return np.diag(sigma)  # independent components, and the commonest case
    unit = np.where(sigma > 0.0, sigma, 1.0)
    correlation = covariance / unit[:, None] / unit[None, :]
    if np.abs(correlation - correlation.T).max(initial=0.0) > 1e-9:
        raise InputError(f"{what}: covariance is not symmetric")
    correlation = 0.5 * (correlation + correlation.T)
    try:
        factor: Array = np.asarray(np.linalg.cholesky(correlation), dtype=np.float64)
        # A singular matrix may pass by its round-off, in one unit and not in another.
        regular = bool((np.diag(factor) ** 2 > 4.0 * EPS * size).all())
    except np.linalg.LinAlgError:
        regular = False
    if not regular:
        values, vectors = np.linalg.eigh(correlation)
        if values[0] < -1e-12 * size:
            smallest = np.linalg.eigvalsh(0.5 * (covariance + covariance.T))[0]
            raise InputError(
                f"{what}: covariance is not positive definite (smallest eigenvalue {smallest:.6g}, "
                f"of the correlation matrix {values[0]:.6g}); give one that is, it is never repaired"
            )
        kept = values > 1e-14 * size
        factor = vectors[:, kept] * np.sqrt(values[kept])
    return unit[:, None] * factor


def lower_factor(wide: Array) -> Array:
    """Return the square lower triangular L (k, k) with L L^T = wide wide^T, for wide (k, m) of any m."""
    size = wide.shape[0]
    upper: Array = np.asarray(np.linalg.qr(wide.T, mode="r"))
    factor = np.zeros((size, size))
    factor[:, : upper.shape[0]] = upper.T
    sign = np.where(np.diag(factor) < 0.0, -1.0, 1.0)
    return factor * sign


def gram_factor(gram: Array) -> Array:
    """Factor a Gram matrix (k, k) that is semidefinite by construction; round-off below zero is cut."""
    if not gram.size:
        return gram
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    kept = values > 4.0 * EPS * max(values[-1], 0.0)
    factor: Array = vectors[:, kept] * np.sqrt(values[kept])
    return factor


def append_rows(triangle: Array, rows: Array, chunk: int = 256) -> Array:
    """Reduce [triangle; rows] (., w) to upper trapezoidal form by Householder QR, a chunk at a time.

    The memory beyond the rows is a few chunks, and time is linear in the number of rows. LAPACK wakes all threads for
    more than about 500 rows, which costs twenty times the work itself on a busy machine.
    """
    width = rows.shape[1]
    chunk = max(chunk, 4 * width)  # the triangle is taken along each time
    whole = len(rows) // chunk if len(rows) >= 2 * chunk else 0
    for first in range(0, whole, STACKED):  # a triangle of each chunk in one call, then one of these
        part = rows[first * chunk : min(first + STACKED, whole) * chunk].reshape(-1, chunk, width)
        triangle = append_rows(triangle, np.asarray(np.linalg.qr(part, mode="r")).reshape(-1, width), chunk)
    for start in range(whole * chunk, len(rows), chunk):
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows[start : start + chunk]]), mode="r"))
    return triangle


def products(left: npt.NDArray[N], right: npt.NDArray[N]) -> npt.NDArray[N]:
    """left^T right for matrices (m, a) and (m, b), some columns at a time, or of tall ones some rows.

    A library of linear algebra wakes all threads for a large product, which costs twenty times the work itself on a
    busy machine. Complex ones wake them sooner: they are taken as products of real and imaginary parts side by side.
    """
    if np.iscomplexobj(left) or np.iscomplexobj(right):
        a, b = left.shape[1], right.shape[1]
        parts = products(np.hstack([left.real, left.imag]), np.hstack([right.real, right.imag]))
        return np.asarray(parts[:a, :b] - parts[a:, b:] + 1j * (parts[:a, b:] + parts[a:, :b]))
    columns = SMALL // max(left.size, 1)
    if columns >= LEAST_COLUMNS:
        some = range(0, right.shape[1], columns)
        return np.hstack([left.T @ right[:, first : first + columns] for first in some] or [left.T @ right])
    rows = max(SMALL // max(left.shape[1] * right.shape[1], 1), 1)
    out = left[:rows].T @ right[:rows]
    for start in range(rows, len(left), rows):
        out += left[start : start + rows].T @ right[start : start + rows]
    return out


def solve_upper(R: Array, right: Array) -> Array:
    """Solve R x = right for upper triangular R (s, s).

    LU of an upper triangle never exchanges rows, so this is back-substitution; scipy's triangular solver costs
    1.1 ms a call for matrices this small (it wakes all threads), this 10 us.
    """
    return np.asarray(np.linalg.solve(R, right), dtype=np.float64)


def solve_lower(L: Array, right: Array) -> Array:
    """Solve L x = right for lower triangular L (s, s), reversed into an upper triangle."""
    return solve_upper(L[::-1, ::-1], right[::-1])[::-1]


def solve_square(matrix: Array, right: Array) -> Array:
    """Solve matrix x = right for a small regular matrix (s, s) or a stack (n, s, s); LinAlgError when it is singular.

    The pivots of LU depend on the units of rows and columns, so both are brought to a common size first, by powers of
    two, which round nothing.
    """
    down, across = np.ones(matrix.shape[:-1]), np.ones(matrix.shape[:-1])
    balanced = matrix
    for _ in range(3):
        # halfway towards a largest element of 1 in every row and column (Ruiz 2001)
        size = np.abs(balanced)
        rows, columns = size.max(axis=-1, initial=0.0), size.max(axis=-2, initial=0.0)
        if rows.size and max(rows.max(), columns.max()) <= ALIKE * min(rows.min(), columns.min()):
            break
        down, across = down * _half_power(rows), across * _half_power(columns)
        balanced = down[..., :, None] * matrix * across[..., None, :]
    vector = right.ndim == matrix.ndim - 1
    sides = right[..., None] if vector else right
    found = across[..., None] * np.linalg.solve(balanced, down[..., None] * sides)
    return np.asarray(found[..., 0] if vector else found, dtype=np.float64)


def solve_positive(P: Array, right: Array) -> Array:
    """Solve P x = right (s, w) for a regular covariance (s, s), or a stack of them, whatever the units.

    Rows in units of their sigma are all that the choice of pivots needs; columns do not enter it.
    """
    sigma = np.sqrt(np.abs(P.diagonal(0, -2, -1)))[..., None]  # one that has lost its digits is the caller's
    unit = sigma if sigma.all() else np.where(sigma > 0.0, sigma, 1.0)
    return np.asarray(np.linalg.solve(P / unit, right / unit), dtype=np.float64)


def _half_power(size: Array) -> Array:
    """The power of two nearest to 1 / sqrt(size); 1 for nothing."""
    power: Array = np.exp2(np.rint(-0.5 * np.log2(np.where(size > 0.0, size, 1.0))))
    return power


def row_units(factor: Array) -> Array:
    """Lengths (k,) of the rows of a covariance factor (k, r), the sigmas; 1 where there is no error."""
    sigma = np.linalg.norm(factor, axis=1)
    return np.where(sigma > 0.0, sigma, 1.0)


def left_inverse(factor: Array) -> Array:
    """Pseudo-inverse (r, k) of a covariance factor (k, r), its rows scaled to unit length first.

    Without that the cut-off would drop the parameters whose unit makes them small.
    """
    unit = row_units(factor)
    inverse: Array = np.linalg.pinv(factor / unit[:, None], rcond=100 * EPS) / unit
    return inverse


def whiten(factor: Array, offset: Array) -> Array:
    """The shortest draw eta (r,) or (r, w) with factor eta = offset, for a covariance factor (k, r) of any rank."""
    unit = row_units(factor)
    scaled = (offset.T / unit).T
    return np.asarray(np.linalg.lstsq(factor / unit[:, None], scaled, rcond=100 * EPS)[0], dtype=np.float64)


def solve_covariance(P: Array, right: Array) -> Array:
    """Solve P x = right for a covariance (k, k) of any rank, in units of its sigmas; the shortest solution there."""
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    found = np.linalg.lstsq(P / unit[:, None] / unit, (right.T / unit).T, rcond=100 * EPS)[0]
    return np.asarray((found.T / unit).T, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditioning:
    """How well a triangle R (s, s) determines its unknowns, after scaling its columns to unit length.

    `direction` (s,) is the worst determined combination in the units of the unknowns, scaled columns removed.
    """

    number: float
    rank: int
    direction: Array

    @property
    def observable(self) -> bool:
        """Whether the smallest singular value is more than round-off."""
        return self.number <= OBSERVABLE_CONDITION


def conditioning(R: Array) -> Conditioning:
    """Measure the column-scaled condition number, rank and weakest direction of a triangle."""
    if not R.size:  # priors hold everything exactly: nothing is left to determine
        return Conditioning(number=1.0, rank=0, direction=np.zeros(0))
    lengths = np.linalg.norm(R, axis=0)
    unit = np.where(lengths > 0.0, lengths, 1.0)
    _, values, vectors = np.linalg.svd(R / unit)
    rank = int((values > values[0] / OBSERVABLE_CONDITION).sum()) if values[0] > 0.0 else 0
    number = float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf
    return Conditioning(number=number, rank=rank, direction=vectors[-1] / unit)


def cholesky_rows(stack: Array, what: str) -> Array:
    """Lower Cholesky factors of a stack (n, p, p), vectorised over n because p is small.

    Raises
    ------
    InputError
        If one is not positive definite; names its index and smallest eigenvalue.
    """
    size = stack.shape[1]
    L = np.zeros(stack.shape)
    for j in range(size):
        pivot = stack[:, j, j] - np.einsum("nk,nk->n", L[:, j, :j], L[:, j, :j])
        bad = ~(pivot > 4.0 * EPS * stack[:, j, j])
        if bad.any():
            index = int(np.argmax(bad))
            smallest = np.linalg.eigvalsh(stack[index])[0]
            raise InputError(
                f"{what}: covariance of measurement {index} is not positive definite "
                f"(smallest eigenvalue {smallest:.6g})"
            )
        L[:, j, j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            L[:, i, j] = (stack[:, i, j] - np.einsum("nk,nk->n", L[:, i, :j], L[:, j, :j])) / L[:, j, j]
    return L


def root_rows(stack: Array) -> Array:
    """Square factors C (n, k, k), C C^T = each covariance of a stack; singular ones are allowed."""
    sigma = np.sqrt(np.maximum(np.einsum("nkk->nk", stack), 0.0))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    correlation = stack / unit[:, :, None] / unit[:, None, :]
    values, vectors = np.linalg.eigh(0.5 * (correlation + correlation.transpose(0, 2, 1)))
    return np.ascontiguousarray(unit[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def solve_rows(L: Array, rows: Array) -> None:
    """Replace rows (n, p, w) by L^-1 rows in place, for a stack of lower triangles (n, p, p)."""
    for i in range(L.shape[1]):
        for j in range(i):
            rows[:, i] -= L[:, i, j, None] * rows[:, j]
        rows[:, i] /= L[:, i, i, None]


def solve_rows_transposed(L: Array, rows: Array) -> None:
    """Replace rows (n, p, w) by L^-T rows in place, for a stack of lower triangles (n, p, p)."""
    for i in range(L.shape[1] - 1, -1, -1):
        for j in range(i + 1, L.shape[1]):
            rows[:, i] -= L[:, j, i, None] * rows[:, j]
        rows[:, i] /= L[:, i, i, None]


def multiply_rows(stack: Array, rows: Array) -> Array:
    """Return stack (n or 1, a, p) times rows (n, p, w), vectorised over n because a and p are small."""
    out = np.zeros((rows.shape[0], stack.shape[1], rows.shape[2]))
    for i in range(stack.shape[1]):
        for j in range(stack.shape[2]):
            factor = stack[:, i, j, None]
            if len(stack) > 1 or factor[0, 0] != 0.0:  # one diagonal covariance for all is the common case
                out[:, i] += factor * rows[:, j]
    return out
