"""Largest error inside boxes, for measurements of one or two components: a small linear programme.

What the noise and the white nuisances of one measurement can add to it, each inside its box, is a sum of segments: an
interval, or in the plane a zonogon. Its support function is linear between the normals of its edges, so in the dual
programme the multiplier of a measurement is a sum of edge normals, each at the price of its support. As many equations
are left as there are common unknowns, however many measurements there are, and no column for any nuisance.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """The segments whose sum is what the fresh errors of each measurement can add to it.

    Attributes
    ----------
    ends : shape (n, m, p), one half of each segment, p = 1 or 2; unused ones are zero.
    """

    ends: Array

    @classmethod
    def of(cls, parts: list[tuple[npt.NDArray[np.int64], Array]], n: int, p: int) -> "Segments":
        """Gather parts (rows (r,), ends (r, q, p)); a row may occur in several parts, but once in each."""
        width = sum(ends.shape[1] for _, ends in parts)
        found, first = np.zeros((n, width, p)), 0
        for rows, ends in parts:
            found[rows, first : first + ends.shape[1]] = ends
            first += ends.shape[1]
        return cls(ends=found)

    def normals(self) -> Array:
        """Edge normals (n, m, p) over their support, so that each has the price 1; zero where there is no edge."""
        edges = np.ones_like(self.ends)
        if self.ends.shape[2] == 2:
            edges = np.stack([-self.ends[:, :, 1], self.ends[:, :, 0]], axis=2)
        empty = ~self.ends.any(axis=2)
        # no length needed: normal over support does not depend on it
        support = np.abs(edges @ self.ends.transpose(0, 2, 1)).sum(axis=2)
        found: Array = edges / np.where(empty | (support == 0.0), np.inf, support)[:, :, None]
        return found


def largest(common: Array, segments: Segments, boxed: int, level: float, objective: Array) -> Array:
    """Largest value (d,) of objective (d, k) times the common unknowns that leaves no residual.

    Parameters
    ----------
    common : shape (n, p, k), partials of the measurements by the common unknowns, the last `boxed` within `level`.

    Raises
    ------
    GeometryError
        If a quantity is not bounded.
    """
    k = common.shape[2]
    normals = segments.normals()
    used = normals.any(axis=2)
    columns = np.einsum("nmp,npk->nmk", normals, common)[used].T
    boxes = np.eye(k)[:, k - boxed :] / level
    both = np.hstack([columns, boxes])
    unit = np.abs(both).max(axis=1, initial=0.0)
    unit[unit == 0.0] = 1.0
    equations = np.hstack([both, -both]) / unit[:, None]
    worst = np.zeros(len(objective))
    for row, wanted in enumerate(objective / unit):
        size = float(np.abs(wanted).max(initial=0.0))
        if size == 0.0:
            continue
        worst[row] = size * _cheapest(equations, wanted / size)
    return worst


def _cheapest(equations: Array, wanted: Array) -> float:
    """Smallest sum of multipliers >= 0 that meet the equations."""
    from scipy.optimize import linprog  # 0.7 s of import, for this stage alone

    cost = np.ones(equations.shape[1])
    for presolve in (False, True):  # so few equations gain nothing from it; it helps where they depend on each other
        found = linprog(cost, A_eq=equations, b_eq=wanted, method="highs-ds", options={"presolve": presolve})
        if found.status == 0:
            return float(found.fun)
    if found.status == 2:
        raise GeometryError("guaranteed: the quantity is not bounded; the measurements and boxes do not determine it")
    raise GeometryError(f"guaranteed: the linear programme failed: {found.message}")
