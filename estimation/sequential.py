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

from nebosvod.errors import InputError
from nebosvod.estimation.estimate import Estimate, Solution, Status
from nebosvod.estimation.partition import Partition
from nebosvod.estimation.problem import LinearProblem
from nebosvod.estimation.sources import residual_after, weak_direction
from nebosvod.estimation.square_root import conditioning, covariance_factor, lower_factor, solve_rows, solve_square
from nebosvod.estimation.whitening import Whitener, projected, whitened_rows

Array = npt.NDArray[np.float64]
Gain = Literal["formal", "schmidt", "as_printed"]
GAINS = ("formal", "schmidt", "as_printed")


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
    if gate is not None:
        sweep.limit = 2.0 * float(gammaincinv(0.5 * problem.p, gate))
    for k in range(problem.n):
        sweep.take(k, rows[k], _fresh(problem, whitener, k), gain)
    return _estimate(problem, partition, sweep)


@dataclass(slots=True)
class _Sweep:
    """The running filter in unknowns y: estimate, claim P, cross C, errors by source."""

    size: int
    y: Array
    P: Array
    C: Array
    S: Array
    outside: Array
    common: Array  # (s_y, D) response of the error to the draws of all priors
    fresh: dict[str, Array]
    chi2: float = 0.0
    limit: float = np.inf
    rejected: int = 0

    @classmethod
    def start(cls, problem: LinearProblem, partition: Partition) -> "_Sweep":
        """Begin at the priors."""
        size = partition.n_unknowns
        draws = sum(source.draw.shape[1] for source in partition.sources)
        common, outside = np.zeros((size, draws)), np.zeros((len(partition.left_out), draws))
        first = 0
        for source in partition.sources:
            span = slice(first, first + source.draw.shape[1])
            count = source.inverse.shape[1]
            common[source.unknowns, span] = -(source.inverse @ source.draw[:count])
            outside[source.left_out, span] = source.draw[count:]
            first = span.stop
        zero = np.zeros((size, size))
        names = [*problem.noise_names, *(white.name for white in problem.white if white.treatment != "fixed")]
        return cls(
            size=size,
            y=np.zeros(size),
            P=np.eye(size),
            C=-common @ outside.T,
            S=outside @ outside.T,
            outside=outside,
            common=common,
            fresh=dict.fromkeys(names, zero),
        )

    def take(self, k: int, row: Array, fresh: dict[str, Array], rule: Gain) -> None:
        """Take in one whitened measurement (p, w): its assumed noise is I."""
        H, v, H_j = row[:, : self.size], row[:, self.size], row[:, self.size + 1 :]
        noise = np.eye(len(row))
        across = H @ self.P
        V = across @ H.T + noise
        if rule == "as_printed":
            noise = noise + H_j @ self.S @ H_j.T
            V = across @ H.T + noise
        elif rule == "schmidt":
            # C = cov(estimate - truth, assumed - truth), the sign that the innovation sees
            mixed = H @ self.C @ H_j.T
            V = V + mixed + mixed.T + H_j @ self.S @ H_j.T
            across = across + H_j @ self.C.T
        K = solve_square(V, across).T
        keep = np.eye(self.size) - K @ H
        innovation = v - H @ self.y
        nis = float(innovation @ solve_square(V, innovation))
        if nis > self.limit:
            self.rejected += 1
            return
        self.chi2 += nis
        self.y = self.y + K @ innovation
        if rule == "schmidt":
            cross = keep @ self.C @ H_j.T @ K.T
            self.P = _even(keep @ self.P @ keep.T - cross - cross.T + K @ (H_j @ self.S @ H_j.T + noise) @ K.T)
            self.C = keep @ self.C - K @ H_j @ self.S
        else:
            self.P = _even(keep @ self.P @ keep.T + K @ noise @ K.T)
        self.common = keep @ self.common + K @ (H_j @ self.outside)
        for name, part in self.fresh.items():
            moved = keep @ part @ keep.T
            self.fresh[name] = moved + K @ fresh[name] @ K.T if name in fresh else moved


def _fresh(problem: LinearProblem, whitener: Whitener, k: int) -> dict[str, Array]:
    """True covariances of the fresh sources at one measurement, in whitened components."""
    L = whitener.part(k, k + 1)
    out = {}
    label = 0 if problem.noise_label is None else int(problem.noise_label[k])
    out[problem.noise_names[label]] = problem.truth[0 if len(problem.truth) == 1 else k]
    for white in problem.white:
        if white.treatment == "fixed":
            continue
        for i in np.flatnonzero(white.rows == k):
            Q = white.truth if len(white.truth) == 1 else white.truth[i : i + 1]
            out[white.name] = projected(white.H[i : i + 1], Q)[0]
    return {name: _whiten_both(L, N) for name, N in out.items()}


def _whiten_both(L: Array, N: Array) -> Array:
    """L^-1 N L^-T for one measurement."""
    half = np.array(N)[None]
    solve_rows(L, half)
    other = np.ascontiguousarray(half.transpose(0, 2, 1))
    solve_rows(L, other)
    whitened: Array = other[0]
    return whitened


def _state_only(problem: LinearProblem) -> LinearProblem:
    """Leave out all estimated blocks but the first, as the printed filter does, and say so."""
    first = next(block for block in problem.blocks if block.treatment == "estimated")
    common = [b.name for b in problem.blocks if b is not first and b.treatment in ("estimated", "considered")]
    if common:
        warnings.warn(
            f"the filter as printed takes {', '.join(common)} as fresh noise at each measurement; its covariance is "
            "wrong when they are common to several (up to 13.6 times too small a sigma)",
            UserWarning,
            stacklevel=3,
        )
    blocks = tuple(
        replace(b, treatment="considered") if b is not first and b.treatment == "estimated" else b
        for b in problem.blocks
    )
    return replace(problem, blocks=blocks)


def _estimate(problem: LinearProblem, partition: Partition, sweep: _Sweep) -> Estimate:
    """Dress the end of a sweep as an Estimate."""
    mean = partition.mean + partition.T @ sweep.y
    pad = np.zeros((len(partition.left_out), sweep.size))
    base = np.vstack([partition.T, pad])
    factors = {name: base @ covariance_factor(_even(part), name) for name, part in sweep.fresh.items()}
    gains, first = {}, 0
    for source in partition.sources:
        span = slice(first, first + source.draw.shape[1])
        factors[source.name] = np.vstack([partition.T @ sweep.common[:, span], -sweep.outside[:, span]])
        gains[source.name] = factors[source.name] @ np.linalg.pinv(source.draw)
        first = span.stop
    claim = lower_factor(covariance_factor(sweep.P, "filter"))
    condition = conditioning(np.asarray(np.linalg.qr(np.linalg.pinv(claim), mode="r")))
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
        dof=problem.residual.size - sweep.rejected * problem.p,
        condition_number=condition.number,
        rank=condition.rank,
        weak_direction=weak_direction(problem, partition, condition),
        solution=solution,
        notes=(f"{sweep.rejected} of {problem.n} measurements left out by the gate",) if sweep.rejected else (),
    )


def _even(P: Array) -> Array:
    """Remove the asymmetry of round-off."""
    even: Array = 0.5 * (P + P.T)
    return even
