"""Steady state of a filter, against scipy's Riccati solver, closed forms and the filter itself."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from nebosvod.errors import GeometryError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.continuous import discretise
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.steady import steady_map, steady_state


@pytest.mark.parametrize("seed", range(6))
def test_random_systems_agree_with_scipy_and_with_the_filter_run_to_its_end(seed):
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(4, 4)) * 0.6
    G, H, C = rng.normal(size=(4, 2)), rng.normal(size=(2, 4)), rng.normal(size=(2, 2))
    Q, R = G @ G.T, C @ C.T + 0.1 * np.eye(2)
    found = steady_state(F, Q, H, R)
    np.testing.assert_allclose(found.predicted, solve_discrete_are(F.T, H.T, Q, R), rtol=1e-8, atol=1e-9)
    belief = Belief.of(np.zeros(4), 10.0 * np.eye(4))
    for _ in range(200):
        belief, innovation = kalman.update(kalman.predict(belief, F, Q), np.zeros(2), H, R)
    np.testing.assert_allclose(found.filtered, belief.covariance, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.gain, innovation.gain, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(belief.covariance)), rtol=1e-8)


def test_closed_form_of_the_random_walk():
    q, r = 0.3, 2.0
    one = np.eye(1)
    found = steady_state(one, q * one, one, r * one)
    assert found.predicted[0, 0] == pytest.approx((q + np.sqrt(q**2 + 4.0 * q * r)) / 2.0, rel=1e-12)


def test_closed_form_of_position_and_velocity():
    """Kalata 1984: with the tracking index L^2 = T^4 sv / r, the gains of alpha and beta."""
    T, sa, r = 0.5, 0.04, 9.0
    F = np.array([[1.0, T], [0.0, 1.0]])
    G = np.array([[0.5 * T**2], [T]])
    gain = steady_state(F, sa * G @ G.T, np.array([[1.0, 0.0]]), np.array([[r]])).gain
    index = T**2 * np.sqrt(sa / r)
    d = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    assert gain[0, 0] == pytest.approx(1.0 - d**2, rel=1e-10)
    assert gain[1, 0] * T == pytest.approx(2.0 * (1.0 - d) ** 2, rel=1e-10)


def test_an_unseen_mode_that_grows_and_an_undisturbed_one_have_no_steady_state():
    with pytest.raises(GeometryError, match="there is none"):
        steady_state(np.diag([1.1, 0.5]), np.eye(2), np.array([[0.0, 1.0]]), np.eye(1))
    with pytest.raises(GeometryError, match="there is none"):
        steady_state(np.eye(1), np.zeros((1, 1)), np.eye(1), np.eye(1))
    unseen = steady_state(np.diag([0.9, 0.5]), np.eye(2), np.array([[0.0, 1.0]]), np.eye(1))
    assert unseen.predicted[0, 0] == pytest.approx(1.0 / (1.0 - 0.81), rel=1e-12)  # fades by itself
    still = steady_state(np.array([[0.9]]), np.zeros((1, 1)), np.eye(1), np.eye(1))
    assert still.filtered[0, 0] == pytest.approx(0.0, abs=1e-15)


def test_the_map_over_two_parameters_is_each_steady_state_and_nan_where_there_is_none():
    def model(step, sigma):
        F, Q = discretise([[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1e-2]], step)
        return F, Q, np.array([[1.0, 0.0]]) * (sigma < 5.0), np.array([[sigma**2]])

    steps, sigmas = np.array([0.5, 1.0, 2.0]), np.array([0.1, 1.0, 10.0])
    found = steady_map(model, steps, sigmas, np.eye(2))
    assert found.shape == (3, 3, 2)
    assert np.isnan(found[:, 2]).all()
    F, Q, H, R = model(2.0, 1.0)
    P = solve_discrete_are(F.T, H.T, Q, R)
    after = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
    np.testing.assert_allclose(found[2, 1], np.sqrt(np.diag(after)), rtol=1e-9)
    assert np.all(np.diff(found[:, :2, 0], axis=0) > 0.0)  # rarer measurements, larger sigma
    assert np.all(np.diff(found[:, :2, 0], axis=1) > 0.0)
