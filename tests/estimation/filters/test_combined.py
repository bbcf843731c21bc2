"""Grid block, moments, equivalent measurement."""

from typing import Any

import numpy as np
import pytest

from nebosvod.errors import GeometryError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.combined import (
    GridBlock,
    adapt,
    drift_covariance,
    equivalent_measurement,
    ready,
    with_drift,
)
from nebosvod.estimation.filters.kalman import Belief


def spd(rng, size):
    A = rng.normal(size=(size, size))
    return A @ A.T / size + 0.2 * np.eye(size)


def test_the_equivalent_measurement_leads_from_the_prior_to_the_posterior():
    rng = np.random.default_rng(0)
    for p in (1, 2, 4):
        prior = Belief.of(rng.normal(size=4), spd(rng, 4))
        H, y = rng.normal(size=(p, 4)), rng.normal(size=p)
        posterior, _ = kalman.update(prior, y - H @ prior.mean, H, spd(rng, p))
        found = equivalent_measurement(prior, posterior)
        assert len(found.y) == p  # rank-deficient information keeps its rank
        again, _ = kalman.update(prior, found.y - found.H @ prior.mean, found.H, found.R)
        np.testing.assert_allclose(again.mean, posterior.mean, atol=1e-9)
        np.testing.assert_allclose(again.covariance, posterior.covariance, atol=1e-9)


def test_directions_where_the_posterior_is_wider_than_the_prior_are_dropped():
    prior = Belief.of(np.zeros(2), np.eye(2))
    found = equivalent_measurement(prior, Belief.of([0.5, 3.0], np.diag([0.25, 4.0])))
    assert len(found.y) == 1
    after, _ = kalman.update(prior, found.y - found.H @ prior.mean, found.H, found.R)
    np.testing.assert_allclose(after.mean, [0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(after.covariance, np.diag([0.25, 1.0]), atol=1e-12)


def test_nothing_learnt_is_no_measurement_and_a_singular_prior_is_refused():
    prior = Belief.of(np.zeros(2), np.eye(2))
    assert len(equivalent_measurement(prior, prior).y) == 0
    with pytest.raises(GeometryError):
        equivalent_measurement(Belief.of(np.zeros(2), np.diag([1.0, 0.0])), prior)


def test_a_grid_of_a_linear_measurement_is_the_kalman_update():
    rng = np.random.default_rng(1)
    prior = Belief.of(rng.normal(size=3), spd(rng, 3))
    H, R = rng.normal(size=(2, 3)), spd(rng, 2)
    y = H @ prior.mean + rng.normal(size=2)
    block = GridBlock.of_prior(prior, 2, points=61, reach=6.0)
    block = block.update(y, block.nodes @ H[:, :2].T, H[:, 2:], R)
    wanted, _ = kalman.update(prior, y - H @ prior.mean, H, R)
    found = block.moments()
    np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-6)
    np.testing.assert_allclose(found.covariance, wanted.covariance, atol=1e-6)


def test_moments_of_a_bimodal_posterior_equal_dense_quadrature():
    """y = x^2 + e + v: two roots; e is conditionally Gaussian with the cross term of mean and node kept."""
    prior = Belief.of([0.3, 0.0], np.diag([1.0, 0.2]))
    block = GridBlock.of_prior(prior, 1, points=401, reach=6.0)
    block = block.update(np.array([1.0]), block.nodes**2, np.eye(1), 0.1 * np.eye(1))
    x = np.linspace(-7.0, 7.0, 4001)
    e = np.linspace(-4.0, 4.0, 1601)
    X, E = np.meshgrid(x, e, indexing="ij")
    p = np.exp(-0.5 * (X - 0.3) ** 2 - 0.5 * E**2 / 0.2 - 0.5 * (1.0 - X**2 - E) ** 2 / 0.1)
    p /= p.sum()
    mean = np.array([(p * X).sum(), (p * E).sum()])
    cross = (p * (X - mean[0]) * (E - mean[1])).sum()
    K = np.array([[(p * (X - mean[0]) ** 2).sum(), cross], [cross, (p * (E - mean[1]) ** 2).sum()]])
    found = block.moments()
    np.testing.assert_allclose(found.mean, mean, atol=1e-5)
    np.testing.assert_allclose(found.covariance, K, atol=1e-5)


def test_an_adaptive_grid_follows_a_narrow_ridge_where_an_aligned_one_fails():
    angle, sigmas = 0.7, np.array([1.0, 0.004])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    K = turn @ np.diag(sigmas**2) @ turn.T
    information = np.linalg.solve(K, np.eye(2))

    def evaluate(nodes):
        away = nodes - [0.3, -0.2]
        g = len(nodes)
        return GridBlock(
            nodes=nodes,
            log_weight=-0.5 * np.einsum("ni,ij,nj->n", away, information, away),
            mean=np.zeros((g, 0)),
            covariance=np.zeros((0, 0)),
        )

    found = adapt(evaluate, Belief.of(np.zeros(2), 4.0 * np.eye(2)))
    assert found.effective >= 30
    np.testing.assert_allclose(found.moments().mean, [0.3, -0.2], atol=2e-3)
    ratio = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(K), found.moments().factor), compute_uv=False)
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)
    axis = np.linspace(-4.0, 4.0, 41)
    aligned = evaluate(np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2))
    assert aligned.effective < 30


def test_a_block_is_ready_when_its_minor_axis_is_down_to_the_drift():
    block = Belief.of(np.zeros(3), np.diag([100.0, 0.04, 1.0]))
    assert ready(block, 2, drift=0.25)
    assert not ready(block, 2, drift=0.1)
    flat = Belief(mean=np.zeros(2), factor=np.array([[1.0], [0.0]]))  # no width at all in one direction
    assert ready(flat, 2, drift=1e-9)


def test_the_drift_over_the_interval_makes_the_correction_honest():
    """A block holds x still while it moves at an unknown rate: the correction to x at the end needs dQ_L."""
    rng = np.random.default_rng(3)
    T, n, sigma, rate = 2.0, 20, 0.05, 0.2
    t = np.linspace(0.0, T, n)
    prior = Belief.of([0.0], [[1.0]])
    plain: list[Any] = []
    drifting: list[Any] = []
    for _ in range(60):
        x, v = rng.normal(), rate * rng.normal()
        block = GridBlock.of_prior(prior, 1, points=401)
        for k in range(n):
            y = np.array([x + v * (t[k] - T) + sigma * rng.normal()])
            block = block.update(y, block.nodes, np.zeros((1, 0)), sigma**2 * np.eye(1))
        linear = equivalent_measurement(prior, block.moments())
        for out, measurement in (
            (plain, linear),
            (drifting, with_drift(linear, drift_covariance(np.array([[rate**2]]), T))),
        ):
            after, _ = kalman.update(prior, measurement.y, measurement.H, measurement.R)
            out.append(kalman.normalized_error_squared(after, np.array([x])))
    assert np.mean(plain) > 50.0
    # The drift about the middle is T^2/4 and the mean square T^2/3: honest with a margin of a third.
    assert 0.45 < np.mean(drifting) < 1.1


def test_the_blocks_prior_is_the_filters_marginal_and_a_broad_one_misses_the_root():
    """y = x^2: the filter knows the sign. A block of its own broad prior is bimodal and drags the estimate to zero."""
    marginal = Belief.of([1.2], [[0.35**2]])
    broad = Belief.of([0.0], [[3.0**2]])
    R, y = 0.2**2 * np.eye(1), np.array([1.5**2])

    def corrected(own):
        block = GridBlock.of_prior(own, 1, points=2001, reach=5.0)
        block = block.update(y, block.nodes**2, np.zeros((1, 0)), R)
        linear = equivalent_measurement(own, block.moments())
        return kalman.update(marginal, linear.y - linear.H @ marginal.mean, linear.H, linear.R)[0]

    x = np.linspace(-3.0, 5.0, 200001)
    density = np.exp(-0.5 * ((x - 1.2) / 0.35) ** 2 - 0.5 * ((1.5**2 - x**2) / 0.2) ** 2)
    mean = np.sum(density * x) / density.sum()
    variance = np.sum(density * (x - mean) ** 2) / density.sum()
    right, wrong = corrected(marginal), corrected(broad)
    assert right.mean[0] == pytest.approx(mean, abs=1e-6)
    assert right.covariance[0, 0] == pytest.approx(variance, rel=1e-4)
    assert abs(wrong.mean[0] - mean) > 2.0 * np.sqrt(variance)
    assert wrong.covariance[0, 0] > 10.0 * variance  # and the measurement is wasted


def test_an_axis_aligned_grid_across_a_ridge_gives_four_to_seven_tenths_of_the_sigmas():
    """41 x 41 nodes along the axes, a ridge 250 times as long as wide: few nodes hit it, and by chance."""
    along, across = np.array([np.cos(0.7), np.sin(0.7)]), np.array([-np.sin(0.7), np.cos(0.7)])
    axis = np.linspace(-4.0, 4.0, 41)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    for centre in ([0.0, 0.0], [0.13, 0.05]):
        away = nodes - centre
        log_weight = -0.5 * (away @ along) ** 2 - 0.5 * (away @ across / 0.004) ** 2
        rest = np.zeros((len(nodes), 0))
        block = GridBlock(nodes=nodes, log_weight=log_weight, mean=rest, covariance=np.zeros((0, 0)))
        found = block.moments().covariance
        assert block.effective < 30.0  # which is how `adapt` knows
        assert 0.4 < np.sqrt(along @ found @ along) < 0.7
        assert 0.4 < np.sqrt(across @ found @ across) / 0.004 < 0.7


@pytest.mark.parametrize("reach", [4.0, 6.0])
@pytest.mark.parametrize("points", [21, 41])
@pytest.mark.parametrize("d", [1, 2])
def test_a_block_that_measured_nothing_is_no_measurement(reach, points, d):
    """A grid cut at 4 sigmas is narrower than the prior; that is not information."""
    rng = np.random.default_rng(d)
    prior = Belief.of(rng.normal(size=3), spd(rng, 3))
    found = GridBlock.of_prior(prior, d, points=points, reach=reach).moments()
    np.testing.assert_allclose(found.mean, prior.mean, atol=1e-13)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-12, atol=1e-13)
    assert len(equivalent_measurement(prior, found).y) == 0


def test_three_hundred_empty_blocks_leave_the_sigma_where_it_was():
    belief = Belief.of(np.zeros(2), np.eye(2))
    for _ in range(300):
        linear = equivalent_measurement(belief, GridBlock.of_prior(belief, 2).moments())
        belief, _ = kalman.update(belief, linear.y - linear.H @ belief.mean, linear.H, linear.R)
    np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), 1.0, atol=1e-6)
    np.testing.assert_allclose(belief.mean, 0.0, atol=1e-6)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)])
@pytest.mark.parametrize("field", ["slope", "plateau", "nothing"])
def test_a_field_of_one_coordinate_gives_one_row(direction, field):
    """A slope and a plateau (flat, then a slope) tell of one direction; a flat field of none."""
    prior = Belief.of(np.zeros(2), np.eye(2))
    h = {"slope": lambda s: s, "plateau": lambda s: np.maximum(s, 0.0), "nothing": np.zeros_like}[field]
    block = GridBlock.of_prior(prior, 2, points=121)
    block = block.update(np.array([0.7]), h(block.nodes @ direction)[:, None], np.zeros((1, 0)), np.array([[0.09]]))  # type: ignore[operator]
    found = equivalent_measurement(prior, block.moments())
    if field == "nothing":
        assert len(found.y) == 0
        return
    assert len(found.y) == 1
    s = np.linspace(-8.0, 8.0, 200001)  # the other coordinate keeps its prior
    density = np.exp(-0.5 * s**2 - 0.5 * ((0.7 - h(s)) / 0.3) ** 2)  # type: ignore[operator]
    mean = np.sum(density * s) / density.sum()
    variance = np.sum(density * (s - mean) ** 2) / density.sum()
    after, _ = kalman.update(prior, found.y - found.H @ prior.mean, found.H, found.R)
    axis = np.array(direction)
    assert axis @ after.mean == pytest.approx(mean, abs=2e-3)
    assert axis @ after.covariance @ axis == pytest.approx(variance, rel=5e-3)
    across = np.array([-axis[1], axis[0]])
    assert across @ after.covariance @ across == pytest.approx(1.0, abs=1e-6)
