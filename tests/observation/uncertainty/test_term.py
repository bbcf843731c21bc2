"""Square roots of covariances that may be singular."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.uncertainty.term import root


def test_root_squares_to_the_covariance_also_when_it_is_singular():
    rng = np.random.default_rng(2)
    thin = rng.normal(size=(5, 3, 2))
    covariance = thin @ np.swapaxes(thin, 1, 2)
    factor = root(covariance)
    np.testing.assert_allclose(factor @ np.swapaxes(factor, 1, 2), covariance, atol=1e-14)
    np.testing.assert_array_equal(root(np.zeros((2, 2))), 0.0)


def test_an_indefinite_covariance_is_refused_with_its_eigenvalue():
    with pytest.raises(InputError, match=r"smallest eigenvalue of the correlations -1"):
        root(np.array([[1.0, 2.0], [2.0, 1.0]]))


def test_root_keeps_velocities_beside_positions():
    """km^2 and (km/s)^2 differ by 1e12: eigenvalues of the bare matrix would lose the small block."""
    correlation = np.array([[1.0, -0.999], [-0.999, 1.0]])
    sigma = np.array([10.0, 1e-6])
    covariance = correlation * np.outer(sigma, sigma)
    factor = root(covariance)
    np.testing.assert_allclose((factor @ factor.T) / covariance, 1.0, rtol=1e-12)
