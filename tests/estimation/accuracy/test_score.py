"""Score tests against dense least squares and against drawn data."""

import math

import numpy as np
import pytest
from scipy.stats import chi2 as chi_square

from nebosvod.estimation.accuracy import score
from nebosvod.estimation.accuracy.score import alone, among, score_test, sigmas


def made(seed, n=60, s=4, k=2, truth=(0.0, 0.0), nights=20, scale=1.0):
    """Whitened residuals of a least-squares fit without the new parameters, partials, and what the test needs."""
    rng = np.random.default_rng(seed)
    B, G = rng.standard_normal((n, 2, s)), rng.standard_normal((n, 2, k))
    y = scale * rng.standard_normal((n, 2)) + G @ np.array(truth)
    x = np.linalg.lstsq(B.reshape(-1, s), y.ravel(), rcond=None)[0]
    q = y - B @ x
    N = np.tensordot(B, B, axes=([0, 1], [0, 1]))
    night = np.repeat(np.arange(nights), n // nights)
    return q, B, G, N, np.zeros(s), np.ones(n, dtype=bool), night, y


def test_the_estimate_is_that_of_a_fit_with_the_new_parameters():
    q, B, G, N, g, inside, night, y = made(1, truth=(0.3, -0.2))
    found = score_test(q, B, G, N, g, inside, night)
    design = np.concatenate([B, G], axis=2).reshape(-1, 6)
    x = np.linalg.lstsq(design, y.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found.estimate, x[4:], rtol=1e-10)
    drop = np.sum(q**2) - np.sum((y.ravel() - design @ x) ** 2)
    assert found.explained == pytest.approx(drop, rel=1e-10)


def test_a_group_that_the_fit_left_out_is_tested_like_one_that_it_used():
    """The fit is made from the other half; the test must answer as a joint fit of everything does."""
    _q, B, G, _N, _g, _inside, night, y = made(2, truth=(1.0, 0.5))
    others = np.arange(60) < 30
    design = B[others].reshape(-1, 4)
    x = np.linalg.lstsq(design, y[others].ravel(), rcond=None)[0]
    left = y - B @ x
    rows = np.flatnonzero(~others)
    found = score_test(
        left[rows], B[rows], G[rows], design.T @ design, design.T @ left[others].ravel(), np.zeros(30, dtype=bool),
        night[rows],
    )  # fmt: skip
    both = np.concatenate([B, np.where(others[:, None, None], 0.0, G)], axis=2).reshape(-1, 6)
    np.testing.assert_allclose(found.estimate, np.linalg.lstsq(both, y.ravel(), rcond=None)[0][4:], rtol=1e-9)


@pytest.mark.parametrize("scale", [0.2, 1.0, 5.0])
def test_the_statistic_is_that_of_chance_whatever_the_sigmas_are(scale):
    """1,500 draws without any shared error: the size of the test at 5 and 1 per cent, sigmas wrong by any factor."""
    found = [score_test(*made(seed, scale=scale)[:7]).statistic for seed in range(1500)]
    for level in (0.05, 0.01):
        share = np.mean(np.array(found) > chi_square.isf(level, 2))
        assert share == pytest.approx(level, abs=3.5 * np.sqrt(level / 1500))


def test_errors_alike_within_a_night_are_no_shared_error():
    """Each night has its own error of 3 sigma: with a constant partial that pulls like a bias, and is none."""
    wrong = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        night = np.repeat(np.arange(40), 5)
        G = np.tile(np.eye(2), (200, 1, 1))
        q = rng.standard_normal((200, 2)) + np.repeat(3.0 * rng.standard_normal((40, 2)), 5, axis=0)
        B = rng.standard_normal((200, 2, 3))
        slope = np.tensordot(B, q, axes=([0, 1], [0, 1]))
        N = np.tensordot(B, B, axes=([0, 1], [0, 1]))
        wrong += score_test(q, B, G, N, slope, np.ones(200, dtype=bool), night).significance > 3.0
    assert wrong <= 6  # 0.8 expected; as independent records more than half


def test_gross_errors_do_not_make_a_shared_error():
    q, B, G, N, _g, inside, night, _ = made(4, k=1, truth=(0.0,))
    q[[3, 17]] += 200.0
    slope = np.tensordot(B, q, axes=([0, 1], [0, 1]))
    found = score_test(q, B, G, N, slope, inside, night)
    assert not found.used[[3, 17]].any()
    assert found.significance < 4.0


@pytest.mark.parametrize(("n", "s", "k", "units"), [(4, 3, 1, 0), (40, 6, 4, 6), (300, 7, 16, 3), (400, 6, 44, 0)])
def test_the_answer_is_the_same_where_the_compiled_loops_leave_it_to_numpy(monkeypatch, n, s, k, units):
    """Of few rows and many, gross errors trimmed, nights and units of any size; singular matrices go that way."""
    rng = np.random.default_rng(n)
    B, G = rng.standard_normal((n, 2, s)), rng.standard_normal((n, 2, k)) * 10.0 ** rng.uniform(-units, units, k)
    q = rng.standard_normal((n, 2)) * np.where(rng.random(n) < 0.1, 30.0, 1.0)[:, None]
    inside, night = rng.random(n) < 0.9, rng.integers(0, n // 3 + 1, n)
    others = rng.standard_normal((50, s))
    N = others.T @ others + np.tensordot(B[inside], B[inside], axes=([0, 1], [0, 1]))
    slope = rng.standard_normal(s)
    loops = score_test(q, B, G, N, slope, inside, night)
    monkeypatch.setattr(score, "scored", lambda *given: False)
    plain = score_test(q, B, G, N, slope, inside, night)
    np.testing.assert_array_equal(loops.used, plain.used)
    sigma = np.sqrt(np.diag(plain.covariance))
    np.testing.assert_allclose(loops.estimate / sigma, plain.estimate / sigma, atol=1e-9)
    np.testing.assert_allclose(
        loops.covariance / np.outer(sigma, sigma), plain.covariance / np.outer(sigma, sigma), atol=1e-9
    )
    told = [(one.statistic, one.explained, one.scatter) for one in (loops, plain)]
    np.testing.assert_allclose(told[0], told[1], rtol=1e-9)


def test_what_the_orbit_can_take_up_is_not_tested():
    q, B, _, N, g, inside, night, _ = made(5)
    assert score_test(q, B, B[:, :, :2] + 0.0, N, g, inside, night) is None


@pytest.mark.parametrize(("statistic", "freedom", "expected"), [(25.0, 1, 5.0), (9.0, 1, 3.0), (11.829, 2, 3.0)])
def test_sigmas_of_one_normal_number(statistic, freedom, expected):
    assert sigmas(statistic, freedom) == pytest.approx(expected, abs=1e-3)


def test_sigmas_grow_beyond_what_a_chance_can_be_written_as():
    values = [sigmas(value, 4) for value in (1100.0, 1270.0, 1300.0, 5000.0)]
    assert np.all(np.diff(values) > 0.0)


@pytest.mark.parametrize(("one", "tried"), [(2.5, 1), (3.0, 40), (5.0, 2000)])
def test_the_surest_of_many_is_as_rare_as_it_is_among_them(one, tried):
    """Against the distribution of the largest: Phi written with the error function of the standard library."""
    chance = 1.0 - math.erf(one / math.sqrt(2.0)) ** tried
    assert 1.0 - math.erf(among(one, tried) / math.sqrt(2.0)) == pytest.approx(chance, rel=1e-6)
    assert alone(among(one, tried), tried) == pytest.approx(one, rel=1e-6)


def test_what_is_very_rare_stays_so_among_many():
    values = [among(size, 1000) for size in (35.0, 36.0, 37.0, 40.0, 600.0)]
    assert np.all(np.diff(values) > 0.0)
    assert 599.9 < values[-1] < 600.0
