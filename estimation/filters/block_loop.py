"""The loop of the combined algorithm: block, equivalent measurement, filter, next block.

A Kalman filter carries a state whose first coordinates enter the measurements through a strongly nonlinear function (a
map). Measurements are gathered in a block that holds these coordinates still on a grid; when the block knows them as
well as they can be held still, it is condensed into one linear measurement, the filter takes that, and the next block
begins with the filter's new belief. After Stepanov (correlation-extreme navigation).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.combined import (
    MIN_EFFECTIVE,
    REACH,
    SINGULAR,
    EquivalentMeasurement,
    GridBlock,
    equivalent_measurement,
    with_drift,
)
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.refinement import STEEP, Refined, refine
from nebosvod.estimation.problem.square_root import covariance_factor, lower_factor, row_units, solve_square

Array = npt.NDArray[np.float64]
RIM = 1e-3  # weight on the edge of the grid that is worth a warning


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """Motion of the state to the epoch of a measurement, and the measurement y = h(x[:d]) + H x[d:] + v.

    Attributes
    ----------
    F, Q : shape (s, s), x' = F x + w from the epoch before. shift : shape (s,), added to x'; None = 0.
    observed : shape (p,).
    predict : takes values (g, d) of the nonlinear coordinates, returns h (g, p).
    H : shape (p, s - d), partials by the rest of the state. R : shape (p, p).
    """

    F: Array
    Q: Array
    observed: Array
    predict: Callable[[Array], Array]
    H: Array
    R: Array
    shift: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    """What a block gave.

    Attributes
    ----------
    belief : of the filter after it, at the epoch of its last measurement.
    before : of the filter at that epoch without it.
    block : moments of the block: nonlinear coordinates as their mean over the interval, then the rest at its end.
    first, last : numbers of its measurements in the order given, from 0.
    rows : of the equivalent measurement; 0 when it taught nothing.
    dQ : shape (d, d), how far the coordinates are from their mean over the interval, which the block holds still.
    drift : shape (d, d), covariance of their motion from the first measurement to the last, beyond what is predicted.
    effective : effective number of nodes.
    warnings : sentences; empty when the moments can be trusted.
    """

    belief: Belief
    before: Belief
    block: Belief
    first: int
    last: int
    rows: int
    dQ: Array
    drift: Array
    effective: float
    warnings: tuple[str, ...] = field(default=())


def follow(
    belief: Belief,
    steps: Iterable[Step],
    d: int,
    *,
    cell: npt.ArrayLike | None = None,
    points: int = 21,
    reach: float = REACH,
    longest: int = 50,
) -> Iterator[Condensed]:
    """Run the loop: yields what each block gave, as soon as it is condensed; the last block at the end of the steps.

    Parameters
    ----------
    belief : of the state (s,) before the first step; the first d components are the nonlinear ones, and uncertain.
    cell, points, reach : of the first grid of a block, see `refinement.refine`.
    longest : a block is condensed after so many measurements at the latest.

    Raises
    ------
    InputError
        If d does not fit the state, or `longest` is not positive.
    GeometryError
        If a nonlinear coordinate is known exactly, or no node of a block has a finite weight.

    Notes
    -----
    The moment: before a measurement is taken into a block, the drift of the coordinates from the block's beginning to
    that measurement is compared with the block's ellipse. When the ellipse is not wider than the drift in some
    direction (its minor semi-axis, where they drift alike in all), it resolves more than stands still: it is
    condensed first. Unlike `combined.ready`, which knows one drift, this does not ask for coordinates of one unit.

    The correction: a block that holds moving coordinates still measures their mean over its interval. The mean is a
    linear function of the state and the process noise on the way, so the filter carries it beside the state to the
    block's end and corrects both; R is raised by H dQ H^T for what the coordinates do about their mean. A drift whose
    rate the filter knows is in the mean of the prediction and costs nothing.

    References
    ----------
    Stepanov, combined algorithm of correlation-extreme navigation (Avtometriya), (31) and appendix A.
    """
    if not 1 <= d <= len(belief.mean):
        raise InputError(f"follow: {d} nonlinear coordinates of a state of {len(belief.mean)}")
    if longest < 1:
        raise InputError(f"follow: longest must be at least 1 (got {longest})")
    arc, grid = _Arc.begin(belief, d), None
    number = 0
    for number, step in enumerate(steps):
        ahead = arc.moved(step)
        if grid is not None:
            full = len(arc.steps) >= longest
            if full or _resolves(grid.block.moments().factor[:d], ahead.moved_by):
                done = arc.condense(grid, number - len(arc.steps))
                yield done
                ahead = _Arc.begin(done.belief, d).moved(step)
        arc = ahead
        grid = refine(arc.evaluate, arc.prior_of_grid, points=points, cell=cell, reach=reach)
    if grid is not None:
        yield arc.condense(grid, number + 1 - len(arc.steps))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Arc:
    """An open block: its steps, and the state at each as a mean (s,) and columns over common unit draws."""

    d: int
    means: tuple[Array, ...]
    factors: tuple[Array, ...]
    steps: tuple[Step, ...]

    @classmethod
    def begin(cls, belief: Belief, d: int) -> "_Arc":
        return cls(d=d, means=(belief.mean,), factors=(belief.factor,), steps=())

    def moved(self, step: Step) -> "_Arc":
        """With one more step; the state before the first of them is forgotten."""
        mean = step.F @ self.means[-1] + (0.0 if step.shift is None else step.shift)
        noise = covariance_factor(step.Q, "process noise")
        factor = np.hstack([step.F @ self.factors[-1], noise])
        known = slice(0 if self.steps else 1, None)
        old = tuple(np.pad(one, ((0, 0), (0, noise.shape[1]))) for one in self.factors[known])
        return replace(self, means=(*self.means[known], mean), factors=(*old, factor), steps=(*self.steps, step))

    @property
    def middle(self) -> Belief:
        """The coordinates' mean over the interval (d,), as mean and columns."""
        centre = np.mean([m[: self.d] for m in self.means], axis=0)
        return Belief(mean=centre, factor=np.mean([G[: self.d] for G in self.factors], axis=0))

    @property
    def prior_of_grid(self) -> Belief:
        return replace(self.middle, factor=lower_factor(self.middle.factor))

    @property
    def moved_by(self) -> Array:
        """Factor of the motion of the coordinates from the first to the last step."""
        return self.factors[-1][: self.d] - self.factors[0][: self.d]

    @property
    def dQ(self) -> Array:
        """Mean square of the coordinates about their mean over the interval, beyond what is predicted."""
        away = [G[: self.d] - self.middle.factor for G in self.factors]
        return np.asarray(np.mean([one @ one.T for one in away], axis=0), dtype=np.float64)

    def start(self, nodes: Array) -> GridBlock:
        """The rest at the first step, given the coordinates' mean over the interval."""
        d, middle = self.d, self.middle
        L = lower_factor(np.vstack([middle.factor, self.factors[0][d:]]))
        unit = solve_square(L[:d, :d], (nodes - middle.mean).T).T
        return GridBlock(
            nodes=nodes,
            log_weight=-0.5 * np.sum(unit**2, axis=1),
            mean=self.means[0][d:] + unit @ L[d:, :d].T,
            covariance=L[d:, d:] @ L[d:, d:].T,
        )

    def evaluate(self, nodes: Array, measured: bool = True) -> GridBlock:
        """The block on some nodes with all its measurements taken in."""
        d, block, centre = self.d, self.start(nodes), self.middle.mean
        for k, step in enumerate(self.steps):
            if k:
                block = _moved(block, step, self.means[k - 1][:d] - centre, d)
            if measured:
                there = nodes + (self.means[k][:d] - centre)
                block = block.update(step.observed, step.predict(there), step.H, step.R)
        return block

    def condense(self, grid: Refined, first: int) -> Condensed:
        """One linear measurement of the mean over the interval and the rest at the end, taken by the filter."""
        d, s = self.d, len(self.means[-1])
        posterior = grid.block.moments()
        linear = _of_the_uncertain(self._empty(), posterior)
        inner = np.zeros((s, s))
        inner[:d, :d] = self.dQ
        linear = with_drift(linear, inner)
        middle = self.middle
        both = Belief(
            mean=np.concatenate([self.means[-1], middle.mean]),
            factor=np.vstack([self.factors[-1], middle.factor]),
        )
        H = np.hstack([np.zeros((len(linear.y), d)), linear.H[:, d:], linear.H[:, :d]])
        after = both
        if len(linear.y):
            after, _ = kalman.update(both, linear.y - H @ both.mean, H, linear.R)
        return Condensed(
            belief=Belief(mean=after.mean[:s], factor=lower_factor(after.factor[:s])),
            before=Belief(mean=self.means[-1], factor=lower_factor(self.factors[-1])),
            block=posterior,
            first=first,
            last=first + len(self.steps) - 1,
            rows=len(linear.y),
            dQ=self.dQ,
            drift=self.moved_by @ self.moved_by.T,
            effective=grid.effective,
            warnings=_warnings(grid),
        )

    def _empty(self) -> Belief:
        """Moments of the block without its measurements, in closed form: what the posterior is compared with."""
        d = self.d
        middle, rest = self.middle, self.factors[0][d:]
        mean, factor = self.means[0][d:], lower_factor(np.vstack([middle.factor, rest]))
        nodes, rest = factor[:d], factor[d:]
        for before, step in zip(self.means, self.steps[1:]):
            shift = 0.0 if step.shift is None else step.shift[d:]
            mean = step.F[d:, d:] @ mean + step.F[d:, :d] @ before[:d] + shift
            noise = covariance_factor(step.Q[d:, d:], "process noise")
            rest = np.hstack([step.F[d:, d:] @ rest + step.F[d:, :d] @ nodes, noise])
            nodes = np.pad(nodes, ((0, 0), (0, noise.shape[1])))
        return Belief(mean=np.concatenate([middle.mean, mean]), factor=lower_factor(np.vstack([nodes, rest])))


def _of_the_uncertain(prior: Belief, posterior: Belief) -> EquivalentMeasurement:
    """The equivalent measurement; components that the ones before them determine are not among what is measured."""
    L = lower_factor(prior.factor)
    free = np.flatnonzero(np.diag(L) > SINGULAR * row_units(L))
    one, other = (Belief(mean=b.mean[free], factor=b.factor[free]) for b in (prior, posterior))
    found = equivalent_measurement(one, other)
    H = np.zeros((len(found.y), len(L)))
    H[:, free] = found.H
    return replace(found, H=H)


def _resolves(ellipse: Array, drift: Array) -> bool:
    """Whether an ellipse is not wider than a drift in some direction, both given by factors (d, .)."""
    square = lower_factor(ellipse)
    if not (np.diag(square) > 0.0).all():
        return True
    return bool(np.linalg.svd(solve_square(square, drift), compute_uv=False)[0] >= 1.0)


def _moved(block: GridBlock, step: Step, ahead: Array, d: int) -> GridBlock:
    """The rest moved to the next step while the coordinates stand still, `ahead` of the nodes at the step before."""
    moved = block.move(step.F[d:, d:], step.Q[d:, d:])
    shift = 0.0 if step.shift is None else step.shift[d:]
    return replace(moved, mean=moved.mean + (block.nodes + ahead) @ step.F[d:, :d].T + shift)


def _warnings(grid: Refined) -> tuple[str, ...]:
    """Why the moments of a grid are not to be trusted."""
    said = []
    if grid.effective < MIN_EFFECTIVE:
        said.append(f"{grid.effective:.1f} effective nodes carry the weight (at least {MIN_EFFECTIVE:.0f} are needed)")
    if grid.steepness > STEEP:
        said.append(f"neighbouring nodes differ by {grid.steepness:.1f} in log weight: cells wider than the posterior")
    if grid.rim > RIM:
        said.append(f"{100 * grid.rim:.1f} % of the weight lies on the edge of the grid: the prior is too narrow")
    return tuple(said)
