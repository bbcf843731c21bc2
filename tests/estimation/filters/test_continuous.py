"""Van Loan's discretisation, against closed forms and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from nebosvod.errors import InputError
from nebosvod.estimation.filters.continuous import discretise


def test_closed_forms_of_the_textbooks():
    h, q = 0.7, 2.5
    F, Q = discretise([[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, q]], h)  # white acceleration
    np.testing.assert_allclose(F, [[1.0, h], [0.0, 1.0]], atol=1e-15)
    np.testing.assert_allclose(Q, q * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]), rtol=1e-14)
    F, Q = discretise([[-1.0 / 3.0]], [[q]], h)  # Ornstein and Uhlenbeck
    assert F[0, 0] == pytest.approx(np.exp(-h / 3.0), rel=1e-14)
    assert Q[0, 0] == pytest.approx(1.5 * q * (1.0 - np.exp(-2.0 * h / 3.0)), rel=1e-14)
    F, Q = discretise(np.zeros((2, 2)), q * np.eye(2), h)
    np.testing.assert_allclose(Q, q * h * np.eye(2))
    F, Q = discretise([[0.0, 1.0], [0.0, 0.0]], np.zeros((2, 2)), 0.0)
    np.testing.assert_array_equal(F, np.eye(2))
    np.testing.assert_array_equal(Q, 0.0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step", [0.01, 1.0, 6.0])
def test_random_systems_agree_with_quadrature_of_the_definition(seed, step):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4)) - 0.8 * np.eye(4)
    B = rng.normal(size=(4, 2))
    F, Q = discretise(A, B @ B.T, step)
    wanted, _ = quad_vec(lambda t: expm(A * t) @ B @ B.T @ expm(A * t).T, 0.0, step, epsrel=1e-12, epsabs=1e-14)
    np.testing.assert_allclose(F, expm(A * step), rtol=1e-10, atol=1e-12 * np.abs(F).max())
    np.testing.assert_allclose(Q, wanted, rtol=1e-9, atol=1e-11 * np.abs(Q).max())


def test_a_stiff_system_over_a_long_step_ends_at_its_stationary_covariance():
    """exp(+700) of the direct exponential would be infinite."""
    F, Q = discretise([[-7.0]], [[3.0]], 500.0)
    assert F[0, 0] == pytest.approx(0.0, abs=1e-300)
    assert Q[0, 0] == pytest.approx(3.0 / 14.0, rel=1e-12)


def test_wrong_shapes_and_numbers_are_refused():
    with pytest.raises(InputError, match="square alike"):
        discretise(np.zeros((2, 3)), np.zeros((2, 2)), 1.0)
    with pytest.raises(InputError, match="finite"):
        discretise([[np.nan]], [[1.0]], 1.0)
    with pytest.raises(InputError, match="finite"):
        discretise([[0.0]], [[1.0]], -1.0)
