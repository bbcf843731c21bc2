"""Variance components by restricted likelihood, against closed forms and a dense likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, LinearProblem, White
from nebosvod.estimation.accuracy.variance_components import estimate_components
from nebosvod.estimation.solvers import batch


def instruments(seed, n=60, sigmas=(0.5, 3.0)):
    rng = np.random.default_rng(seed)
    label = np.arange(n) % 2
    H = rng.normal(size=(n, 2, 3))
    v = np.array(sigmas)[label][:, None] * rng.normal(size=(n, 2))
    return LinearProblem(
        residual=H @ [1.0, -2.0, 0.5] + v, R=np.eye(2), noise_label=label, noise_names=("a", "b"),
        blocks=(Block(name="x", names=("x", "y", "z"), H=H),),
    )  # fmt: skip


def dense_restricted(problem, parts):
    """-2 log restricted likelihood of the logarithms of factors, by dense algebra."""
    A = np.concatenate([b.H for b in problem.blocks], axis=2).reshape(-1, sum(b.H.shape[2] for b in problem.blocks))
    v = problem.residual.reshape(-1)

    def cost(logs):
        V = sum(np.exp(log) * part for log, part in zip(logs, parts))
        iVA, iVv = np.linalg.solve(V, A), np.linalg.solve(V, v)
        N = A.T @ iVA
        left = v @ iVv - (A.T @ iVv) @ np.linalg.solve(N, A.T @ iVv)
        return np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1] + left

    return cost


def test_one_kind_of_noise_is_chi2_over_its_degrees_of_freedom():
    problem = replace(instruments(0), noise_label=None, noise_names=("noise",))
    found = estimate_components(problem)
    estimate = batch.solve(problem)
    assert found.factors[0] == pytest.approx(estimate.chi2 / (120 - 3), rel=1e-9)
    assert found.sigma[0] == pytest.approx(found.factors[0] * np.sqrt(2.0 / (120 - 3)), rel=1e-6)
    assert batch.solve(found.problem).chi2 == pytest.approx(117.0, rel=1e-9)


def test_two_instruments_agree_with_the_dense_restricted_likelihood():
    problem = instruments(1)
    found = estimate_components(problem)
    both = np.repeat(problem.noise_label == 1, 2)
    cost = dense_restricted(problem, [np.diag(1.0 * ~both), np.diag(1.0 * both)])
    wanted = minimize(cost, np.log(found.factors) + 0.3, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    np.testing.assert_allclose(found.factors, np.exp(wanted.x), rtol=1e-5)
    assert found.converged
    assert np.all(np.abs(found.factors - [0.25, 9.0]) < 3.0 * found.sigma)


def test_balanced_groups_give_the_analysis_of_variance():
    """v_kj = mean + z_k + e_kj: within mean square = s2, between mean square = s2 + p q."""
    rng = np.random.default_rng(3)
    n, p = 25, 4
    values = 5.0 + 1.5 * rng.normal(size=(n, 1)) + 0.4 * rng.normal(size=(n, p))
    ones = np.ones((n, p, 1))
    problem = LinearProblem(
        residual=values, R=np.eye(p), blocks=(Block(name="mean", names=("mean",), H=ones),),
        white=(White(name="z", H=ones, Q=[[1.0]], rows=np.arange(n)),), noise_names=("noise",),
    )  # fmt: skip
    found = estimate_components(problem)
    within = np.sum((values - values.mean(axis=1, keepdims=True)) ** 2) / (n * (p - 1))
    between = p * np.sum((values.mean(axis=1) - values.mean()) ** 2) / (n - 1)
    assert found.names == ("noise", "z")
    np.testing.assert_allclose(found.factors, [within, (between - within) / p], rtol=1e-5)


def test_they_are_not_biased_by_many_parameters():
    """Ten parameters from sixteen measurements: maximum likelihood would give 0.4 of the truth."""
    rng = np.random.default_rng(4)
    H = rng.normal(size=(16, 1, 10))
    names = tuple(f"x{k}" for k in range(10))
    factors = []
    for _ in range(100):
        problem = LinearProblem(
            residual=rng.normal(size=(16, 1)), R=[[1.0]], blocks=(Block(name="x", names=names, H=H),)
        )
        factors.append(estimate_components(problem).factors[0])
    assert np.mean(factors) == pytest.approx(1.0, abs=0.24)  # 4 sigma of chi2 / 6 over 100 draws


def test_noise_that_is_not_there_is_zero_and_what_cannot_be_told_is_refused(make_problem):
    rng = np.random.default_rng(5)
    ones = np.ones((40, 3, 1))
    quiet = rng.normal(size=(40, 3))
    quiet -= 0.9 * quiet.mean(axis=1, keepdims=True)  # less common than chance
    problem = LinearProblem(
        residual=quiet, R=np.eye(3), blocks=(Block(name="mean", names=("mean",), H=ones),),
        white=(White(name="z", H=ones, Q=[[1.0]], rows=np.arange(40)),),
    )  # fmt: skip
    assert estimate_components(problem).factors[1] == 0.0
    with pytest.raises(InputError, match="time-correlated"):
        estimate_components(make_problem(seed=1, n=10, z="markov"))
    with pytest.raises(GeometryError):
        estimate_components(replace(problem, blocks=(Block(name="m", names=("m",), H=np.zeros((40, 3, 1))),)))
