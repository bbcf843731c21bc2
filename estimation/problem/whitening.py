"""The assumed noise of all measurements together, as an operator that whitens rows in O(n).

Assumed noise = measurement noise + white nuisances that are estimated (their covariance belongs to the weights
and they need no unknowns of their own) + time-correlated nuisances that are estimated. With Sigma = L L^T,
`whiten` applies L^-1 and `adjoint` L^-T: together the weight matrix, which is never formed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.problem.markov import Chain, ChainFilter, merge
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem, White
from nebosvod.estimation.problem.square_root import cholesky_rows, solve_rows, solve_rows_transposed

Array = npt.NDArray[np.float64]
CHUNK = 8192  # measurements; whitened rows of one chunk stay in the second-level cache


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whitener:
    """Assumed noise of a problem, factored.

    Attributes
    ----------
    L : shape (n or 1, p, p), Cholesky factors of noise plus estimated white nuisances.
    chains : time-correlated nuisances, merged where they touch the same measurement, as factored filters.
    """

    L: Array
    chains: tuple[ChainFilter, ...]

    @classmethod
    def of(cls, problem: LinearProblem) -> "Whitener":
        """Factor the assumed noise; a measurement whose noise is singular raises InputError."""
        inside = [white for white in problem.white if white.treatment == "estimated"]
        total = problem.R
        if inside:
            total = np.array(np.broadcast_to(problem.R, (problem.n, problem.p, problem.p)))
            for white in inside:
                add_white(total, white, white.Q)
        L = cholesky_rows(total, "noise")
        chains = merge([markov for markov in problem.markov if markov.treatment == "estimated"])
        return cls(L=L, chains=tuple(Chain.filtered(chain, L) for chain in chains))

    def part(self, start: int, stop: int) -> Array:
        """Factors of the measurements start..stop."""
        return self.L if len(self.L) == 1 else self.L[start:stop]

    def whiten(self, rows: Array) -> None:
        """Replace rows (n, p, w) of all measurements by L^-1 rows in place."""
        free = np.ones(len(rows), dtype=bool)
        for chain in self.chains:
            free[chain.rows] = False
            chain.whiten(rows)
        self._solve_free(free, rows, solve_rows)

    def adjoint(self, rows: Array) -> None:
        """Replace rows (n, p, w) by L^-T rows in place; all measurements at once when there are chains."""
        free = np.ones(len(rows), dtype=bool)
        for chain in self.chains:
            free[chain.rows] = False
            chain.adjoint(rows)
        self._solve_free(free, rows, solve_rows_transposed)

    def adjoint_part(self, start: int, stop: int, rows: Array) -> None:
        """Apply L^-T in place to the rows of measurements start..stop; only when there are no chains."""
        solve_rows_transposed(self.part(start, stop), rows)

    def _solve_free(self, free: npt.NDArray[np.bool_], rows: Array, solve: Callable[[Array, Array], None]) -> None:
        """Solve with the block factors where no chain passes."""
        if free.any():
            part = rows[free]
            solve(self.L if len(self.L) == 1 else self.L[free], part)
            rows[free] = part


def chunks(n: int, size: int = CHUNK) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) that cover 0..n."""
    for start in range(0, n, size):
        yield start, min(start + size, n)


def add_white(total: Array, white: White, Q: Array) -> None:
    """Add H Q H^T of a white nuisance to the stack total (n, p, p) in place, chunk by chunk."""
    p = white.H.shape[1]
    for start, stop in chunks(len(white.rows)):
        added = projected(white.H[start:stop], Q if len(Q) == 1 else Q[start:stop])
        for i in range(p):
            for j in range(p):
                total[white.rows[start:stop], i, j] += added[:, i, j]


def projected(H: Array, Q: Array) -> Array:
    """Return H Q H^T (n, p, p) for H (n, p, q) and Q (n or 1, q, q)."""
    HQ = (H.reshape(-1, H.shape[2]) @ Q[0]).reshape(H.shape) if len(Q) == 1 else np.einsum("npq,nqr->npr", H, Q)
    p = H.shape[1]
    out = np.empty((len(H), p, p))
    for i in range(p):
        for j in range(i + 1):
            out[:, i, j] = out[:, j, i] = np.einsum("nq,nq->n", HQ[:, i], H[:, j])
    return out


def whitened_rows(problem: LinearProblem, partition: Partition, whitener: Whitener) -> Array:
    """Assemble and whiten the rows [H T | v | H_left_out], shape (n, p, s_y + 1 + s_j).

    v is the residual after the assumed means of all parameters.
    """
    rows = _assembled(problem, partition, partition.T, None if whitener.chains else whitener)
    if whitener.chains:
        whitener.whiten(rows)
    return rows


def raw_rows(problem: LinearProblem, partition: Partition) -> Array:
    """Assemble the rows [H | v | H_left_out] in the parameters' own units, not whitened."""
    return _assembled(problem, partition, np.eye(len(partition.estimated)), None)


def _assembled(problem: LinearProblem, partition: Partition, T: Array, whitener: Whitener | None) -> Array:
    """Fill the rows chunk by chunk, whitening each while it is in the cache."""
    n, p, size = problem.n, problem.p, T.shape[1]
    rows = np.zeros((n, p, size + 1 + len(partition.left_out)))
    plan = _plan(problem, partition, T)
    for start, stop in chunks(n):
        part = rows[start:stop]
        part[:, :, size] = problem.residual[start:stop]
        for H, columns, spread, mean in plan:
            block = H[start:stop].reshape(-1, H.shape[2])
            part[:, :, columns] += (block @ spread).reshape(stop - start, p, -1)
            if mean.any():
                part[:, :, size] -= (block @ mean).reshape(stop - start, p)
        if whitener is not None:
            solve_rows(whitener.part(start, stop), part)
    return rows


def _plan(problem: LinearProblem, partition: Partition, T: Array) -> list[tuple[Array, slice, Array, Array]]:
    """For each block: its H, the span of columns it fills, the matrix onto them, its assumed mean."""
    place = {name: index for index, name in enumerate(partition.estimated)}
    place_out = {name: index for index, name in enumerate(partition.left_out)}
    plan = []
    for block in problem.blocks:
        if block.treatment == "fixed":
            continue
        if block.treatment == "estimated":
            index = [place[name] for name in block.names]
            spread, mean, shift = T[index], partition.mean[index], 0
        else:
            index = [place_out[name] for name in block.names]
            spread = np.eye(len(partition.left_out))[index]
            mean, shift = partition.left_out_mean[index], T.shape[1] + 1
        used = np.flatnonzero(spread.any(axis=0))
        first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, 0)
        plan.append((block.H, slice(shift + first, shift + last), np.ascontiguousarray(spread[:, first:last]), mean))
    return plan
