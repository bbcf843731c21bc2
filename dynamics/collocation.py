"""Tables of 8-stage Gauss-Legendre collocation (order 16) for second-order equations.

Stage accelerations a_j at the nodes c_j h define one polynomial a(s). Its first and second integrals give velocity and
position at the nodes: V_i = v + h sum_j A_ij a_j, X_i = x + h c_i v + h^2 sum_j (A A)_ij a_j (Hairer, Lubich, Wanner,
Geometric Numerical Integration, II.1 and II.2). Everything is built from shifted Legendre polynomials, in which the
integrals are three-term and lose no digits; tests compare with 40-digit arithmetic.
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
STAGES = 8


def _legendre(x: Array, count: int) -> Array:
    """P_0 .. P_(count-1) at x in [-1, 1], shape (count, len(x))."""
    values = [np.ones_like(x), x]
    for k in range(1, count - 1):
        values.append(((2 * k + 1) * x * values[k] - k * values[k - 1]) / (k + 1))
    return np.array(values[:count])


def _first_integrals(x: Array) -> Array:
    """Integrals of P_k(2s - 1) from 0 to (x + 1)/2 for k < STAGES, shape (STAGES, len(x))."""
    P = _legendre(x, STAGES + 1)
    rows = [(P[1] + P[0]) / 2]
    rows += [(P[k + 1] - P[k - 1]) / (2 * (2 * k + 1)) for k in range(1, STAGES)]
    return np.array(rows)


_x, _w = np.polynomial.legendre.leggauss(STAGES)
NODES: Array = (1.0 + _x) / 2.0
WEIGHTS: Array = _w / 2.0
# nodal values -> coefficients of P_k(2s - 1): row k
TO_LEGENDRE: Array = np.array([(2 * k + 1) * WEIGHTS * row for k, row in enumerate(_legendre(_x, STAGES))])
A: Array = _first_integrals(_x).T @ TO_LEGENDRE
AA: Array = A @ A
POSITION_WEIGHTS: Array = WEIGHTS @ A
STEP_WEIGHTS: Array = np.concatenate([WEIGHTS, POSITION_WEIGHTS])  # over a whole step: of the velocity, the position
# transposed and flat, [j * 8 + i]: the order in which the kernels run
A_FLAT: Array = np.ascontiguousarray(A.T).ravel()
AA_FLAT: Array = np.ascontiguousarray(AA.T).ravel()
LAST_ROW: Array = np.ascontiguousarray(TO_LEGENDRE[STAGES - 1])
TO_LEGENDRE_FLAT: Array = np.ascontiguousarray(TO_LEGENDRE).ravel()
BARYCENTRIC: Array = np.array([1.0 / np.prod([NODES[j] - NODES[k] for k in range(STAGES) if k != j]) for j in range(8)])


def _derivatives() -> Array:
    """D[i, j] = derivative of Lagrange polynomial j at node i (Berrut and Trefethen 2004, eq. 9.4); rows sum to 0."""
    gaps = NODES[:, None] - NODES + np.eye(STAGES)
    D: Array = BARYCENTRIC / BARYCENTRIC[:, None] / gaps
    np.fill_diagonal(D, 0.0)
    np.fill_diagonal(D, -D.sum(axis=1))
    return D


DERIVATIVES_FLAT: Array = np.ascontiguousarray(_derivatives().T).ravel()
