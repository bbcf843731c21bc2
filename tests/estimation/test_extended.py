"""Klaus' filter, worst correlation, and the gain they rest on."""

import numpy as np
import pytest

from nebosvod.estimation import extended
from nebosvod.estimation.sources import measurement_gain


def test_the_gain_is_that_of_the_definition(make_problem, dense):
    for z in ("white", "markov"):
        problem = make_problem(seed=1, z=z)
        gain = measurement_gain(problem)
        np.testing.assert_allclose(gain.reshape(-1, gain.shape[2]).T, dense(problem).M_v, atol=1e-11)


def test_klaus_filter_equals_the_covariance_with_the_bias_estimated_without_prior():
    rng = np.random.default_rng(0)
    U, S = rng.normal(size=(30, 3)), rng.normal(size=(30, 2))
    found = extended.klaus(U, S, ("a", "b", "c"))
    both = np.hstack([U, S])
    K = np.linalg.solve(both.T @ both, np.eye(5))[:3, :3]
    np.testing.assert_allclose(found.covariance, K, rtol=1e-10)


def test_a_bias_that_imitates_the_motion_is_found_and_named():
    t = np.linspace(0.0, 1.0, 20)
    U = np.stack([np.ones(20), t, t**2], axis=1)
    S = (3.0 * np.ones(20) - 2.0 * t)[:, None]  # looks like position and rate together
    found = extended.klaus(U, S, ("position", "rate", "acceleration"))
    assert found.covariance is None
    lengths = np.linalg.norm(U, axis=0)
    direction = np.array([3.0, -2.0, 0.0]) * lengths
    direction /= direction[np.argmax(np.abs(direction))]
    np.testing.assert_allclose(list(found.direction.values()), direction, atol=1e-6)


def kernel(t, k, w, phi):
    tau = np.abs(t[:, None] - t[None, :])
    return np.exp(-k * tau) * np.cos(w * tau + phi) / np.cos(phi)


def test_the_family_is_positive_definite_up_to_its_edge_and_not_beyond():
    t = np.linspace(0.0, 10.0, 150)
    k, w = 0.5, 1.5
    edge = np.arctan(k / w)
    for phi in (edge, -edge, 0.0):
        assert np.linalg.eigvalsh(kernel(t, k, w, phi))[0] > -1e-9
    assert np.linalg.eigvalsh(kernel(t, k, w, edge + 0.1))[0] < -1e-6


def test_the_recursion_equals_the_double_sum_and_the_search_finds_the_worst():
    rng = np.random.default_rng(5)
    a, t = rng.normal(size=25), np.sort(rng.uniform(0, 10, 25))
    found = extended.worst_correlation(a, t)
    K = kernel(t, found.decay_per_s, found.frequency_rad_per_s, found.phase_rad)
    assert np.sqrt(a @ K @ a) == pytest.approx(found.sigma, rel=1e-9)
    assert found.sigma_white == pytest.approx(np.linalg.norm(a), rel=1e-12)
    assert found.sigma_white <= found.sigma <= found.bound == pytest.approx(np.abs(a).sum())
    for _ in range(300):
        k, w = np.exp(rng.uniform(np.log(0.01), np.log(50.0), 2))
        phi = np.arctan(rng.uniform(-1, 1) * k / w)
        assert a @ kernel(t, k, w, phi) @ a <= found.sigma**2 * (1 + 1e-6)


def test_weights_of_one_sign_reach_the_bound_of_full_correlation():
    found = extended.worst_correlation(np.ones(10), np.arange(10.0))
    assert found.sigma == pytest.approx(found.bound, rel=2e-3)


def test_separate_series_do_not_conspire():
    a, t = np.ones(10), np.repeat(np.arange(5.0), 2)
    found = extended.worst_correlation(a, t, np.tile([0, 1], 5))
    assert found.sigma == pytest.approx(np.sqrt(2) * 5.0, rel=5e-3)


def test_worst_prediction_is_between_the_noise_share_and_the_absolute_bound(make_problem):
    from nebosvod.estimation import batch

    problem = make_problem(seed=3, n=20)
    found = batch.solve(problem)
    W = np.eye(len(found.names))[:2]
    noise = sum(found.shares[name] for name in problem.noise_names)
    for d, worst in enumerate(extended.worst_prediction(problem, W, np.arange(20.0))):
        assert worst.sigma_white == pytest.approx(np.sqrt(noise[d, d]), rel=1e-9)
        assert worst.sigma_white <= worst.sigma <= worst.bound


def test_bias_imitates_works_on_blocks(make_problem):
    problem = make_problem(seed=3)
    assert extended.bias_imitates(problem, "state", "bias A").covariance is not None
