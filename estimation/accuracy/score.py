"""Score tests: whether measurements tell of a parameter that the estimate has held at zero.

C. R. Rao's test looks at the slope of the cost where the estimate without the parameter stands, so that one linear
solve answers what another fit would. The answer here is scaled by what the residuals really scatter, by measurement and
by cluster: an absolute threshold would never fire where the stated sigmas are too large, and always where errors of
one night are alike.

References
----------
Rao 1948, Proc. Camb. Phil. Soc. 44, 50: the score test.
White 1982, Econometrica 50, 1; Liang and Zeger 1986, Biometrika 73, 13: variances from the residuals by cluster.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, chdtri, ndtr, ndtri

from nebosvod.estimation.accuracy.score_loops import CLEAR, UNSEEN, add_products, scored

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
TRIMMED = 4.0  # robust sigmas of the whitened residual, beyond which a measurement says nothing of a common parameter
TRIMS = 4
FEW = 8  # measurements, below which none is trimmed
FEW_FREE = 20  # degrees of freedom, below which the scatter of the residuals may enlarge a variance, never lessen it
CLUSTERS = 10  # fewer do not tell a variance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Score:
    """What the measurements say of k parameters held at zero.

    Attributes
    ----------
    estimate, covariance : (k,) and (k, k), as a fit with them would find to first order, scaled by the residuals.
    statistic : estimate^T covariance^-1 estimate: chi squared with k degrees of freedom if they are zero.
    explained : by how much chi squared would drop, as the weights count it.
    used : (m,) which measurements were not trimmed.
    scatter : variance of the whitened residuals that are left, one where the stated sigmas are right.
    """

    estimate: Array
    covariance: Array
    statistic: float
    explained: float
    used: Flags
    scatter: float

    @property
    def significance(self) -> float:
        """The statistic as that many sigmas of one normal number."""
        return sigmas(self.statistic, len(self.estimate))

    def part(self, columns: slice) -> float:
        """Significance of some of the parameters, the others free."""
        estimate, covariance = self.estimate[columns], self.covariance[columns, columns]
        return sigmas(float(estimate @ np.linalg.solve(covariance, estimate)), len(estimate))


def sigmas(statistic: float, freedom: float) -> float:
    """As many sigmas of one normal number as chi squared with these degrees of freedom is rare."""
    chance = float(chdtrc(freedom, statistic))
    if chance > 1e-280:
        return float(-ndtri(chance / 2.0))
    return float(np.sqrt(max(statistic - (freedom - 1) * np.log(max(statistic, 1.0)), 0.0)))


def among(significance: float, tried: int) -> float:
    """The sigmas that are as rare as it is that any of so many independent tests exceeds this significance.

    The correction of Sidak; tests that hang together are fewer than they seem, so
    that it errs on the careful side. Zero where chance would bring it.

    References
    ----------
    Sidak 1967, J. Am. Stat. Assoc. 62, 626.
    """
    chance = 2.0 * float(ndtr(-significance))
    if chance * tried < 1e-280:
        return float(np.sqrt(max(significance**2 - 2.0 * np.log(tried), 0.0)))
    return float(-ndtri(-np.expm1(tried * np.log1p(-chance)) / 2.0)) if chance < 1.0 else 0.0


def alone(significance: float, tried: int) -> float:
    """The inverse of `among`: what one of so many tests needs by itself to be as rare among all."""
    return float(-ndtri(-np.expm1(np.log1p(-2.0 * float(ndtr(-significance))) / max(tried, 1)) / 2.0))


def score_test(
    q: Array,
    B: Array,
    G: Array,
    information: Array,
    slope: Array,
    inside: Flags,
    cluster: Rows,
    *,
    everyone: bool = False,
) -> Score | None:
    """Test k parameters that m measurements share; None where the measurements cannot tell them from the others.

    Parameters
    ----------
    q : shape (m, p), whitened residuals of the measurements in question.
    B, G : shape (m, p, s) and (m, p, k), their whitened partials by the parameters of the estimate, and by the new.
    information : shape (s, s), B^T B over all measurements that made the estimate, and its prior.
    slope : shape (s,), B^T q over the same; zero where the estimate has converged.
    inside : shape (m,), which of these m measurements made the estimate.
    cluster : shape (m,), number of the group within which errors may be alike, such as a night of a station.
    everyone : whether to begin with measurements that the estimate left out, where most are in it; trimmed they are
        in any case.

    Notes
    -----
    With N, g of all measurements, M = N_cc - N_cx N_xx^-1 N_xc and g_eff = g_c - N_cx N_xx^-1 g_x:
    estimate = M^-1 g_eff. Its covariance is the larger of s^2 M^-1, s^2 the scatter of what is left, and
    M^-1 (sum over clusters of u u^T) M^-1, u the sum of Z^T (q - what is explained), Z = G - B N_xx^-1 N_xc; where the
    answer rests on few clusters, s^2 is at least one. Records count in s^2 as they pull the answer. The slope of
    measurements left out of the estimate is counted in, so that a whole group that was rejected is tested like one
    that was not.

    References
    ----------
    Rao 1948, Proc. Camb. Phil. Soc. 44, 50.
    White 1982, Econometrica 50, 1; Liang, Zeger 1986, Biometrika 73, 13: variances by cluster.
    """
    trusting = everyone or inside.mean() <= 0.5  # else gross errors would lead
    used = np.ones(len(q), dtype=np.bool_) if trusting else inside.copy()
    rows = np.concatenate([B, G, q[:, :, None]], axis=2)
    told = _by_loops(rows, information, slope, inside, used.copy(), cluster)
    if told is not None:
        return told
    without = _gram(rows[inside])  # of what the estimate is made of already
    others = information - without[: len(slope), : len(slope)], slope - without[: len(slope), -1]
    found = _solved(rows, *others, used)
    for _ in range(TRIMS if len(q) >= FEW else 0):
        if found is None:
            return None
        size = np.sqrt(np.sum(found.left**2, axis=1))
        kept = size <= TRIMMED * max(float(np.median(size[used])), 1e-300) / _middle(q.shape[1])
        if np.array_equal(kept, used) or kept.sum() <= len(q) // 2:
            break
        used = kept
        found = _solved(rows, *others, used)
    return None if found is None else _judged(found, B[used], G[used], cluster[used], used)


def _by_loops(rows: Array, information: Array, slope: Array, inside: Flags, used: Flags, cluster: Rows) -> Score | None:
    """The test by compiled loops; None where a matrix may be singular."""
    (m, p, w), s = rows.shape, len(slope)
    k = w - s - 1
    which = cluster if 0 <= cluster.min() <= cluster.max() < m else np.unique(cluster, return_inverse=True)[1].ravel()
    c = int(which.max()) + 1
    others = np.zeros((w, w))
    others[:s, :s], others[-1, :s] = information, slope
    without = np.zeros((w, w))
    add_products(rows, inside, -1.0, without)
    others[:s, :s] += without[:s, :s]
    others[-1, :s] += without[-1, :s]
    estimate, covariance, told = np.empty(k), np.empty((k, k)), np.empty(3)
    found = scored(
        rows, s, others, used, which, TRIMS if m >= FEW else 0, TRIMMED / _middle(p), FEW_FREE, CLUSTERS,
        np.empty((w, w)), np.empty((w, w)), np.zeros((k, k)), np.zeros((k, k)), np.empty((m, p)), np.empty(m + k),
        np.zeros(c), np.zeros(c), np.zeros((c, k)), estimate, covariance, told,
    )  # fmt: skip
    if not found:
        return None
    statistic, explained, scatter = told.tolist()
    return Score(
        estimate=estimate, covariance=covariance, statistic=statistic, explained=explained, used=used, scatter=scatter
    )


def _middle(p: int) -> float:
    """Median length of p normal numbers."""
    return float(np.sqrt(chdtri(p, 0.5)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solved:
    """Estimate (k,), M (k, k), P = N_xx^-1 N_xc (s, k) and what is left of the residuals (m, p)."""

    estimate: Array
    M: Array
    P: Array
    left: Array


def _solved(rows: Array, information: Array, slope: Array, used: Flags) -> _Solved | None:
    """Solve for the new parameters; None where M is singular.

    Parameters
    ----------
    rows : shape (m, p, s + k + 1), [B | G | q].
    information, slope : of all measurements but these m.
    """
    s = len(slope)
    whole = _gram(rows if used.all() else rows[used])
    N = information + whole[:s, :s]
    N_cc, size = whole[s:-1, s:-1], np.sqrt(np.diag(whole)[s:-1])
    if not (np.diag(N) > 0.0).all() or not (size > 0.0).all():
        return None
    taken = _divided(N, np.column_stack([whole[:s, s:-1], slope + whole[:s, -1]]))
    P, p = taken[:, :-1], taken[:, -1]
    M = N_cc - whole[s:-1, :s] @ P
    if np.linalg.eigvalsh(M / np.outer(size, size))[0] < UNSEEN:
        return None
    estimate = np.asarray(np.linalg.solve(M, whole[s:-1, -1] - P.T @ (slope + whole[:s, -1])), dtype=np.float64)
    return _Solved(estimate=estimate, M=M, P=P, left=rows @ np.concatenate([P @ estimate - p, -estimate, [1.0]]))


def _judged(found: _Solved, B: Array, G: Array, cluster: Rows, used: Flags) -> Score:
    """The score by the scatter of what is left, of measurements and of clusters."""
    estimate, M, left = found.estimate, found.M, found.left[used]
    Z = G - B @ found.P
    k, (m, p) = len(estimate), left.shape
    freedom = p * m - k
    pull = _pull(M, Z)  # a scatter is that of the measurements the answer rests on
    scatter = float(m * (pull @ np.sum(left**2, axis=1)) / pull.sum()) / freedom if freedom > 0 else 1.0
    which = np.unique(cluster, return_inverse=True)[1].ravel()
    shares = np.bincount(which, pull)
    by_cluster = shares.sum() ** 2 / np.sum(shares**2) >= max(CLUSTERS, k) and len(shares) >= 2 * k
    sure = freedom >= FEW_FREE and by_cluster
    covariance = np.linalg.solve(M, np.eye(k)) * (scatter if sure else max(scatter, 1.0))
    statistic = float(estimate @ np.linalg.solve(covariance, estimate))
    if by_cluster:
        wide = _clustered(M, Z, left, which, len(shares))
        apart = float(estimate @ np.linalg.solve(wide, estimate))
        if apart < statistic:
            covariance, statistic = wide, apart
    explained = float(estimate @ M @ estimate)
    return Score(
        estimate=estimate, covariance=covariance, statistic=statistic, explained=explained, used=used, scatter=scatter
    )


def _divided(N: Array, right: Array) -> Array:
    """N^-1 right, of least length where N (s, s) is singular."""
    scale = np.sqrt(np.diag(N))
    one, many = N / np.outer(scale, scale), right / scale[:, None]
    try:
        clear = np.diag(np.linalg.cholesky(one)).min() > CLEAR
    except np.linalg.LinAlgError:
        clear = False
    found = np.linalg.solve(one, many) if clear else np.linalg.lstsq(one, many, rcond=1e-13)[0]
    return np.asarray(found / scale[:, None])


def _pull(M: Array, Z: Array) -> Array:
    """How much of the answer rests on each measurement (m,): traces of Z M^-1 Z^T, in any units of the parameters."""
    size = np.sqrt(np.diag(M))
    scaled = (Z / size).reshape(-1, len(M))
    own = np.linalg.solve(M / np.outer(size, size), scaled.T).T
    return np.asarray(np.sum((own * scaled).reshape(len(Z), -1), axis=1), dtype=np.float64)


def _clustered(M: Array, Z: Array, left: Array, which: Rows, counted: int) -> Array:
    """The covariance (k, k) that the scatter of the clusters gives."""
    own = (Z * left[:, :, None]).sum(axis=1)
    u = np.column_stack([np.bincount(which, own[:, j], counted) for j in range(len(M))])
    half = np.linalg.solve(M, u.T)
    return np.asarray(half @ half.T * (counted / (counted - len(M))), dtype=np.float64)


def _gram(rows: Array) -> Array:
    """Sums over measurements of all products of the columns of rows (m, p, n): (n, n)."""
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
