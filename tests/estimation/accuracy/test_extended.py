"""Klaus' filter, worst correlation, and the gain they rest on."""

import itertools

import numpy as np
import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy import extended
from nebosvod.estimation.problem.sources import measurement_gain


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


def test_biases_that_say_nothing_new_to_klaus_filter_change_nothing():
    """A column of zeros (an instrument that was off) or one that repeats others costs no measurement."""
    rng = np.random.default_rng(0)
    U, S = rng.normal(size=(12, 3)), rng.normal(size=(12, 2))
    names = ("a", "b", "c")
    wanted = extended.klaus(U, S, names)
    more = np.column_stack([np.zeros(12), S[:, 0], S[:, 0] - 2.0 * S[:, 1], S[:, 1]])
    found = extended.klaus(U, more, names)
    np.testing.assert_allclose(found.covariance, wanted.covariance, rtol=1e-10)
    none = extended.klaus(U, np.zeros((12, 1)), names)
    np.testing.assert_allclose(none.covariance @ (U.T @ U), np.eye(3), atol=1e-10)


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
    assert found.sigma == pytest.approx(found.bound, rel=1e-4)


TIMES = {
    "steady": np.arange(48.0),
    "irregular": np.arange(48.0) + np.random.default_rng(2).uniform(-0.4, 0.4, 48),
    "triplets a night": (np.arange(16.0)[:, None] + [0.0, 0.03, 0.08]).ravel(),
    "steps of 2 and 3": np.cumsum(np.tile([2.0, 3.0], 24)),
}
RHYTHMS = {"random": None, "a day": 2.0 * np.pi, "near a day": 6.0, "an orbit": 2.0 * np.pi / 0.07, "slow": 0.3}


def dense_scan(a, t):
    """Largest a^T K a by the dense matrix of the family, over decays and all frequencies up to pi / shortest step."""
    span, shortest = np.ptp(t), np.diff(t).min()
    tau = np.abs(t[:, None] - t[None, :])
    pairs, largest = np.outer(a, a).ravel(), 0.0
    frequencies = np.arange(0.1 / span, np.pi / shortest, 0.4 / span)
    for k in np.geomspace(1e-3 / span, 10.0 / shortest, 6):
        damped = (pairs * np.exp(-k * tau.ravel())).astype(np.float32)
        for part in np.array_split(frequencies, 1 + len(frequencies) // 400):
            phase = np.multiply.outer(part, tau.ravel()).astype(np.float32)
            values = np.cos(phase) @ damped + np.abs(np.sin(phase) @ damped) * (k / part)
            largest = max(largest, float(values.max()))
    return np.sqrt(largest)


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("rhythm", RHYTHMS)
def test_the_worst_correlation_is_that_of_a_dense_scan_of_all_frequencies(times, rhythm):
    """Peaks are as narrow as 2 pi / span: a coarse grid of frequencies misses a rhythm of the weights."""
    rng = np.random.default_rng(3)
    t = TIMES[times]
    a = rng.normal(size=len(t))
    if RHYTHMS[rhythm] is not None:
        a = np.cos(RHYTHMS[rhythm] * t + 1.0) * (1.0 + 0.3 * a)
    found = extended.worst_correlation(a, t)
    K = kernel(t, found.decay_per_s, found.frequency_rad_per_s, found.phase_rad)
    assert np.sqrt(a @ K @ a) == pytest.approx(found.sigma, rel=1e-9)  # it is reached ...
    assert np.linalg.eigvalsh(K)[0] > -1e-9  # ... by a correlation that exists
    assert dense_scan(a, t) <= found.sigma * (1.0 + 1e-4)


def test_a_rhythm_of_one_series_is_found_among_others_of_other_length_and_order():
    rng = np.random.default_rng(4)
    t = np.concatenate([np.arange(0.0, 30.0, 0.25), 100.0 + np.sort(rng.uniform(0.0, 12.0, 40))])
    a = np.cos(5.1 * t) + 0.3 * rng.normal(size=len(t))
    series = (t > 60.0).astype(int)
    order = rng.permutation(len(t))
    found = extended.worst_correlation(a[order], t[order], series[order])
    w = np.linspace(0.01, np.pi / 0.25, 4000)
    each = [np.abs(np.exp(1j * np.outer(w, t[series == i])) @ a[series == i]) ** 2 for i in (0, 1)]
    assert found.sigma == pytest.approx(np.sqrt(np.max(each[0] + each[1])), rel=2e-3)  # a decay of nothing: |A(w)|
    assert found.frequency_rad_per_s == pytest.approx(5.1, abs=0.05)


def test_measurements_of_one_moment_are_one_draw():
    found = extended.worst_correlation(np.array([1.0, 2.0, -0.5]), np.full(3, 7.0))
    assert found.sigma == pytest.approx(2.5, rel=1e-12)
    assert extended.worst_correlation(np.zeros(4), np.arange(4.0)).sigma == 0.0


def test_separate_series_do_not_conspire():
    a, t = np.ones(10), np.repeat(np.arange(5.0), 2)
    found = extended.worst_correlation(a, t, np.tile([0, 1], 5))
    assert found.sigma == pytest.approx(np.sqrt(2) * 5.0, rel=5e-3)


def test_worst_prediction_is_between_the_noise_share_and_the_absolute_bound(make_problem):
    from nebosvod.estimation.solvers import batch

    problem = make_problem(seed=3, n=20)
    found = batch.solve(problem)
    W = np.eye(len(found.names))[:2]
    noise = sum(found.shares[name] for name in problem.noise_names)
    for d, worst in enumerate(extended.worst_prediction(problem, W, np.arange(20.0))):
        assert worst.sigma_white == pytest.approx(np.sqrt(noise[d, d]), rel=1e-9)  # type: ignore[index]
        assert worst.sigma_white <= worst.sigma <= worst.bound


def test_bias_imitates_works_on_blocks(make_problem):
    problem = make_problem(seed=3)
    assert extended.bias_imitates(problem, "state", "bias A").covariance is not None


def few_case(seed, m=9, s=3):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(m, s)), rng.uniform(0.5, 2.0, m), rng.normal(size=s)


@pytest.mark.parametrize("seed", range(6))
def test_lidovs_few_measurements_are_the_best_of_all_subsets_by_brute_force(seed):
    """All 84 choices of three measurements out of nine determine the state of three; none bounds it better."""
    U, sigma, p = few_case(seed)
    found = extended.few_measurements(U, sigma, p)
    assert len(found.rows) <= 3
    np.testing.assert_allclose(U.T @ found.weights, p, atol=1e-12)
    assert found.bound == pytest.approx(np.abs(found.weights) @ sigma, rel=1e-12)
    best = min(
        np.abs(np.linalg.solve(U[list(rows)].T, p)) @ sigma[list(rows)] for rows in itertools.combinations(range(9), 3)
    )
    assert found.bound == pytest.approx(best, rel=1e-9)


def test_six_measurements_suffice_for_a_state_of_six_and_no_correlation_passes_their_bound():
    U, sigma, p = few_case(1, m=60, s=6)
    found = extended.few_measurements(U, sigma, p)
    assert len(found.rows) == 6
    W = np.diag(sigma**-2.0)
    least = W @ U @ np.linalg.solve(U.T @ W @ U, p)
    assert found.bound_all == pytest.approx(np.abs(least) @ sigma, rel=1e-9)
    assert found.bound < 0.9 * found.bound_all  # least squares is not the best against all correlations
    rng = np.random.default_rng(2)
    for _ in range(300):
        A = rng.normal(size=(60, rng.integers(1, 4)))
        correlation = A @ A.T
        unit = np.sqrt(np.diag(correlation))
        K = sigma[:, None] * correlation / np.outer(unit, unit) * sigma
        assert np.sqrt(found.weights @ K @ found.weights) <= found.bound * (1 + 1e-12)
        assert np.sqrt(least @ K @ least) <= found.bound_all * (1 + 1e-12)
    signs = np.sign(found.weights) * sigma
    assert np.sqrt(found.weights @ np.outer(signs, signs) @ found.weights) == pytest.approx(found.bound, rel=1e-12)


def test_a_base_with_the_information_of_the_rest_added_is_the_covariance_of_all_and_the_base_bounds_it():
    """[iK_r0 + sum iG_k]^-1 for every base of brute force: one matrix, below each K_r0."""
    U, sigma, _ = few_case(3, m=7)
    rows = U / sigma[:, None]
    whole = np.linalg.solve(rows.T @ rows, np.eye(3))
    for base in itertools.combinations(range(7), 3):
        S = extended.base_bound(U, sigma, base)
        K_r0 = S @ S.T
        rest = rows[[i for i in range(7) if i not in base]]
        np.testing.assert_allclose(
            np.linalg.solve(np.linalg.solve(K_r0, np.eye(3)) + rest.T @ rest, np.eye(3)), whole, rtol=1e-6
        )
        assert np.linalg.eigvalsh(K_r0 - whole)[0] > -1e-9 * np.trace(K_r0)


def test_few_measurements_do_not_depend_on_units_and_refuse_what_is_not_determined():
    U, sigma, p = few_case(4)
    unit = np.array([1e-8, 1.0, 1e8])
    one, two = extended.few_measurements(U, sigma, p), extended.few_measurements(U * unit, sigma, p * unit)
    assert two.bound == pytest.approx(one.bound, rel=1e-9)
    assert list(two.rows) == list(one.rows)
    assert extended.few_measurements(U, sigma, np.zeros(3)).bound == 0.0
    with pytest.raises(GeometryError, match="do not determine"):
        extended.few_measurements(U[:2], sigma[:2], p)
    with pytest.raises(GeometryError, match="do not determine"):
        extended.base_bound(U, sigma, (0, 1))
    with pytest.raises(InputError, match="sigma must be positive"):
        extended.few_measurements(U, 0.0 * sigma, p)
    with pytest.raises(InputError, match="needs U"):
        extended.few_measurements(U, sigma[:2], p)
