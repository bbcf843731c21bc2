"""A short arc of directions: a grid over range and range rate, the rest linear, condensed for a Kalman filter.

A body moves in a plane in a straight line; an observer on a circle of radius 1 (period 2 pi) sees its direction
over a tenth of a time unit. Direction and its rate are measured at once; range and range rate are felt through the
observer's acceleration only, together, along a curved ridge that no linearisation describes.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.combined import GridBlock, adapt, equivalent_measurement
from nebosvod.estimation.filters.kalman import Belief

Array = npt.NDArray[np.float64]
T = np.linspace(-0.05, 0.05, 15)
SIGMA = 1e-4  # rad
# Known beforehand of [ln range, range rate, direction, its rate]: little.
PRIOR = Belief.of([np.log(0.4), 0.0, 0.8, 0.0], np.diag([0.35**2, 0.25**2, 1.0, 1.0]))


@dataclass(frozen=True)
class Arc:
    """Moments of the grid, the filter's belief after the equivalent measurement, and the truth (4,)."""

    grid: Belief
    filtered: Belief
    truth: Array


def directions(x: Array) -> Array:
    """Directions (..., n) at the epochs of the arc for x (..., 4): ln range, range rate, direction, its rate."""
    rho, rate, angle, spin = np.exp(x[..., 0]), x[..., 1], x[..., 2], x[..., 3]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    position = rho[..., None] * along
    velocity = rate[..., None] * along + (rho * spin)[..., None] * across + [0.0, 1.0]  # the observer's own added
    observer = np.stack([np.cos(T) - 1.0, np.sin(T)], axis=-1)
    away = position[..., None, :] + velocity[..., None, :] * T[:, None] - observer
    found: Array = np.arctan2(away[..., 1], away[..., 0])
    return found


def block_of(nodes: Array, observed: Array) -> GridBlock:
    """Fit direction and rate at each node (g, 2); weight = prior exp(-chi2 / 2) sqrt(det P)."""
    line = np.polynomial.polynomial.polyfit(T, observed, 1)
    rest = np.broadcast_to(line, (len(nodes), 2)).copy()
    for _ in range(4):
        x = np.hstack([nodes, rest])
        steps = [directions(x + 1e-6 * unit) - directions(x - 1e-6 * unit) for unit in np.eye(4)[2:]]
        H = np.stack(steps, axis=-1) / 2e-6 / SIGMA
        v = (observed - directions(x)) / SIGMA
        normal = H.transpose(0, 2, 1) @ H
        rest += np.linalg.solve(normal, H.transpose(0, 2, 1) @ v[:, :, None])[:, :, 0]
    misfit = (observed - directions(np.hstack([nodes, rest]))) / SIGMA
    away = (nodes - PRIOR.mean[:2]) / np.diag(PRIOR.factor)[:2]
    logs = -0.5 * np.sum(misfit**2, axis=1) - 0.5 * np.sum(away**2, axis=1)
    covariance = np.linalg.solve(normal, np.broadcast_to(np.eye(2), normal.shape))
    return GridBlock(
        nodes=nodes, log_weight=logs - 0.5 * np.linalg.slogdet(normal)[1], mean=rest, covariance=covariance
    )


def observe(rng: np.random.Generator) -> tuple[Array, Array]:
    """A body drawn from the prior of range and range rate, and its measured directions."""
    truth = np.array([0.0, 0.0, 0.8, 0.3])
    truth[:2] = PRIOR.mean[:2] + np.diag(PRIOR.factor)[:2] * rng.normal(size=2)
    return truth, directions(truth) + SIGMA * rng.normal(size=len(T))


def solve(rng: np.random.Generator) -> Arc:
    """Condense one arc: an adaptive grid along the ridge, its moments, the equivalent measurement, the filter."""
    truth, observed = observe(rng)
    start = Belief(mean=PRIOR.mean[:2], factor=PRIOR.factor[:2, :2])
    grid = adapt(lambda nodes: block_of(nodes, observed), start, points=61).moments()
    linear = equivalent_measurement(PRIOR, grid)
    filtered, _ = kalman.update(PRIOR, linear.y - linear.H @ PRIOR.mean, linear.H, linear.R)
    return Arc(grid, filtered, truth)


def main() -> None:
    """Print what one arc says."""
    found = solve(np.random.default_rng(1))
    sigma = np.sqrt(np.diag(found.filtered.covariance))
    names = ("ln range", "range rate", "direction", "its rate")
    for name, true, value, s in zip(names, found.truth, found.filtered.mean, sigma):
        print(f"{name:11s} truth {true:9.5f}  found {value:9.5f} +- {s:.5f}")
    correlation = found.grid.covariance[0, 1] / np.prod(np.sqrt(np.diag(found.grid.covariance))[:2])
    print(f"correlation of range and range rate {correlation:.4f}")


if __name__ == "__main__":
    main()
