"""Where least squares can be believed the grid says the same, and its block stands for the night in the filter."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import Ephemeris
from nebosvod.estimation.filters.combined import equivalent_measurement
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.equivalent import block, state_partials, wide
from nebosvod.first_hour.grid import grid_of
from nebosvod.first_hour.tracklet import Tracklet

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hour_cases import CASES, Case, made  # type: ignore[import-not-found]

Array = npt.NDArray[np.float64]
KNOWN = [case for case in CASES if case.name in ("two stations, 6 h, 0.2 au", "one station, 3 h, 0.01 au",
                                                 "two spacecraft, 20 min, 0.02 au")]  # fmt: skip


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


def least_squares(tracklet: Tracklet, near: Array) -> tuple[Array, Array]:
    """The best six coordinates and their covariance by least squares, every nuisance marginalised."""
    best = Conditional(tracklet).solve(near[None], 0)
    inverse = np.linalg.solve(best.factor[0], np.eye(best.factor.shape[1]))
    K = (inverse @ inverse.T)[-6:, -6:]
    order = [5, 4, 0, 1, 2, 3]  # the factor has the attributable first, then the rate and the range
    return best.coordinates[0], K[np.ix_(order, order)]


def divergence(m0: Array, P0: Array, m1: Array, P1: Array) -> float:
    """Kullback and Leibler's, of two normal distributions."""
    inverse = np.linalg.solve(P1, np.eye(len(P1)))
    d = m1 - m0
    logs = np.linalg.slogdet(P1)[1] - np.linalg.slogdet(P0)[1]
    return float(0.5 * (np.trace(inverse @ P0) + d @ inverse @ d - len(d) + logs))


@pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.name)
def test_where_the_range_is_known_the_grid_is_least_squares(case: Case, bodies: Ephemeris) -> None:
    one = made(case, bodies)
    grid = grid_of(Conditional(one.tracklet), one.region)
    mean, P = grid.moments()
    assert np.sqrt(P[0, 0]) < 0.1
    best, K = least_squares(one.tracklet, grid.nodes.coordinates[int(np.argmin(grid.nodes.chi2))])
    assert divergence(mean, P, best[:2], K[:2, :2]) < 0.1
    assert divergence(best[:2], K[:2, :2], mean, P) < 0.1


def test_the_equivalent_measurement_carries_a_night_into_the_next(bodies: Ephemeris) -> None:
    """A first part's block, then the rest by a filter from it: the joint answer within 0.1 sigma of all data."""
    one = made(KNOWN[1], bodies)
    order = np.argsort(one.tracklet.exposures.t_s)
    first, rest = np.sort(order[:6]), np.sort(order[6:])
    night = one.tracklet.select(first)
    # its own region of range, counted at the reference of the first night
    grid = grid_of(Conditional(night), one.region)
    posterior = block(grid)
    before = wide(posterior)
    equal = equivalent_measurement(before, posterior)
    filtered = taken(before, equal.y, equal.H, equal.R)
    assert np.all(np.abs(filtered.mean - posterior.mean) < 1e-3 * np.sqrt(np.diag(covariance(posterior))))
    joint, K = all_data(one.tracklet, night, rest, filtered)
    sigma = np.sqrt(np.diag(K))
    state, _ = state_partials(Conditional(night), joint)
    best, Kb = least_squares(reference_of(one.tracklet, night), joint)
    assert np.all(np.abs(joint - best) < 0.1 * np.sqrt(np.diag(Kb))), (joint - best) / np.sqrt(np.diag(Kb))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(Kb)), rtol=0.1)
    assert np.isfinite(state).all()


def covariance(belief: Belief) -> Array:
    return np.asarray(belief.factor @ belief.factor.T)


def taken(before: Belief, y: Array, H: Array, R: Array) -> Belief:
    """The Kalman filter's answer to one linear measurement, by the normal equations scaled to the prior."""
    P = covariance(before)
    V = H @ P @ H.T + R
    gain = np.linalg.solve(V, H @ P).T
    keep = np.eye(len(P)) - gain @ H
    return Belief.of(before.mean + gain @ (y - H @ before.mean), keep @ P @ keep.T + gain @ R @ gain.T)


def reference_of(whole: Tracklet, night: Tracklet) -> Tracklet:
    """All measurements, about the reference of the first night."""
    row = int(np.argmin(np.abs(whole.exposures.counted_from(night.epoch).t_s)))
    return replace(whole, exposures=whole.exposures.counted_from(night.epoch), reference=row)


def all_data(whole: Tracklet, night: Tracklet, rest: npt.NDArray[np.int64], belief: Belief) -> tuple[Array, Array]:
    """Iterated update of the first night's belief by the other measurements, without their shared errors."""
    every = Conditional(reference_of(whole, night))
    x, P = belief.mean.copy(), covariance(belief)
    scale = np.sqrt(np.diag(P))
    prior = np.linalg.solve(np.linalg.cholesky(P / np.outer(scale, scale)), np.eye(6))
    for _ in range(6):
        base, J, _ = every._partials(x[None], np.zeros((1, len(whole.columns.names))))
        W = 1.0 / whole.exposures.sigma_rad[rest].ravel()
        rows = np.vstack([(J[0, rest].reshape(-1, 6) * W[:, None]) * scale, prior])
        right = np.concatenate([base.residual[0, rest].ravel() * W, prior @ ((belief.mean - x) / scale)])
        Q, T = np.linalg.qr(rows)
        x = x + scale * np.linalg.solve(T, Q.T @ right)
    inverse = np.linalg.solve(T, np.eye(6)) * scale[:, None]
    return x, np.asarray(inverse @ inverse.T)
