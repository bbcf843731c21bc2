"""Map-aided navigation by the combined algorithm, against a dense-grid Bayesian reference.

An inertial system drifts in two coordinates; a sensor measures a scalar field (a map) with a slowly varying error
of its own. A grid block takes the map in, its moments become one linear measurement, and a Kalman filter of
position and velocity errors takes that. km, hours.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.combined import GridBlock, equivalent_measurement
from nebosvod.estimation.filters.kalman import Belief

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Navigation:
    """Position error (2,) and its belief: by the combined algorithm and by the dense reference; the truth."""

    combined: Belief
    reference_mean: Array
    reference_covariance: Array
    truth: Array


def height(position: Array) -> Array:
    """The map: a field with several scales, position (..., 2) in km, height in m."""
    x, y = position[..., 0], position[..., 1]
    field: Array = (
        80.0 * np.sin(0.9 * x + 0.3 * y) + 60.0 * np.cos(0.4 * x - 1.1 * y) + 15.0 * np.sin(2.3 * x * 0.7 + y)
    )
    return field


def track(t: float) -> Array:
    """Position the inertial system believes, km."""
    return np.array([12.0 * t, 5.0 * t])


def navigate(rng: np.random.Generator, n: int = 25, step: float = 0.04, sigma: float = 8.0) -> Navigation:
    """Fly, measure n heights, and estimate the position error at the end of the interval."""
    prior = np.diag([1.0, 1.0, 0.05**2, 0.05**2])  # position and velocity error of the inertial system
    error_prior, tau = 10.0, 1.0  # sensor error: Gauss-Markov, m, hours
    decay = np.exp(-step / tau)
    truth = np.linalg.cholesky(prior) @ rng.normal(size=4)
    epsilon = error_prior * rng.normal()
    belief = Belief.of(np.zeros(4), prior)
    # Over the interval the position error is constant but for the drift of the velocity error, which is small.
    start = Belief.of(np.zeros(3), np.diag([prior[0, 0], prior[1, 1], error_prior**2]))
    block = GridBlock.of_prior(start, 2, points=181, reach=4.5)
    logs, nodes, weights = [], [], []
    for k in range(n):
        t = k * step
        if k:
            noise = error_prior * np.sqrt(1.0 - decay**2)
            epsilon = decay * epsilon + noise * rng.normal()
            block = block.move(np.array([[decay]]), np.array([[noise**2]]))
        observed = np.array([height(track(t) + truth[:2]) + epsilon + sigma * rng.normal()])
        logs.append(observed[0])
        block = block.update(observed, height(track(t) + block.nodes)[:, None], np.eye(1), sigma**2 * np.eye(1))
    found = block.moments()
    marginal = Belief.of(found.mean[:2], found.covariance[:2, :2])
    # the block's prior is the filter's own marginal, so that nothing is counted twice
    linear = equivalent_measurement(Belief.of(belief.mean[:2], prior[:2, :2]), marginal)
    H = np.hstack([linear.H, np.zeros((len(linear.y), 2))])
    combined, _ = kalman.update(belief, linear.y - H @ belief.mean, H, linear.R)
    nodes, weights = _reference(np.array(logs), step, sigma, error_prior, decay, prior)
    mean = weights @ nodes
    away = nodes - mean
    return Navigation(combined, mean, (weights[:, None] * away).T @ away, truth)


def _reference(
    observed: Array, step: float, sigma: float, error_prior: float, decay: float, prior: Array
) -> tuple[Array, Array]:
    """Posterior over a dense grid of the position error with the sensor error's full covariance in time."""
    axis = np.linspace(-4.5, 4.5, 361)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2) * np.sqrt(np.diag(prior)[:2])
    lag = np.abs(np.subtract.outer(np.arange(len(observed)), np.arange(len(observed))))
    L = np.linalg.cholesky(error_prior**2 * decay**lag + sigma**2 * np.eye(len(observed)))
    predicted = np.stack([height(track(k * step) + nodes) for k in range(len(observed))])
    white = np.linalg.solve(L, observed[:, None] - predicted)
    logs = -0.5 * np.sum(white**2, axis=0) - 0.5 * np.sum(nodes**2 / np.diag(prior)[:2], axis=1)
    weights = np.exp(logs - logs.max())
    return nodes, weights / weights.sum()


def main() -> None:
    """Print the position error found by both."""
    found = navigate(np.random.default_rng(5))
    sigma = np.sqrt(np.diag(found.combined.covariance))[:2]
    reference = np.sqrt(np.diag(found.reference_covariance))
    print("truth              ", np.round(found.truth[:2], 3))
    print("combined algorithm ", np.round(found.combined.mean[:2], 3), "+-", np.round(sigma, 3))
    print("dense reference    ", np.round(found.reference_mean, 3), "+-", np.round(reference, 3))


if __name__ == "__main__":
    main()
