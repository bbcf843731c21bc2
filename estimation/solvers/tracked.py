"""The augmented filter over a `LinearProblem` with everything it went through: beliefs, innovations, smoothed beliefs.

Its state is every estimated parameter and, beside them, the values of the time-correlated nuisances, which move from
one measurement to the next. Parameters stand still, so its last belief of them is the batch's; what it believed on the
way, what each measurement told, and what a nuisance was when, is what the other solvers do not keep.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.smoother import smooth
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem, Markov
from nebosvod.estimation.problem.square_root import covariance_factor, lower_factor
from nebosvod.estimation.problem.whitening import Whitener, raw_rows

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """A time-correlated nuisance in the state: its columns, and the row of the measurement to which each step leads."""

    name: str
    span: slice
    place: dict[int, int]
    F: Array
    Q: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moving:
    """A linear problem as a system that moves: s' = F s + w between measurements, residual = H s + v at each.

    Attributes
    ----------
    names : of the w components of s: the estimated parameters in the order of the blocks, then `NAME 0`, `NAME 1` ...
        of each time-correlated nuisance that is estimated.
    mean, factor : (w,) and (w, w), what is known of s before the first measurement.
    residual : (n, p), after the assumed means of the parameters left out. H : (n, p, w).
    R : (n, p, p) noise with the white nuisances that are estimated.
    chains : the nuisances that move.
    """

    names: tuple[str, ...]
    mean: Array
    factor: Array
    residual: Array
    H: Array
    R: Array
    chains: tuple[Chain, ...]

    @classmethod
    def of(cls, problem: LinearProblem) -> "Moving":
        """See a problem, rows in time order, as a system.

        Raises
        ------
        InputError
            If an estimated parameter has no prior: a covariance of what is not known is not a number.
        """
        partition = Partition.of(problem)
        if partition.n_free:
            raise InputError(
                "a filter that keeps its covariance needs a prior for every estimated parameter; "
                "recursive.solve does without"
            )
        slow = [markov for markov in problem.markov if markov.treatment == "estimated"]
        s = len(partition.estimated)
        ends = s + np.cumsum([0, *(markov.P0.shape[0] for markov in slow)])
        spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
        rows = raw_rows(problem, partition)
        H = np.zeros((problem.n, problem.p, int(ends[-1])))
        H[:, :, :s] = rows[:, :, :s]
        factors = [partition.T, *(covariance_factor(markov.P0, markov.name) for markov in slow)]
        wide = np.zeros((int(ends[-1]), sum(factor.shape[1] for factor in factors)))
        first = 0
        for span, factor in zip([slice(0, s), *spans], factors):
            wide[span, first : first + factor.shape[1]] = factor
            first += factor.shape[1]
        for markov, span in zip(slow, spans):
            H[markov.rows, :, span] = markov.H
        L = Whitener.of(replace(problem, markov=())).L
        names = [f"{markov.name} {i}" for markov in slow for i in range(markov.P0.shape[0])]
        mean = np.concatenate([partition.mean, np.zeros(len(names))])
        return cls(
            names=(*partition.estimated, *names),
            mean=mean,
            factor=lower_factor(wide),
            # raw rows count from the assumed means of the estimated parameters
            residual=rows[:, :, s] + H @ mean,
            H=H,
            R=np.broadcast_to(L @ L.transpose(0, 2, 1), (problem.n, problem.p, problem.p)),
            chains=tuple(_chain(markov, span) for markov, span in zip(slow, spans)),
        )

    @property
    def prior(self) -> Belief:
        """What is known before the first measurement."""
        return Belief(mean=self.mean, factor=self.factor)

    def step(self, k: int) -> tuple[Array, Array] | None:
        """F and Q (w, w) that lead to measurement k; None where everything stands still."""
        moved = [(chain, chain.place[k]) for chain in self.chains if chain.place.get(k)]
        if not moved:
            return None
        F, Q = np.eye(len(self.names)), np.zeros((len(self.names), len(self.names)))
        for chain, i in moved:
            F[chain.span, chain.span], Q[chain.span, chain.span] = chain.F[i], chain.Q[i]
        return F, Q

    def carried(self, belief: Belief, k: int) -> Belief:
        """The belief before measurement k from that after the one before."""
        step = self.step(k)
        return belief if step is None else kalman.predict(belief, *step)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """What a filter believed after each of n measurements, and what each told it.

    Attributes
    ----------
    names : of the w components, as of `Moving`.
    mean : (n, w). factor : (n, w, w), covariance = factor factor^T.
    innovation : (n, p), observed minus predicted; spread : (n, p, p) factor of its covariance.
    """

    names: tuple[str, ...]
    mean: Array
    factor: Array
    innovation: Array
    spread: Array

    @classmethod
    def empty(cls, moving: Moving) -> "Track":
        """Room for what a filter of this system will believe."""
        n, p, w = moving.H.shape
        return cls(
            names=moving.names,
            mean=np.empty((n, w)),
            factor=np.empty((n, w, w)),
            innovation=np.empty((n, p)),
            spread=np.empty((n, p, p)),
        )

    def keep(self, k: int, belief: Belief, seen: kalman.Innovation, residual: Array) -> None:
        """Fill the row of measurement k."""
        self.mean[k], self.factor[k] = belief.mean, belief.factor
        self.innovation[k], self.spread[k] = residual, seen.factor

    def covariance(self, W: Array, names: Sequence[str]) -> Array:
        """Covariances (n, d, d) of W x after each measurement, W (d, k) or (n, d, k) by the named components."""
        place = [self.names.index(name) for name in names]
        wide = W @ self.factor[:, place]
        return np.asarray(wide @ wide.transpose(0, 2, 1), dtype=np.float64)


def follow(moving: Moving) -> Track:
    """Filter all measurements in order, in square-root form.

    Notes
    -----
    About 0.1 ms a measurement; the last belief of the parameters equals the batch.
    """
    track = Track.empty(moving)
    belief = moving.prior
    for k in range(len(moving.residual)):
        belief = moving.carried(belief, k)
        told = moving.residual[k] - moving.H[k] @ belief.mean
        belief, seen = kalman.update(belief, told, moving.H[k], moving.R[k])
        track.keep(k, belief, seen, told)
    return track


def smoothed(moving: Moving, track: Track) -> Track:
    """The beliefs at each measurement from all measurements, those after it too (Rauch, Tung, Striebel).

    Where nothing moves that is the last belief, everywhere. Innovations are those of the filter.

    References
    ----------
    Rauch, Tung, Striebel 1965, AIAA Journal 3, 1445.
    """
    n = len(track.mean)
    if not moving.chains:
        last = slice(n - 1, n)
        return replace(track, mean=np.repeat(track.mean[last], n, 0), factor=np.repeat(track.factor[last], n, 0))
    still = np.eye(len(moving.names))
    steps = [moving.step(k) for k in range(1, n)]
    beliefs = [Belief(mean=mean, factor=factor) for mean, factor in zip(track.mean, track.factor)]
    found = smooth(
        beliefs,
        [still if step is None else step[0] for step in steps],
        [None if step is None else step[1] for step in steps],
    )
    return replace(track, mean=np.array([b.mean for b in found]), factor=np.array([b.factor for b in found]))


def _chain(markov: Markov, span: slice) -> Chain:
    """The first row has no step: the nuisance begins there with its own covariance."""
    return Chain(
        name=markov.name,
        span=span,
        place={int(row): i for i, row in enumerate(markov.rows) if i},
        F=markov.F,
        Q=markov.Q,
    )
