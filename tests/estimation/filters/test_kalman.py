"""Pure predict and update, iterated and chord updates, information form, smoother."""

import numpy as np
import pytest
from scipy.stats import chi2

from nebosvod.errors import GeometryError
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief, Information
from nebosvod.estimation.filters.smoother import smooth


def random_system(seed, s=4, p=2, steps=12):
    rng = np.random.default_rng(seed)
    F = [np.eye(s) + 0.1 * rng.normal(size=(s, s)) for _ in range(steps - 1)]
    Q = [0.05 * _spd(rng, s) for _ in range(steps - 1)]
    H = [rng.normal(size=(p, s)) for _ in range(steps)]
    R = [_spd(rng, p) for _ in range(steps)]
    y = [rng.normal(size=p) for _ in range(steps)]
    return F, Q, H, R, y


def _spd(rng, size):
    A = rng.normal(size=(size, size))
    return A @ A.T / size + 0.2 * np.eye(size)


def run(belief, F, Q, H, R, y):
    filtered = []
    for k in range(len(H)):
        if k:
            belief = kalman.predict(belief, F[k - 1], Q[k - 1])
        belief, _ = kalman.update(belief, y[k] - H[k] @ belief.mean, H[k], R[k])
        filtered.append(belief)
    return filtered


def joint_posterior(P0, F, Q, H, R, y):
    """Mean and covariance of all states given all measurements, by one dense normal system."""
    s, steps = len(P0), len(H)
    N, b = np.zeros((s * steps, s * steps)), np.zeros(s * steps)
    N[:s, :s] += np.linalg.solve(P0, np.eye(s))
    for k in range(steps):
        span = slice(s * k, s * k + s)
        N[span, span] += H[k].T @ np.linalg.solve(R[k], H[k])
        b[span] += H[k].T @ np.linalg.solve(R[k], y[k])
        if k:
            both = np.zeros((s, s * steps))
            both[:, span] = np.eye(s)
            both[:, s * (k - 1) : s * k] = -F[k - 1]
            N += both.T @ np.linalg.solve(Q[k - 1], both)
    K = np.linalg.solve(N, np.eye(s * steps))
    return K @ b, K


def test_filter_and_smoother_equal_the_dense_posterior():
    for seed in range(5):
        F, Q, H, R, y = random_system(seed)
        P0 = 3.0 * np.eye(4)
        filtered = run(Belief.of(np.zeros(4), P0), F, Q, H, R, y)
        mean, K = joint_posterior(P0, F, Q, H, R, y)
        np.testing.assert_allclose(filtered[-1].mean, mean[-4:], atol=1e-11)
        np.testing.assert_allclose(filtered[-1].covariance, K[-4:, -4:], atol=1e-12)
        for k, belief in enumerate(smooth(filtered, F, Q)):
            np.testing.assert_allclose(belief.mean, mean[4 * k : 4 * k + 4], atol=1e-10)
            np.testing.assert_allclose(belief.covariance, K[4 * k : 4 * k + 4, 4 * k : 4 * k + 4], atol=1e-11)


def test_smoothing_without_process_noise_carries_the_last_belief_back():
    F, _, H, R, y = random_system(1)
    none = [None] * len(F)
    filtered = run(Belief.of(np.zeros(4), np.eye(4)), F, none, H, R, y)
    smoothed = smooth(filtered, F, none)
    ahead = smoothed[0]
    for transition in F:
        ahead = kalman.predict(ahead, transition)
    np.testing.assert_allclose(ahead.mean, filtered[-1].mean, atol=1e-10)
    np.testing.assert_allclose(ahead.covariance, filtered[-1].covariance, atol=1e-11)


@pytest.mark.parametrize(("prior", "digits"), [(1e2, 1e-12), (1e4, 1e-11), (1e6, 1e-9)])
def test_joseph_form_agrees_with_square_root_up_to_a_prior_of_1e6(prior, digits):
    rng = np.random.default_rng(5)
    belief, P = Belief.of(np.zeros(4), prior * np.eye(4)), prior * np.eye(4)
    for _ in range(20):
        H = rng.normal(size=(2, 4))
        gain, P = kalman.joseph(P, H, np.eye(2))
        belief, innovation = kalman.update(belief, np.zeros(2), H, np.eye(2))
        np.testing.assert_allclose(innovation.gain, gain, atol=1e-7)
    sigma = np.sqrt(np.diag(P))
    assert np.max(np.abs(belief.covariance - P) / np.outer(sigma, sigma)) < digits


def test_the_plain_update_loses_sign_where_the_square_root_does_not():
    prior, H, R = 1e18 * np.eye(2), np.array([[1.0, 1.0 + 1e-9]]), np.eye(1)
    V = H @ prior @ H.T + R
    plain = prior - prior @ H.T @ np.linalg.solve(V, H @ prior)
    belief, _ = kalman.update(Belief.of(np.zeros(2), prior), [0.0], H, R)
    # Through the factor: forming the covariance at this condition number would lose it again.
    assert np.linalg.norm(H @ belief.factor) == pytest.approx(1.0, rel=1e-6)
    assert not 0.5 < (H @ plain @ H.T)[0, 0] < 2.0
    assert (np.diag(belief.factor) > 0).all()


def test_information_form_starts_from_nothing_and_equals_least_squares():
    rng = np.random.default_rng(2)
    H, y = rng.normal(size=(6, 1, 3)), rng.normal(size=6)
    information = Information.nothing(3)
    for k in range(6):
        if k < 3:
            with pytest.raises(GeometryError, match="not determined"):
                information.belief()
        information = kalman.inform(information, y[k], H[k], np.eye(1))
    wanted, *_ = np.linalg.lstsq(H[:, 0], y, rcond=None)
    np.testing.assert_allclose(information.belief().mean, wanted, rtol=1e-10)
    normal = H[:, 0].T @ H[:, 0]
    np.testing.assert_allclose(information.belief().covariance @ normal, np.eye(3), atol=1e-10)


def test_the_gate_leaves_out_gross_errors_and_keeps_the_belief():
    belief = Belief.of([0.0], [[1.0]])
    after, innovation = kalman.update(belief, [50.0], np.eye(1), np.eye(1), gate=0.999)
    assert after is belief
    assert not innovation.accepted
    assert innovation.nis == pytest.approx(50.0**2 / 2.0)
    rng = np.random.default_rng(0)
    kept = 0
    for residual in rng.normal(size=2000) * np.sqrt(2.0):
        kept += kalman.update(belief, [residual], np.eye(1), np.eye(1), gate=0.95)[1].accepted
    low, high = 2000 * 0.95 + np.array([-1, 1]) * 2.58 * np.sqrt(2000 * 0.95 * 0.05)
    assert low < kept < high


def test_an_indefinite_measurement_covariance_is_refused():
    with pytest.raises(GeometryError):
        kalman.update(Belief.of([0.0], [[1.0]]), [0.0], np.eye(1), -np.eye(1))


def polar(x):
    """Range and bearing from the origin, with partials."""
    r = np.hypot(*x)
    return np.array([r, np.arctan2(x[1], x[0])]), np.array([[x[0] / r, x[1] / r], [-x[1] / r**2, x[0] / r**2]])


def range_bearing_nees(estimator, runs=200):
    """NEES of one precise range and bearing on a wide prior: strongly nonlinear."""
    rng = np.random.default_rng(77)
    R = np.diag([0.01**2, 0.02**2])
    P0 = np.diag([0.6**2, 0.6**2])
    out = []
    for _ in range(runs):
        truth = np.array([3.0, 1.0]) + 0.6 * rng.normal(size=2)
        observed = polar(truth)[0] + np.linalg.cholesky(R) @ rng.normal(size=2)
        belief = estimator(Belief.of([3.0, 1.0], P0), observed, R)
        out.append(kalman.normalized_error_squared(belief, truth))
    return np.array(out)


def test_the_iterated_update_is_consistent_where_the_printed_one_is_wildly_optimistic():
    right = range_bearing_nees(lambda b, y, R: kalman.iterated_update(b, y, polar, R)[0])
    median = chi2.ppf(0.5, 2)  # 1.386
    assert np.median(right) == pytest.approx(median, rel=0.2)
    low, high = chi2.ppf([0.005, 0.995], 2 * right.size)
    assert low < right.sum() < high
    printed = range_bearing_nees(lambda b, y, R: kalman.iterated_update_as_printed(b, y, polar, R, 10))
    assert np.median(printed) > 10.0 * median


def test_the_printed_iteration_counts_the_measurement_as_often_as_it_iterates():
    H = np.array([[1.0, 0.3], [0.2, 0.8]])
    R, P0 = np.diag([0.1, 0.2]), np.eye(2)
    belief = kalman.iterated_update_as_printed(Belief.of(np.zeros(2), P0), np.zeros(2), lambda x: (H @ x, H), R, 5)
    information = np.eye(2) + 5 * H.T @ np.linalg.solve(R, H)
    np.testing.assert_allclose(belief.covariance @ information, np.eye(2), atol=1e-10)


def test_chord_linearisation_of_a_cube_gives_the_textbook_numbers():
    """h = x^3, m = 1, s = 0.6: slope 4.08, mean shift 1.08, exact residual variance 2.613 (Platonov, Ivanov)."""
    line = kalman.chord(lambda x: x**3, Belief.of([1.0], [[0.36]]))
    assert line.slope[0, 0] == pytest.approx(4.08, abs=1e-12)
    assert line.mean_shift[0] == pytest.approx(1.08, abs=1e-12)
    s = 0.6  # exact: Var(x^3) - slope^2 s^2 with moments of the normal distribution
    variance = 9 * s**2 + 36 * s**4 + 15 * s**6
    assert variance - line.slope[0, 0] ** 2 * s**2 == pytest.approx(2.613, abs=5e-4)
    assert line.residual_covariance[0, 0] == pytest.approx(variance - line.slope[0, 0] ** 2 * s**2, rel=1e-12)


def test_chord_linearisation_sees_what_two_axes_do_together():
    """f = x y has no slope at zero and the variance 1, which chords along the axes do not see at all."""
    line = kalman.chord(lambda x: x[:1] * x[1:], Belief.of([0.0, 0.0], np.eye(2)))
    np.testing.assert_allclose(line.slope, 0.0, atol=1e-14)
    assert line.mean_shift[0] == pytest.approx(0.0, abs=1e-14)
    assert line.residual_covariance[0, 0] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
@pytest.mark.parametrize("wide", [False, True])
def test_chord_linearisation_of_any_cubic_is_that_of_exact_moments(size, wide):
    """Random cubic maps, all mixed terms, correlated belief: E f, cov(f, x) iP and the rest by tensor quadrature."""
    rng = np.random.default_rng(size)
    linear, square, cube = (rng.normal(size=(2, *[size] * degree)) for degree in (1, 2, 3))

    def f(x):
        return linear @ x + square @ x @ x + cube @ x @ x @ x

    belief = Belief.of(rng.normal(size=size), _spd(rng, size))
    if wide:  # a factor with more columns than rows is the same belief
        turn = np.linalg.qr(rng.normal(size=(size + 2, size + 2)))[0][:size]
        belief = Belief(mean=belief.mean, factor=belief.factor @ turn)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)  # exact to degree 9: the square of a cubic has 6
    grid = np.stack(np.meshgrid(*[nodes] * size, indexing="ij"), axis=-1).reshape(-1, size)
    w = np.prod(np.stack(np.meshgrid(*[weights] * size, indexing="ij"), axis=-1).reshape(-1, size), axis=1)
    w /= w.sum()
    L = np.linalg.cholesky(belief.covariance)
    values = np.stack([f(belief.mean + L @ draw) for draw in grid])
    mean = w @ values
    slope = np.linalg.solve(L.T, (w[:, None] * grid).T @ (values - mean)).T
    rest = values - mean - (grid @ L.T) @ slope.T
    line = kalman.chord(f, belief)
    np.testing.assert_allclose(line.value, mean, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(line.mean_shift, mean - f(belief.mean), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(line.slope, slope, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(line.residual_covariance, (w[:, None] * rest).T @ rest, rtol=1e-9, atol=1e-9)


def test_chord_linearisation_of_a_line_is_the_line_whatever_the_factor():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(2, 3))
    line = kalman.chord(lambda x: A @ x + 1.0, Belief.of(np.ones(3), _spd(rng, 3)))
    np.testing.assert_allclose(line.slope, A, atol=1e-12)
    np.testing.assert_allclose(line.residual_covariance, 0.0, atol=1e-24)


@pytest.mark.parametrize("start", [3.0, 30.0, -8.0])
def test_the_iterated_update_says_when_it_has_not_found_the_minimum(start):
    """arctan far out on a wide prior: converged means at a minimum of the cost, on a dense grid of it."""
    P, R, y = 1e4, 1e-4, 0.0
    belief = Belief.of([start], [[P]])

    def measure(x):
        return np.arctan(x), np.array([[1.0 / (1.0 + x[0] ** 2)]])

    after, _, converged = kalman.iterated_update(belief, [y], measure, R * np.eye(1), limit=60)
    x = np.linspace(-400.0, 400.0, 2_000_001)
    cost = (x - start) ** 2 / P + (y - np.arctan(x)) ** 2 / R
    assert np.isfinite(after.mean).all()
    if converged:
        assert after.mean[0] == pytest.approx(x[np.argmin(cost)], abs=1e-3)
    else:
        assert (after.mean[0] - start) ** 2 / P + np.arctan(after.mean[0]) ** 2 / R <= np.arctan(start) ** 2 / R


def test_the_iterated_update_with_wrong_partials_or_an_overflow_has_not_converged():
    belief = Belief.of([1.0], [[4.0]])
    _, _, converged = kalman.iterated_update(belief, [5.0], lambda x: (x, -np.eye(1)), 0.01 * np.eye(1))
    assert not converged

    def explodes(x):
        with np.errstate(over="ignore"):
            return np.exp(400.0 * x), np.exp(400.0 * x)[:, None] * 400.0

    after, _, converged = kalman.iterated_update(belief, [5.0], explodes, 0.01 * np.eye(1))
    assert np.isfinite(after.mean).all()
    assert not converged or np.exp(400.0 * after.mean[0]) == pytest.approx(5.0, rel=0.1)
