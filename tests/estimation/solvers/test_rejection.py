"""Rejection and recovery of measurements, by the covariance of each residual."""

from typing import Any

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.solvers.rejection import Thresholds, chi_squared, reselect, settled

PLAIN = Thresholds(fudge=0.0)


def line_fit(y, sigma, selected, t):
    """Straight lines in two components through the selected points: estimate (4,), factor of its covariance, H."""
    H = np.zeros((len(t), 2, 4))
    for axis in range(2):
        H[:, axis, 2 * axis], H[:, axis, 2 * axis + 1] = 1.0, t
    A = (H[selected] / sigma).reshape(-1, 4)
    K = np.linalg.solve(A.T @ A, np.eye(4))
    return K @ (A.T @ (y[selected] / sigma).ravel()), np.linalg.cholesky(K), H


def drawn(rng, n=25, sigma=0.3):
    t = np.linspace(-1.0, 1.0, n)
    truth = np.stack([2.0 + t, -1.0 + 0.5 * t], axis=1)
    return t, truth + sigma * rng.standard_normal((n, 2)), sigma


def rounds(t, y, sigma, thresholds, held=None):
    """Fit and reselect until nothing changes."""
    selected = np.ones(len(t), dtype=bool)
    history: list[Any] = []
    for _ in range(20):
        estimate, S, H = line_fit(y, sigma, selected, t)
        chi2 = chi_squared(y - H @ estimate, np.tile(sigma**2 * np.eye(2), (len(t), 1, 1)), H, S, selected)
        latest = reselect(chi2, selected, thresholds, least=3, held=held)
        if settled([*history, selected], latest):
            return latest, chi2
        history.append(selected)
        selected = latest
    raise AssertionError("did not settle")


@pytest.mark.parametrize("kept", [True, False])
def test_chi_squared_of_a_residual_has_mean_two_whether_it_was_in_the_fit_or_not(kept):
    rng = np.random.default_rng(5)
    sample = []
    for _ in range(4000):
        t, y, sigma = drawn(rng, n=5)
        selected = np.ones(5, dtype=bool)
        selected[0] = kept
        estimate, S, H = line_fit(y, sigma, selected, t)
        R = np.tile(sigma**2 * np.eye(2), (5, 1, 1))
        sample.append(chi_squared(y - H @ estimate, R, H, S, selected)[0])
    # mean 2, variance 4: 99.9 % of the means of 4000 lie within 3.3 * 2 / sqrt(4000) = 0.10
    assert np.mean(sample) == pytest.approx(2.0, abs=0.10)


def test_the_noise_alone_would_give_another_chi_squared():
    """An end point of five carries 60 % of its own value into the line: the plain chi squared is that much smaller."""
    t, y, sigma = drawn(np.random.default_rng(6), n=5)
    selected = np.ones(5, dtype=bool)
    estimate, S, H = line_fit(y, sigma, selected, t)
    residual = y - H @ estimate
    chi2 = chi_squared(residual, np.tile(sigma**2 * np.eye(2), (5, 1, 1)), H, S, selected)
    plain = np.sum(residual**2, axis=1) / sigma**2
    leverage = np.array([1 / 5 + x**2 / np.sum(t**2) for x in t])
    assert chi2 == pytest.approx(plain / (1.0 - leverage), rel=1e-9)


def test_a_tilted_noise_covariance_is_used_whole():
    R = np.array([[[1.0, 0.9], [0.9, 1.0]]])
    along, across = np.array([[1.0, 1.0]]), np.array([[1.0, -1.0]])
    nothing = np.zeros((1, 2, 1)), np.zeros((1, 1))
    rejected = np.array([False])
    assert chi_squared(along, R, *nothing, rejected) == pytest.approx([2.0 / 1.9])
    assert chi_squared(across, R, *nothing, rejected) == pytest.approx([2.0 / 0.1])


def test_a_measurement_the_fit_passes_through_is_no_gross_error():
    """Two points make a line: no residual can say anything, and round-off must not become a chi squared."""
    t = np.array([-1.0, 1.0])
    y = np.array([[1.0, 2.0], [3.0, 4.0]])
    selected = np.ones(2, dtype=bool)
    estimate, S, H = line_fit(y, 0.1, selected, t)
    chi2 = chi_squared(y - H @ estimate + 1e-9, np.tile(0.01 * np.eye(2), (2, 1, 1)), H, S, selected)
    assert np.all(chi2 < 1e-6)


def test_gross_errors_go_and_everything_else_stays():
    rng = np.random.default_rng(2)
    t, y, sigma = drawn(rng)
    y[3] += [30.0, 0.0]
    y[20] += [0.0, -8.0]
    selected, chi2 = rounds(t, y, sigma, PLAIN)
    wanted = np.ones(25, dtype=bool)
    wanted[[3, 20]] = False
    np.testing.assert_array_equal(selected, wanted)
    assert chi2[3] == pytest.approx((30.0 / sigma) ** 2, rel=0.2)


def test_good_neighbours_of_a_gross_error_come_back():
    """With everything above the threshold out at once (fraction 0), recovery has to bring the good ones back."""
    t, y, sigma = drawn(np.random.default_rng(3))
    y[2] += [300.0, 0.0]
    thresholds, everyone = Thresholds(fudge=0.0, fraction=0.0), np.ones(25, dtype=bool)
    estimate, S, H = line_fit(y, sigma, everyone, t)
    chi2 = chi_squared(y - H @ estimate, np.tile(sigma**2 * np.eye(2), (25, 1, 1)), H, S, everyone)
    assert reselect(chi2, everyone, thresholds, least=3).sum() < 10
    selected, _ = rounds(t, y, sigma, thresholds)
    assert not selected[2]
    assert selected.sum() >= 21  # of 24 good ones, 2-3 % of which lie beyond the thresholds by chance


def test_one_round_takes_only_the_worst():
    chi2 = np.array([1000.0, 300.0, 200.0, 9.0, 1.0])
    kept = reselect(chi2, np.ones(5, dtype=bool), PLAIN, least=1)
    np.testing.assert_array_equal(kept, [False, False, True, True, True])


def test_recovery_is_below_rejection():
    chi2 = np.array([7.5, 7.5, 6.9, 8.1])
    kept = reselect(chi2, np.array([True, False, False, True]), PLAIN, least=1)
    np.testing.assert_array_equal(kept, [True, False, True, False])


def test_few_measurements_do_not_outvote_one_another():
    chi2 = np.full(6, 1.0)
    chi2[0] = 60.0
    everyone = np.ones(6, dtype=bool)
    assert reselect(chi2, everyone, Thresholds(), least=3).all()
    chi2[0] = 8.0 + 400.0 / 1.2**6 + 0.1  # the fudge of six measurements
    assert not reselect(chi2, everyone, Thresholds(), least=3)[0]


def test_enough_measurements_stay_to_determine_the_estimate():
    chi2 = np.array([900.0, 800.0, 700.0, 600.0, 500.0])
    kept = reselect(chi2, np.ones(5, dtype=bool), PLAIN, least=3)
    np.testing.assert_array_equal(kept, [False, False, True, True, True])


def test_what_the_user_selected_does_not_change():
    t, y, sigma = drawn(np.random.default_rng(4))
    y[3] += [30.0, 0.0]
    held = np.zeros(25, dtype=bool)
    held[3] = True
    selected = np.ones(25, dtype=bool)
    estimate, S, H = line_fit(y, sigma, selected, t)
    chi2 = chi_squared(y - H @ estimate, np.tile(sigma**2 * np.eye(2), (25, 1, 1)), H, S, selected)
    assert reselect(chi2, selected, PLAIN, least=3, held=held)[3]


def test_a_selection_seen_before_ends_the_rounds():
    first, second = np.array([True, False]), np.array([True, True])
    assert settled([first, second], first)
    assert not settled([second], first)


@pytest.mark.parametrize(
    "wrong", [{"reject": 5.0}, {"recover": 0.0}, {"fraction": 1.0}, {"fudge": -1.0}, {"decay": 1.0}, {"reject": np.inf}]
)
def test_thresholds_that_make_no_sense_are_refused(wrong):
    with pytest.raises(InputError, match="rejection"):
        Thresholds(**wrong)


def test_a_covariance_that_is_not_one_is_named():
    R = np.tile(np.eye(2), (3, 1, 1))
    R[1, 0, 1] = R[1, 1, 0] = 2.0
    with pytest.raises(InputError, match="measurement 1"):
        chi_squared(np.zeros((3, 2)), R, np.zeros((3, 2, 1)), np.zeros((1, 1)), np.ones(3, dtype=bool))
