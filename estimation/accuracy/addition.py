"""What one more measurement would do to an estimate: exact rank-p updates of square roots, many candidates at once.

A belief is the factor S of what the estimator believes and the joint factor G of what its error is, over estimated
parameters and those left out. With whitened partials H_all = [H H_j] of the new measurement, X = H S,
V = I + X X^T and K = S X^T iV,
    S <- S iC, C^T C = I + X^T X        G <- [G - [K; 0] H_all G, [K; 0] N^(1/2)]
so nothing is subtracted from a covariance, and groups considered or ignored keep their say.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import lower_factor, root_rows, solve_lower, solve_positive, solve_rows
from nebosvod.estimation.problem.whitening import Whitener, add_white, raw_rows

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Belief:
    """Factors of the error after some measurements.

    Attributes
    ----------
    names : estimated parameters, then those left out (considered and ignored).
    S : shape (s, r), of what the estimator believes of the estimated ones.
    G : shape (s + s_j, r'), of estimate minus truth, in truth.
    """

    names: tuple[str, ...]
    S: Array
    G: Array

    @classmethod
    def of(cls, estimate: Estimate) -> "Belief":
        """The belief of an estimate."""
        names = estimate.names + estimate.left_out
        return cls(names=names, S=estimate.S_formal, G=estimate.factor(names))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Additions:
    """Whitened measurements that could be added, c of them.

    Attributes
    ----------
    H : shape (c, p, s + s_j), partials by the names of the belief.
    noise : shape (c, p, p), factors of their true noise; the identity where the truth is as assumed.
    """

    H: Array
    noise: Array


def additions(problem: LinearProblem) -> Additions:
    """All measurements of a problem as additions, in their order.

    Raises
    ------
    InputError
        If a time-correlated nuisance that is estimated meets a noise that differs from the assumed one.

    Notes
    -----
    Where a time-correlated nuisance is estimated, a row holds what is new in it given the rows before: the additions
    are then to be taken in order, all of them.
    """
    partition = Partition.of(problem)
    whitener = Whitener.of(problem)
    rows = raw_rows(problem, partition)
    whitener.whiten(rows)
    size = len(partition.estimated)
    H = np.concatenate([rows[:, :, :size], rows[:, :, size + 1 :]], axis=2)
    return Additions(H=np.ascontiguousarray(H), noise=_true_noise(problem, whitener))


def _true_noise(problem: LinearProblem, whitener: Whitener) -> Array:
    """Factors (n, p, p) of the true noise of whitened rows."""
    outside = [white for white in problem.white if white.treatment in ("considered", "ignored")]
    wrong = [white for white in problem.white if white.true_Q is not None and white.treatment == "estimated"]
    odd = any(markov.differs for markov in problem.markov if markov.treatment == "estimated")
    if not outside and not wrong and not odd and problem.true_R is None:
        return np.broadcast_to(np.eye(problem.p), (problem.n, problem.p, problem.p))
    if whitener.chains:
        raise InputError("additions: a time-correlated nuisance is estimated and the noise is not as assumed")
    total = np.array(np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p)))
    for white in problem.white:
        if white.treatment != "fixed":
            add_white(total, white, white.truth)
    factor = root_rows(total)
    solve_rows(np.broadcast_to(whitener.L, total.shape), factor)
    return factor


def gains(belief: Belief, added: Additions) -> tuple[Array, Array]:
    """Gains K (c, s, p) and factors (c, p, p) of the innovation covariance, as the estimator believes them."""
    X = added.H[:, :, : len(belief.S)] @ belief.S
    V = np.eye(X.shape[1]) + X @ X.transpose(0, 2, 1)
    K = solve_positive(V, X @ belief.S.T).transpose(0, 2, 1)
    return K, np.asarray(np.linalg.cholesky(V), dtype=np.float64)


def predicted(belief: Belief, added: Additions, W: Array) -> Array:
    """Factors (c, d, r) of the true error of w = W x after each of the additions alone.

    Parameters
    ----------
    W : shape (d, s + s_j), by the names of the belief.
    """
    K, _ = gains(belief, added)
    WK = W[:, : len(belief.S)] @ K
    old = (W @ belief.G) - WK @ (added.H @ belief.G)
    return np.concatenate([old, WK @ added.noise], axis=2)


def take(belief: Belief, added: Additions, index: int) -> Belief:
    """Return the belief after one of the additions."""
    one = Additions(H=added.H[index : index + 1], noise=added.noise[index : index + 1])
    K = gains(belief, one)[0][0]
    size = len(belief.S)
    X = one.H[0, :, :size] @ belief.S
    C = np.asarray(np.linalg.qr(np.vstack([np.eye(X.shape[1]), X]), mode="r"))
    G = np.array(belief.G)
    G[:size] -= K @ (one.H[0] @ belief.G)
    fresh = np.zeros((len(G), one.noise.shape[2]))
    fresh[:size] = K @ one.noise[0]
    return replace(belief, S=solve_lower(C.T, belief.S.T).T, G=lower_factor(np.hstack([G, fresh])))
