"""Least moduli against medians, a primal programme, and beside the guaranteed bounds."""

import numpy as np
import pytest
from scipy.optimize import linprog

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, LinearProblem, Prior
from nebosvod.estimation.accuracy import guaranteed
from nebosvod.estimation.solvers import batch, least_moduli


def inverse(matrix):
    return np.linalg.solve(matrix, np.eye(len(matrix)))


def line(values, sigma=1.0, prior=None, H=None):
    n = len(values)
    H = np.ones((n, 1, 1)) if H is None else H
    names = ("height", "slope")[: H.shape[2]]
    priors = () if prior is None else (Prior(name="p", names=names, covariance=prior),)
    blocks = (Block(name="x", names=names, H=H),)
    return LinearProblem(residual=np.asarray(values, float)[:, None], R=[[sigma**2]], blocks=blocks, priors=priors)


def test_a_constant_is_the_median_and_one_bad_measurement_does_not_matter():
    values = [1.0, 1.2, 0.9, 1.1, 55.0]
    found = least_moduli.solve(line(values))
    assert found.value("height") == pytest.approx(np.median(values))
    assert batch.solve(line(values)).value("height") > 10.0
    assert not guaranteed.bound(line(values), np.eye(1)).consistent  # the boxes are empty; the median stands
    assert found.exact.sum() == 1
    assert found.gap < 1e-9


def test_random_problems_agree_with_a_primal_programme_and_pass_through_as_many_points_as_unknowns(make_problem):
    for seed in range(4):
        problem = make_problem(seed=seed, n=15, z="none", state_prior="own")
        found = least_moduli.solve(problem)
        estimate = batch.solve(problem)
        # dense rows by numpy: measurements whitened by their Cholesky factors, then the priors
        names = found.names
        rows, right = [], []
        L = np.linalg.cholesky(np.broadcast_to(problem.R, (problem.n, problem.p, problem.p)))
        H = np.concatenate([b.H for b in problem.blocks if b.treatment == "estimated"], axis=2)
        order = [n for b in problem.blocks if b.treatment == "estimated" for n in b.names]
        for k in range(problem.n):
            rows.append(np.linalg.solve(L[k], H[k]))
            right.append(np.linalg.solve(L[k], problem.residual[k]))
        for prior in problem.priors:
            W = inverse(np.linalg.cholesky(prior.covariance))
            row = np.zeros((len(W), len(order)))
            row[:, [order.index(n) for n in prior.names]] = W
            rows.append(row)
            right.append(W @ prior.mean)
        A, v = np.vstack(rows), np.concatenate(right)
        m, s = A.shape
        cost = np.concatenate([np.zeros(s), np.ones(m)])
        both = np.vstack([np.hstack([A, -np.eye(m)]), np.hstack([-A, -np.eye(m)])])
        wanted = linprog(cost, A_ub=both, b_ub=np.concatenate([v, -v]), bounds=[(None, None)] * s + [(0, None)] * m)
        assert found.cost == pytest.approx(wanted.fun, rel=1e-8)
        assert order == list(names)
        np.testing.assert_allclose(
            found.mean, wanted.x[:s], rtol=1e-6, atol=1e-6 * np.sqrt(np.diag(estimate.K_formal)).max()
        )
        assert found.gap < 1e-7


def test_its_sigma_is_that_of_many_normal_draws():
    rng = np.random.default_rng(2)
    t = np.linspace(-1.0, 1.0, 101)
    H = np.stack([np.ones(101), t], axis=1)[:, None, :]
    errors = [least_moduli.solve(line(0.3 * rng.normal(size=101), 0.3, H=H)).mean for _ in range(150)]
    sigma = np.linalg.norm(least_moduli.solve(line(np.zeros(101), 0.3, H=H)).factor, axis=1)
    np.testing.assert_allclose(np.std(errors, axis=0) / sigma, 1.0, atol=0.2)  # 1 sigma of 150 draws is 0.06


def test_what_is_not_determined_is_refused(make_problem):
    with pytest.raises(GeometryError, match="do not determine"):
        least_moduli.solve(line([1.0, 2.0], H=np.ones((2, 1, 2))))
    with pytest.raises(InputError, match="time-correlated"):
        least_moduli.solve(make_problem(seed=1, n=10, z="markov"))
