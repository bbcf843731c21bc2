"""Differential correction: it finds the minimum, keeps the prior, and says why where it does not."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, Nongrav
from nebosvod.estimation import Block, LinearProblem, Status
from nebosvod.estimation.solvers import batch
from nebosvod.fits.correction import Knowledge, correct

AU_KM = 149597870.7


def off_by(state, au, seed=3):
    direction = np.random.default_rng(seed).standard_normal(6)
    direction /= np.linalg.norm(direction[:3])
    return state + au * np.array([AU_KM] * 3 + [30.0] * 3) * direction


@pytest.mark.parametrize("au", [1e-4, 1e-2])
def test_a_wrong_start_ends_at_the_one_minimum(made_sky, au):
    made = made_sky()
    near, far = (correct(made.sky, x, made.forces) for x in (made.state, off_by(made.state, au)))
    assert far.status is Status.CONVERGED
    assert np.abs(np.linalg.solve(far.S, far.x - near.x)).max() < 1e-3  # sigma
    assert far.cost == pytest.approx(near.cost, rel=1e-6)


@pytest.mark.parametrize("au", [50.0, 95.0])
def test_an_object_beyond_the_planets_is_fitted(made_sky, au):
    """Light takes longer than six hours from 43 au on, as from Eris: the first record had no orbit at its emission."""
    state = np.array([au * AU_KM, 0.0, 0.0, 0.0, 0.9 * np.sqrt(887.1 / au), 0.3])  # 887.1 km2/s2: GM of the Sun/1 au
    made = made_sky(days=1500.0, state=state)
    found = correct(made.sky, off_by(state, 0.1), made.forces)
    assert found.status is Status.CONVERGED
    assert np.sum(np.linalg.solve(found.S, found.x - state) ** 2) < 22.5  # 0.999 of a chi-square of 6


def test_the_answer_is_that_of_the_general_estimator(made_sky):
    made = made_sky()
    found = correct(made.sky, off_by(made.state, 1e-4), made.forces)
    names = tuple("abcdef")
    block = Block(name="state", names=names, H=found.seen.H)
    estimate = batch.solve(LinearProblem(residual=found.residual, R=made.sky.R, blocks=(block,)))
    assert np.abs(np.linalg.solve(found.S, estimate.mean)).max() < 1e-3
    np.testing.assert_allclose(found.S @ found.S.T, estimate.covariance(names), rtol=1e-6)


def test_errors_are_as_large_as_the_covariance_says(made_sky):
    chi2 = []
    for seed in range(40):
        made = made_sky(n=30, seed=seed)
        found = correct(made.sky, made.state, made.forces)
        chi2.append(np.sum(np.linalg.solve(found.S, found.x - made.state) ** 2))
    # mean of 40 chi-squares with 6 degrees of freedom: 6 +- 3.3 sqrt(12/40)
    assert np.mean(chi2) == pytest.approx(6.0, abs=1.8)


def test_observations_left_out_do_not_pull(made_sky):
    made = made_sky()
    observed = made.sky.observed.copy()
    observed[5] += 1e-3
    selected = np.ones(len(made.sky), dtype=bool)
    selected[5] = False
    spoilt = replace(made.sky, observed=observed)
    found = correct(spoilt, made.state, made.forces, selected=selected)
    clean = correct(made.sky, made.state, made.forces, selected=selected)
    np.testing.assert_allclose(found.x, clean.x, rtol=1e-12)
    assert len(found.residual) == len(made.sky)


def test_a_dynamic_parameter_is_found_with_its_prior(made_sky, ephemeris):
    truth, sigma = 3e-8, 1e-9
    forces = ForceModel(ephemeris=ephemeris, nongrav=Nongrav(a2_au_d2=truth), parameters=("a2_au_d2",))
    made = made_sky(forces=forces)
    start = np.append(made.state, 0.0)
    free = correct(made.sky, start, forces)
    assert abs(free.x[6] - truth) < 4.0 * np.linalg.norm(free.S[6])
    U = np.zeros((1, 7))
    U[0, 6] = 1.0 / sigma
    told = correct(made.sky, start, forces, prior=Knowledge(U=U, mean=np.append(np.zeros(6), truth)))
    assert np.linalg.norm(told.S[6]) < sigma < np.linalg.norm(free.S[6])
    assert abs(told.x[6] - truth) < 4.0 * sigma


def test_two_observations_are_not_observable(made_sky):
    made = made_sky()
    selected = np.zeros(len(made.sky), dtype=bool)
    selected[[0, 60]] = True
    found = correct(made.sky, made.state, made.forces, selected=selected)
    assert found.status is Status.NOT_OBSERVABLE
    assert found.S is None


def test_the_limit_of_iterations_is_a_status(made_sky):
    made = made_sky()
    found = correct(made.sky, off_by(made.state, 1e-2), made.forces, limit=1)
    assert found.status is Status.ITERATION_LIMIT
    assert np.isfinite(found.x).all()


def test_the_covariance_comes_from_a_factor_of_full_rank(made_sky):
    found = correct(*[getattr(made_sky(n=20, days=2.0), k) for k in ("sky", "state", "forces")])
    assert np.linalg.matrix_rank(found.S / np.linalg.norm(found.S, axis=1)[:, None]) == 6
