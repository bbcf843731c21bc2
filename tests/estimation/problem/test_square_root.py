"""Factors and triangular reductions."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import (
    append_rows,
    cholesky_rows,
    conditioning,
    covariance_factor,
    gram_factor,
    lower_factor,
)


def test_the_square_root_method_gives_the_textbook_triangle():
    A = np.array([[4.0, 2, 2], [2, 5, 3], [2, 3, 6]])
    S = np.array([[2.0, 1, 1], [0, 2, 1], [0, 0, 2]])  # Platonov, Ivanov 2013: A = S^T S
    np.testing.assert_allclose(covariance_factor(A, "A").T, S, atol=1e-15)
    np.testing.assert_allclose(cholesky_rows(A[None], "A")[0].T, S, atol=1e-15)
    np.testing.assert_allclose(lower_factor(S.T).T, S, atol=1e-14)


def test_a_covariance_in_mixed_units_is_factored_to_relative_accuracy():
    scale = np.array([1e-9, 1.0, 1e12])
    correlation = np.array([[1.0, 0.99, 0.2], [0.99, 1.0, 0.1], [0.2, 0.1, 1.0]])
    L = covariance_factor(scale[:, None] * correlation * scale, "C")
    np.testing.assert_allclose(L @ L.T / np.outer(scale, scale), correlation, rtol=1e-14)


def test_singular_and_zero_covariances_give_narrow_factors():
    assert covariance_factor(np.zeros((2, 2)), "C").shape == (2, 0)
    L = covariance_factor(np.array([[1.0, 2], [2, 4]]), "C")
    assert L.shape == (2, 1)
    np.testing.assert_allclose(L @ L.T, [[1, 2], [2, 4]], rtol=1e-13)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "smallest eigenvalue -1"),
        ([[1.0, 0.5], [0.2, 1.0]], "not symmetric"),
        ([[-1.0, 0.0], [0.0, 1.0]], "negative variance"),
        ([[0.0, 0.5], [0.5, 1.0]], "not positive definite"),
    ],
)
def test_what_is_not_a_covariance_is_refused_and_never_repaired(matrix, words):
    with pytest.raises(InputError, match=words):
        covariance_factor(np.array(matrix), "C")


def test_reduction_in_chunks_equals_one_qr():
    rows = np.random.default_rng(0).normal(size=(1000, 7))
    whole = append_rows(np.zeros((0, 7)), rows)
    parts = append_rows(np.zeros((7, 7)), rows, chunk=13)
    np.testing.assert_allclose(whole.T @ whole, rows.T @ rows, rtol=1e-12)
    np.testing.assert_allclose(np.abs(parts), np.abs(whole), atol=1e-11)


def test_conditioning_ignores_units_and_finds_the_weak_combination():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(30, 3))
    A[:, 2] = A[:, 1] + 1e-5 * A[:, 2]
    plain = conditioning(np.linalg.qr(A, mode="r"))
    scaled = conditioning(np.linalg.qr(A * np.array([1e-9, 1.0, 1e9]), mode="r"))
    assert 1e4 < plain.number < 1e6
    assert scaled.number == pytest.approx(plain.number, rel=1e-5)
    direction = plain.direction / plain.direction[1]
    assert abs(direction[0]) < 1e-4
    assert direction[2] == pytest.approx(-1.0, rel=1e-3)
    assert not conditioning(np.diag([1.0, 0.0])).observable


def test_the_factor_of_a_gram_matrix_drops_what_is_round_off():
    v = np.array([[1.0, 2.0, 3.0]])
    G = gram_factor(v.T @ v)
    assert G.shape == (3, 1)
    np.testing.assert_allclose(G @ G.T, v.T @ v, rtol=1e-14)
