"""Arcs by their normal equations equal all at once; what condensing hides."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy import consistency
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.normal_places import GaussFilter, combine, condense
from nebosvod.estimation.solvers import batch, recursive


def inverse(matrix):
    return np.linalg.solve(matrix, np.eye(len(matrix)))


def arc(problem, keep):
    """The measurements `keep` (slice) of a problem; white nuisances follow their measurements."""
    mask = np.zeros(problem.n, dtype=bool)
    mask[keep] = True
    place = np.cumsum(mask) - 1
    white = []
    for w in problem.white:
        mine = mask[w.rows]
        white.append(replace(w, H=w.H[mine], rows=place[w.rows[mine]]))
    return replace(
        problem,
        residual=problem.residual[mask],
        R=problem.R[mask],
        blocks=tuple(replace(b, H=b.H[mask]) for b in problem.blocks),
        white=tuple(white),
        noise_label=problem.noise_label[mask],
    )


ARCS = (slice(0, 3), slice(3, 15), slice(15, 24))  # the first alone determines nothing


@pytest.mark.parametrize("treatments", [{}, {"c": "considered"}, {"bias": "ignored"}, {"c": "fixed"}])
@pytest.mark.parametrize("state_prior", ["none", "own"])
def test_arcs_combined_by_their_normal_places_equal_all_measurements_at_once(
    make_problem, covariance_error, treatments, state_prior
):
    """Biases and c are common to the arcs and have one prior each; the white nuisance is in the weights."""
    problem = make_problem(seed=3, treatments=treatments, state_prior=state_prior, spread=10.0)
    if treatments.get("c") == "fixed":
        problem = replace(problem, priors=tuple(p for p in problem.priors if p.name != "c"))
    problem = replace(problem, priors=tuple(replace(p, mean=np.full(len(p.names), 0.3)) for p in problem.priors))
    places = [condense(arc(problem, keep), f"arc {i}") for i, keep in enumerate(ARCS)]
    wanted = batch.solve(problem)
    for solve in (batch.solve, recursive.solve):
        found = solve(combine(places, problem))
        assert covariance_error(found.K_formal, wanted.K_formal) < 1e-11
        assert covariance_error(found.K_true, wanted.K_true) < 1e-11
        np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-10)
        assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-10)
    assert sum(place.count for place in places) == problem.residual.size
    for source in (prior.name for prior in problem.priors):
        if source in wanted.shares:
            np.testing.assert_allclose(found.shares[source], wanted.shares[source], atol=1e-11)


def test_a_prior_of_a_common_nuisance_counted_in_each_arc_would_be_optimistic(make_problem):
    problem = make_problem(seed=3)
    places = [condense(arc(problem, keep)) for keep in ARCS]
    right = batch.solve(combine(places, problem)).sigma("bias A 0")
    thrice = tuple(replace(p, covariance=p.covariance / 3.0) if p.name == "bias A" else p for p in problem.priors)
    assert batch.solve(replace(combine(places, problem), priors=thrice)).sigma("bias A 0") < 0.95 * right


def test_an_arc_without_an_instrument_says_nothing_about_its_bias(make_problem, covariance_error):
    problem = make_problem(seed=4, z="none")
    first, second = (arc(problem, problem.noise_label == label) for label in (0, 1))
    without_b = replace(
        first,
        blocks=tuple(b for b in first.blocks if b.name != "bias B"),
        priors=tuple(p for p in first.priors if p.name != "bias B"),
    )
    places = [condense(without_b), condense(second)]
    assert "bias B 0" not in places[0].names
    assert covariance_error(batch.solve(combine(places, problem)).K_true, batch.solve(problem).K_true) < 1e-12


def test_what_has_no_normal_place_is_refused(make_problem):
    with pytest.raises(InputError, match="true noise differ"):
        condense(make_problem(truth=True))
    with pytest.raises(InputError, match="has no normal place"):
        condense(make_problem(treatments={"z": "considered"}))
    problem = make_problem(z="none")
    other = replace(problem, blocks=problem.blocks[:1], priors=())
    with pytest.raises(InputError, match="'c1', which is not a parameter"):
        combine([condense(problem)], other)
    with pytest.raises(InputError, match="no normal places"):
        combine([], problem)


def test_the_accumulating_filter_equals_the_batch_in_any_order_and_in_parts(make_problem, covariance_error):
    problem = make_problem(seed=5, z="none", state_prior="own")
    H = np.concatenate([block.H for block in problem.blocks], axis=2)
    names = problem.names("estimated")
    parts = [GaussFilter.start(len(names)) for _ in range(2)]
    for k in np.random.default_rng(0).permutation(problem.n):
        parts[k % 2] = parts[k % 2].add(problem.residual[k], H[k], problem.R[k])
    with_priors = parts[0] + parts[1]
    for prior in problem.priors:
        E = np.stack([np.eye(len(names))[names.index(name)] for name in prior.names])
        with_priors = with_priors.add(prior.mean, E, prior.covariance)
    x, S, chi2 = with_priors.solution()
    wanted = batch.solve(problem)
    np.testing.assert_allclose(x, wanted.mean, atol=1e-11)
    assert covariance_error(S @ S.T, wanted.K_formal) < 1e-11
    assert chi2 == pytest.approx(wanted.chi2, rel=1e-10)


def test_the_accumulating_filter_says_when_nothing_can_be_solved():
    filter_ = GaussFilter.start(2).add([1.0], np.array([[1.0, 2.0]]), np.eye(1))
    with pytest.raises(GeometryError, match="do not determine"):
        filter_.solution()
    nearly = filter_.add([1.0], np.array([[1.0, 2.0 + 1e-8]]), np.eye(1))
    with pytest.raises(GeometryError, match=r"cannot resolve|do not determine"):
        nearly.solution()
    with pytest.raises(GeometryError, match="not positive definite"):
        filter_.add([1.0], np.array([[1.0, 2.0]]), -np.eye(1))


def test_condensing_hides_the_correlation_that_the_residuals_show():
    """Noise correlated over three measurements: seen in 1000 residuals, not in 40 means of 25 of them."""
    rng = np.random.default_rng(8)
    hidden = 0
    for _ in range(20):
        noise = np.convolve(rng.normal(size=1002), np.ones(3) / np.sqrt(3.0), "valid")
        assert not consistency.residual_pattern(noise).random()
        places = noise.reshape(40, 25).mean(axis=1) * 5.0
        hidden += consistency.residual_pattern(places).random()
    assert hidden >= 17


def test_genins_accumulation_is_the_kalman_filter_and_needs_no_prior():
    rng = np.random.default_rng(11)
    F = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    G = rng.normal(size=(3, 1))
    H, R = rng.normal(size=(8, 2, 3)), np.diag([0.4, 1.3])
    y = rng.normal(size=(8, 2))
    prior = kalman.Belief.of([0.3, -0.2, 0.1], np.diag([1.0, 2.0, 0.5]))
    known = GaussFilter.start(3).add(prior.mean, np.eye(3), prior.covariance)
    unknown, belief = GaussFilter.start(3), prior
    for k in range(8):
        if k:
            belief = kalman.predict(belief, F, G @ G.T)
            known, unknown = known.move(F, G @ G.T), unknown.move(F, G @ G.T)
        belief, _ = kalman.update(belief, y[k] - H[k] @ belief.mean, H[k], R)
        known, unknown = known.add(y[k], H[k], R), unknown.add(y[k], H[k], R)
    x, S, _ = known.solution()
    np.testing.assert_allclose(x, belief.mean, atol=1e-11)
    np.testing.assert_allclose(S @ S.T, belief.covariance, atol=1e-11)
    # dense least squares over the first state and the phase noises w, for both: estimate of the last state and chi2
    for found, begun in ((known.solution(), True), (unknown.solution(), False)):
        rows, right = [], []
        if begun:
            W = inverse(prior.factor)
            rows.append(np.hstack([W, np.zeros((3, 7))]))
            right.append(W @ prior.mean)
        state = np.hstack([np.eye(3), np.zeros((3, 7))])
        for k in range(8):
            if k:
                state = F @ state
                state[:, 2 + k] += G[:, 0]
            W = inverse(np.linalg.cholesky(R))
            rows.append(W @ H[k] @ state)
            right.append(W @ y[k])
        rows.append(np.hstack([np.zeros((7, 3)), np.eye(7)]))
        right.append(np.zeros(7))
        A, v = np.vstack(rows), np.concatenate(right)
        solution = np.linalg.lstsq(A, v)[0]
        np.testing.assert_allclose(found[0], state @ solution, atol=1e-10)
        np.testing.assert_allclose(found[1] @ found[1].T, state @ inverse(A.T @ A) @ state.T, atol=1e-10)
        assert found[2] == pytest.approx(np.sum((v - A @ solution) ** 2), abs=1e-9)
    with pytest.raises(InputError, match="singular"):
        known.move(np.zeros((3, 3)), np.eye(3))
