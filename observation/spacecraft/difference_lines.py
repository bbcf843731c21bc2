"""Modified difference arrays, the orbits in SPK files of types 1 and 21 (what JPL's Horizons sends)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array
from nebosvod.observation.spacecraft.tabulated import check_sizes

LARGEST_TABLE = 25  # rows of one difference table (NAIF, spk21.inc)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DifferenceLines:
    """One segment: records of a variable-order multistep integration, each good up to its own end.

    Parameters
    ----------
    records : shape (k, 4 m + 11), of each: reference time; m step sizes; position and velocity at it, interleaved;
        three tables of m differences; highest order plus one, and the order of each axis. km, s.
    end_of_record_s : shape (k,), ascending, seconds after the table's epoch.
    start_s, end_s : the usable span.

    Raises
    ------
    InputError
        If shapes differ, a number is not finite, times do not ascend, or an order does not fit the tables.

    References
    ----------
    NAIF, SPK Required Reading, data types 1 and 21; F. T. Krogh, "Changing step size in the integration of
    differential equations using modified divided differences", Lecture Notes in Mathematics 362 (1974).
    """

    records: Array
    end_of_record_s: Array
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        rows, width = self.records.shape
        size = (width - 11) // 4
        if (
            rows < 1
            or self.end_of_record_s.shape != (rows,)
            or not 2 <= size <= LARGEST_TABLE
            or width != 4 * size + 11
        ):
            raise InputError(f"difference lines: shapes {self.records.shape}, {self.end_of_record_s.shape} do not fit")
        if not (np.all(np.isfinite(self.records)) and np.all(np.isfinite(self.end_of_record_s))):
            raise InputError("difference lines: a number is not finite")
        check_sizes(self.end_of_record_s, self.records, (self.start_s, self.end_s))
        if not np.all(np.diff(self.end_of_record_s) > 0.0):
            raise InputError("difference lines: times must ascend strictly")
        highest, orders = self.records[:, -4], self.records[:, -3:]
        used = np.arange(size) < highest[:, None] - 2.0
        if np.any((highest < 2) | (highest > size + 1)) or np.any((orders < 0) | (orders >= highest[:, None])):
            raise InputError(f"difference lines: orders outside of 2 to {size + 1}")
        if np.any(used & (self.records[:, 1 : 1 + size] == 0.0)):
            raise InputError("difference lines: a step size is zero")

    def evaluate(self, t_s: Array) -> Array:
        """States (n, 6) at times inside the span, each from the first record that ends at it or later."""
        which = np.minimum(np.searchsorted(self.end_of_record_s, t_s), self.end_of_record_s.size - 1)
        found = np.empty((t_s.size, 6))
        for number in np.unique(which):
            mine = which == number
            found[mine] = _states(self.records[number], t_s[mine])
        return found


def _states(record: Array, t_s: Array) -> Array:
    """States (n, 6) by one record.

    Notes
    -----
    r = r0 + d (v0 + d sum_j D_j w_j), v = v0 + d sum_j D_j w'_j with d = t - t0: integrals of Newton's form of the
    acceleration. The weights w follow from 1/j by the recursion w_j <- f_j w_(j of the row before) - c_j w_j.
    """
    size = (record.size - 11) // 4
    step, reference = record[1 : 1 + size], record[1 + size : 7 + size].reshape(3, 2)
    differences = record[7 + size : 7 + 4 * size].reshape(3, size)
    highest, orders = int(record[-4]), record[-3:].astype(np.int64)
    d = t_s - record[0]
    f, c, reach = [np.ones_like(d)], [], d
    for j in range(highest - 2):
        f.append(reach / step[j])
        c.append(d / step[j])
        reach = d + step[j]
    weights = [np.full_like(d, 1.0 / j) for j in range(1, highest + 1)]
    row, level = 0, highest - 1
    while level >= 2:
        row += 1
        _next_row(weights, f, c, row, level)
        level -= 1
    place = _sums(differences, orders, weights, level)
    _next_row(weights, f, c, row, level)
    rate = _sums(differences, orders, weights, level - 1)
    r0, v0 = reference[:, 0], reference[:, 1]
    d = d[:, None]
    return np.concatenate([r0 + d * (v0 + d * place), v0 + d * rate], axis=1)


def _next_row(weights: list[Array], f: list[Array], c: list[Array], count: int, level: int) -> None:
    """The weights of one integration less, in place, from `level` on."""
    for j in range(count):
        weights[j + level] = f[j + 1] * weights[j + level - 1] - c[j] * weights[j + level]


def _sums(differences: Array, orders: npt.NDArray[np.int64], weights: list[Array], level: int) -> Array:
    """Sum over the differences of each axis, (n, 3); the smallest, of highest order, first."""
    sums = np.zeros((weights[0].size, 3))
    for axis in range(3):
        for j in range(int(orders[axis]) - 1, -1, -1):
            sums[:, axis] += differences[axis, j] * weights[j + level]
    return sums
