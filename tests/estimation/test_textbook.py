"""Exercises of the textbook with their answers, and its misprints with the number that shows each.

Platonov, Ivanov 2013, Methods of measurement processing. The exercises are numbered here in the order of the book's
pages; each is answered by the package and by a closed form or dense algebra beside it.
"""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.optimize import linprog
from scipy.special import erf

from nebosvod.estimation.accuracy import ellipse, extended, guaranteed
from nebosvod.estimation.accuracy.conditional import conditional_sigmas, regress
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.continuous import discretise
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.normal_places import GaussFilter
from nebosvod.estimation.filters.steady import steady_state
from nebosvod.estimation.filters.triad import triad
from nebosvod.estimation.problem.square_root import covariance_factor
from nebosvod.estimation.solvers import parabolic


def inverse(matrix):
    return np.linalg.solve(matrix, np.eye(len(matrix)))


def test_exercise_1_probability_inside_one_and_three_sigmas():
    """p. 4 prints another number for one sigma."""
    assert ellipse.probability(1.0, 1) == pytest.approx(0.683, abs=5e-4)
    assert ellipse.probability(1.0, 1) == pytest.approx(erf(1.0 / np.sqrt(2.0)), rel=1e-12)
    assert ellipse.probability(3.0, 1) == pytest.approx(0.9973, abs=5e-5)


def test_exercise_2_probability_inside_an_ellipse_and_the_ellipse_of_a_probability():
    assert [round(ellipse.probability(level), 4) for level in (1.0, 2.0, 3.0)] == [0.3935, 0.8647, 0.9889]
    assert ellipse.level_of(0.5) == pytest.approx(1.1774, abs=5e-5)
    assert ellipse.level_of(0.997) == pytest.approx(3.409, abs=5e-4)
    assert ellipse.level_of(0.997) == pytest.approx(np.sqrt(-2.0 * np.log(0.003)), rel=1e-10)


def test_exercise_3_the_three_sigma_ellipsoid_holds_less_with_every_dimension():
    assert [round(ellipse.probability(3.0, d), 4) for d in (2, 3, 6)] == [0.9889, 0.9707, 0.8264]


@pytest.mark.parametrize("r", [0.0, 0.5, -0.9])
def test_exercise_4_semi_axes_and_angle_of_an_ellipse(r):
    sx, sy = 3.0, 1.2
    K = np.array([[sx**2, r * sx * sy], [r * sx * sy, sy**2]])
    found = ellipse.Ellipse.of_covariance(K)
    np.testing.assert_allclose(found.semi_axes, np.sqrt(np.linalg.eigvalsh(K)[::-1]), rtol=1e-12)
    assert found.angle_rad == pytest.approx(0.5 * np.arctan2(2.0 * r * sx * sy, sx**2 - sy**2), abs=1e-12)


def test_exercise_5_marginal_and_conditional_sigma_and_the_regression_line():
    """p. 28 mixes them: a block of K is marginal; the inverse of a block of K^-1 is conditional."""
    K = np.array([[4.0, 1.8, 0.5], [1.8, 1.0, 0.2], [0.5, 0.2, 2.0]])
    belief = Belief.of(np.zeros(3), K)
    assert np.sqrt(K[0, 0]) == 2.0
    assert conditional_sigmas(belief.factor)[0] == pytest.approx(inverse(K)[0, 0] ** -0.5, rel=1e-12)
    assert conditional_sigmas(belief.factor)[0] < 0.9  # less than half of the marginal
    assert regress(belief, [0], [1]).slope[0, 0] == pytest.approx(1.8)
    np.testing.assert_allclose(regress(belief, [0, 1], [2]).at(0.0).covariance, inverse(inverse(K)[:2, :2]), rtol=1e-10)


def test_exercise_6_square_root_of_a_matrix():
    A = np.array([[4.0, 2.0, 2.0], [2.0, 5.0, 3.0], [2.0, 3.0, 6.0]])
    np.testing.assert_allclose(
        covariance_factor(A, "A").T, [[2.0, 1.0, 1.0], [0.0, 2.0, 1.0], [0.0, 0.0, 2.0]], atol=1e-14
    )


def test_exercise_7_accumulation_with_phase_noise_is_the_kalman_filter():
    """pp. 88-90. As printed the prior counts twice (88), and the gain holds K^-1 where K is right (90)."""
    F, Q, H, R = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.0, 0.01]), np.array([[1.0, 0.0]]), np.eye(1)
    y = np.array([0.9, 2.2, 2.8, 4.1, 5.0, 5.9])
    belief = Belief.of([0.0, 1.0], np.diag([0.04, 0.04]))
    gauss = GaussFilter.start(2).add(belief.mean, np.eye(2), belief.covariance)
    printed, K = belief.mean, belief.covariance
    for measured in y:
        belief = kalman.predict(belief, F, Q)
        belief, _ = kalman.update(belief, measured - H @ belief.mean, H, R)
        gauss = gauss.move(F, Q).add([measured], H, R)
        K = inverse(inverse(F @ K @ F.T + Q) + H.T @ H)
        printed = F @ printed + inverse(K) @ H.T @ (measured - H @ F @ printed)
    x, S, _ = gauss.solution()
    np.testing.assert_allclose(x, belief.mean, rtol=1e-10)
    np.testing.assert_allclose(S @ S.T, belief.covariance, rtol=1e-10)
    assert np.abs(belief.mean).max() < 7.0
    assert np.abs(printed).max() > 1e4  # the printed recursion explodes
    once = GaussFilter.start(1).add([0.0], np.eye(1), np.eye(1))
    twice = once.add([0.0], np.eye(1), np.eye(1))
    assert once.solution()[1][0, 0] / twice.solution()[1][0, 0] == pytest.approx(np.sqrt(2.0))  # sigma too small


def test_exercise_8_chord_of_a_cube():
    line = kalman.chord(lambda x: x**3, Belief.of([1.0], [[0.36]]))
    assert line.slope[0, 0] == pytest.approx(4.08, abs=5e-3)
    assert line.mean_shift[0] == pytest.approx(1.08, abs=5e-3)
    assert line.residual_covariance[0, 0] == pytest.approx(2.613, abs=5e-4)


@pytest.mark.parametrize(("ratio", "positive"), [(0.5, True), (0.99, True), (1.05, False), (1.5, False)])
def test_exercise_9_akims_correlation_is_one_if_the_phase_is_small_enough(ratio, positive):
    """exp(-k|t|) cos(w|t| + phi)/cos phi is positive definite iff |tan phi| <= k/w."""
    k, w = 0.3, 0.9
    phi = np.arctan(ratio * k / w)
    t = np.arange(0.0, 40.0, 0.05)
    column = np.exp(-k * t) * np.cos(w * t + phi) / np.cos(phi)
    assert (np.linalg.eigvalsh(toeplitz(column))[0] > -1e-9) == positive


def test_exercise_10_lidovs_measurements_and_the_bound_of_any_correlation():
    """pp. 131-138, a line from nine measurements: its value at t = 2 is best told by the two at the ends."""
    t = np.linspace(-1.0, 1.0, 9)
    U, p = np.stack([np.ones(9), t], axis=1), np.array([1.0, 2.0])
    found = extended.few_measurements(U, np.ones(9), p)
    np.testing.assert_array_equal(found.rows, [0, 8])
    assert found.bound == pytest.approx(0.5 + 1.5)  # weights -1/2 and 3/2
    wanted = linprog(np.ones(18), A_eq=np.hstack([U.T, -U.T]), b_eq=p)
    assert found.bound == pytest.approx(wanted.fun)
    assert found.bound < found.bound_all
    # p. 137: [iK_r0 + sum iG_k]^-1 is the covariance of all measurements, whichever two begin; conditional it is not
    rest = [k for k in range(9) if k not in (0, 8)]
    S = extended.base_bound(U, np.ones(9), [0, 8])
    np.testing.assert_allclose(inverse(inverse(S @ S.T) + U[rest].T @ U[rest]), inverse(U.T @ U), atol=1e-12)


def test_exercise_11_guaranteed_bounds_of_a_square():
    found = guaranteed.extreme(guaranteed.polytope([[1.0, 1.0], [1.0, -1.0]], [1.0, 2.0]), np.eye(2))
    np.testing.assert_allclose(found.upper, [1.5, 1.5], rtol=1e-9)


def test_exercise_12_the_root_of_the_cost_along_the_exact_descent():
    def whitened(x):
        return np.array([x[0] ** 2 + x[1] - 3.0, x[0] - x[1] ** 3]), np.array(
            [[2.0 * x[0], 1.0], [1.0, -3.0 * x[1] ** 2]]
        )

    path = parabolic.descend(whitened, [3.0, 2.0])
    assert path.status == "converged"
    np.testing.assert_allclose(path.psi, (np.sqrt(path.psi[0]) - path.s) ** 2, atol=1e-3)


def test_table_1_discretisation_and_page_200_steady_accuracy():
    F, Q = discretise([[0.0, 1.0], [0.0, 0.0]], np.diag([0.0, 3.0]), 2.0)
    np.testing.assert_allclose(Q, 3.0 * np.array([[8.0 / 3.0, 2.0], [2.0, 2.0]]), rtol=1e-12)
    P = steady_state(F, Q, np.array([[1.0, 0.0]]), np.eye(1)).predicted
    after = P - np.outer(P[:, 0], P[0]) / (P[0, 0] + 1.0)
    np.testing.assert_allclose(F @ after @ F.T + Q, P, rtol=1e-9)


def test_page_58_an_estimate_is_linear_in_what_was_measured():
    """With psi_i twice in the right side of the normal equations, doubled measurements would count four times."""

    def estimate(y):
        gauss = GaussFilter.start(1)
        for value, slope in zip(y, (1.0, 2.0, 0.5)):
            gauss = gauss.add([value], np.array([[slope]]), np.eye(1))
        return gauss.solution()[0][0]

    y = np.array([1.0, 3.0, 0.2])
    assert estimate(2.0 * y) == pytest.approx(2.0 * estimate(y))
    h = np.array([1.0, 2.0, 0.5])
    assert h @ (2.0 * y) ** 2 / (h @ y**2) == pytest.approx(4.0)


def test_formula_b_6_the_singular_value_decomposition_has_v_transposed():
    A = np.array([[2.0, 1.0], [0.0, 1.0]])
    U, s, Vt = np.linalg.svd(A)
    np.testing.assert_allclose(U @ np.diag(s) @ Vt, A, atol=1e-14)
    assert np.abs(U @ np.diag(s) @ Vt.T - A).max() > 0.5


def test_page_193_the_matrix_of_small_angles_holds_near_unity_only():
    """I + [a x] against the rotation: off by a^2 / 2, 5e-5 at 0.01 rad and a half at 1 rad; TRIAD has no such limit."""
    for a, low, high in ((0.01, 4e-5, 6e-5), (1.0, 0.4, 0.5)):
        c, s = np.cos(a), np.sin(a)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        small = np.array([[1.0, -a, 0.0], [a, 1.0, 0.0], [0.0, 0.0, 1.0]])
        assert low < np.abs(small - R).max() < high
        pair = np.array([[1.0, 0.2, 0.3], [-0.4, 1.0, 0.1]])
        np.testing.assert_allclose(triad(pair @ R.T, pair).R_body_from_reference, R, atol=1e-14)
