"""Is there a bias, and since when: likelihood ratios of no bias against one that is there all the time, or appears.

H0: the model as it is, without this bias. H1: a constant bias of unknown size from a certain measurement on. Twice the
logarithm of the likelihood ratio is the drop of chi2, u^T M^-1 u with the score u = Z^T v and its covariance
M = Z^T Z, Z what the whitened partials by the bias have beyond those of everything that is estimated. Where the moment
is unknown too, the largest over all moments decides, and how large it becomes by chance alone is drawn from the joint
distribution of all scores, which is normal and known. The bias stage of a two-stage filter that runs from no bias sums
the same numbers; begun anew at the moment found (`two_stage.restart`), it ends at the estimate given here.

References
----------
Willsky, Jones 1976, IEEE Trans. Automatic Control 21, 108: generalised likelihood ratios of jumps.
Volovik and others 2017: two hypotheses of a two-stage filter. Friedland 1969, IEEE Trans. Automatic Control 14, 359.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, chdtri, chndtr, fdtrc

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import (
    append_rows,
    conditioning,
    products,
    solve_rows,
    solve_upper,
)
from nebosvod.estimation.problem.whitening import Whitener, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
UNSEEN = 1e-8  # of its own information that everything estimated must leave to a bias
MIN_FREEDOM = 10.0  # of the sums over clusters; fewer do not tell a scatter
DRAWS = 4_000
PART = 100  # of them at once
LIKELY = 0.1  # chance that is looked at closely
SEED = 20170101


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """How much larger than stated the errors are, from sums of whitened residuals over clusters that stand alone.

    `variance` is one where the stated sigmas are right; `freedom` is infinite where that is taken for granted.
    """

    variance: float = 1.0
    freedom: float = np.inf


@dataclass(frozen=True, eq=False)
class Scan:
    """Scores of a bias of k components that begins at one of m moments; one moment is a bias that is always there.

    Attributes
    ----------
    onsets : (m,), the first measurement that has it.
    scores : (m, k). information : (m k, m k), their joint covariance under H0.
    moves : (s, m k), minus the change of the estimated parameters by a bias.
    sigma : (s,), of these parameters without a bias.
    scatter : how the errors compare with the stated sigmas.
    """

    onsets: Rows
    scores: Array
    information: Array
    moves: Array
    sigma: Array
    scatter: Scatter

    @property
    def k(self) -> int:
        """Components of the bias."""
        return int(self.scores.shape[1])

    def own(self, i: int) -> Array:
        """Information (k, k) about a bias from moment i on."""
        span = slice(i * self.k, (i + 1) * self.k)
        return self.information[span, span]

    def estimate(self, i: int) -> tuple[Array, Array]:
        """The bias (k,) that is there from moment i on, and its covariance (k, k)."""
        inverse = np.linalg.solve(self.own(i), np.eye(self.k))
        return inverse @ self.scores[i], np.asarray(inverse * self.scatter.variance, dtype=np.float64)

    def shift(self, i: int) -> Array:
        """By how much the estimated parameters (s,) move where the bias from moment i on is estimated with them."""
        return np.asarray(-self.moves[:, i * self.k : (i + 1) * self.k] @ self.estimate(i)[0])

    @cached_property
    def statistics(self) -> Array:
        """Drop of chi2 (m,) in units of the scatter."""
        m, k = self.scores.shape
        blocks = np.einsum("iaib->iab", self.information.reshape(m, k, m, k))
        moved = np.linalg.solve(blocks, self.scores[:, :, None])[:, :, 0]
        return np.asarray(np.sum(self.scores * moved, axis=1) / self.scatter.variance)

    @property
    def best(self) -> int:
        """The moment from which on a bias explains most."""
        return int(np.argmax(self.statistics))

    def chance(self, level: float = LIKELY) -> float:
        """Chance that without a bias one from the best of these moments on would explain as much.

        Parameters
        ----------
        level : below which it is asked for. Of several moments it is at least that of one and at most the sum over all;
            where these leave open whether it is below, it is drawn, else the sum is given.
        """
        found, count = float(self.statistics.max()), len(self.onsets)
        bound = count * self._tail(found)
        if count == 1 or not self._tail(found) <= level <= bound:
            return min(bound, 1.0)
        return min(bound, float((1 + np.count_nonzero(self._largest >= found)) / (1 + len(self._largest))))

    def threshold(self, level: float) -> float:
        """What the largest statistic passes with this chance without a bias; at least ten draws lie above."""
        if len(self.onsets) == 1 and np.isinf(self.scatter.freedom):
            return float(chdtri(self.k, level))
        return float(np.quantile(self._largest, 1.0 - max(level, 10.0 / len(self._largest))))

    def power(self, i: int, sizes: Array, level: float) -> Array:
        """Chance (len(sizes),) to find a bias of these sizes from moment i on, in the direction hardest to see.

        Exact for a single moment, from draws for several; with the stated sigmas.
        """
        values, vectors = np.linalg.eigh(self.own(i))
        limit = self.threshold(level)
        if len(self.onsets) == 1:
            return np.asarray(1.0 - chndtr(limit, self.k, np.maximum(sizes**2 * values[0], 1e-12)))
        span = slice(i * self.k, (i + 1) * self.k)
        mean = np.linalg.solve(self._roots, (self.information[:, span] @ vectors[:, 0]).reshape(-1, self.k, 1))[:, :, 0]
        some, moved = self._draws[:, :, : DRAWS // 4], mean.T[:, :, None]
        return np.array([np.mean(_largest(some + b * moved) > limit) for b in sizes])

    def _tail(self, statistic: float) -> float:
        """Chance of a statistic at one moment."""
        if np.isinf(self.scatter.freedom):
            return float(chdtrc(self.k, statistic))
        return float(fdtrc(self.k, self.scatter.freedom, statistic / self.k))

    @cached_property
    def _roots(self) -> Array:
        """Cholesky factors (m, k, k) of the information of each moment."""
        return np.array([np.linalg.cholesky(self.own(i)) for i in range(len(self.onsets))])

    @cached_property
    def _draws(self) -> Array:
        """Whitened scores (k, m, DRAWS) of worlds without a bias; the same each time."""
        m, k = self.scores.shape
        white = np.zeros_like(self.information)
        for i in range(m):
            white[i * k : (i + 1) * k, i * k : (i + 1) * k] = np.linalg.solve(self._roots[i], np.eye(k))
        values, vectors = np.linalg.eigh(white @ self.information @ white.T)
        # the symmetric root: the only one that does not jump where eigenvalues are alike
        factor = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        rng = np.random.default_rng(SEED)
        drawn = np.concatenate([factor @ rng.standard_normal((factor.shape[1], PART)) for _ in range(DRAWS // PART)], 1)
        return np.ascontiguousarray(drawn.reshape(m, k, DRAWS).transpose(1, 0, 2))

    @cached_property
    def _largest(self) -> Array:
        """Largest statistic (DRAWS,) over the moments, with a scatter that is itself drawn where it is estimated."""
        squares = _largest(self._draws)
        freedom = self.scatter.freedom
        if np.isinf(freedom):
            return squares
        return np.asarray(squares / (np.random.default_rng(SEED + 1).chisquare(freedom, DRAWS) / freedom))


def _largest(scores: Array) -> Array:
    """Largest square (N,) over the moments of whitened scores (k, m, N)."""
    squares = scores[0] ** 2
    for component in scores[1:]:
        squares += component**2
    return np.asarray(squares.max(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ground:
    """H0 as its tests need it: whitened partials B (n, p, s) and residuals v (n, p), and the solution without a bias.

    Attributes
    ----------
    half : (s, s), half half^T is the covariance of the unknowns; told : (s,), half told is their estimate.
    names : of the parameters. spread : (parameters, s), to them from the unknowns.
    """

    whitener: Whitener
    B: Array
    v: Array
    half: Array
    told: Array
    names: tuple[str, ...]
    spread: Array

    @classmethod
    def of(cls, problem: LinearProblem) -> "Ground":
        """Solve H0.

        Parameters
        ----------
        problem : rows in time order; whatever else errs is estimated or in its weights (`nothing_left_out`).
        """
        partition, whitener = Partition.of(problem), Whitener.of(problem)
        rows = whitened_rows(problem, partition, whitener)
        size = partition.n_unknowns
        B, v = np.ascontiguousarray(rows[:, :, :size]), np.ascontiguousarray(rows[:, :, size])
        R = append_rows(prior_rows(partition, size), B.reshape(-1, size))[:size]
        if len(R) < size or not conditioning(R).observable:
            raise GeometryError("Ground: the problem is not observable")
        half = solve_upper(R, np.eye(size))
        told = half.T @ (B.reshape(-1, size).T @ v.ravel())
        return cls(whitener=whitener, B=B, v=v, half=half, told=told, names=partition.estimated, spread=partition.T)

    def scan(
        self, rows: npt.ArrayLike, onsets: npt.ArrayLike, clusters: Rows | None = None, G: Array | None = None
    ) -> Scan | None:
        """Score a bias of some measurements from each of some moments on; None where it cannot be told.

        Parameters
        ----------
        rows : shape (r,), measurements that have it while it is there, ascending.
        onsets : shape (m,), measurements with which it may begin, ascending. Moments at which it cannot be told from
            what is estimated are left out.
        clusters : shape (r,), number of the group within which errors may be alike: the scatter is then that of the
            sums over groups. By default the stated sigmas are believed.
        G : shape (r, p, k), partials by the bias; by default each component of the measurements has its own.
        """
        place, begins = np.asarray(rows, dtype=np.int64), np.asarray(onsets, dtype=np.int64)
        p = self.v.shape[1]
        own = np.broadcast_to(np.eye(p), (len(place), p, p)) if G is None else G
        if not len(place) or not len(begins) or (np.diff(begins) <= 0).any() or (np.diff(place) <= 0).any():
            raise InputError("scan: needs ascending rows and onsets, at least one of each")
        wide, B, v = self._whitened(place, begins, own)
        size, k = self.B.shape[2], own.shape[2]
        flat = wide.reshape(-1, wide.shape[2])
        A = self.half.T @ products(B.reshape(-1, size), flat)
        whole = products(flat, flat)
        M = whole - A.T @ A
        u = flat.T @ v.ravel() - A.T @ self.told
        kept = [i for i in range(len(begins)) if _told(M, whole, slice(i * k, (i + 1) * k))]
        if not kept:
            return None
        at = np.concatenate([np.arange(i * k, (i + 1) * k) for i in kept])
        spread = self.spread @ self.half
        found = Scan(
            onsets=begins[kept],
            scores=u[at].reshape(-1, k),
            information=M[np.ix_(at, at)],
            moves=spread @ A[:, at],
            sigma=np.linalg.norm(spread, axis=1),
            scatter=Scatter(),
        )
        if clusters is None:
            return found
        i = int(np.argmax(found.statistics))
        b = found.estimate(i)[0]
        Z = wide[:, :, kept[i] * k : (kept[i] + 1) * k]
        x = self.half @ (self.told - A[:, at[i * k : (i + 1) * k]] @ b)
        left = v - B @ x - Z @ b
        scatter = _scatter(left if len(left) == len(place) else left[place], clusters, k)  # chains reach every row
        return None if scatter is None else replace(found, scatter=scatter)

    def _whitened(self, rows: Rows, onsets: Rows, G: Array) -> tuple[Array, Array, Array]:
        """Whitened partials (q, p, m k) by the bias from each moment on, and B and v, of the q rows it reaches."""
        begun = (rows[:, None] >= onsets)[:, None, :, None]
        wide = np.where(begun, G[:, :, None, :], 0.0).reshape(len(rows), G.shape[1], -1)
        if not self.whitener.chains:
            L = self.whitener.L if len(self.whitener.L) == 1 else self.whitener.L[rows]
            wide = np.ascontiguousarray(wide)
            solve_rows(L, wide)
            return wide, np.ascontiguousarray(self.B[rows]), self.v[rows]
        every = np.zeros((len(self.v), *wide.shape[1:]))
        every[rows] = wide
        self.whitener.whiten(every)
        return every, self.B, self.v


def _told(M: Array, whole: Array, span: slice) -> bool:
    """Whether what is estimated leaves enough of the information about a bias."""
    unit = np.sqrt(np.diag(whole)[span])
    if not (unit > 0.0).all():
        return False
    return bool(np.linalg.eigvalsh(M[span, span] / np.outer(unit, unit))[0] > UNSEEN)


def _scatter(left: Array, clusters: Rows, k: int) -> Scatter | None:
    """The scatter of whitened residuals (q, p) by cluster, after k numbers were taken from them; None of too few."""
    if len(clusters) != len(left):
        raise InputError(f"scan: clusters need one number for each of {len(left)} rows, got {len(clusters)}")
    which = np.unique(clusters, return_inverse=True)[1].ravel()
    count = np.bincount(which).astype(np.float64)
    sums = np.stack([np.bincount(which, left[:, j]) for j in range(left.shape[1])], axis=1)
    freedom = float(sums.size - k)
    if freedom < MIN_FREEDOM:
        return None
    return Scatter(variance=float(np.sum(sums**2 / count[:, None]) / freedom), freedom=freedom)
