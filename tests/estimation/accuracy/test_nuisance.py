"""The nuisance brought back from the solution equals the nuisance carried as parameters."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, Markov, Prior, White
from nebosvod.estimation.accuracy.refined import refine, response
from nebosvod.estimation.problem.sources import measurement_gain
from nebosvod.estimation.solvers import batch


@pytest.mark.parametrize("z", ["white", "markov"])
def test_refined_nuisance_equals_the_one_carried_explicitly(make_problem, z):
    problem = make_problem(seed=5, n=12, z=z)
    nuisance = (problem.white or problem.markov)[0]
    found = refine(problem, batch.solve(problem), nuisance.name)
    explicit, names = _explicit(problem, nuisance)
    whole = batch.solve(explicit)
    common = batch.solve(problem).names
    for i in range(len(nuisance.rows)):
        mine = names[3 * i : 3 * i + 3]
        np.testing.assert_allclose(found.mean[i], [whole.value(name) for name in mine], atol=1e-10)
        K = whole.covariance((*common, *mine))
        s = len(common)
        np.testing.assert_allclose(found.covariance[i], K[s:, s:], atol=1e-11)
        np.testing.assert_allclose(found.cross[i], K[:s, s:], atol=1e-11)


@pytest.mark.parametrize("z", ["white", "markov"])
@pytest.mark.parametrize("bias", ["estimated", "considered"])
def test_a_refined_nuisance_counts_from_the_assumed_means(make_problem, z, bias):
    """Priors about means that are not zero: g acts on the estimate minus the mean its residual was taken about."""
    rng = np.random.default_rng(8)
    problem = make_problem(seed=5, n=12, z=z, state_prior="own", treatments={"bias": bias})
    priors = tuple(replace(prior, mean=3.0 * rng.normal(size=len(prior.names))) for prior in problem.priors)
    problem = replace(problem, priors=priors)
    nuisance = (problem.white or problem.markov)[0]
    found = refine(problem, batch.solve(problem), nuisance.name)
    explicit, names = _explicit(problem, nuisance)
    whole = batch.solve(explicit)
    for i in range(len(nuisance.rows)):
        np.testing.assert_allclose(found.mean[i], [whole.value(name) for name in names[3 * i : 3 * i + 3]], atol=1e-9)
    # and by dense algebra: z = Q H^T iV (v - H x), V the noise with z in it
    if z == "white":
        x = dict(zip(whole.names + whole.left_out, [*whole.mean, *whole.solution.mean_left_out]))
        for i, k in enumerate(nuisance.rows):
            v = problem.residual[k] - sum(
                block.H[k] @ np.array([x[name] for name in block.names]) for block in problem.blocks
            )
            H, Q = nuisance.H[i], nuisance.Q[0]
            z_k = Q @ H.T @ np.linalg.solve(H @ Q @ H.T + problem.R[k], v)
            np.testing.assert_allclose(found.mean[i], z_k, atol=1e-9)


@pytest.mark.parametrize("asked", ["z white", "z slow", "z slower"])
def test_nuisances_that_share_measurements_are_told_apart(make_problem, asked):
    """One fresh and two correlated in time, some rows shared by all three: carried explicitly, and its response."""
    rng = np.random.default_rng(4)
    problem = make_problem(seed=5, n=12, z="none")
    Q = np.eye(3) + 0.3
    white = White(name="z white", H=rng.normal(size=(7, 2, 3)), Q=Q, rows=np.arange(2, 9))
    slow, slower = (
        Markov(
            name=name, H=rng.normal(size=(len(rows), 2, 3)), F=np.tile(f * np.eye(3), (len(rows), 1, 1)),
            Q=np.tile((1.0 - f**2) * Q, (len(rows), 1, 1)), P0=Q, rows=rows,
        )
        for name, f, rows in (("z slow", 0.6, np.arange(0, 12, 2)), ("z slower", 0.9, np.array([1, 4, 5, 8, 11])))
    )  # fmt: skip
    problem = replace(problem, white=(white,), markov=(slow, slower))
    nuisance = {one.name: one for one in (white, slow, slower)}[asked]
    found = refine(problem, batch.solve(problem), asked)
    full = response(problem, asked, measurement_gain(problem))
    explicit, names = _explicit(problem, nuisance)
    explicit = replace(
        explicit,
        white=tuple(one for one in problem.white if one.name != asked),
        markov=tuple(one for one in problem.markov if one.name != asked),
    )
    whole, M = batch.solve(explicit), measurement_gain(explicit)
    assert full.shape == (len(nuisance.rows), 3, problem.n, problem.p)
    for i in range(len(nuisance.rows)):
        mine = names[3 * i : 3 * i + 3]
        np.testing.assert_allclose(found.mean[i], [whole.value(name) for name in mine], atol=1e-9)
        np.testing.assert_allclose(found.covariance[i], whole.covariance(mine), atol=1e-10)
        columns = [whole.names.index(name) for name in mine]
        np.testing.assert_allclose(full[i], np.moveaxis(M[:, :, columns], 2, 0), atol=1e-10)


def _explicit(problem, nuisance):
    """The problem with the nuisance as a block of its own and its full covariance in time as the prior."""
    n_r = len(nuisance.rows)
    names = tuple(f"z{i} {axis}" for i in range(n_r) for axis in "xyz")
    H = np.zeros((problem.n, problem.p, 3 * n_r))
    P = np.zeros((3 * n_r, 3 * n_r))
    for i, row in enumerate(nuisance.rows):
        H[row, :, 3 * i : 3 * i + 3] = nuisance.H[i]
        here = slice(3 * i, 3 * i + 3)
        if hasattr(nuisance, "P0"):
            if i == 0:
                P[here, here] = nuisance.P0
            else:
                before = slice(3 * i - 3, 3 * i)
                P[here, : 3 * i] = nuisance.F[i] @ P[before, : 3 * i]
                P[: 3 * i, here] = P[here, : 3 * i].T
                P[here, here] = nuisance.F[i] @ P[before, before] @ nuisance.F[i].T + nuisance.Q[i]
        else:
            P[here, here] = nuisance.Q[0]
    block = Block(name="z", names=names, H=H)
    explicit = replace(
        problem,
        blocks=(*problem.blocks, block),
        priors=(*problem.priors, Prior(name="z", names=names, covariance=P)),
        white=tuple(w for w in problem.white if w is not nuisance),
        markov=tuple(m for m in problem.markov if m is not nuisance),
    )
    return explicit, names


def test_what_cannot_be_refined_is_refused(make_problem):
    problem = make_problem(treatments={"z": "ignored"})
    with pytest.raises(InputError, match="no estimated nuisance"):
        refine(problem, batch.solve(problem), "z A")
