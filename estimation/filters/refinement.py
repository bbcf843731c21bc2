"""A grid that is refined where a posterior lives, one bump of it or many, until its cells resolve it.

`combined.adapt` follows one ridge by turning a single grid. A wide prior over a map has many places that look alike,
and a posterior thousands of times smaller: here cells that carry weight are split, those that do not are dropped,
and what is too sharp for the present cells is taken in part (tempered) until they are small enough.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters.combined import MIN_EFFECTIVE, REACH, SINGULAR, GridBlock
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem.square_root import lower_factor, row_units

Array = npt.NDArray[np.float64]
LEAST = 1e-8  # a cell of a smaller part of the largest weight is dropped: beyond 6 sigmas of a normal posterior
STEEP = 1.0  # mean difference of log weights of neighbours up to which a grid resolves: cells of about one sigma
MOST = 20_000  # cells of a grid
WORTHLESS = 1e4  # in log weight below all others


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refined:
    """A block on cells of one size, and how far to trust its moments.

    Attributes
    ----------
    block : on the finest grid.
    effective : effective number of nodes, 1 / sum w^2.
    stages : grids that were laid.
    steepness : mean difference of the log weights of neighbours; above 1 the cells are wider than the posterior.
    rim : weight on the outermost cells of the first grid: the prior does not reach far enough.
    """

    block: GridBlock
    effective: float
    stages: int
    steepness: float
    rim: float

    @property
    def resolved(self) -> bool:
        """Whether enough nodes carry the weight, without jumps from one to the next."""
        return self.effective >= MIN_EFFECTIVE and self.steepness <= STEEP


def refine(
    evaluate: Callable[[Array], GridBlock],
    prior: Belief,
    *,
    points: int = 21,
    cell: npt.ArrayLike | None = None,
    reach: float = REACH,
    limit: int = 25,
) -> Refined:
    """Lay a grid over a Gaussian prior and refine it where the posterior lives.

    Parameters
    ----------
    evaluate : takes nodes (g, d), returns the block with their log weights: prior density (normal, mean and covariance
        of `prior`) times likelihood. Nodes with no finite weight, such as those off the chart, count nothing.
    prior : of the d nonlinear coordinates.
    points : nodes of the first grid along each axis at least, to `reach` sigmas.
    cell : largest spacing of the first grid, one for all coordinates or shape (d,): the length over which a map
        changes, for what falls between the nodes is not found again. None = `points` nodes, however wide the prior.
    limit : grids at most.

    Raises
    ------
    InputError
        If the first grid would have more than 20 000 nodes.
    GeometryError
        If the prior is singular, or no node has a finite weight.

    Notes
    -----
    At each stage the likelihood is raised to the largest power <= 1 that leaves 30 effective nodes; the nodes with
    weight at that power are kept and each is split into 2^d. The power is 1 when the cells are small enough. All nodes
    of a grid stand for cells of one size, so weights are densities.
    """
    d = len(prior.mean)
    if d < 1 or points < 5:
        raise InputError(f"refine: needs at least one coordinate and five points, got {d} and {points}")
    L = lower_factor(prior.factor)
    if not (np.diag(L) > SINGULAR * row_units(L)).all():
        raise GeometryError("refine: the prior covariance is singular")
    if cell is not None:
        wide = float(np.max(np.linalg.norm(L, axis=1) / np.asarray(cell, dtype=np.float64)))
        points = max(points, 2 * math.ceil(reach * wide) + 1)
        if points**d > MOST:
            raise InputError(f"refine: {points}^{d} nodes are too many for cells of {cell} (at most {MOST})")
    axis = np.linspace(-reach, reach, points)
    # spread so that the bare grid has the moments of the prior (`GridBlock.of_prior`)
    bare = np.exp(-0.5 * axis**2)
    axis = axis / np.sqrt(bare @ axis**2 / bare.sum())
    unit = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(1, -1, d)
    shape, size = (points,) * d, float(axis[1] - axis[0])
    corners = np.stack(np.meshgrid(*[[-0.25, 0.25]] * d, indexing="ij"), axis=-1).reshape(1, -1, d)
    edge = axis[-1] - 0.5 * size
    for stage in range(1, limit + 1):
        flat = unit.reshape(-1, d)
        block = _sound(evaluate(prior.mean + flat @ L.T))
        tempered, power = _tempered(block.log_weight, -0.5 * np.sum(flat**2, axis=1))
        rim = float(block.weight[(np.abs(flat) > edge).any(axis=1)].sum())
        steepness = _steepness(block.log_weight, block.weight, shape)
        found = Refined(block=block, effective=block.effective, stages=stage, steepness=steepness, rim=rim)
        if (power == 1.0 and found.resolved) or stage == limit:
            break
        kept = flat[_heaviest(tempered, MOST // 2**d)]
        unit, shape, size = kept[:, None] + size * corners, (2,) * d, 0.5 * size
    return found


def _sound(block: GridBlock) -> GridBlock:
    """The block with nodes of no finite weight made worthless."""
    good = np.isfinite(block.log_weight) & np.isfinite(block.mean).all(axis=1)
    if good.all():
        return block
    if not good.any():
        raise GeometryError("refine: no node has a finite weight: the grid lies off the chart")
    floor = block.log_weight[good].min() - WORTHLESS
    return replace(
        block,
        log_weight=np.where(good, block.log_weight, floor),
        mean=np.where(good[:, None], block.mean, 0.0),
    )


def _tempered(log_weight: Array, log_prior: Array) -> tuple[Array, float]:
    """Normalised weights with the likelihood to the largest power that leaves enough effective nodes, and the power."""
    likelihood = log_weight - log_prior

    def at(power: float) -> Array:
        logs = log_prior + power * likelihood
        raw = np.exp(logs - logs.max())
        normalised: Array = raw / raw.sum()
        return normalised

    whole = at(1.0)
    if 1.0 / np.sum(whole**2) >= MIN_EFFECTIVE:
        return whole, 1.0
    low, high = -40.0, 0.0  # of the log of the power
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 1.0 / np.sum(at(np.exp(middle)) ** 2) >= MIN_EFFECTIVE else (low, middle)
    return at(np.exp(low)), float(np.exp(low))


def _heaviest(weight: Array, most: int) -> npt.NDArray[np.int64]:
    """Nodes that carry weight, the heaviest if there are too many."""
    order = np.argsort(weight)[::-1][:most]
    kept: npt.NDArray[np.int64] = np.sort(order[weight[order] > LEAST * weight[order[0]]])
    return kept


def _steepness(log_weight: Array, weight: Array, shape: tuple[int, ...]) -> float:
    """Mean difference of log weights between neighbours along the axes, weighted by the heavier of the two."""
    logs, w = log_weight.reshape(-1, *shape), weight.reshape(-1, *shape)
    worst = 0.0
    for axis in range(1, logs.ndim):
        ends = [slice(None)] * logs.ndim
        before, after = list(ends), list(ends)
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        share = np.maximum(w[tuple(before)], w[tuple(after)])
        jump = np.minimum(np.abs(logs[tuple(after)] - logs[tuple(before)]), 1e3)
        worst = max(worst, float(np.sum(share * jump) / share.sum()))
    return worst
