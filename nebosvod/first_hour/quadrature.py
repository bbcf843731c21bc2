"""Gaussian quadrature of weighed times: a few nodes that sum polynomials as all the times do."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BEYOND = 0.05  # of half the span, by which a node may lie outside of it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quadrature:
    """K nodes for r weighed times.

    Attributes
    ----------
    t_s, weight : (K,) of the nodes; sum of weight g(t_s) is that over all times for polynomials g of a degree up to
        2K - 2.
    onto : (K, r) from values at the times to those of the nearest polynomial of degree K - 1 at the nodes.
    back : (r, K) from values at the nodes to those of that polynomial at the times.
    """

    t_s: Array
    weight: Array
    onto: Array
    back: Array

    @classmethod
    def of(cls, t_s: Array, weight: Array, count: int, at_s: float | None = None) -> "Quadrature | None":
        """The nodes; None where one lies outside of the times.

        Parameters
        ----------
        t_s, weight : (r,), of more than `count` different times.
        at_s : where one of the nodes has to be.

        References
        ----------
        Golub and Welsch 1969, Math. Comp. 23, 221; Golub 1973, SIAM Review 15, 318.
        """
        middle, half = 0.5 * (t_s.min() + t_s.max()), 0.5 * float(np.ptp(t_s))
        s = (t_s - middle) / half
        alpha, beta, P = _recurrence(s, weight, count)
        off = beta[1:count]
        if at_s is not None:
            at = (at_s - middle) / half
            J = np.diag(alpha[:-1] - at) + np.diag(off[:-1], 1) + np.diag(off[:-1], -1)
            right = np.zeros(count - 1)
            right[-1] = off[-1] ** 2
            alpha = np.append(alpha[:-1], at + np.linalg.lstsq(J, right, rcond=None)[0][-1])
        node, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(off, 1) + np.diag(off, -1))
        if np.abs(node).max() > 1.0 + BEYOND:
            return None
        if at_s is not None:
            node[np.argmin(np.abs(node - at))] = at
        of_node = weight.sum() * vectors[0] ** 2
        Q = _basis(node, alpha, beta, count)
        return cls(
            t_s=middle + half * node,
            weight=of_node,
            onto=Q @ (P * weight[:, None]).T,
            back=P @ (Q * of_node[:, None]).T,
        )


def _recurrence(s: Array, weight: Array, count: int) -> tuple[Array, Array, Array]:
    """Coefficients alpha, beta (count,) of the orthonormal polynomials, and their values P (r, count): Stieltjes."""
    alpha, beta, P = np.empty(count), np.empty(count), np.empty((len(s), count))
    beta[0] = np.sqrt(weight.sum())
    P[:, 0] = 1.0 / beta[0]
    for j in range(count):
        alpha[j] = weight @ (s * P[:, j] ** 2)
        if j + 1 == count:
            break
        onward = (s - alpha[j]) * P[:, j] - (beta[j] * P[:, j - 1] if j else 0.0)
        onward -= P[:, : j + 1] @ (P[:, : j + 1].T @ (weight * onward))  # rounding leaves some of the earlier ones
        beta[j + 1] = np.sqrt(weight @ onward**2)
        P[:, j + 1] = onward / beta[j + 1]
    return alpha, beta, P


def _basis(s: Array, alpha: Array, beta: Array, count: int) -> Array:
    """Values (len(s), count) of the orthonormal polynomials; the last alpha is not needed."""
    P = np.empty((len(s), count))
    P[:, 0] = 1.0 / beta[0]
    for j in range(count - 1):
        before = beta[j] * P[:, j - 1] if j else 0.0
        P[:, j + 1] = ((s - alpha[j]) * P[:, j] - before) / beta[j + 1]
    return P
