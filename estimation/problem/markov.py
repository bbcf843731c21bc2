"""Time-correlated nuisances in O(n): a small square-root filter that whitens measurement rows.

The covariance of the measurements that a Gauss-Markov nuisance z touches is dense, but its Cholesky factor is a
filter: row k minus what the earlier rows predict of it, over the innovation's factor. The filter depends on the
covariances alone, so it is built once; columns of partials and residuals then run through it, forwards for L^-1
and backwards for L^-T.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop
from nebosvod.estimation.problem.problem import Markov
from nebosvod.estimation.problem.square_root import covariance_factor, root_rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Nuisances merged into one z (q,) because they touch common measurements; arrays as in `Markov`."""

    H: Array
    F: Array
    Q: Array
    P0: Array
    rows: IntArray

    def filtered(self, L: Array) -> "ChainFilter":
        """Build the whitening filter; L (n or 1, p, p) factors the rest of the noise of all measurements."""
        noise = np.ascontiguousarray(np.broadcast_to(L if len(L) == 1 else L[self.rows], self._noise_shape()))
        start = covariance_factor(self.P0, "P0")
        root = np.zeros_like(self.P0)
        root[:, : start.shape[1]] = start
        innovation, gain = _filter(self.H, self.F, root_rows(self.Q), root, noise)
        return ChainFilter(H=self.H, F=self.F, rows=np.array(self.rows), innovation=innovation, gain=gain)

    def _noise_shape(self) -> tuple[int, int, int]:
        return len(self.rows), self.H.shape[1], self.H.shape[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChainFilter:
    """A factored chain: innovation factors (n_r, p, p) and whitened gains (n_r, q, p)."""

    H: Array
    F: Array
    rows: IntArray
    innovation: Array
    gain: Array

    def whiten(self, rows: Array) -> None:
        """Apply L^-1 in place to the touched rows among all rows (n, p, w)."""
        _forward(self.H, self.F, self.innovation, self.gain, self.rows, rows)

    def adjoint(self, rows: Array) -> None:
        """Apply L^-T in place to the touched rows among all rows (n, p, w)."""
        _backward(self.H, self.F, self.innovation, self.gain, self.rows, rows)


def merge(nuisances: list[Markov]) -> list[Chain]:
    """Join nuisances that share a measurement into one chain; the rest stay chains of their own."""
    groups: list[list[Markov]] = []
    for nuisance in nuisances:
        mine = nuisance.rows
        joined = [group for group in groups if any(np.intersect1d(mine, other.rows, True).size for other in group)]
        groups = [group for group in groups if group not in joined]
        groups.append([other for group in joined for other in group] + [nuisance])
    return [_joined(group) for group in groups]


def joined_with(nuisance: Markov, others: Sequence[Markov]) -> Chain:
    """The chain of a nuisance and of all that share a measurement with it, one through the other; its own q come first.

    Where nothing does, it is alone.
    """
    group, rows, left = [nuisance], nuisance.rows, list(others)
    while found := [other for other in left if np.intersect1d(rows, other.rows, True).size]:
        group += found
        left = [other for other in left if other not in found]
        rows = np.unique(np.concatenate([rows, *(other.rows for other in found)]))
    return _joined(group)


def _joined(group: list[Markov]) -> Chain:
    """Stack nuisances block by block; one that a row does not touch keeps its value across it."""
    rows = group[0].rows if len(group) == 1 else np.unique(np.concatenate([each.rows for each in group]))
    size = sum(nuisance.P0.shape[0] for nuisance in group)
    n, p = len(rows), group[0].H.shape[1]
    H, F, Q, P0 = np.zeros((n, p, size)), np.zeros((n, size, size)), np.zeros((n, size, size)), np.zeros((size, size))
    F[:] = np.eye(size)
    first = 0
    for nuisance in group:
        span = slice(first, first + nuisance.P0.shape[0])
        where = np.searchsorted(rows, nuisance.rows)
        H[where, :, span] = nuisance.H
        F[where[1:], span, span] = nuisance.F[1:]
        Q[where[1:], span, span] = nuisance.Q[1:]
        P0[span, span] = nuisance.P0
        first = span.stop
    return Chain(H=H, F=F, Q=Q, P0=P0, rows=rows)


def accumulated(nuisance: Markov, gain: Array) -> Array:
    """Covariance (w, w) of sum_k gain_k^T H_k z_k, z as it really is, for a gain (n, p, w) over all measurements."""
    reach: Array
    total: Array
    truth = nuisance.truth
    H, F, Q = _plain(truth.H, truth.F, truth.Q)
    reach, total = _accumulate(H, F, Q, np.array(truth.rows), gain)
    return total + reach.T @ truth.P0 @ reach


def _plain(*arrays: Array) -> tuple[Array, ...]:
    """Contiguous writable copies: one compiled variant of each kernel serves all callers."""
    return tuple(np.array(array, order="C") for array in arrays)


@plain_loop
def _triangularise(M):  # type: ignore[no-untyped-def]
    """Make M (m, k), m <= k, lower triangular from the right by Householder reflections, in place."""
    m, k = M.shape
    for i in range(m):
        norm = 0.0
        for j in range(i, k):
            norm += M[i, j] * M[i, j]
        norm = np.sqrt(norm)
        if norm == 0.0:
            continue
        alpha = -norm if M[i, i] > 0.0 else norm
        head = M[i, i] - alpha
        square = norm * norm - M[i, i] * M[i, i] + head * head
        for r in range(i + 1, m):
            dot = M[r, i] * head
            for j in range(i + 1, k):
                dot += M[r, j] * M[i, j]
            dot *= 2.0 / square
            M[r, i] -= dot * head
            for j in range(i + 1, k):
                M[r, j] -= dot * M[i, j]
        M[i, i] = alpha
        for j in range(i + 1, k):
            M[i, j] = 0.0
        if alpha < 0.0:
            for r in range(i, m):
                M[r, i] = -M[r, i]


@plain_loop
def _filter(H, F, step, root, noise):  # type: ignore[no-untyped-def]
    """Square-root filter over the rows: innovation factors (n, p, p) and gains K = gain iL (n, q, p)."""
    n, p, q = H.shape
    innovation = np.zeros((n, p, p))
    gain = np.zeros((n, q, p))
    S = root.copy()
    wide = np.zeros((q, 2 * q))
    array = np.zeros((p + q, p + q))
    for k in range(n):
        if k > 0:
            wide[:, :q] = F[k] @ S
            wide[:, q:] = step[k]
            _triangularise(wide)
            S[:, :] = wide[:, :q]
        array[:, :] = 0.0
        array[:p, :p] = noise[k]
        array[:p, p:] = H[k] @ S
        array[p:, p:] = S
        _triangularise(array)
        innovation[k] = array[:p, :p]
        gain[k] = array[p:, :p]
        S[:, :] = array[p:, p:]
    return innovation, gain


@plain_loop
def _forward(H, F, innovation, gain, index, rows):  # type: ignore[no-untyped-def]
    """w_k = iL_k (y_k - H_k a_k), a_{k+1} = F_{k+1} (a_k + gain_k w_k), for all columns of rows, in place."""
    n, p, q = H.shape
    width = rows.shape[2]
    a = np.zeros((q, width))
    new = np.zeros((q, width))
    for k in range(n):
        if k > 0:
            new[:, :] = 0.0
            for i in range(q):
                for j in range(q):
                    for c in range(width):
                        new[i, c] += F[k, i, j] * a[j, c]
            a[:, :] = new
        row = rows[index[k]]
        for i in range(p):
            for c in range(width):
                value = row[i, c]
                for j in range(q):
                    value -= H[k, i, j] * a[j, c]
                for j in range(i):
                    value -= innovation[k, i, j] * row[j, c]
                row[i, c] = value / innovation[k, i, i]
        for i in range(q):
            for j in range(p):
                for c in range(width):
                    a[i, c] += gain[k, i, j] * row[j, c]


@plain_loop
def _backward(H, F, innovation, gain, index, rows):  # type: ignore[no-untyped-def]
    """The transpose of `_forward`: f = F_{k+1}^T abar, t_k = L_k^-T (g_k + gain_k^T f), abar = f - H_k^T t_k."""
    n, p, q = H.shape
    width = rows.shape[2]
    bar = np.zeros((q, width))
    f = np.zeros((q, width))
    for k in range(n - 1, -1, -1):
        f[:, :] = 0.0
        if k < n - 1:
            for i in range(q):
                for j in range(q):
                    for c in range(width):
                        f[i, c] += F[k + 1, j, i] * bar[j, c]
        row = rows[index[k]]
        for i in range(p - 1, -1, -1):
            for c in range(width):
                value = row[i, c]
                for j in range(q):
                    value += gain[k, j, i] * f[j, c]
                for j in range(i + 1, p):
                    value -= innovation[k, j, i] * row[j, c]
                row[i, c] = value / innovation[k, i, i]
        for i in range(q):
            for c in range(width):
                value = f[i, c]
                for j in range(p):
                    value -= H[k, j, i] * row[j, c]
                bar[i, c] = value


@plain_loop
def _accumulate(H, F, Q, index, gain):  # type: ignore[no-untyped-def]
    """Backward sum a_k = H_k^T gain_k + F_{k+1}^T a_{k+1}: a_0 (q, w) and sum_k>0 a_k^T Q_k a_k (w, w)."""
    n, p, q = H.shape
    width = gain.shape[2]
    a = np.zeros((q, width))
    total = np.zeros((width, width))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            new = np.zeros((q, width))
            for i in range(q):
                for j in range(q):
                    for c in range(width):
                        new[i, c] += F[k + 1, j, i] * a[j, c]
            a = new
        for i in range(q):
            for j in range(p):
                for c in range(width):
                    a[i, c] += H[k, j, i] * gain[index[k], j, c]
        if k > 0:
            total += np.ascontiguousarray(a.T) @ (Q[k] @ a)
    return a, total
