"""Orbits drawn from the posterior: within the cells of the grid, and in each with attributable and nuisances drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.first_hour.conditional import RATE
from nebosvod.first_hour.grid import HEADLINE, Grid, interval_of, log_prior

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
LEAST, NEAR_LEAST = 1e-4, 1e-8  # weight of a cell from which at least one orbit is drawn, and of one near the target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Draws:
    """m orbits, each with its weight.

    Attributes
    ----------
    cell : (m,) the node of the grid each was drawn about.
    coordinates, states : (m, 6) with the attributable drawn; heliocentric ICRF at the reference time, km and km/s.
    nuisance : (m, k) drawn with it: biases, clocks and places of the stations.
    log_density : by prior, (m,) log of posterior density times the size of the cell, up to a constant.
    """

    cell: Rows
    coordinates: Array
    states: Array
    nuisance: Array
    log_density: Mapping[str, Array]

    def __len__(self) -> int:
        """How many."""
        return len(self.cell)

    def weight(self, prior: str = HEADLINE) -> Array:
        """Normalised weights (m,): those of a cell share what it weighs."""
        log = self.log_density[prior]
        top = log.max(initial=-np.inf)
        shared = np.bincount(self.cell)[self.cell]
        w = np.exp(log - top) / shared if np.isfinite(top) else np.zeros(len(log))
        total = w.sum()
        return np.asarray(w / total if total > 0.0 else w)

    def effective(self, prior: str = HEADLINE) -> float:
        """How many draws of equal weight tell as much."""
        total = float(np.sum(self.weight(prior) ** 2))
        return 1.0 / total if total > 0.0 else 0.0

    def joined(self, other: "Draws") -> "Draws":
        """Both together."""
        return Draws(
            cell=np.concatenate([self.cell, other.cell]),
            coordinates=np.concatenate([self.coordinates, other.coordinates]),
            states=np.concatenate([self.states, other.states]),
            nuisance=np.concatenate([self.nuisance, other.nuisance]),
            log_density={p: np.concatenate([log, other.log_density[p]]) for p, log in self.log_density.items()},
        )


def shares(grid: Grid, count: int, near: npt.NDArray[np.bool_]) -> Rows:
    """How many of `count` orbits to draw in each cell (m,): by the mean weight of the priors, at least one.

    Parameters
    ----------
    near : (m,) which cells may hold orbits that hit, however little they weigh.
    """
    p = np.mean([grid.weight(prior) for prior in grid.priors], axis=0)
    found = np.rint(count * p).astype(np.int64)
    return np.where(p > np.where(near, NEAR_LEAST, LEAST), np.maximum(found, 1), 0)


def draw(grid: Grid, number: Rows, rng: np.random.Generator) -> Draws:
    """Draw orbits in cells.

    Parameters
    ----------
    number : (m,) of each cell.

    Notes
    -----
    Range and rate are uniform in the cell, sheared as the ridge is; the posterior density there, with attributable and
    nuisances solved for anew, is the weight. Then these are drawn from their normal distribution.
    """
    conditional, region = grid.conditional, grid.region
    cell = np.repeat(np.arange(len(number)), number)
    line = grid.line[cell]
    x = grid.low[line] + grid.width[line] * rng.random(len(cell))
    shift = x - grid.lines.coordinates[line, 0]
    begin, end = interval_of(region, conditional, grid.lines, shift, line)
    length = np.where(end > begin, end - begin, np.nan)
    low, high = grid.share[cell].T
    y = begin + length * (low + (high - low) * rng.random(len(cell)))
    kept = np.flatnonzero(np.isfinite(y))
    cell, line, x, y, length, size = cell[kept], line[kept], x[kept], y[kept], length[kept], (high - low)[kept]
    start = grid.nodes.coordinates[cell].copy()
    start[:, 2:] += (y - start[:, RATE])[:, None] * grid.lines.drift[line, -4:]
    start[:, 0], start[:, RATE] = x, y
    nodes = conditional.solve(start, 2)
    log = -0.5 * nodes.chi2 + nodes.log_spread + np.log(length * size * grid.width[line])
    log = np.where(region.allows(nodes.above_km) & np.isfinite(log), log, -np.inf)
    coordinates = nodes.coordinates.copy()
    normal = rng.standard_normal(nodes.factor.shape[:2])
    moved = np.linalg.solve(nodes.factor, normal[:, :, None])[:, :, 0]
    coordinates[:, 2:] += moved[:, -4:]
    states = conditional.states(coordinates)
    log = np.where(region.holds(states, conditional.sight.gm), log, -np.inf)
    return Draws(
        cell=cell,
        coordinates=coordinates,
        states=states,
        nuisance=nodes.nuisance + moved[:, :-4],
        log_density={prior: log + log_prior(prior, nodes) for prior in grid.priors},
    )


def without(draws: Draws, lost: npt.NDArray[np.bool_]) -> Draws:
    """The same, where some (m,) count nothing."""
    density = {prior: np.where(lost, -np.inf, log) for prior, log in draws.log_density.items()}
    return replace(draws, log_density=density)
