"""One factorisation, many residual vectors: what repeated estimation of one linear problem costs least.

An estimate is affine in the residuals: mean = offset + M_v v with M_v = K_formal H^T W. From the factor S the
estimator itself found, M_v = S (L^-T L^-1 H S)^T, n p s numbers; each further estimate is then one product.
The innovations of a sequential pass are affine as well: their gains and covariances do not depend on the data.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop
from nebosvod.estimation.accuracy.addition import Additions, Belief, additions
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import append_rows, conditioning, lower_factor, solve_rows
from nebosvod.estimation.problem.subset import subset
from nebosvod.estimation.problem.whitening import Whitener, raw_rows, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows, solve
from nebosvod.estimation.solvers.recursive import mismatched

Array = npt.NDArray[np.float64]
DETERMINED = 1e8  # condition number from which on a pass over the measurements speaks of innovations


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repeated:
    """The affine map from residuals to estimates.

    Attributes
    ----------
    names : s estimated parameters.
    gain : shape (s, n, p).
    offset : shape (s,), the estimate at zero residual.
    """

    names: tuple[str, ...]
    gain: Array
    offset: Array

    @classmethod
    def of(cls, problem: LinearProblem, estimate: Estimate) -> "Repeated":
        """The map of a batch or an augmented recursive estimate, by its own factor."""
        partition, whitener = Partition.of(problem), Whitener.of(problem)
        X = raw_rows(problem, partition)[:, :, : len(estimate.names)] @ estimate.S_formal
        whitener.whiten(X)
        whitener.adjoint(X)
        gain = np.einsum("sr,npr->snp", estimate.S_formal, X, optimize=True)
        offset = estimate.mean - np.einsum("snp,np->s", gain, problem.residual)
        return cls(names=estimate.names, gain=np.ascontiguousarray(gain), offset=offset)

    def means(self, residuals: Array) -> Array:
        """Estimates (N, s) for residuals (N, n, p)."""
        count = len(residuals)
        found: Array = residuals.reshape(count, -1) @ self.gain.reshape(len(self.gain), -1).T
        return found + self.offset


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Innovations:
    """A sequential pass prepared once, for many residual vectors.

    Attributes
    ----------
    first : number of measurements that only start the pass, until everything estimated is determined.
    start : estimates after those.
    H : shape (n - first, p, s), whitened; K : (n - first, s, p).
    formal : shape (n - first, p, p), factors of the innovation covariance the estimator believes.
    true : the same of what it is, or None where a time-correlated nuisance is left out.
    """

    problem: LinearProblem
    first: int
    start: Repeated
    H: Array
    K: Array
    formal: Array
    true: Array | None

    @classmethod
    def of(cls, problem: LinearProblem, first: int | None = None) -> "Innovations | None":
        """Prepare the pass; None when the measurements never determine the parameters well.

        Parameters
        ----------
        first : measurements that only start it; by default as few as determine the parameters.
        """
        first = first_determined(problem) if first is None else first
        if first is None:
            return None
        head = subset(problem, np.arange(problem.n) < first)
        estimate = solve(head)
        belief = Belief.of(estimate)
        added, known = _all_additions(problem)
        size, p, rest = len(estimate.names), problem.p, problem.n - first
        K, formal, true = np.empty((rest, size, p)), np.empty((rest, p, p)), np.empty((rest, p, p))
        H, noise, same = np.ascontiguousarray(added.H[first:]), added.noise[first:], not mismatched(problem)
        _pass(H, np.ascontiguousarray(noise), lower_factor(belief.S), belief.G, same, K, formal, true)
        return cls(
            problem=problem,
            first=first,
            start=Repeated.of(head, estimate),
            H=np.ascontiguousarray(H[:, :, :size]),
            K=K,
            formal=formal,
            true=true if known else None,
        )

    def squares(self, residuals: Array) -> tuple[Array, Array | None]:
        """Normalised squares (N, n - first) of the innovations for residuals (N, n, p): as believed, and in truth."""
        partition = Partition.of(self.problem)
        rows = np.array(residuals.transpose(1, 2, 0), order="C")  # a copy, also of a single vector
        assumed = np.concatenate([partition.mean, partition.left_out_mean])
        raw = raw_rows(replace(self.problem, residual=residuals[0]), partition)
        size = len(partition.estimated)
        shift = residuals[0] - raw[:, :, size]  # H times the assumed means
        rows -= shift[:, :, None]
        Whitener.of(self.problem).whiten(rows)
        x = self.start.means(residuals[:, : self.first]).T - assumed[:size, None]
        innovation = np.empty((len(self.H), *rows.shape[1:]))
        for i in range(len(self.H)):
            innovation[i] = rows[self.first + i] - self.H[i] @ x
            x = x + self.K[i] @ innovation[i]
        return _squares(self.formal, innovation), None if self.true is None else _squares(self.true, innovation)


@plain_loop
def _pass(H, noise, S, G, same, K, formal, true):  # type: ignore[no-untyped-def]
    """Take in whitened measurements (m, p, s + s_j) in order; fill gains and factors of the innovation covariances.

    S <- S (I - X^T L^-T (L + I)^-1 X) with X = H S, L L^T = I + X X^T (Andrews 1968), and G as in `addition`.

    Parameters
    ----------
    same : whether the truth is as assumed: then G is S.
    """
    p, size, every = H.shape[1], len(S), len(G)
    unit = np.eye(p)
    S, G = S.copy(), G.copy()
    for k in range(len(H)):
        X = np.ascontiguousarray(H[k, :, :size]) @ S
        L = np.linalg.cholesky(unit + X @ X.T)
        inner = np.linalg.solve(L, X)  # L^-1 X
        formal[k] = L
        K[k] = np.linalg.solve(L.T, inner @ S.T).T
        if same:
            true[k] = L
        else:
            HG = H[k] @ G
            wide = np.hstack((HG, noise[k]))
            true[k] = np.linalg.cholesky(wide @ wide.T)
            G[:size] -= K[k] @ HG
            fresh = np.zeros((every, p))
            fresh[:size] = K[k] @ noise[k]
            G = np.ascontiguousarray(np.linalg.qr(np.hstack((G, fresh)).T)[1].T)
        S -= (S @ inner.T) @ np.linalg.solve(L + unit, X)
    return G


def _squares(factors: Array, innovation: Array) -> Array:
    white = np.array(innovation)
    solve_rows(factors, white)
    total: Array = np.einsum("npk,npk->kn", white, white)
    return total


def first_determined(problem: LinearProblem) -> int | None:
    """Smallest number of measurements that determine all unknowns, by bisection; None if all do not."""
    partition = Partition.of(problem)
    rows = whitened_rows(problem, partition, Whitener.of(problem))
    width, size = rows.shape[2], partition.n_unknowns

    def determined(count: int) -> bool:
        R = append_rows(prior_rows(partition, width), rows[:count].reshape(-1, width))[:size, :size]
        return R.shape[0] == size and conditioning(R).number <= DETERMINED

    if not determined(problem.n):
        return None
    low, high = 0, problem.n
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if determined(middle) else (middle, high)
    return high


def _all_additions(problem: LinearProblem) -> tuple[Additions, bool]:
    """The measurements as additions, and whether their true noise is known."""
    left_out = any(markov.treatment in ("considered", "ignored") for markov in problem.markov)
    chains = any(markov.treatment == "estimated" for markov in problem.markov)
    odd = (
        problem.true_R is not None
        or any(markov.differs for markov in problem.markov)
        or any(white.treatment in ("considered", "ignored") or white.true_Q is not None for white in problem.white)
    )
    if chains and odd:
        white = tuple(replace(white, true_Q=None) for white in problem.white if white.treatment == "estimated")
        markov = tuple(markov.assumed for markov in problem.markov)
        return additions(replace(problem, white=white, markov=markov, true_R=None)), False
    return additions(problem), not left_out
