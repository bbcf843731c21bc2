"""Covariance-form filters over a `LinearProblem`, one gain after another, with the honest budget of any gain.

Three rules for the gain: `formal` (Joseph form; equals the batch for whatever is estimated and considered),
`schmidt` (the gain knows the groups left out; greedy, depends on the order of the data) and `as_printed`, which is
(2.139) of Guo and Ivashkin: common nuisances taken as fresh noise at each step, right for white nuisances only.
Whatever the gain, its true error is followed source by source:
    M_g <- (I - K H) M_g + K H_g for common sources, P_g <- (I - K H) P_g (I - K H)^T + K N_g K^T for fresh ones.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

from nebosvod.borders.compiled import plain_loop
from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate, Solution, Status
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import not_observable, prior_draws, residual_after, weak_direction
from nebosvod.estimation.problem.square_root import (
    append_rows,
    conditioning,
    gram_factor,
    left_inverse,
    solve_lower,
    solve_rows,
)
from nebosvod.estimation.problem.whitening import Whitener, projected, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Gain = Literal["formal", "schmidt", "as_printed"]
GAINS = ("formal", "schmidt", "as_printed")
LOST = 1e-13  # smallest over largest eigenvalue of a covariance in which round-off is a thousandth of the smallest
UNRESOLVED = "The covariance form of the filter has lost the digits of this problem; recursive.solve keeps them."


def solve(problem: LinearProblem, gain: Gain = "formal", gate: float | None = None) -> Estimate:
    """Process the measurements in order with a chosen rule for the gain.

    Parameters
    ----------
    problem : every estimated parameter needs a prior here; time-correlated nuisances are for `recursive`.
    gain : "formal", "schmidt" (groups left out are known to the gain; K_formal is then its own claim), or
        "as_printed" (all but the state is left out and counted as fresh noise; warns, K_formal is what it claims).
    gate : probability of a good measurement to pass (e.g. 0.999); one whose innovation lies outside is not used, and
        the estimate's notes count them. None = use all.

    Raises
    ------
    InputError
        If a parameter has no prior or a nuisance is time-correlated: use `recursive.solve`.

    References
    ----------
    Guo, Ivashkin 2018, section 2.7; Tapley, Schutz, Born 2004, chapter 6.
    """
    if gain not in GAINS:
        raise InputError(f"gain must be one of {', '.join(GAINS)}, got {gain!r}")
    if gain == "as_printed":
        problem = _state_only(problem)
    partition = Partition.of(problem)
    if partition.n_free or any(markov.treatment != "fixed" for markov in problem.markov):
        raise InputError(
            "this filter needs a prior for every estimated parameter and no time-correlated nuisance; "
            "recursive.solve does without"
        )
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    sweep = _Sweep.start(problem, partition)
    limit = np.inf if gate is None else 2.0 * float(gammaincinv(0.5 * problem.p, gate))
    sweep.run(rows, _Fresh.of(problem, whitener), gain, limit)
    if not resolved(sweep.P):
        width = rows.shape[2]
        triangle = append_rows(prior_rows(partition, width), rows.reshape(-1, width))
        return not_observable(problem, partition, conditioning(triangle[: sweep.size, : sweep.size]), UNRESOLVED)
    return _estimate(problem, partition, sweep)


@dataclass(slots=True)
class _Sweep:
    """The running filter in unknowns y: estimate, claim P, cross C, errors by source; the kernel changes the arrays."""

    size: int
    y: Array
    P: Array
    C: Array
    S: Array
    outside: Array
    common: Array  # (s_y, D) response of the error to the draws of all priors
    fresh: Array  # (number of fresh sources, s_y, s_y)
    chi2: float = 0.0
    rejected: int = 0

    @classmethod
    def start(cls, problem: LinearProblem, partition: Partition) -> "_Sweep":
        """Begin at the priors."""
        size = partition.n_unknowns
        common, outside = prior_draws(partition)
        return cls(
            size=size,
            y=np.zeros((size, 1)),
            P=np.eye(size),
            C=-common @ outside.T,
            S=outside @ outside.T,
            outside=outside,
            common=common,
            fresh=np.zeros((len(_fresh_names(problem)), size, size)),
        )

    def run(self, rows: Array, fresh: "_Fresh", gain: Gain, limit: float) -> None:
        """Take in all whitened rows (n, p, w): their assumed noise is I."""
        state = (self.y, self.P, self.C, self.common, self.fresh)
        entries = (fresh.first, fresh.source, fresh.N)
        found = _filter(rows, state, self.S, self.outside, entries, GAINS.index(gain), limit)
        self.y, self.P, self.common, self.chi2, self.rejected = found


# The kernel is written in products and sums of small plain matrices: array expressions, slices and the library's
# solver would compile five times as long and run no faster.


@plain_loop
def _times(A, B):  # type: ignore[no-untyped-def]
    """A B."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out


@plain_loop
def _turned(A):  # type: ignore[no-untyped-def]
    """A^T as a plain matrix."""
    out = np.zeros((A.shape[1], A.shape[0]))
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[j, i] = A[i, j]
    return out


@plain_loop
def _add(A, B, factor):  # type: ignore[no-untyped-def]
    """A <- A + factor B."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] += factor * B[i, j]


@plain_loop
def _copy(A, out):  # type: ignore[no-untyped-def]
    """out <- A."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j]


@plain_loop
def _between(A, P):  # type: ignore[no-untyped-def]
    """A P A^T without the asymmetry of round-off."""
    out = _times(_times(A, P), _turned(A))
    for i in range(len(out)):
        for j in range(i):
            out[i, j] = out[j, i] = 0.5 * (out[i, j] + out[j, i])
    return out


@plain_loop
def _solve(V, B):  # type: ignore[no-untyped-def]
    """iV B for a small positive definite V, by Cholesky; V and B are destroyed."""
    for j in range(len(V)):
        for k in range(j):
            V[j, j] -= V[j, k] * V[j, k]
        V[j, j] = np.sqrt(V[j, j])
        for i in range(j + 1, len(V)):
            for k in range(j):
                V[i, j] -= V[i, k] * V[j, k]
            V[i, j] /= V[j, j]
    for c in range(B.shape[1]):
        for i in range(len(V)):
            for k in range(i):
                B[i, c] -= V[i, k] * B[k, c]
            B[i, c] /= V[i, i]
        for i in range(len(V) - 1, -1, -1):
            for k in range(i + 1, len(V)):
                B[i, c] -= V[k, i] * B[k, c]
            B[i, c] /= V[i, i]
    return B


@plain_loop
def _split(rows, k, size):  # type: ignore[no-untyped-def]
    """H (p, s_y), v (p, 1) and H_j (p, s_j) of one measurement."""
    p, width = rows.shape[1:]
    H, v, H_j = np.zeros((p, size)), np.zeros((p, 1)), np.zeros((p, width - size - 1))
    for i in range(p):
        for j in range(size):
            H[i, j] = rows[k, i, j]
        v[i, 0] = rows[k, i, size]
        for j in range(size + 1, width):
            H_j[i, j - size - 1] = rows[k, i, j]
    return H, v, H_j


@plain_loop
def _filter(rows, state, S, outside, fresh, rule, limit):  # type: ignore[no-untyped-def]
    """Run the filter over all rows; returns y, P, common, chi2 and the number of rejected measurements."""
    y, P, C, common, parts = state
    first, source, N = fresh
    chi2, rejected = 0.0, 0
    for k in range(len(rows)):
        H, v, H_j = _split(rows, k, len(y))
        noise, across = np.eye(len(v)), _times(H, P)
        if rule > 0:
            _add(noise, _between(H_j, S), 1.0)
        V = _times(across, _turned(H))
        _add(V, noise, 1.0)
        if rule == 1:  # C = cov(estimate - truth, assumed - truth), the sign that the innovation sees
            mixed = _times(_times(H, C), _turned(H_j))
            _add(V, mixed, 1.0)
            _add(V, _turned(mixed), 1.0)
            _add(across, _times(H_j, _turned(C)), 1.0)
        _add(v, _times(H, y), -1.0)
        nis = _times(_turned(v), _solve(V.copy(), v.copy()))[0, 0]
        if nis > limit:
            rejected += 1
            continue
        chi2 += nis
        K, keep = _turned(_solve(V, across)), np.eye(len(y))
        _add(keep, _times(K, H), -1.0)
        _add(y, _times(K, v), 1.0)
        P = _between(keep, P)
        _add(P, _between(K, noise), 1.0)
        if rule == 1:
            cross = _times(_times(_times(keep, C), _turned(H_j)), _turned(K))
            _add(P, cross, -1.0)
            _add(P, _turned(cross), -1.0)
            C = _times(keep, C)
            _add(C, _times(K, _times(H_j, S)), -1.0)
        common = _times(keep, common)
        _add(common, _times(K, _times(H_j, outside)), 1.0)
        for i in range(len(parts)):
            _copy(_between(keep, parts[i]), parts[i])
        for i in range(first[k], first[k + 1]):
            _add(parts[source[i]], _between(K, N[i]), 1.0)
    return y, P, common, chi2, rejected


def _fresh_names(problem: LinearProblem) -> list[str]:
    """Names of the sources that are drawn anew at each measurement."""
    return [*problem.noise_names, *(white.name for white in problem.white if white.treatment != "fixed")]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fresh:
    """True covariances N (e, p, p) of the fresh sources in whitened components; those of measurement k are the
    entries first[k]..first[k + 1], each of the source numbered source[i]."""

    first: IntArray
    source: IntArray
    N: Array

    @classmethod
    def of(cls, problem: LinearProblem, whitener: Whitener) -> "_Fresh":
        """Collect noise and white nuisances and sort them by measurement."""
        n, p = problem.n, problem.p
        label = np.zeros(n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
        rows, sources = [np.arange(n)], [label]
        covariances = [np.broadcast_to(problem.truth, (n, p, p))]
        live = [white for white in problem.white if white.treatment != "fixed"]
        for index, white in enumerate(live, start=len(problem.noise_names)):
            rows.append(white.rows)
            sources.append(np.full(len(white.rows), index, dtype=np.int64))
            covariances.append(projected(white.H, white.truth))
        row = np.concatenate(rows)
        order = np.argsort(row, kind="stable")
        N, row = np.concatenate(covariances)[order], row[order]
        L = whitener.L if len(whitener.L) == 1 else whitener.L[row]
        for _ in range(2):  # L^-1 N, then its transpose likewise
            solve_rows(L, N)
            N = np.ascontiguousarray(N.transpose(0, 2, 1))
        first = np.searchsorted(row, np.arange(n + 1))
        return cls(first=first, source=np.concatenate(sources)[order], N=N)


def as_printed_takes_afresh(problem: LinearProblem) -> str:
    """What the filter as printed gets wrong in this problem, in a sentence; empty where it is right."""
    first = next(block for block in problem.blocks if block.treatment == "estimated")
    common = [b.name for b in problem.blocks if b is not first and b.treatment in ("estimated", "considered")]
    if not common:
        return ""
    return (
        f"the filter as printed takes {', '.join(common)} as fresh noise at each measurement; its covariance is "
        "wrong when they are common to several (up to 13.6 times too small a sigma)"
    )


def _state_only(problem: LinearProblem) -> LinearProblem:
    """Leave out all estimated blocks but the first, as the printed filter does, and say so."""
    first = next(block for block in problem.blocks if block.treatment == "estimated")
    if said := as_printed_takes_afresh(problem):
        warnings.warn(said, UserWarning, stacklevel=3)
    blocks = tuple(
        replace(b, treatment="considered") if b is not first and b.treatment == "estimated" else b
        for b in problem.blocks
    )
    return replace(problem, blocks=blocks)


def resolved(P: Array) -> bool:
    """Whether a covariance that was updated many times still has digits in its smallest direction."""
    if not np.isfinite(P).all():
        return False
    values = np.linalg.eigvalsh(P)
    return not values.size or bool(values[0] > LOST * values[-1])


def _estimate(problem: LinearProblem, partition: Partition, sweep: _Sweep) -> Estimate:
    """Dress the end of a sweep as an Estimate."""
    mean = partition.mean + partition.T @ sweep.y[:, 0]
    pad = np.zeros((len(partition.left_out), sweep.size))
    base = np.vstack([partition.T, pad])
    factors = {name: base @ gram_factor(part) for name, part in zip(_fresh_names(problem), sweep.fresh)}
    gains, first = {}, 0
    for source in partition.sources:
        span = slice(first, first + source.draw.shape[1])
        factors[source.name] = np.vstack([partition.T @ sweep.common[:, span], -sweep.outside[:, span]])
        gains[source.name] = factors[source.name] @ left_inverse(source.draw)
        first = span.stop
    claim = np.asarray(np.linalg.cholesky(sweep.P), dtype=np.float64)
    condition = conditioning(np.asarray(np.linalg.qr(solve_lower(claim, np.eye(sweep.size)), mode="r")))
    solution = Solution(
        mean=mean,
        mean_left_out=partition.left_out_mean,
        S_formal=partition.T @ claim,
        factors=factors,
        gains=gains,
        gain_names={source.name: source.names for source in partition.sources},
        residual_after=residual_after(problem, partition, mean),
        chi2=sweep.chi2,
    )
    return Estimate(
        names=partition.estimated,
        left_out=partition.left_out,
        status=Status.CONVERGED,
        message=Status.CONVERGED.sentence,
        dof=problem.counted - sweep.rejected * problem.p,
        condition_number=condition.number,
        rank=condition.rank,
        weak_direction=weak_direction(problem, partition, condition),
        solution=solution,
        notes=(f"{sweep.rejected} of {problem.n} measurements left out by the gate",) if sweep.rejected else (),
    )
