"""The loop of the combined algorithm."""

import numpy as np
import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.block_loop import Step, follow
from nebosvod.estimation.filters.kalman import Belief


def linear_steps(rng, n, *, q, sigma, F=None):
    """Position and rate, and a sensor error that fades; the position is measured with it."""
    F = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.9]]) if F is None else F
    Q = np.diag([0.0, q, 0.1])
    H = np.array([[0.0, 1.0]])
    y = np.cumsum(rng.normal(size=n))
    return [
        Step(F=F, Q=Q, observed=y[k : k + 1], predict=lambda nodes: 2.0 * nodes, H=H, R=np.array([[sigma**2]]))
        for k in range(n)
    ]


def kalman_of(belief, steps):
    for step in steps:
        belief = kalman.predict(belief, step.F, step.Q, step.shift)
        H = np.hstack([[[2.0]], step.H])
        belief, _ = kalman.update(belief, step.observed - H @ belief.mean, H, step.R)
    return belief


def test_with_blocks_of_one_linear_measurement_the_loop_is_the_kalman_filter():
    rng = np.random.default_rng(0)
    start = Belief.of([0.3, -0.1, 0.2], [[1.0, 0.1, 0.0], [0.1, 0.04, 0.0], [0.0, 0.0, 0.5]])
    steps = linear_steps(rng, 12, q=0.01, sigma=0.5)
    steps[3] = Step(**{name: getattr(steps[3], name) for name in ("F", "Q", "observed", "predict", "H", "R")},
                    shift=np.array([0.2, -0.1, 0.3]))  # fmt: skip
    found = list(follow(start, steps, 1, points=61, longest=1))
    wanted = kalman_of(start, steps)
    assert [(one.first, one.last) for one in found] == [(k, k) for k in range(12)]
    np.testing.assert_allclose(found[-1].belief.mean, wanted.mean, atol=1e-5)
    np.testing.assert_allclose(found[-1].belief.covariance, wanted.covariance, atol=1e-5)
    assert not any(one.warnings for one in found)
    assert all(one.rows >= 1 for one in found)
    np.testing.assert_allclose(found[-1].dQ, 0.0, atol=1e-15)


def test_a_block_of_coordinates_that_stand_still_loses_nothing_at_any_length():
    """No rate: the block with all measurements is the Kalman filter, the fading sensor error included."""
    rng = np.random.default_rng(1)
    start = Belief.of([0.3, 0.0, 0.2], np.diag([1.0, 0.04, 0.5]))
    steps = linear_steps(rng, 15, q=0.0, sigma=0.5, F=np.diag([1.0, 1.0, 0.9]))
    found = list(follow(start, steps, 1, points=61))
    assert len(found) == 1
    np.testing.assert_allclose(found[0].belief.mean, kalman_of(start, steps).mean, atol=1e-5)
    np.testing.assert_allclose(found[0].belief.covariance, kalman_of(start, steps).covariance, atol=1e-5)


def test_a_known_rate_is_followed_and_an_unknown_one_ends_the_block():
    rng = np.random.default_rng(2)
    known = Belief.of([0.0, 3.0, 0.0], np.diag([1.0, 1e-12, 1e-6]))
    steps = linear_steps(rng, 10, q=0.0, sigma=0.5)
    found = list(follow(known, steps, 1))
    assert len(found) == 1
    np.testing.assert_allclose(found[0].belief.mean, kalman_of(known, steps).mean, atol=1e-4)
    unknown = Belief.of([0.0, 3.0, 0.0], np.diag([1.0, 4.0, 1e-6]))
    blocks = list(follow(unknown, steps, 1))
    assert len(blocks) > 2
    for block in blocks[:-1]:
        # the ellipse had come down to the drift to the next measurement, not earlier
        last = np.sqrt(block.block.covariance[0, 0])
        assert last <= np.sqrt(block.drift[0, 0]) + 0.1 * np.sqrt(block.before.covariance[1, 1]) + 1e-12


def test_dQ_is_the_mean_square_about_the_mean_of_the_interval():
    """x moves at a constant rate of sigma r: its mean square about the mean of K epochs is r^2 T^2 (K+1)/(12 (K-1))."""
    r, K, step = 0.7, 9, 0.1
    start = Belief.of([0.0, 0.0, 0.0], np.diag([1.0, r**2, 1e-4]))
    quiet = [
        Step(**{name: getattr(s, name) for name in ("F", "Q", "observed", "predict", "H")}, R=np.array([[1e6]]))
        for s in linear_steps(np.random.default_rng(3), K, q=0.0, sigma=1.0)
    ]
    (found,) = follow(start, quiet, 1)
    T = step * (K - 1)
    assert found.dQ[0, 0] == pytest.approx(r**2 * T**2 * (K + 1) / (12 * (K - 1)), rel=1e-9)
    assert found.drift[0, 0] == pytest.approx((r * T) ** 2, rel=1e-9)


def test_blocks_are_honest_while_the_coordinate_moves():
    """A curved field (y = 2 x + 0.3 sin 3 x), a rate that wanders: 40 draws, NEES of the last belief."""
    rng = np.random.default_rng(4)
    F, Q = np.array([[1.0, 0.1], [0.0, 1.0]]), np.diag([0.0, 0.02])
    sigma0 = np.array([1.0, 0.6])

    def curved(nodes):
        return 2.0 * nodes + 0.3 * np.sin(3.0 * nodes)

    scores, squares = [], []
    for _ in range(40):
        x = sigma0 * rng.normal(size=2)
        steps = []
        for _ in range(12):
            x = F @ x + np.sqrt(np.diag(Q)) * rng.normal(size=2)
            y = np.array([2.0 * x[0] + 0.3 * np.sin(3.0 * x[0]) + 0.3 * rng.normal()])
            steps.append(
                Step(
                    F=F,
                    Q=Q,
                    observed=y,
                    predict=lambda nodes: 2.0 * nodes + 0.3 * np.sin(3.0 * nodes),
                    H=np.zeros((1, 1)),
                    R=np.array([[0.09]]),
                )
            )
        *_, last = follow(Belief.of(np.zeros(2), np.diag(sigma0**2)), steps, 1)
        scores.append(kalman.normalized_error_squared(last.belief, x))
        squares.append((last.belief.mean[0] - x[0]) ** 2 / last.belief.covariance[0, 0])
    # 99.9 % of chi-square over 80 and 40: 0.56 to 1.60, 0.41 to 1.95
    assert 0.56 < np.mean(scores) / 2.0 < 1.60
    assert 0.41 < np.mean(squares) < 1.95


def test_few_nodes_are_warned_of_and_an_empty_block_teaches_nothing():
    start = Belief.of([0.0, 0.0], np.diag([1.0, 1e-4]))
    still = {"F": np.eye(2), "Q": np.zeros((2, 2)), "H": np.zeros((1, 1))}
    sharp = Step(observed=np.array([9.5]), predict=lambda nodes: nodes, R=np.array([[1e-2]]), **still)
    (outside,) = follow(start, [sharp], 1)
    assert any("edge of the grid" in said for said in outside.warnings)
    jumps = Step(observed=np.array([0.0]), predict=lambda nodes: np.sin(1e12 * nodes), R=np.array([[1e-4]]), **still)
    (rough,) = follow(start, [jumps], 1)
    assert any("neighbouring nodes" in said for said in rough.warnings)
    assert any("effective nodes carry the weight" in said for said in rough.warnings)
    flat = Step(observed=np.array([1.0]), predict=np.zeros_like, R=np.array([[1.0]]), **still)
    belief = start
    for _ in range(40):
        (empty,) = follow(belief, [flat, flat], 1)
        belief = empty.belief
        assert empty.rows == 0
    np.testing.assert_allclose(belief.covariance, start.covariance, rtol=1e-6)


def test_wrong_dimensions_are_refused():
    start = Belief.of([0.0, 0.0], np.eye(2))
    with pytest.raises(InputError, match="3 nonlinear coordinates"):
        next(follow(start, [], 3))
    with pytest.raises(InputError, match="longest"):
        next(follow(start, [], 1, longest=0))
    assert list(follow(start, [], 1)) == []


def test_a_component_known_exactly_is_no_hindrance_and_a_known_coordinate_is_said():
    rng = np.random.default_rng(6)
    known = Belief(mean=np.array([0.3, 0.5, 0.0]), factor=np.diag([1.0, 0.0, 0.0]))  # rate and sensor without error
    steps = [
        Step(**{name: getattr(s, name) for name in ("F", "observed", "predict", "H", "R")}, Q=np.zeros((3, 3)))
        for s in linear_steps(rng, 6, q=0.0, sigma=0.5)
    ]
    *_, last = follow(known, steps, 1, points=61)
    wanted = kalman_of(known, steps)
    np.testing.assert_allclose(last.belief.mean, wanted.mean, atol=1e-5)
    np.testing.assert_allclose(last.belief.covariance, wanted.covariance, atol=1e-5)
    with pytest.raises(GeometryError, match="singular"):
        list(follow(Belief.of([0.0, 0.0, 0.0], np.diag([0.0, 0.0, 1.0])), steps, 1))


def test_nodes_off_the_chart_count_nothing():
    """A chart that ends at zero: the posterior is the half-normal one, and without any chart the loop says so."""
    start = Belief.of([0.0, 0.0], np.diag([1.0, 1e-4]))
    step = Step(F=np.eye(2), Q=np.zeros((2, 2)), observed=np.array([0.0]), H=np.zeros((1, 1)), R=np.array([[1.0]]),
                predict=lambda nodes: np.where(nodes < 0.0, np.nan, 0.0))  # fmt: skip
    (found,) = follow(start, [step], 1, points=201)
    assert found.block.mean[0] == pytest.approx(np.sqrt(2.0 / np.pi), rel=0.03)
    assert found.block.covariance[0, 0] == pytest.approx(1.0 - 2.0 / np.pi, rel=0.06)
    nowhere = Step(F=np.eye(2), Q=np.zeros((2, 2)), observed=np.array([0.0]), H=np.zeros((1, 1)), R=np.array([[1.0]]),
                   predict=lambda nodes: np.full_like(nodes, np.nan))  # fmt: skip
    with pytest.raises(GeometryError, match="off the chart"):
        list(follow(start, [nowhere], 1))
