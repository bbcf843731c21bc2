"""A polynomial of several variables through many points: a cloud's own map from its states to what they lead to."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from math import comb

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.problem.square_root import solve_upper

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
SINGULAR = 1e-11  # of the largest: a smaller diagonal of the triangle determines nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polynomial:
    """values = sum of coefficients times products of up to `degree` of the scaled variables (u - centre) / spread.

    Attributes
    ----------
    centre, spread : (r,) of the variables. coefficients : (terms, m).
    """

    degree: int
    centre: Array
    spread: Array
    coefficients: Array

    @staticmethod
    def terms(size: int, degree: int) -> int:
        """How many coefficients a value has."""
        return comb(size + degree, degree)

    @classmethod
    def through(cls, u: Array, values: Array, degree: int) -> "Polynomial":
        """Least squares through points u (n, r) with values (n, m)."""
        centre, spread = u.mean(axis=0), u.std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        products = _products((u - centre) / spread, degree)
        coefficients = _least_squares(products, values)
        return cls(degree=degree, centre=centre, spread=spread, coefficients=coefficients)

    def __call__(self, u: Array) -> Array:
        """Values (k, m) at points (k, r)."""
        values: Array = _products((u - self.centre) / self.spread, self.degree) @ self.coefficients
        return values

    def gradient(self, u: Array) -> Array:
        """Partials (k, m, r) at points (k, r)."""
        x = (u - self.centre) / self.spread
        found = np.empty((len(u), self.coefficients.shape[1], u.shape[1]))
        for k in range(u.shape[1]):
            found[:, :, k] = _derivatives(x, self.degree, k) @ self.coefficients / self.spread[k]
        return found


def _least_squares(products: Array, values: Array) -> Array:
    """Coefficients (terms, m), by QR where they are determined: ten times faster than the singular values of lstsq."""
    q, r = np.linalg.qr(products)
    size = np.abs(np.diag(r))
    if len(r) < products.shape[1] or size.min() <= SINGULAR * size.max():
        return np.asarray(np.linalg.lstsq(products, values)[0], dtype=np.float64)
    return solve_upper(r, q.T @ values)


@lru_cache(maxsize=16)
def _exponents(size: int, degree: int) -> Rows:
    """Powers (terms, size) of each product."""
    rows = [
        np.bincount(np.array(chosen, dtype=np.int64), minlength=size)
        for total in range(degree + 1)
        for chosen in combinations_with_replacement(range(size), total)
    ]
    return np.array(rows, dtype=np.int64)


def _powers(x: Array, degree: int) -> Array:
    """x to the powers 0 to degree, shape (degree + 1, n, r)."""
    found = np.ones((degree + 1, *x.shape))
    for k in range(1, degree + 1):
        found[k] = found[k - 1] * x
    return found


@lru_cache(maxsize=16)
def _growth(size: int, degree: int) -> tuple[tuple[int, int], ...]:
    """Of each product after the first: an earlier one, and the variable that it is multiplied with."""
    chosen = [c for total in range(degree + 1) for c in combinations_with_replacement(range(size), total)]
    place = {c: k for k, c in enumerate(chosen)}
    return tuple((place[c[:-1]], c[-1]) for c in chosen[1:])


def _products(x: Array, degree: int) -> Array:
    """All products (n, terms)."""
    growth = _growth(x.shape[1], degree)
    found, columns = np.empty((len(growth) + 1, len(x))), np.ascontiguousarray(x.T)
    found[0] = 1.0
    for k, (earlier, variable) in enumerate(growth, start=1):
        np.multiply(found[earlier], columns[variable], out=found[k])
    return found.T


def _derivatives(x: Array, degree: int, by: int) -> Array:
    """Partials (n, terms) of all products by one variable."""
    powers, exponents = _powers(x, degree), _exponents(x.shape[1], degree)
    found = np.broadcast_to(exponents[:, by], (len(x), len(exponents))).astype(np.float64)
    for k in range(x.shape[1]):
        power = np.maximum(exponents[:, k] - (k == by), 0)
        found *= powers[power, :, k].T
    return found
