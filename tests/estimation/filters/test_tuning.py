"""Process noise by the likelihood of innovations and by NEES."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters import kalman, tuning
from nebosvod.estimation.filters.kalman import Belief

F = np.array([[1.0, 0.5], [0.0, 0.9]])
H = np.array([[1.0, 0.0]])
Q, R = np.diag([0.02, 0.1]), np.array([[0.3]])
START = Belief.of([0.0, 0.0], np.eye(2))


def simulate(seed, n):
    rng = np.random.default_rng(seed)
    x, out, y = rng.normal(size=2), [], []
    for _ in range(n):
        x = F @ x + np.sqrt(np.diag(Q)) * rng.normal(size=2)
        out.append(x)
        y.append(H @ x + np.sqrt(R[0]) * rng.normal(size=1))
    return np.array(out), np.array(y)


def passed(y, q=1.0, r=1.0):
    n = len(y)
    return tuning.run(START, y, [F] * n, [q * Q] * n, [H] * n, [r * R] * n)


def dense_covariance(n, q, r):
    """Covariance of all measurements at once."""
    moves = [np.eye(2)]
    P = [F @ F.T + q * Q]
    for _ in range(n - 1):
        P.append(F @ P[-1] @ F.T + q * Q)
        moves.append(F @ moves[-1])
    V = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            V[i, j] = V[j, i] = (H @ moves[i - j] @ P[j] @ H.T)[0, 0]
    return V + r * R[0, 0] * np.eye(n)


def test_the_cost_is_the_likelihood_of_all_measurements_at_once():
    _, y = simulate(0, 30)
    for q, r in ((1.0, 1.0), (3.0, 0.5)):
        wanted = -2.0 * multivariate_normal(np.zeros(30), dense_covariance(30, q, r)).logpdf(y[:, 0])
        assert passed(y, q, r).cost == pytest.approx(wanted, rel=1e-10)


def test_the_factors_are_those_of_the_dense_likelihood_and_the_truth_lies_within_their_sigmas():
    _, y = simulate(1, 100)
    found = tuning.by_likelihood(lambda f: passed(y, f[0], f[1]).cost, 2)

    def cost(logs):
        q, r = np.exp(logs)
        V = dense_covariance(100, q, r)
        return np.linalg.slogdet(V)[1] + y[:, 0] @ np.linalg.solve(V, y[:, 0])

    wanted = minimize(cost, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
    np.testing.assert_allclose(np.log(found.factors), wanted.x, atol=2e-3)
    assert np.all(np.abs(np.log(found.factors)) < 3.0 * found.sigma_log)
    assert np.all(found.sigma_log < 1.0)


def test_nees_finds_the_q_of_the_truth():
    flights = [simulate(seed, 40) for seed in range(8)]

    def nees(q):
        scores = []
        for truth, y in flights:
            beliefs = passed(y, q).beliefs
            scores += [kalman.normalized_error_squared(beliefs[k], truth[k]) for k in range(5, 40, 5)]
        return float(np.mean(scores)) / 2.0

    assert tuning.by_nees(nees) == pytest.approx(1.0, rel=0.6)
    assert tuning.by_nees(lambda q: 4.0 / q) == pytest.approx(4.0, rel=1e-3)


def test_what_the_data_do_not_tell_is_said():
    with pytest.raises(GeometryError, match="do not tell"):
        tuning.by_likelihood(lambda f: float(np.exp(-f[0])), 1, widest=100.0)
    with pytest.raises(GeometryError, match="NEES"):
        tuning.by_nees(lambda q: 0.5)
    with pytest.raises(InputError, match="1 F"):
        tuning.run(START, np.zeros((2, 1)), [F], [Q] * 2, [H] * 2, [R] * 2)
