"""Where a Kalman filter of a system that does not change ends: the steady covariance and gain, and maps of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.estimation.filters.kalman import Belief, update
from nebosvod.estimation.problem.square_root import gram_factor, solve_positive, solve_square

Array = npt.NDArray[np.float64]
Model = tuple[Array, Array, Array, Array]  # F, Q, H, R
CLOSE = 1e-13  # of the product of two sigmas: change of a covariance that ends the doubling
LONGEST = 60  # doublings: 1e18 measurements


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steady:
    """Steady covariances (s, s) before and after a measurement, and the gain (s, p)."""

    predicted: Array
    filtered: Array
    gain: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations (s,) after a measurement."""
        return np.asarray(np.sqrt(np.diag(self.filtered)), dtype=np.float64)


def steady_state(F: Array, Q: Array, H: Array, R: Array) -> Steady:
    """Solve the Riccati equation of a filter: P = F P F^T - F P H^T (H P H^T + R)^-1 H P F^T + Q.

    Parameters
    ----------
    F, Q : shape (s, s). H : shape (p, s). R : shape (p, p), positive definite.

    Raises
    ------
    GeometryError
        If there is no steady state: a mode that grows is not seen, or one that keeps is not disturbed, so that its
        sigma falls without end.

    Notes
    -----
    By doubling: the k-th step has the covariance after 2^k measurements that began with exact knowledge.

    References
    ----------
    Anderson, Moore 1979, Optimal Filtering, section 6.7; Platonov, Ivanov 2013, p. 200.
    """
    A, G = np.asarray(F, dtype=np.float64).T, H.T @ solve_positive(R, H)
    P = np.asarray(Q, dtype=np.float64)
    for _ in range(LONGEST):
        W = np.eye(len(P)) + G @ P
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                right = solve_square(W, np.hstack([A, G]))
                new = P + A.T @ P @ right[:, : len(P)]
                A, G = A @ right[:, : len(P)], G + A @ right[:, len(P) :] @ A.T
        except np.linalg.LinAlgError:
            break
        new, G = 0.5 * (new + new.T), 0.5 * (G + G.T)
        if not (np.isfinite(new).all() and np.isfinite(A).all() and np.isfinite(G).all()):
            break
        sigma = np.sqrt(np.abs(np.diag(new)))
        if (np.abs(new - P) <= CLOSE * np.outer(sigma, sigma)).all() and np.abs(np.linalg.eigvals(A)).max() < 0.5:
            return _with_gain(new, H, R)  # A is what is left of an error after 2^k measurements
        P = new
    raise GeometryError("steady_state: there is none: some mode is not seen, or never disturbed, and does not fade")


def _with_gain(P: Array, H: Array, R: Array) -> Steady:
    unit = np.sqrt(np.diag(P))
    unit = np.where(unit > 0.0, unit, 1.0)
    factor = unit[:, None] * gram_factor(P / unit[:, None] / unit)
    after, innovation = update(Belief(mean=np.zeros(len(P)), factor=factor), np.zeros(len(H)), H, R)
    return Steady(predicted=P, filtered=after.covariance, gain=innovation.gain)


def steady_map(
    model: Callable[[float, float], Model], first: npt.ArrayLike, second: npt.ArrayLike, W: npt.ArrayLike
) -> Array:
    """Steady sigma of w = W x (d, s) over two design parameters: shape (a, b, d), after a measurement.

    Parameters
    ----------
    model : takes a value of each parameter, returns F, Q, H, R.
    first, second : shapes (a,) and (b,), values of the parameters.

    Notes
    -----
    nan where there is no steady state.

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, p. 200.
    """
    rows, columns, by = (np.asarray(value, dtype=np.float64) for value in (first, second, np.atleast_2d(W)))
    found = np.full((len(rows), len(columns), len(by)), np.nan)
    for i, one in enumerate(rows):
        for j, other in enumerate(columns):
            try:
                P = steady_state(*model(float(one), float(other))).filtered
            except GeometryError:
                continue
            found[i, j] = np.sqrt(np.einsum("ds,st,dt->d", by, P, by))
    return found
