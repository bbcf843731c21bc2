"""What the measurements say about a nuisance itself: its estimate and covariance at each measurement, in O(n).

The nuisances are not unknowns of the solution; here they are brought back from it. With x the common parameters,
z = z(v) - z(H) x, where z(.) is the conditional mean of the nuisance for a column taken as residual.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem, Markov, White
from nebosvod.estimation.problem.square_root import solve_covariance, solve_positive, solve_rows
from nebosvod.estimation.problem.whitening import Whitener, raw_rows

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NuisanceEstimate:
    """A nuisance after the measurements (assumed model), row by row of its `rows`.

    Attributes
    ----------
    mean : shape (n_r, q).
    covariance : shape (n_r, q, q).
    cross : shape (n_r, s, q), covariance with the estimated common parameters.
    """

    mean: Array
    covariance: Array
    cross: Array


def refine(problem: LinearProblem, estimate: Estimate, name: str) -> NuisanceEstimate:
    """Estimate a white or time-correlated nuisance that was treated as `estimated`.

    Parameters
    ----------
    estimate : the batch (or last recursive) estimate of this problem.

    Raises
    ------
    InputError
        If there is no such nuisance, it is not estimated, or shares a measurement with a time-correlated one.

    Notes
    -----
    z = z(v) - z(H) (x - xbar): v is the residual after the assumed means xbar, so the estimate counts from there too.

    References
    ----------
    Guo, Ivashkin 2018, section 2.2: K_z = (iQ + H_z^T iR H_z)^-1 + g K g^T, K_xz = -K g^T; the time-correlated
    case by a Rauch-Tung-Striebel pass of the nuisance's own small filter.
    """
    groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    found = [group for group in groups if group.name == name and group.treatment == "estimated"]
    if not found:
        raise InputError(f"refine: no estimated nuisance {name!r}")
    nuisance = found[0]
    for other in problem.markov:
        if other.name != name and other.treatment == "estimated" and np.intersect1d(other.rows, nuisance.rows).size:
            raise InputError(f"refine: {name!r} shares measurements with {other.name!r}; join the two into one")
    partition = Partition.of(problem)
    raw = raw_rows(problem, partition)[nuisance.rows]
    size = len(partition.estimated)
    columns = np.ascontiguousarray(raw[:, :, : size + 1])
    L = _rest_factor(problem, nuisance)
    P, answer = _white(nuisance, L, columns) if isinstance(nuisance, White) else _markov(nuisance, L, columns)
    g = answer[:, :, :size]
    cross = -np.einsum("st,nqt->nsq", estimate.K_formal, g)
    return NuisanceEstimate(
        mean=answer[:, :, size] - g @ (estimate.mean - partition.mean),
        covariance=P - np.einsum("nqs,nsr->nqr", g, cross),
        cross=cross,
    )


def _rest_factor(problem: LinearProblem, nuisance: White | Markov) -> Array:
    """Factors (n_r, p, p) of the noise of the touched rows; a white nuisance's own covariance included."""
    whole = Whitener.of(problem).L
    L = np.broadcast_to(whole, (problem.n, problem.p, problem.p))[nuisance.rows]
    return np.ascontiguousarray(L)


def _white(white: White, L: Array, columns: Array) -> tuple[Array, Array]:
    """Covariance given x, Q - Q H^T iRz H Q, and the conditional mean Q H^T iRz of each column."""
    Q = np.broadcast_to(white.Q, (len(white.rows), *white.Q.shape[1:]))
    half = np.einsum("npq,nqr->npr", white.H, Q)
    solve_rows(L, half)
    whitened = columns.copy()
    solve_rows(L, whitened)
    return Q - np.einsum("npq,npr->nqr", half, half), np.einsum("npq,npw->nqw", half, whitened)


def _markov(markov: Markov, L: Array, columns: Array) -> tuple[Array, Array]:
    """Smoothed covariance given x and the smoothed mean of each column."""
    n, q = len(markov.rows), markov.P0.shape[0]
    whitened, H = columns.copy(), np.array(markov.H)
    solve_rows(L, whitened)
    solve_rows(L, H)
    mean, P = np.zeros((n, q, columns.shape[2])), np.zeros((n, q, q))
    ahead_mean, ahead_P = np.zeros_like(mean), np.zeros_like(P)
    for k in range(n):
        F, Q = markov.F[k], markov.Q[k]
        ahead_mean[k] = F @ mean[k - 1] if k else 0.0
        ahead_P[k] = F @ P[k - 1] @ F.T + Q if k else markov.P0
        V = H[k] @ ahead_P[k] @ H[k].T + np.eye(H.shape[1])
        gain = solve_positive(V, H[k] @ ahead_P[k]).T
        keep = np.eye(q) - gain @ H[k]
        mean[k] = ahead_mean[k] + gain @ (whitened[k] - H[k] @ ahead_mean[k])
        P[k] = keep @ ahead_P[k] @ keep.T + gain @ gain.T
    for k in range(n - 2, -1, -1):
        J = solve_covariance(ahead_P[k + 1], markov.F[k + 1] @ P[k]).T
        mean[k] += J @ (mean[k + 1] - ahead_mean[k + 1])
        keep = np.eye(q) - J @ markov.F[k + 1]
        P[k] = keep @ P[k] @ keep.T + J @ (markov.Q[k + 1] + P[k + 1]) @ J.T
    return P, mean
