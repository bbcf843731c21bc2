"""Pairs of measurements to a triangle in one compiled pass: whitened, and reduced by Householder reflections.

What `whitening` and `square_root.append_rows` do for any problem, for the commonest one: two measurements at a time,
with a noise of their own and no nuisances. A reflection that folds rows into a triangle touches one row of it.
"""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import FASTMATH, compiled_when_called

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
PART = 512  # rows at a time, a column after another: with seven columns they fill a first-level cache


def reduced(H: Array, residual: Array, whitener: Array, chosen: Flags, start: Array) -> tuple[Array, float]:
    """Fold the chosen measurements into a triangle.

    Parameters
    ----------
    H : shape (n, 2, s), partials. residual : shape (n, 2).
    whitener : shape (n, 2, 2), lower triangular, of the noise of each pair.
    chosen : shape (n,), which pairs count.
    start : shape (k, s + 1), upper trapezoidal rows [R | z] known before, k up to s + 1.

    Returns
    -------
    triangle : shape (s + 1, s + 1), upper triangular, with triangle^T triangle = start^T start + rows^T rows for the
        whitened rows [H | residual]. cost : sum of the squared whitened residuals.

    References
    ----------
    Golub, Van Loan 2013, Matrix Computations, section 5.1.2 (reflections) and 6.5.4 (appending rows).
    """
    width = H.shape[2] + 1
    triangle = np.zeros((width, width))
    triangle[: len(start)] = start
    cost = _fold(H, residual, whitener, chosen, np.empty((width, PART)), triangle)
    return triangle, cost


def solved(triangle: Array, weakest: float) -> tuple[Array, float]:
    """The solution (s,) of R x = z for a triangle [R | z] (s + 1, s + 1), and |z|.

    Zeros and nan where a diagonal element is not more than `weakest` of the length of its column.
    """
    x = np.empty(len(triangle) - 1)
    return x, _solve(triangle, weakest, x)


def _reordering(function):  # type: ignore[no-untyped-def]
    """Compile with sums in any order, so that they run in the lanes of the processor: no compensated sum is here."""
    return compiled_when_called(function, fastmath=FASTMATH | {"reassoc"})


@_reordering
def _fold(H, residual, whitener, chosen, columns, triangle):  # type: ignore[no-untyped-def]
    """Reduce rows into the triangle, `PART` at a time; `columns` (w, PART) is scratch. Returns the cost."""
    width, room = columns.shape
    cost, count = 0.0, 0
    for e in range(H.shape[0]):
        if chosen[e]:
            a, b, c = whitener[e, 0, 0], whitener[e, 1, 0], whitener[e, 1, 1]
            for k in range(width - 1):
                columns[k, count] = a * H[e, 0, k]
                columns[k, count + 1] = b * H[e, 0, k] + c * H[e, 1, k]
            p, q = a * residual[e, 0], b * residual[e, 0] + c * residual[e, 1]
            columns[width - 1, count], columns[width - 1, count + 1] = p, q
            cost += p * p + q * q
            count += 2
        if count == room:
            _reflect(columns, count, triangle)
            count = 0
    _reflect(columns, count, triangle)
    return cost


@_reordering
def _reflect(columns, count, triangle):  # type: ignore[no-untyped-def]
    """Reflect `count` rows, stored as columns (w, .), into the triangle (w, w); they are used up."""
    width = columns.shape[0]
    for k in range(width):
        pivot = columns[k]
        length = 0.0
        for r in range(count):
            length += pivot[r] * pivot[r]
        if length == 0.0:
            continue
        old = triangle[k, k]
        new = -math.copysign(math.sqrt(old * old + length), old)
        head = old - new
        scale = 2.0 / (head * head + length)
        triangle[k, k] = new
        for j in range(k + 1, width):
            other = columns[j]
            along = head * triangle[k, j]
            for r in range(count):
                along += pivot[r] * other[r]
            along *= scale
            triangle[k, j] -= along * head
            for r in range(count):
                other[r] -= along * pivot[r]


@_reordering
def _solve(triangle, weakest, x):  # type: ignore[no-untyped-def]
    """Back-substitution into x (s,); returns |z|, or nan where a diagonal element is lost."""
    size = x.shape[0]
    right = 0.0
    for k in range(size):
        length = 0.0
        for i in range(k + 1):
            length += triangle[i, k] * triangle[i, k]
        if not abs(triangle[k, k]) > weakest * math.sqrt(length):
            x[:] = 0.0
            return math.nan
        right += triangle[k, size] * triangle[k, size]
    for k in range(size - 1, -1, -1):
        rest = triangle[k, size]
        for j in range(k + 1, size):
            rest -= triangle[k, j] * x[j]
        x[k] = rest / triangle[k, k]
    return math.sqrt(right)
