"""What the measurements say about a nuisance itself: its estimate and covariance at each measurement, in O(n).

The nuisances are not unknowns of the solution; here they are brought back from it. With x the common parameters,
z = z(v) - z(H) x, where z(.) is the conditional mean of the nuisance for a column taken as residual.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.markov import Chain, joined_with
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem, Markov, White
from nebosvod.estimation.problem.square_root import solve_covariance, solve_positive, solve_rows
from nebosvod.estimation.problem.whitening import Whitener, raw_rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


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
        If there is no such nuisance, or it is not estimated.

    Notes
    -----
    z = z(v) - z(H) (x - xbar): v is the residual after the assumed means xbar, so the estimate counts from there too.

    References
    ----------
    Guo, Ivashkin 2018, section 2.2: K_z = (iQ + H_z^T iR H_z)^-1 + g K g^T, K_xz = -K g^T; the time-correlated
    case by a Rauch-Tung-Striebel pass of the nuisance's own small filter.
    """
    asked, partition = _Asked.of(problem, name), Partition.of(problem)
    size = len(partition.estimated)
    P, answer = asked.conditional(raw_rows(problem, partition)[asked.chain.rows, :, : size + 1])
    g = answer[:, :, :size]
    cross = -np.einsum("st,nqt->nsq", estimate.K_formal, g)
    return NuisanceEstimate(
        mean=answer[:, :, size] - g @ (estimate.mean - partition.mean),
        covariance=P - np.einsum("nqs,nsr->nqr", g, cross),
        cross=cross,
    )


def response(problem: LinearProblem, name: str, gain: Array) -> Array:
    """How each measurement moves the estimate of such a nuisance: k_z (n_r, q, n, p), dense.

    Parameters
    ----------
    gain : (n, p, s) of the common parameters, as `nebosvod.estimation.problem.sources.measurement_gain` gives it.

    Raises
    ------
    InputError
        As `refine`.

    Notes
    -----
    z = z(v) - z(H) x: a measurement moves z by itself, where it is one of the nuisance's own rows (or near one, where
    it is correlated in time), and through x.
    """
    asked, partition = _Asked.of(problem, name), Partition.of(problem)
    size, rows, p = len(partition.estimated), asked.chain.rows, problem.p
    units = np.eye(len(rows) * p).reshape(len(rows), p, len(rows) * p)
    H = raw_rows(problem, partition)[rows, :, :size]
    _, answer = asked.conditional(np.concatenate([H, units], axis=2))
    n_r, q = answer.shape[:2]
    found: Array = -np.einsum("kqs,jps->kqjp", answer[:, :, :size], gain, optimize=True)
    found[:, :, rows] += answer[:, :, size:].reshape(n_r, q, len(rows), p)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Asked:
    """A nuisance among those that share measurements with it.

    Attributes
    ----------
    chain : it alone, or joined with the time-correlated ones; L : (n_c, p, p) factors of the rest of the noise there.
    at, q : rows of the chain that are the nuisance's own, and how many components, the first ones.
    """

    chain: White | Markov | Chain
    L: Array
    at: IntArray
    q: int

    @classmethod
    def of(cls, problem: LinearProblem, name: str) -> "_Asked":
        """Find a nuisance that is estimated."""
        groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
        found = [group for group in groups if group.name == name and group.treatment == "estimated"]
        if not found:
            raise InputError(f"refine: no estimated nuisance {name!r}")
        (nuisance,) = found
        others = [other for other in problem.markov if other is not nuisance and other.treatment == "estimated"]
        chain: White | Markov | Chain = nuisance
        rest = problem
        if any(np.intersect1d(other.rows, nuisance.rows).size for other in others):
            if isinstance(nuisance, White):  # fresh: forgotten at each step
                rest = replace(problem, white=tuple(white for white in problem.white if white is not nuisance))
                nuisance = _as_markov(nuisance)
            chain = joined_with(nuisance, others)
        return cls(
            chain=chain,
            L=_rest_factor(rest, chain.rows),
            at=np.searchsorted(chain.rows, nuisance.rows) if chain is not found[0] else np.arange(len(nuisance.rows)),
            q=nuisance.H.shape[2],
        )

    def conditional(self, columns: Array) -> tuple[Array, Array]:
        """Covariance (n_r, q, q) given x, and z(.) (n_r, q, w) of columns (n_c, p, w) of the chain's rows."""
        own = np.ascontiguousarray(columns)
        if isinstance(self.chain, White):
            return _white(self.chain, self.L, own)
        P, mean = _markov(self.chain, self.L, own)
        return P[self.at, : self.q, : self.q], mean[self.at, : self.q]


def _as_markov(white: White) -> Markov:
    """A fresh nuisance as a chain without memory; its rows ascend."""
    order = np.argsort(white.rows)
    Q = np.broadcast_to(white.Q, (len(white.rows), *white.Q.shape[1:]))[order]
    return Markov(name=white.name, H=white.H[order], F=np.zeros_like(Q), Q=Q, P0=Q[0], rows=white.rows[order])


def _rest_factor(problem: LinearProblem, rows: IntArray) -> Array:
    """Factors (n_c, p, p) of the noise of some rows, white nuisances included."""
    L = np.broadcast_to(Whitener.of(problem).L, (problem.n, problem.p, problem.p))[rows]
    return np.ascontiguousarray(L)


def _white(white: White, L: Array, columns: Array) -> tuple[Array, Array]:
    """Covariance given x, Q - Q H^T iRz H Q, and the conditional mean Q H^T iRz of each column."""
    Q = np.broadcast_to(white.Q, (len(white.rows), *white.Q.shape[1:]))
    half = np.einsum("npq,nqr->npr", white.H, Q)
    solve_rows(L, half)
    whitened = columns.copy()
    solve_rows(L, whitened)
    return Q - np.einsum("npq,npr->nqr", half, half), np.einsum("npq,npw->nqw", half, whitened)


def _markov(markov: Markov | Chain, L: Array, columns: Array) -> tuple[Array, Array]:
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
