"""Shares, vanished sources, and the ratio of noise to nuisance."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Prior, White
from nebosvod.estimation.accuracy import budget
from nebosvod.estimation.solvers import batch

ARCSEC = np.pi / 648000.0


def direction_problem(distance_km, sigma_z_km=1.0, n=10, bias=0.0):
    """RA*, Dec of a body at a distance, 0.1 arcsec, from a telescope whose position errs."""
    H_z = np.zeros((n, 2, 3))
    H_z[:, 0, 0] = H_z[:, 1, 1] = -1.0 / distance_km
    H = np.random.default_rng(0).normal(size=(n, 2, 2))
    blocks = [Block(name="state", names=("a", "b"), H=H)]
    priors = []
    if bias:
        H_b = np.broadcast_to(np.eye(2), (n, 2, 2))
        blocks.append(Block(name="bias", names=("b1", "b2"), H=H_b))
        priors.append(Prior(name="bias", names=("b1", "b2"), covariance=bias**2 * np.eye(2)))
    return LinearProblem(
        residual=np.zeros((n, 2)),
        R=(0.1 * ARCSEC) ** 2 * np.eye(2),
        blocks=tuple(blocks),
        priors=tuple(priors),
        white=(White(name="position", H=H_z, Q=sigma_z_km**2 * np.eye(3), rows=np.arange(n)),),
    )


@pytest.mark.parametrize(("distance", "wanted", "digit"), [(3.5e6, 1.70, 5e-3), (1e8, 48.5, 5e-2)])
def test_critical_position_error_for_a_tenth_of_an_arcsecond(distance, wanted, digit):
    """Guo, Ivashkin 2018: sigma_z(0) = rho sigma."""
    found = budget.noise_to_nuisance(direction_problem(distance))
    np.testing.assert_allclose(found.sigma_critical, wanted, atol=digit)
    np.testing.assert_allclose(found.sigma_limit(20.0), found.sigma_critical / 10.0, rtol=1e-12)


def test_eta_is_zero_at_the_critical_error_and_drops_20_db_at_ten_times_it():
    critical = budget.noise_to_nuisance(direction_problem(1e8)).sigma_critical[0]
    assert budget.noise_to_nuisance(direction_problem(1e8, critical)).eta_db_mean == pytest.approx(0.0, abs=1e-9)
    ten = budget.noise_to_nuisance(direction_problem(1e8, 10 * critical))
    np.testing.assert_allclose(ten.eta_db, -20.0, rtol=1e-10)
    np.testing.assert_allclose(ten.eta_whitened_db, -20.0, rtol=1e-10)


def test_a_common_nuisance_counts_with_the_number_of_its_measurements():
    problem = direction_problem(1e8, n=50, bias=0.05 * ARCSEC)
    found = budget.noise_to_nuisance(problem, sources=("bias",))
    np.testing.assert_allclose(found.eta_db, 20 * np.log10(2.0), rtol=1e-10)
    np.testing.assert_allclose(found.eta_effective_db, found.eta_db - 10 * np.log10(50), rtol=1e-10)
    assert np.isinf(found.sigma_critical).all()


def test_default_sources_leave_out_the_prior_of_the_state(make_problem):
    with_state = budget.noise_to_nuisance(make_problem(state_prior="own"))
    named = budget.noise_to_nuisance(make_problem(state_prior="own"), ("c", "bias A", "bias B", "z A", "z B"))
    np.testing.assert_allclose(with_state.eta_db, named.eta_db, rtol=1e-12)


def test_the_mean_is_a_ratio_of_sums_over_any_measurements():
    near, far = direction_problem(3.5e6), direction_problem(1e8)
    H = np.concatenate([near.white[0].H, far.white[0].H])
    white = White(name="position", H=H, Q=near.white[0].Q, rows=np.arange(len(H)))
    blocks = tuple(replace(b, H=np.concatenate([b.H, b.H])) for b in near.blocks)
    both = replace(near, residual=np.zeros((len(H), 2)), blocks=blocks, white=(white,), noise_label=None)
    found = budget.noise_to_nuisance(both)
    R = 2.0 * (0.1 * ARCSEC) ** 2
    N = np.array([np.trace(h @ np.asarray(near.white[0].Q)[0] @ h.T) for h in H])
    assert found.eta_db_mean == pytest.approx(10.0 * np.log10(len(H) * R / N.sum()), abs=1e-9)
    mine = np.arange(len(H)) >= near.n
    assert found.mean_db("eta", mine) == pytest.approx(10.0 * np.log10(mine.sum() * R / N[mine].sum()), abs=1e-9)
    np.testing.assert_allclose(found.sigma_nuisance, np.sqrt(N / 2.0), rtol=1e-9)
    np.testing.assert_allclose(found.sigma_equivalent, np.sqrt((R + N) / 2.0), rtol=1e-9)


def test_of_a_prior_joint_with_the_state_the_other_parameters_count(make_problem):
    """With their marginal covariance: correlations with the state change nothing."""
    apart = make_problem(state_prior="own")
    state = next(prior for prior in apart.priors if set(prior.names) & set(apart.blocks[0].names))
    other = next(prior for prior in apart.priors if prior.name == "c")
    rest = tuple(prior for prior in apart.priors if prior not in (state, other))
    C = np.zeros((len(state.names) + len(other.names),) * 2)
    C[: len(state.names), : len(state.names)] = state.covariance
    C[len(state.names) :, len(state.names) :] = other.covariance
    T = np.eye(len(C))
    T[: len(state.names), len(state.names) :] = 3.0 * np.sqrt(np.diag(state.covariance))[:, None]
    joint = Prior(name="joint", names=(*state.names, *other.names), covariance=T @ C @ T.T)
    found = budget.noise_to_nuisance(replace(apart, priors=(joint, *rest)))
    wanted = budget.noise_to_nuisance(apart)
    np.testing.assert_allclose(found.eta_db, wanted.eta_db, atol=1e-9)
    np.testing.assert_allclose(found.eta_effective_db, wanted.eta_effective_db, atol=1e-9)


def test_what_is_fixed_is_no_nuisance(make_problem):
    fixed = make_problem(treatments={"c": "fixed", "z": "fixed"})
    named = budget.noise_to_nuisance(make_problem(), ("bias A", "bias B"))
    np.testing.assert_allclose(budget.noise_to_nuisance(fixed).eta_db, named.eta_db, atol=1e-9)


def test_stationary_correlated_nuisance_counts_with_its_variance(make_problem):
    problem = make_problem(z="markov")
    found = budget.noise_to_nuisance(problem, ("z A slow",))
    markov = problem.markov[0]
    k = markov.rows[3]
    wanted = np.trace(problem.R[k]) / np.trace(markov.H[3] @ markov.P0 @ markov.H[3].T)
    assert found.eta_db[k] == pytest.approx(10 * np.log10(wanted), rel=1e-10)


def test_shares_of_a_group_sum_to_one_and_their_variances_to_the_sigma(make_problem):
    found = batch.solve(make_problem(seed=3, truth=True, treatments={"c": "considered"}))
    rows = budget.group_shares(found, {"position": ("x", "y"), "velocity": ("vx", "vy")})
    for names, group in ((("x", "y"), rows["position"]), (("vx", "vy"), rows["velocity"])):
        assert sum(row.share for row in group) == pytest.approx(1.0, rel=1e-12)
        trace = np.trace(found.covariance(names))
        assert sum(row.sigma**2 for row in group) == pytest.approx(trace, rel=1e-12)
        assert [row.share for row in group] == sorted((row.share for row in group), reverse=True)


def test_a_vanished_source_has_two_answers_and_reoptimising_is_never_worse(make_problem):
    for seed in range(5):
        problem = make_problem(seed=seed)
        for source in ("z A", "bias A", "c"):
            found = budget.if_vanished(problem, source, ("x", "y"))
            assert found.sigma_new_gain <= found.sigma_same_gain * (1 + 1e-9) < found.sigma
    assert found.sigma_new_gain < 0.999 * found.sigma_same_gain


def test_measurement_noise_cannot_vanish(make_problem):
    with pytest.raises(InputError, match="measurement noise"):
        budget.without(make_problem(), "noise A")
    with pytest.raises(InputError, match="allowed: bias A"):
        budget.without(make_problem(), "bias C")


def mean_problem(sigma=2.0, bias=3.0, n=25):
    """A constant measured n times through one bias: variance sigma^2 / n + bias^2."""
    blocks = [
        Block(name="x", names=("x",), H=np.ones((n, 1, 1))),
        Block(name="bias", names=("b",), H=np.ones((n, 1, 1)), treatment="considered"),
    ]
    prior = Prior(name="bias", names=("b",), covariance=[[bias**2]])
    return LinearProblem(residual=np.zeros((n, 1)), R=[[sigma**2]], blocks=tuple(blocks), priors=(prior,))


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_scaled_source_counts_as_the_closed_formula_says(factor):
    noise = batch.solve(budget.scaled(mean_problem(), "measurement noise", factor)).sigma("x")
    assert noise == pytest.approx(np.sqrt((2.0 * factor) ** 2 / 25 + 9.0), rel=1e-12)
    bias = batch.solve(budget.scaled(mean_problem(), "bias", factor)).sigma("x")
    assert bias == pytest.approx(np.sqrt(4.0 / 25 + (3.0 * factor) ** 2), rel=1e-12)
    quiet = batch.solve(budget.scaled(mean_problem(), "measurement noise", 0.0)).sigma("x")
    assert quiet == pytest.approx(3.0, rel=1e-9)


@pytest.mark.parametrize("z", ["white", "markov"])
@pytest.mark.parametrize("truth", [False, True])
def test_scaling_a_source_scales_both_what_is_assumed_and_what_is_true(make_problem, dense, z, truth):
    problem = make_problem(seed=4, z=z, truth=truth, state_prior="joint" if not truth else "none")
    for source in (problem.priors[-1].name, (*problem.white, *problem.markov)[0].name, problem.noise_names[1]):
        changed = budget.scaled(problem, source, 3.0)
        before, after = dense(problem), dense(changed)
        assert not np.allclose(before.K_formal, after.K_formal, rtol=1e-3)
        # back again is the same problem
        again = dense(budget.scaled(changed, source, 1.0 / 3.0))
        np.testing.assert_allclose(again.K_true, before.K_true, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(batch.solve(changed).K_true, after.K_true, rtol=1e-7, atol=1e-10)


def test_an_unknown_source_or_a_negative_factor_is_refused(make_problem):
    with pytest.raises(InputError, match="allowed: bias A"):
        budget.scaled(make_problem(), "nobody", 0.5)
    with pytest.raises(InputError, match="factor >= 0"):
        budget.scaled(make_problem(), "bias A", -1.0)
