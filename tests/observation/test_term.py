"""Square roots of covariances that may be singular."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.term import root


def test_root_squares_to_the_covariance_also_when_it_is_singular():
    rng = np.random.default_rng(2)
    thin = rng.normal(size=(5, 3, 2))
    covariance = thin @ np.swapaxes(thin, 1, 2)
    factor = root(covariance)
    np.testing.assert_allclose(factor @ np.swapaxes(factor, 1, 2), covariance, atol=1e-14)
    np.testing.assert_array_equal(root(np.zeros((2, 2))), 0.0)


def test_an_indefinite_covariance_is_refused_with_its_eigenvalue():
    with pytest.raises(InputError, match=r"smallest eigenvalue -1"):
        root(np.array([[1.0, 2.0], [2.0, 1.0]]))
