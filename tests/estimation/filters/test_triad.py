"""TRIAD against a known rotation, scipy's solution of Wahba's problem, and Monte Carlo."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters.triad import triad


def test_exact_directions_give_the_rotation():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        R = Rotation.random(random_state=seed).as_matrix()
        reference = rng.normal(size=(2, 3))
        found = triad(3.0 * reference @ R.T, reference).R_body_from_reference
        np.testing.assert_allclose(found, R, atol=1e-13)


def test_the_first_direction_is_kept_and_wahba_with_its_weight_large_agrees():
    rng = np.random.default_rng(1)
    R = Rotation.random(random_state=3).as_matrix()
    reference = rng.normal(size=(2, 3))
    reference /= np.linalg.norm(reference, axis=1, keepdims=True)
    body = reference @ R.T + 0.05 * rng.normal(size=(2, 3))
    body /= np.linalg.norm(body, axis=1, keepdims=True)
    found = triad(body, reference).R_body_from_reference
    np.testing.assert_allclose(found @ reference[0], body[0], atol=1e-14)
    wahba, _ = Rotation.align_vectors(body, reference, weights=[1e8, 1.0])
    np.testing.assert_allclose(found, wahba.as_matrix(), atol=1e-6)


def test_the_covariance_is_that_of_the_errors():
    rng = np.random.default_rng(5)
    R = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    reference = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    exact, sigma = reference @ R.T, (2e-3, 5e-3)
    errors = []
    for _ in range(2000):
        body = exact + np.array(sigma)[:, None] * rng.normal(size=(2, 3))
        found = triad(body, reference).R_body_from_reference
        errors.append(Rotation.from_matrix(found @ R.T).as_rotvec())
    given = triad(exact, reference, sigma).covariance
    unit = np.sqrt(np.diag(given))
    np.testing.assert_allclose(
        np.cov(np.array(errors).T) / np.outer(unit, unit), given / np.outer(unit, unit), atol=0.1
    )


def test_parallel_and_empty_directions_are_refused():
    with pytest.raises(GeometryError, match="parallel"):
        triad([[1, 0, 0], [-2, 0, 0]], [[1, 0, 0], [0, 1, 0]])
    with pytest.raises(InputError, match="no length"):
        triad([[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 0, 0]])
    with pytest.raises(InputError, match="three components"):
        triad([[1, 0], [0, 1]], [[1, 0], [0, 1]])
