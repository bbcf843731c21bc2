"""The named special cases of the source: each against its closed formula and against Monte Carlo.

The formulas are written out with dense matrices as Guo and Ivashkin (2018) derive them, corrected where they are
misprinted; nothing of them is shared with the code under test.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from nebosvod.estimation.accuracy import consistency
from nebosvod.estimation.problem.sources import measurement_gain
from nebosvod.estimation.solvers import batch

STATE = ("x", "y", "vx", "vy")
BIASES = ("bias A 0", "bias A 1", "bias B 0", "bias B 1")


@dataclass
class Closed:
    """What a closed formula says: names, believed and true covariance."""

    names: tuple[str, ...]
    formal: np.ndarray
    true: np.ndarray


@dataclass
class Parts:
    """Dense pieces of a problem: H, H_b, R, R_b, P0 and H_z Q H_z^T."""

    H: np.ndarray
    H_b: np.ndarray
    R: np.ndarray
    R_b: np.ndarray
    P0: np.ndarray
    Z: np.ndarray


def inv(matrix):
    return np.linalg.solve(matrix, np.eye(len(matrix)))


def parts(problem):
    n, p = problem.n, problem.p
    columns = {name: b.H[:, :, i].reshape(-1) for b in problem.blocks for i, name in enumerate(b.names)}
    prior = {prior.name: prior.covariance for prior in problem.priors}
    R, Z = np.zeros((n * p, n * p)), np.zeros((n * p, n * p))
    for k in range(n):
        R[k * p : k * p + p, k * p : k * p + p] = problem.R[k]
    for white in problem.white:
        for H_z, k in zip(white.H, white.rows):
            Z[k * p : k * p + p, k * p : k * p + p] += H_z @ white.Q[0] @ H_z.T
    R_b = np.zeros((4, 4))
    R_b[:2, :2], R_b[2:, 2:] = prior["bias A"], prior["bias B"]
    H, H_b = (np.stack([columns[name] for name in names], axis=1) for names in (STATE, BIASES))
    return Parts(H=H, H_b=H_b, R=R, R_b=R_b, P0=prior["state"], Z=Z)


def noise_only(m):
    """(2.112)-(2.113): K = (iP0 + H^T iR H)^-1."""
    K = inv(inv(m.P0) + m.H.T @ inv(m.R) @ m.H)
    return Closed(STATE, K, K)


def z_not_refined(m):
    """(2.114)-(2.117): the same gain; K + k H_z Q H_z^T k^T."""
    K = noise_only(m).formal
    k = K @ m.H.T @ inv(m.R)
    return Closed(STATE, K, K + k @ m.Z @ k.T)


def bias_estimated(m, Z=None):
    """(2.118)-(2.132): K_x0 = (iP0 + H^T i(Rz + H_b R_b H_b^T) H)^-1, K_b = (iR_b + H_b^T i(Rz + H P0 H^T) H_b)^-1."""
    Rz = m.R + (m.Z if Z is None else Z)
    K = np.zeros((8, 8))
    K[:4, :4] = inv(inv(m.P0) + m.H.T @ inv(Rz + m.H_b @ m.R_b @ m.H_b.T) @ m.H)
    K[4:, 4:] = inv(inv(m.R_b) + m.H_b.T @ inv(Rz + m.H @ m.P0 @ m.H.T) @ m.H_b)
    K[:4, 4:] = -K[:4, :4] @ m.H.T @ inv(Rz) @ m.H_b @ inv(inv(m.R_b) + m.H_b.T @ inv(Rz) @ m.H_b)
    K[4:, :4] = K[:4, 4:].T
    return Closed((*STATE, *BIASES), K, K)


def bias_estimated_z_ignored(m):
    """(2.133)-(2.136): all matrices WITHOUT H_z Q H_z^T; the truth adds its effect through the gain."""
    K = bias_estimated(m, np.zeros_like(m.Z)).formal
    k = K @ np.hstack([m.H, m.H_b]).T @ inv(m.R)
    return Closed((*STATE, *BIASES), K, K + k @ m.Z @ k.T)


def bias_ignored(m):
    """(2.137)-(2.138): K + k H_b R_b H_b^T k^T, z in the weights."""
    Rz = m.R + m.Z
    K = inv(inv(m.P0) + m.H.T @ inv(Rz) @ m.H)
    k = K @ m.H.T @ inv(Rz)
    return Closed(STATE, K, K + k @ m.H_b @ m.R_b @ m.H_b.T @ k.T)


CASES = {
    "measurement noise only": ({"bias": "fixed", "z": "fixed"}, noise_only),
    "z not refined": ({"bias": "fixed", "z": "considered"}, z_not_refined),
    "bias estimated": ({"bias": "estimated", "z": "estimated"}, bias_estimated),
    "bias estimated, z ignored": ({"bias": "estimated", "z": "ignored"}, bias_estimated_z_ignored),
    "bias ignored": ({"bias": "ignored", "z": "estimated"}, bias_ignored),
}


def case(make_problem, name):
    """The problem of one named configuration; c plays no part."""
    problem = make_problem(seed=29, state_prior="own", treatments={"c": "fixed", **CASES[name][0]})
    return replace(problem, priors=tuple(p for p in problem.priors if p.name != "c"))


@pytest.mark.parametrize("way", ["qr", "blocks", "identity"])
@pytest.mark.parametrize("name", CASES)
def test_each_named_configuration_equals_its_closed_formula(make_problem, covariance_error, name, way):
    problem = case(make_problem, name)
    found, wanted = batch.solve(problem, way), CASES[name][1](parts(problem))
    assert found.names == wanted.names
    assert covariance_error(found.K_formal, wanted.formal) < 1e-11
    assert covariance_error(found.K_true, wanted.true) < 1e-11


def simulate(problem, runs, seed, bias_mean=0.0):
    """Errors (runs, s), estimate minus truth, of repeated draws of state, bias, z and noise."""
    rng = np.random.default_rng(seed)
    m = parts(problem)
    treatment = {block.name: block.treatment for block in problem.blocks}
    x = np.linalg.cholesky(m.P0) @ rng.normal(size=(4, runs))
    b = np.linalg.cholesky(m.R_b) @ rng.normal(size=(4, runs)) + bias_mean
    v = m.H @ x + np.linalg.cholesky(m.R) @ rng.normal(size=(len(m.H), runs))
    if treatment["bias A"] != "fixed":
        v += m.H_b @ b
    if problem.white[0].treatment != "fixed":
        for white in problem.white:
            L = np.linalg.cholesky(white.Q[0])
            for H_z, k in zip(white.H, white.rows):
                v[2 * k : 2 * k + 2] += H_z @ L @ rng.normal(size=(3, runs))
    gain = measurement_gain(problem).reshape(problem.n * problem.p, -1)
    truth = np.vstack([x, b]) if treatment["bias A"] == "estimated" else x
    return v.T @ gain - truth.T


@pytest.mark.parametrize("name", CASES)
def test_each_named_configuration_is_honest_in_monte_carlo(make_problem, name):
    problem = case(make_problem, name)
    found = batch.solve(problem)
    errors = simulate(problem, 4000, seed=31)
    assert consistency.judge(errors, found.S_true).consistent
    if name in ("z not refined", "bias estimated, z ignored", "bias ignored"):
        assert not consistency.judge(errors, found.S_formal).consistent  # what it believes is not so


def test_a_mean_bias_shifts_the_estimate_as_the_formula_and_monte_carlo_say(make_problem):
    """(3.2) of the source: a bias of mean mu, ignored, shifts the estimate by k H_b mu."""
    problem = case(make_problem, "bias ignored")
    found, m = batch.solve(problem), parts(problem)
    mu = np.array([1.5, -0.7, 0.4, 2.0])
    Rz = m.R + m.Z
    wanted = bias_ignored(m).formal @ m.H.T @ inv(Rz) @ m.H_b @ mu
    shift = found.shift("bias A", mu[:2]) + found.shift("bias B", mu[2:])
    np.testing.assert_allclose(shift, wanted, rtol=1e-10)
    errors = simulate(problem, 4000, seed=37, bias_mean=mu[:, None])
    whitened = np.linalg.solve(found.S_true, errors.mean(axis=0) - shift) * np.sqrt(len(errors))
    assert np.sum(whitened**2) < chi2.ppf(0.99, 4)
    assert consistency.judge(errors - shift, found.S_true).consistent
    assert not consistency.judge(errors, found.S_true).consistent


def test_a_mean_error_of_an_estimated_bias_shifts_through_its_prior(make_problem):
    problem = case(make_problem, "bias estimated")
    found = batch.solve(problem)
    mu = np.array([1.5, -0.7, 0.4, 2.0])
    shift = found.shift("bias A", mu[:2]) + found.shift("bias B", mu[2:])
    errors = simulate(problem, 4000, seed=41, bias_mean=mu[:, None])
    assert consistency.judge(errors - shift, found.S_true).consistent
    assert not consistency.judge(errors, found.S_true).consistent
    # The prior's wrong mean as seen by the definition: -K Pi mu for the bias and its effect on the state.
    K = bias_estimated(parts(problem)).formal
    np.testing.assert_allclose(shift, -K[:, 4:] @ inv(parts(problem).R_b) @ mu, rtol=1e-9)
