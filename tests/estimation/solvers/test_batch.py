"""Batch least squares: three ways, all treatments, against dense inversion, closed formulas and Monte Carlo."""

from dataclasses import replace
from functools import partial

import mpmath
import numpy as np
import pytest
from scipy.stats import chi2

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, LinearProblem, Prior, Status, White
from nebosvod.estimation.solvers import batch, recursive, sequential

WAYS = ("qr", "blocks", "identity")
EPS = np.finfo(float).eps


def tolerance(condition: float) -> float:
    """Agreement to ask of ways that square the condition number: covariance in units of sigma_i sigma_j."""
    return max(1e-11, 100 * EPS * condition**2)


@pytest.mark.parametrize("z", ["white", "markov", "both"])
@pytest.mark.parametrize("state_prior", ["none", "own", "joint"])
@pytest.mark.parametrize("way", WAYS)
def test_every_way_equals_dense_inversion(make_problem, dense, covariance_error, way, state_prior, z):
    for seed in range(4):
        problem = make_problem(seed=seed, z=z, state_prior=state_prior, spread=10.0)
        found, wanted = batch.solve(problem, way), dense(problem)
        limit = tolerance(found.condition_number)
        assert covariance_error(found.K_formal, wanted.K_formal) < limit
        assert np.max(np.abs(found.mean - wanted.mean) / np.sqrt(np.diag(wanted.K_formal))) < limit
        assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-10)
        for source, share in wanted.shares.items():
            sigma = np.sqrt(np.diag(wanted.K_true))
            assert np.max(np.abs(found.shares[source] - share) / np.outer(sigma, sigma)) < limit


@pytest.mark.parametrize("way", ["blocks", "identity"])
def test_ways_agree_with_qr_as_far_as_the_condition_number_allows(make_problem, covariance_error, way):
    for seed in range(3):
        problem = make_problem(seed=seed)
        block = problem.blocks[0]
        H = np.array(block.H)
        H[:, :, 3] = H[:, :, 2] + 1e-3 * H[:, :, 3]  # two nearly proportional columns: condition number near 1e3
        problem = replace(problem, blocks=(replace(block, H=H), *problem.blocks[1:]))
        found, reference = batch.solve(problem, way), batch.solve(problem)
        assert 300 < reference.condition_number < 1e5
        assert found.condition_number == pytest.approx(reference.condition_number, rel=0.05)
        assert covariance_error(found.K_formal, reference.K_formal) < tolerance(reference.condition_number)


def test_qr_keeps_twelve_digits_where_the_prior_is_1e12(make_problem, covariance_error):
    problem = make_problem(seed=3, n=8, z="none")
    vague = Prior(name="state", names=problem.blocks[0].names, covariance=1e12 * np.eye(4))
    problem = replace(problem, priors=(*problem.priors, vague))
    found = batch.solve(problem)
    with mpmath.workdps(60):
        names = list(found.names)
        columns = {n: b.H[:, :, i].reshape(-1) for b in problem.blocks for i, n in enumerate(b.names)}
        H = mpmath.matrix(np.stack([columns[name] for name in names], axis=1).tolist())
        weight = mpmath.zeros(16)
        for k in range(8):
            weight[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = mpmath.matrix(problem.R[k].tolist()) ** -1
        normal = H.T * weight * H
        for prior in problem.priors:
            information = mpmath.matrix(prior.covariance.tolist()) ** -1
            for i, a in enumerate(prior.names):
                for j, b in enumerate(prior.names):
                    normal[names.index(a), names.index(b)] += information[i, j]
        K = np.array((normal**-1).tolist(), dtype=float)
    assert covariance_error(found.K_formal, K) < 1e-12
    assert covariance_error(found.K_true, K) < 1e-12


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("c", ["estimated", "considered", "ignored", "fixed"])
@pytest.mark.parametrize("bias", ["estimated", "considered", "ignored", "fixed"])
def test_treatments_equal_the_definitions_with_truth_unlike_the_assumption(
    make_problem, dense, covariance_error, way, c, bias
):
    for z, kind in (("estimated", "white"), ("considered", "both"), ("ignored", "markov"), ("fixed", "both")):
        treatments = {"c": c, "bias": bias, "z": z}
        problem = make_problem(seed=11, z=kind, treatments=treatments, truth=True, state_prior="own")
        live = {name for b in problem.blocks if b.treatment != "fixed" for name in b.names}
        priors = tuple(prior for prior in problem.priors if set(prior.names) <= live)
        found, wanted = batch.solve(problem, way), dense(replace(problem, priors=priors))
        assert set(found.sources) == set(wanted.shares)
        assert covariance_error(found.K_formal, wanted.K_formal) < 1e-11
        assert covariance_error(found.K_true, wanted.K_true) < 1e-11
        for name, gain in wanted.gains.items():
            moved = found.shift(name, np.ones(gain.shape[1]))
            order = list(_prior(problem, name).names)
            permuted = _gain_in_order(found, name, order)
            np.testing.assert_allclose(permuted, gain, atol=1e-11 * np.abs(gain).max())
            np.testing.assert_allclose(moved, gain.sum(axis=1), atol=1e-10 * np.abs(gain).max())


def _prior(problem, name):
    return next(prior for prior in problem.priors if prior.name == name)


def _gain_in_order(found, source, names):
    gain_names = found.solution.gain_names[source]
    gain = found.solution.gains[source][: len(found.names)]
    return gain[:, [gain_names.index(name) for name in names]]


def test_shares_sum_to_the_true_covariance_and_equal_the_formal_one_when_nothing_is_left_out(
    make_problem, covariance_error
):
    problem = make_problem(seed=5, z="both", spread=1e3)
    found = batch.solve(problem)
    total = sum(found.shares.values())
    assert covariance_error(total, found.K_true) < 1e-14
    assert covariance_error(found.K_true, found.K_formal) < 1e-10
    assert covariance_error(found.S_true @ found.S_true.T, found.K_true) < 1e-13
    assert covariance_error(found.S_formal @ found.S_formal.T, found.K_formal) < 1e-13


def test_parameters_of_proportional_columns_are_separated_by_their_priors_alone(make_problem):
    rng = np.random.default_rng(2)
    H = rng.normal(size=(30, 2, 1))
    sizes = {"radius": (1e-3, 20.0), "mass": (-1e-13, 1.5e10), "albedo": (0.4, 0.05)}
    blocks = [Block(name=name, names=(name,), H=H * factor) for name, (factor, _) in sizes.items()]
    priors = [Prior(name=name, names=(name,), covariance=[[s**2]]) for name, (_, s) in sizes.items()]
    problem = LinearProblem(residual=rng.normal(size=(30, 2)), R=1e-6 * np.eye(2), blocks=blocks, priors=priors)
    found = batch.solve(problem)
    assert found.status is Status.CONVERGED
    # One combination is measured, so two independent ones stay at their priors: the sum of var/prior is two.
    left = sum((found.sigma_formal(name) / s) ** 2 for name, (_, s) in sizes.items())
    assert left == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("way", ["qr", "identity"])
def test_zero_covariance_means_the_parameter_is_held_as_if_fixed(make_problem, covariance_error, way):
    problem = make_problem(seed=7)
    held = replace(_prior(problem, "bias A"), covariance=np.zeros((2, 2)))
    others = tuple(prior for prior in problem.priors if prior.name != "bias A")
    found = batch.solve(replace(problem, priors=(held, *others)), way)
    blocks = tuple(replace(b, treatment="fixed") if b.name == "bias A" else b for b in problem.blocks)
    wanted = batch.solve(replace(problem, blocks=blocks, priors=others), way)
    assert covariance_error(found.covariance(wanted.names), wanted.K_true) < 1e-12
    assert found.sigma("bias A 0") == 0.0


def test_singular_nuisance_and_prior_are_solved_by_qr_and_identity_and_refused_by_blocks(
    make_problem, covariance_error
):
    problem = make_problem(seed=8)
    direction = np.array([1.0, 2.0, -1.0])
    flat = tuple(replace(w, Q=np.outer(direction, direction)) for w in problem.white)
    c = replace(_prior(problem, "c"), covariance=np.array([[1.0, 2.0], [2.0, 4.0]]))
    problem = replace(problem, white=flat, priors=(c, *[p for p in problem.priors if p.name != "c"]))
    qr, identity = batch.solve(problem), batch.solve(problem, "identity")
    sigma = np.sqrt(np.diag(qr.K_true))
    assert np.max(np.abs(qr.K_formal - identity.K_formal) / np.outer(sigma, sigma)) < 1e-12
    assert 2 * qr.sigma("c1") == pytest.approx(qr.sigma("c2"), rel=1e-12)
    with pytest.raises(InputError, match="blocks needs the inverse of every"):
        batch.solve(problem, "blocks")


def test_noise_may_be_zero_where_a_nuisance_covers_it(make_problem):
    problem = make_problem(seed=9)
    found = batch.solve(replace(problem, R=np.zeros((2, 2))))
    assert found.status is Status.CONVERGED
    assert np.trace(found.shares["noise A"]) == 0.0
    with pytest.raises(InputError, match="measurement 0 is not positive definite"):
        batch.solve(replace(problem, R=np.zeros((2, 2)), white=()))


@pytest.mark.parametrize("way", WAYS)
def test_too_few_measurements_are_not_observable_and_name_the_weak_direction(make_problem, way):
    problem = make_problem(seed=1, n=24)
    block = problem.blocks[0]
    H = np.array(block.H)
    H[:, :, 2] = 2.0 * H[:, :, 1]
    found = batch.solve(replace(problem, blocks=(replace(block, H=H), *problem.blocks[1:])), way)
    assert found.status is Status.NOT_OBSERVABLE
    assert found.rank == len(found.names) - 1
    weak = found.weak_direction
    assert max(weak, key=lambda name: abs(weak[name])) in ("y", "vx")
    # y = +1 against vx = -1/2: in units of the columns' own sizes the two weights are opposite and equal.
    assert weak["y"] == pytest.approx(-weak["vx"], rel=1e-6)
    assert all(abs(weak[name]) < 1e-6 for name in found.names if name not in ("y", "vx"))
    assert "vx" in found.message
    for attribute in ("K_true", "K_formal", "mean", "chi2", "shares"):
        with pytest.raises(GeometryError) as caught:
            getattr(found, attribute)
        assert caught.value.weak_direction == weak


def test_a_single_measurement_without_prior_is_reported_not_crashed(make_problem):
    for n in (1, 2):
        found = batch.solve(make_problem(n=n, z="none", treatments={"bias": "fixed", "c": "fixed"}, p=1))
        assert found.status is Status.NOT_OBSERVABLE
        assert found.rank == n


def test_prediction_carries_cross_terms_and_the_minus_sign_of_groups_left_out(make_problem, dense):
    problem = make_problem(seed=13, treatments={"c": "considered"}, truth=True)
    found, wanted = batch.solve(problem), dense(problem)
    rng = np.random.default_rng(0)
    names = wanted.names + wanted.left_out
    W = rng.normal(size=(3, len(names)))
    prediction = found.predict(W, names)
    W_e, W_c = W[:, : len(wanted.names)], W[:, len(wanted.names) :]
    c = _prior(problem, "c")
    M = W_e @ wanted.gains["c"] - W_c
    share = M @ c.truth @ M.T
    np.testing.assert_allclose(prediction.shares["c"], share, atol=1e-12 * np.abs(share).max())
    others = sum(W_e @ wanted.shares[s] @ W_e.T for s in wanted.shares if s != "c")
    np.testing.assert_allclose(prediction.covariance, share + others, rtol=1e-10)
    np.testing.assert_allclose(prediction.factor @ prediction.factor.T, prediction.covariance, rtol=1e-10)
    np.testing.assert_allclose(prediction.covariance_formal, W_e @ wanted.K_formal @ W_e.T, rtol=1e-10)
    mapping = found.predict({name: W[:, i] for i, name in enumerate(names)})
    np.testing.assert_allclose(mapping.covariance, prediction.covariance, rtol=1e-12)
    np.testing.assert_allclose(prediction.value, W_e @ found.mean, rtol=1e-10)


def test_a_prior_across_an_estimated_and_a_considered_group_stays_one_source(make_problem):
    rng = np.random.default_rng(4)
    n = 12
    H = rng.normal(size=(n, 1, 2))
    covariance = np.array([[2.0, 0.9], [0.9, 1.0]])
    blocks = (
        Block(name="a", names=("a",), H=H[:, :, :1]),
        Block(name="b", names=("b",), H=H[:, :, 1:], treatment="considered"),
    )
    problem = LinearProblem(
        residual=np.zeros((n, 1)),
        R=np.eye(1),
        blocks=blocks,
        priors=(Prior(name="both", names=("a", "b"), covariance=covariance),),
    )
    found = batch.solve(problem)
    K = 1.0 / (np.sum(H[:, 0, 0] ** 2) + 0.5)
    M = np.array([-K * 0.5, K * np.sum(H[:, 0, 0] * H[:, 0, 1])])
    assert found.K_formal[0, 0] == pytest.approx(K, rel=1e-13)
    assert found.shares["both"][0, 0] == pytest.approx(M @ covariance @ M, rel=1e-12)
    cross = found.covariance(("a", "b"))[0, 1]
    assert cross == pytest.approx(-(M @ covariance[:, 1]), rel=1e-12)


def test_means_of_priors_are_where_the_estimate_starts_from(make_problem, dense):
    problem = make_problem(seed=21, treatments={"c": "considered"})
    shifted = tuple(replace(prior, mean=np.full(len(prior.names), 0.7)) for prior in problem.priors)
    found, wanted = batch.solve(replace(problem, priors=shifted)), dense(replace(problem, priors=shifted))
    np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-12)
    assert found.value("c1") == 0.7


NAMED = {
    "measurement noise only": {"c": "fixed", "bias": "fixed", "z": "fixed"},
    "z not refined": {"c": "estimated", "bias": "fixed", "z": "considered"},
    "bias estimated": {"c": "estimated", "bias": "estimated", "z": "estimated"},
    "bias estimated, z ignored": {"c": "estimated", "bias": "estimated", "z": "ignored"},
    "bias ignored": {"c": "estimated", "bias": "ignored", "z": "estimated"},
    "c considered": {"c": "considered", "bias": "estimated", "z": "estimated"},
}


@pytest.mark.parametrize("kind", ["white", "markov"])
@pytest.mark.parametrize("name", NAMED)
def test_named_special_cases_are_honest_in_monte_carlo(make_problem, name, kind):
    """Sample covariance of estimate - truth against K_true: whitened variances within 1 % chi-square bounds."""
    problem = make_problem(seed=17, z=kind, treatments=NAMED[name])
    found = batch.solve(problem)
    errors = _monte_carlo(problem, found, runs=1500)
    whitened = np.linalg.solve(found.S_true, errors)
    runs = errors.shape[1]
    nees = np.sum(whitened**2)
    low, high = chi2.ppf([0.005, 0.995], runs * len(found.names))
    assert low < nees < high
    level = 0.01 / len(found.names)  # Bonferroni over the components
    bounds = chi2.ppf([level / 2, 1 - level / 2], runs) / runs
    assert np.all((bounds[0] < np.mean(whitened**2, axis=1)) & (np.mean(whitened**2, axis=1) < bounds[1]))


def test_ignored_bias_fails_when_judged_by_what_the_estimator_believes(make_problem):
    problem = make_problem(seed=17, treatments=NAMED["bias ignored"])
    found = batch.solve(problem)
    errors = _monte_carlo(problem, found, runs=1500)
    whitened = np.linalg.solve(np.linalg.cholesky(found.K_formal), errors)
    assert np.sum(whitened**2) > chi2.ppf(0.999999, whitened.size)


def _monte_carlo(problem, found, runs):
    """Draw the truth about the prior means and the noise; return estimate - truth (s, runs)."""
    rng = np.random.default_rng(20240607)
    partition_names = found.names + found.left_out
    free = [name for name in found.names if name not in {n for p in problem.priors for n in p.names}]
    truth = {name: rng.normal(size=runs) * 5.0 for name in free}
    for prior in problem.priors:
        draw = np.linalg.cholesky(prior.truth) @ rng.normal(size=(len(prior.names), runs))
        truth.update(zip(prior.names, draw + prior.mean[:, None]))
    v = np.zeros((problem.n, problem.p, runs))
    for block in problem.blocks:
        if block.treatment != "fixed":
            v += block.H @ np.stack([truth[name] for name in block.names])
    R = np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p))
    v += np.linalg.cholesky(R) @ rng.normal(size=v.shape)
    for white in problem.white:
        if white.treatment != "fixed":
            Q = np.broadcast_to(white.truth, (len(white.rows), *white.truth.shape[1:]))
            v[white.rows] += white.H @ np.linalg.cholesky(Q) @ rng.normal(size=(len(white.rows), Q.shape[1], runs))
    for markov in problem.markov:
        z = np.linalg.cholesky(markov.P0) @ rng.normal(size=(markov.P0.shape[0], runs))
        for i, k in enumerate(markov.rows):
            if i:
                z = markov.F[i] @ z + np.linalg.cholesky(markov.Q[i]) @ rng.normal(size=z.shape)
            if markov.treatment != "fixed":
                v[k] += markov.H[i] @ z
    assert set(truth) >= set(partition_names)
    # The estimate is linear in the residual: one solve with several right-hand sides would need another interface,
    # so the gain is measured by unit residuals once.
    zero = batch.solve(replace(problem, residual=np.zeros((problem.n, problem.p)))).mean
    gain = np.empty((len(found.names), problem.n * problem.p))
    for column in range(gain.shape[1]):
        unit = np.zeros(problem.n * problem.p)
        unit[column] = 1.0
        gain[:, column] = batch.solve(replace(problem, residual=unit.reshape(problem.n, problem.p))).mean - zero
    estimate = zero[:, None] + gain @ v.reshape(-1, runs)
    return estimate - np.stack([truth[name] for name in found.names])


def test_white_z_in_the_weights_is_the_same_as_z_carried_as_parameters(make_problem, covariance_error):
    problem = make_problem(seed=19, n=10)
    blocks, priors = list(problem.blocks), list(problem.priors)
    for white in problem.white:
        for i, row in enumerate(white.rows):
            H = np.zeros((problem.n, problem.p, 3))
            H[row] = white.H[i]
            names = tuple(f"{white.name} {i} {axis}" for axis in "xyz")
            blocks.append(Block(name=f"{white.name} {i}", names=names, H=H))
            priors.append(Prior(name=f"{white.name} {i}", names=names, covariance=white.Q[0]))
    explicit = batch.solve(replace(problem, blocks=tuple(blocks), priors=tuple(priors), white=()))
    found = batch.solve(problem)
    assert covariance_error(explicit.covariance(found.names), found.K_true) < 1e-12
    np.testing.assert_allclose(explicit.mean[: len(found.names)], found.mean, atol=1e-12)
    assert explicit.chi2 == pytest.approx(found.chi2, rel=1e-12)
    both = [name for name in explicit.sources if name.startswith("z A")]
    share = sum(explicit.shares[name] for name in both)[: len(found.names), : len(found.names)]  # type: ignore[index]
    np.testing.assert_allclose(share, found.shares["z A"], atol=1e-12)


def test_dof_counts_measurements_less_parameters_without_prior(make_problem):
    assert batch.solve(make_problem(n=24)).dof == 48 - 4
    assert batch.solve(make_problem(n=24, state_prior="own")).dof == 48


def test_an_unknown_way_is_refused(make_problem):
    with pytest.raises(InputError, match="qr, blocks, identity"):
        batch.solve(make_problem(), "cholesky")  # type: ignore[arg-type]


def test_white_sources_with_rows_in_any_order_give_the_same_budget(make_problem, covariance_error):
    problem = make_problem(seed=23)
    order = np.random.default_rng(0).permutation(12)
    turned = tuple(replace(w, H=w.H[order], rows=w.rows[order], Q=w.Q[0]) for w in problem.white)
    assert all(isinstance(w, White) for w in turned)
    found, wanted = batch.solve(replace(problem, white=turned)), batch.solve(problem)
    assert covariance_error(found.shares["z A"], wanted.shares["z A"]) < 1e-12


@pytest.mark.parametrize(
    "solve", [batch.solve, partial(batch.solve, way="identity"), recursive.solve, sequential.solve]
)
def test_priors_that_hold_everything_exactly_leave_nothing_to_determine(solve):
    """As where the prior of a state-only problem vanishes: the estimate is the prior's mean, without an error."""
    rng = np.random.default_rng(0)
    block = Block(name="state", names=("x", "y"), H=rng.normal(size=(5, 2, 2)))
    prior = Prior(name="state", names=("x", "y"), covariance=np.zeros((2, 2)), mean=np.array([1.0, 2.0]))
    white = White(name="z", H=rng.normal(size=(5, 2, 2)), Q=np.eye(2), rows=np.arange(5))
    residual = rng.normal(size=(5, 2))
    found = solve(LinearProblem(residual=residual, R=np.eye(2), blocks=(block,), priors=(prior,), white=(white,)))
    assert found.status is Status.CONVERGED
    assert found.mean.tolist() == [1.0, 2.0]
    assert not found.K_true.any()
    left = residual - block.H @ found.mean
    weighed = np.linalg.solve(np.eye(2) + white.H @ white.H.transpose(0, 2, 1), left[:, :, None])[:, :, 0]
    assert found.chi2 == pytest.approx(np.sum(left * weighed), rel=1e-12)
