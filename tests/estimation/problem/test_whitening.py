"""The whitening operator: a factor of the dense assumed noise, applied in O(n)."""

import time

import numpy as np
import pytest

from nebosvod.estimation.problem.markov import accumulated
from nebosvod.estimation.problem.whitening import Whitener


@pytest.mark.parametrize("z", ["none", "white", "markov", "both"])
def test_whitening_and_its_adjoint_make_the_inverse_of_the_dense_noise(make_problem, dense_noise, z):
    problem = make_problem(seed=1, z=z)
    size = problem.n * problem.p
    rows = np.eye(size).reshape(problem.n, problem.p, size)
    whitener = Whitener.of(problem)
    whitener.whiten(rows)
    forward = rows.reshape(size, size)
    noise = dense_noise(problem)
    np.testing.assert_allclose(forward @ noise @ forward.T, np.eye(size), atol=1e-12)
    weighed = rows.copy()
    whitener.adjoint(weighed)
    np.testing.assert_allclose(weighed.reshape(size, size) @ noise, np.eye(size), atol=1e-11)


def test_two_correlated_nuisances_on_one_measurement_are_merged(make_problem, dense_noise):
    problem = make_problem(seed=1, z="markov")
    first = problem.markov[0]
    from dataclasses import replace

    rows = np.array([0, 2, 6, 8])
    other = replace(first, name="second", H=first.H[:4], F=first.F[:4], Q=first.Q[:4], rows=rows)
    problem = replace(problem, markov=(*problem.markov, other))
    whitener = Whitener.of(problem)
    assert len(whitener.chains) == 2
    size = problem.n * problem.p
    columns = np.eye(size).reshape(problem.n, problem.p, size)
    whitener.whiten(columns)
    forward = columns.reshape(size, size)
    np.testing.assert_allclose(forward @ dense_noise(problem) @ forward.T, np.eye(size), atol=1e-12)


def test_the_share_of_a_correlated_nuisance_is_the_double_sum_in_one_pass(make_problem, dense_chain):
    problem = make_problem(seed=1, z="markov", n=12)
    markov = problem.markov[0]
    gain = np.random.default_rng(0).normal(size=(12, 2, 5))
    P, count = dense_chain(markov), len(markov.rows)
    y = [gain[k].T @ markov.H[i] for i, k in enumerate(markov.rows)]
    wanted = sum(y[i] @ P[i, j] @ y[j].T for i in range(count) for j in range(count))
    np.testing.assert_allclose(accumulated(markov, gain), wanted, rtol=1e-12, atol=1e-12)


def test_whitening_with_chains_is_linear_in_the_number_of_measurements(make_problem):
    times = []
    for n in (2000, 20000):
        problem = make_problem(n=n, z="markov")
        begin = time.process_time()
        Whitener.of(problem).whiten(np.ones((n, 2, 5)))
        times.append(time.process_time() - begin)
    assert times[1] < 40.0 * max(times[0], 2e-3)
