"""A score test as compiled loops: most are of a few dozen rows and few parameters, where numpy is nearly all overhead.

The same test as in `score`, which takes over where a matrix may be singular. One Cholesky factor L of the information
of old and new parameters together holds all of it: its last block is that of M, the forward solution of the slope the
whitened estimate, and that of a measurement's partials what the measurement says of the new parameters alone.
"""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import FASTMATH, Function, compiled

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
CLEAR = 1e-4  # pivot of scaled information, below which it may be singular
UNSEEN = 1e-9  # of its information that the other parameters leave to one: it cannot be told from them


def loop(function: Function) -> Function:
    """Compile a function that makes no arrays."""
    return compiled(function, fastmath=FASTMATH)


@loop
def add_products(rows: Array, chosen: Flags, sign: float, out: Array) -> None:
    """Add to the lower triangle out (w, w) the products of the columns of the chosen rows (m, p, w), summed."""
    for e in range(rows.shape[0]):
        if chosen[e]:
            for r in range(rows.shape[1]):
                for i in range(rows.shape[2]):
                    factor = sign * rows[e, r, i]
                    for j in range(i + 1):
                        out[i, j] += factor * rows[e, r, j]


@loop
def factorise(A: Array, s: int, size: int, L: Array) -> float:
    """Cholesky factor L of the leading `size` rows of a lower triangle A, and the forward solution of the row below.

    Returns the smallest of the first s pivots, in units of the root of the diagonal; 0 where any is not positive.
    """
    least = 1.0
    for j in range(size):
        pivot = A[j, j]
        for h in range(j):
            pivot -= L[j, h] * L[j, h]
        if not pivot > 0.0:
            return 0.0
        L[j, j] = math.sqrt(pivot)
        if j < s:
            least = min(least, math.sqrt(pivot / A[j, j]))
        for i in range(j + 1, size + 1):
            total = A[i, j]
            for h in range(j):
                total -= L[i, h] * L[j, h]
            L[i, j] = total / L[j, j]
    return least


@loop
def solve(rows: Array, s: int, others: Array, used: Flags, A: Array, L: Array, half: Array, left: Array) -> bool:
    """Solve for all parameters together; whether the old ones and the new can be told apart beyond doubt.

    Parameters
    ----------
    rows : shape (m, p, w), [B | G | q], s columns of old parameters.
    others : shape (w, w), lower triangle of the products of all measurements but these m, zero for the new parameters.
    A, L : (w, w), filled with the products and their factor; the last row of A with the solution.
    half : (k, k), filled with the inverse of the last block of the factor: M^-1 = half^T half.
    left : (m, p), filled with what is left of the residuals.
    """
    m, p, w = rows.shape
    for i in range(w):
        for j in range(w):
            A[i, j] = others[i, j]
    add_products(rows, used, 1.0, A)
    for i in range(w - 1):
        if not A[i, i] > 0.0:
            return False
    if factorise(A, s, w - 1, L) <= CLEAR:
        return False
    trace = 0.0  # of M^-1 in units of the own information, which no eigenvalue of it exceeds
    for c in range(s, w - 1):
        for i in range(c, w - 1):
            total = 1.0 if i == c else 0.0
            for h in range(c, i):
                total -= L[i, h] * half[h - s, c - s]
            half[i - s, c - s] = total / L[i, i]
            trace += half[i - s, c - s] ** 2 * A[c, c]
    if not trace < 1.0 / UNSEEN:
        return False
    for i in range(w - 2, -1, -1):
        total = L[w - 1, i]
        for h in range(i + 1, w - 1):
            total -= L[h, i] * A[w - 1, h]
        A[w - 1, i] = total / L[i, i]  # the slope is no longer needed
    for e in range(m):
        for r in range(p):
            total = rows[e, r, w - 1]
            for i in range(w - 1):
                total -= rows[e, r, i] * A[w - 1, i]
            left[e, r] = total
    return True


@loop
def middle(values: Array, count: int) -> float:
    """Median of the first values, whose order is lost (Hoare's selection)."""
    low, high, half = 0, count - 1, count // 2
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if half <= j:
            high = j
        elif half >= i:
            low = i
        else:
            break
    if count % 2:
        return float(values[half])
    below = float(values[0])
    for i in range(1, half):
        below = max(below, float(values[i]))
    return 0.5 * (below + float(values[half]))


@loop
def trim(left: Array, bound: float, used: Flags, work: Array) -> bool:
    """Use the measurements with residuals (m, p) up to `bound` of the median one alone; whether that changes anything.

    Fewer than half of them do not decide.
    """
    m, count = len(used), 0
    for e in range(m):
        if used[e]:
            work[count] = 0.0
            for r in range(left.shape[1]):
                work[count] += left[e, r] ** 2
            work[count] = math.sqrt(work[count])
            count += 1
    most = bound * max(middle(work, count), 1e-300)
    kept, changed = 0, False
    for e in range(m):
        size = 0.0
        for r in range(left.shape[1]):
            size += left[e, r] ** 2
        work[e] = math.sqrt(size)
        kept += work[e] <= most
        changed = changed or (work[e] <= most) != used[e]
    if not changed or kept <= m // 2:
        return False
    for e in range(m):
        used[e] = work[e] <= most
    return True


@loop
def judge(
    rows: Array, s: int, used: Flags, which: Rows, L: Array, left: Array, shares: Array, present: Array, u: Array
) -> tuple[float, float, int]:
    """Sum over the used measurements of what the answer rests on in each, the same times its residual, their number.

    Parameters
    ----------
    L : of `solve`; its last row, the forward solution of the slope, makes room for those of measurements.
    shares, present, u : (c,), (c,) and (c, k), filled for each cluster with what the answer rests on, whether any
        measurement is used, and the sum of the whitened pull.
    """
    w = rows.shape[2]
    pull, weighed, count, last = 0.0, 0.0, 0, w - 1
    for e in range(len(used)):
        if not used[e]:
            continue
        own, length = 0.0, 0.0
        for r in range(rows.shape[1]):
            for i in range(w - 1):
                total = rows[e, r, i]
                for h in range(i):
                    total -= L[i, h] * L[last, h]
                L[last, i] = total / L[i, i]
                if i >= s:
                    own += L[last, i] ** 2
                    u[which[e], i - s] += L[last, i] * left[e, r]
            length += left[e, r] ** 2
        pull += own
        weighed += own * length
        shares[which[e]] += own
        present[which[e]] = 1.0
        count += 1
    return pull, weighed, count


@loop
def squared(K: Array, x: Array, A: Array, L: Array) -> float:
    """x^T K^-1 x for a covariance K (k, k); infinite where it is singular. A, L : of k + 1 or more, to work in."""
    k, total = len(K), 0.0
    for i in range(k):
        for j in range(i + 1):
            A[i, j] = K[i, j]
        A[k, i] = x[i]
        if not K[i, i] > 0.0:
            return math.inf
    if factorise(A, k, k, L) == 0.0:
        return math.inf
    for i in range(k):
        total += L[k, i] ** 2
    return total


@loop
def turn(half: Array, K: Array, A: Array, out: Array) -> None:
    """The covariance out = half^T K half of parameters whose whitened ones have the covariance K (k, k).

    A : to work in, of k or more.
    """
    k = len(K)
    for g in range(k):
        for j in range(k):
            A[g, j] = 0.0
            for h in range(j, k):  # half is a lower triangle
                A[g, j] += K[g, h] * half[h, j]
    for i in range(k):
        for j in range(k):
            out[i, j] = 0.0
            for g in range(i, k):
                out[i, j] += half[g, i] * A[g, j]


@loop
def scored(
    rows: Array, s: int, others: Array, used: Flags, which: Rows, trims: int, bound: float, few_free: int,
    clusters: int, A: Array, L: Array, half: Array, K: Array, left: Array, work: Array, shares: Array, present: Array,
    u: Array, estimate: Array, covariance: Array, told: Array,
) -> bool:  # fmt: skip
    """The test of k parameters, as in `score.score_test`; False where it is for `score` to decide.

    Parameters
    ----------
    rows, others, A, L, half, left : as in `solve`. shares, present, u : as in `judge`, zero. K : (k, k) zero.
    work : (m + k,).
    used : (m,) which measurements to begin with; at the end those that were not trimmed.
    which : (m,) number of the cluster.
    trims, bound : at most so many times; of the length of the median residual.
    estimate, covariance, told : filled; told with statistic, explained, scatter.
    """
    k = len(estimate)
    if not solve(rows, s, others, used, A, L, half, left):
        return False
    for _ in range(trims):
        if not trim(left, bound, used, work):
            break
        if not solve(rows, s, others, used, A, L, half, left):
            return False
    explained = 0.0
    for i in range(k):
        estimate[i] = A[s + k, s + i]
        work[i] = L[s + k, s + i]  # the estimate in the sigmas that the weights give
        explained += work[i] ** 2
    pull, weighed, count = judge(rows, s, used, which, L, left, shares, present, u)
    groups, square = 0, 0.0
    for c in range(len(shares)):
        groups += present[c] > 0.0
        square += shares[c] ** 2
    freedom = rows.shape[1] * count - k
    scatter = count * weighed / pull / freedom if freedom > 0 else 1.0
    by_cluster = pull * pull >= max(clusters, k) * square and groups >= 2 * k
    factor = scatter if freedom >= few_free and by_cluster else max(scatter, 1.0)
    statistic = explained / factor
    for i in range(k):
        K[i, i] = factor
    turn(half, K, A, covariance)
    if by_cluster:
        for i in range(k):
            for j in range(k):
                K[i, j] = 0.0
                for c in range(len(shares)):
                    K[i, j] += u[c, i] * u[c, j]
                K[i, j] *= groups / (groups - k)
        apart = squared(K, work, A, L)
        if apart < statistic:
            statistic = apart
            turn(half, K, A, covariance)
    told[0], told[1], told[2] = statistic, explained, scatter
    return True
