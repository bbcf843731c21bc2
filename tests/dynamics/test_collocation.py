"""The tables of the integrator against 40-digit arithmetic."""

import mpmath as mp
import numpy as np
import pytest

from nebosvod.dynamics import collocation


@pytest.fixture(scope="module")
def exact() -> tuple[list[mp.mpf], mp.matrix]:
    """Nodes of the shifted Legendre polynomial of degree 8, and the integrals of their Lagrange polynomials."""
    with mp.workdps(40):
        starts = (np.polynomial.legendre.leggauss(8)[0] + 1.0) / 2.0
        nodes = [mp.findroot(lambda c: mp.legendre(8, 2 * c - 1), mp.mpf(float(start))) for start in starts]
        powers = mp.matrix(8, 8)
        for i in range(8):
            for k in range(8):
                powers[i, k] = nodes[i] ** k
        A = mp.matrix(8, 8)
        for j in range(8):
            unit = mp.matrix(8, 1)
            unit[j] = 1
            coefficient = mp.lu_solve(powers, unit)
            for i in range(8):
                A[i, j] = mp.fsum(coefficient[k] * nodes[i] ** (k + 1) / (k + 1) for k in range(8))
        return nodes, A


def test_nodes_and_integrals_are_right_to_the_last_digit(exact: tuple[list[mp.mpf], mp.matrix]) -> None:
    """6e-16: rounding of sums of eight products of numbers below one."""
    nodes, A = exact
    wanted = np.array([[float(A[i, j]) for j in range(8)] for i in range(8)])
    with mp.workdps(40):
        square = A * A
    twice = np.array([[float(square[i, j]) for j in range(8)] for i in range(8)])
    assert np.abs(collocation.NODES - np.array([float(c) for c in nodes])).max() < 6e-16
    assert np.abs(collocation.A - wanted).max() < 6e-16
    assert np.abs(collocation.AA - twice).max() < 6e-16


def test_weights_integrate_polynomials_of_degree_15_exactly() -> None:
    for degree in range(16):
        assert collocation.WEIGHTS @ collocation.NODES**degree == pytest.approx(1.0 / (degree + 1), rel=4e-15)


def test_position_weights_integrate_twice() -> None:
    for degree in range(8):
        value = collocation.POSITION_WEIGHTS @ collocation.NODES**degree
        assert value == pytest.approx(1.0 / ((degree + 1) * (degree + 2)), rel=1e-14)


def test_legendre_rows_pick_single_polynomials() -> None:
    values = np.polynomial.legendre.legval(2.0 * collocation.NODES - 1.0, np.eye(8))
    assert np.abs(collocation.TO_LEGENDRE @ values.T - np.eye(8)).max() < 2e-14


def test_flat_tables_are_the_transposed_ones() -> None:
    assert np.array_equal(collocation.A_FLAT.reshape(8, 8).T, collocation.A)
    assert np.array_equal(collocation.AA_FLAT.reshape(8, 8).T, collocation.AA)
