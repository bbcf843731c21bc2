"""Filters that keep what they believed, against the same filters and smoothers by dense matrices."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import LinearProblem, Markov
from nebosvod.estimation.solvers import batch, separated, tracked
from nebosvod.estimation.solvers.tracked import Moving, Track


def joint(problem: LinearProblem) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Every parameter and every value of every nuisance at every row as one vector: names, mean, P, H (n, p, N), R."""
    n, p = problem.n, problem.p
    names = [name for block in problem.blocks for name in block.names]
    chains = problem.markov
    sizes = [len(names), *(len(m.rows) * m.P0.shape[0] for m in chains)]
    total = sum(sizes)
    mean, P, H = np.zeros(total), np.zeros((total, total)), np.zeros((n, p, total))
    H[:, :, : len(names)] = np.concatenate([block.H for block in problem.blocks], axis=2)
    for prior in problem.priors:
        at = [names.index(name) for name in prior.names]
        P[np.ix_(at, at)], mean[at] = prior.covariance, prior.mean
    first = len(names)
    for chain in chains:
        q, C = chain.P0.shape[0], chain.P0
        for i in range(len(chain.rows)):
            here = slice(first + i * q, first + (i + 1) * q)
            if i:
                before = slice(here.start - q, here.start)
                C = chain.F[i] @ C @ chain.F[i].T + chain.Q[i]
                P[here, : here.start] = chain.F[i] @ P[before, : here.start]
                P[: here.start, here] = P[here, : here.start].T
            P[here, here] = C
            H[chain.rows[i], :, here] = chain.H[i]
        first += len(chain.rows) * q
    R = np.array(np.broadcast_to(problem.R, (n, p, p)))
    for white in problem.white:
        R[white.rows] += (
            white.H @ np.broadcast_to(white.Q, (len(white.rows), *white.Q.shape[1:])) @ white.H.transpose(0, 2, 1)
        )
    return names, mean, P, H, R


def conditioned(problem: LinearProblem, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the joint vector, given the first `count` measurements."""
    _, mean, P, H, R = joint(problem)
    rows = H[:count].reshape(-1, H.shape[2])
    noise = np.zeros((len(rows), len(rows)))
    for k in range(count):
        span = slice(k * problem.p, (k + 1) * problem.p)
        noise[span, span] = R[k]
    V = rows @ P @ rows.T + noise
    gain = np.linalg.solve(V, rows @ P).T
    told = problem.residual[:count].ravel() - rows @ mean
    return mean + gain @ told, P - gain @ rows @ P


def value_at(problem: LinearProblem, chain: Markov, k: int) -> slice | None:
    """Where the joint vector has a nuisance as of row k; None before its first row."""
    first = sum(len(block.names) for block in problem.blocks)
    for other in problem.markov:
        if other is chain:
            break
        first += len(other.rows) * other.P0.shape[0]
    i = int(np.searchsorted(chain.rows, k, side="right")) - 1
    q = chain.P0.shape[0]
    return None if i < 0 else slice(first + i * q, first + (i + 1) * q)


def begins_at_nothing(problem: LinearProblem) -> LinearProblem:
    """The same with a first nuisance that has no error at its first row, as noise of the motion has none."""
    first, *rest = problem.markov
    walk = replace(first, P0=np.zeros_like(first.P0), F=np.broadcast_to(np.eye(len(first.P0)), first.F.shape))
    return replace(problem, markov=(walk, *rest))


@pytest.fixture(params=["none", "white", "both", "walk"])
def problem(request, make_problem) -> LinearProblem:
    kind = request.param
    made = make_problem(seed=4, n=14, z="both" if kind == "walk" else kind, state_prior="own", spread=1e2)
    priors = tuple(replace(prior, mean=np.full(len(prior.names), 0.01)) for prior in made.priors)
    made = replace(made, priors=priors)
    return begins_at_nothing(made) if kind == "walk" else made


def tracks(problem: LinearProblem) -> dict[str, Track]:
    return {"augmented": tracked.follow(Moving.of(problem)), "two stages": separated.stages(problem).track}


def test_every_belief_is_the_posterior_of_the_measurements_so_far(problem):
    for track in tracks(problem).values():
        for k in range(problem.n):
            mean, P = conditioned(problem, k + 1)
            place = list(range(sum(len(block.names) for block in problem.blocks)))
            known = len(place)
            for chain in problem.markov:
                at = value_at(problem, chain, k)
                place += [] if at is None else range(at.start, at.stop)
            mine = [*range(known)]
            column = known
            for chain in problem.markov:
                q = chain.P0.shape[0]
                mine += range(column, column + q) if value_at(problem, chain, k) is not None else []
                column += q
            sigma = np.sqrt(np.diag(P)[place])
            unit = np.where(sigma > 0.0, sigma, 1.0)
            np.testing.assert_allclose(track.mean[k][mine] / unit, mean[place] / unit, atol=1e-9)
            found = (track.factor[k] @ track.factor[k].T)[np.ix_(mine, mine)]
            np.testing.assert_allclose(
                found / np.outer(unit, unit), P[np.ix_(place, place)] / np.outer(unit, unit), atol=1e-9
            )


def test_innovations_are_what_the_measurements_before_do_not_foretell(problem):
    _, _, _, H, R = joint(problem)
    for track in tracks(problem).values():
        for k in (0, 5, problem.n - 1):
            mean, P = conditioned(problem, k) if k else joint(problem)[1:3]
            np.testing.assert_allclose(track.innovation[k], problem.residual[k] - H[k] @ mean, atol=1e-9)
            V = H[k] @ P @ H[k].T + R[k]
            np.testing.assert_allclose(track.spread[k] @ track.spread[k].T, V, rtol=1e-9)


def test_smoothed_beliefs_are_the_posterior_of_all_measurements(problem):
    moving = Moving.of(problem)
    found = tracked.smoothed(moving, tracked.follow(moving))
    mean, P = conditioned(problem, problem.n)
    for chain, own in zip(problem.markov, moving.chains):
        for k in range(int(chain.rows[0]), problem.n):
            at = value_at(problem, chain, k)
            np.testing.assert_allclose(found.mean[k][own.span], mean[at], atol=1e-9)
            np.testing.assert_allclose((found.factor[k] @ found.factor[k].T)[own.span, own.span], P[at, at], atol=1e-9)
    known = sum(len(block.names) for block in problem.blocks)
    np.testing.assert_allclose(found.mean[0][:known], mean[:known], atol=1e-9)
    np.testing.assert_allclose(found.factor[0][:known] @ found.factor[0][:known].T, P[:known, :known], atol=1e-9)


def test_drifting_biases_in_two_stages_end_where_the_batch_does(problem, covariance_error):
    found, wanted = separated.solve_drifting(problem), batch.solve(problem)
    assert found.names == wanted.names
    assert covariance_error(found.K_formal, wanted.K_formal) < 1e-9
    assert covariance_error(found.K_true, wanted.K_true) < 1e-9
    sigma = np.sqrt(np.diag(wanted.K_formal))
    np.testing.assert_allclose(found.mean / sigma, wanted.mean / sigma, atol=1e-9)
    assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-9)


def test_the_stages_blend_into_the_belief(problem):
    found = separated.stages(problem)
    place = [found.track.names.index(name) for name in found.bias]
    states = [found.track.names.index(name) for name in found.state]
    assumed = Moving.of(problem).mean[place]
    blended = found.x0 + np.einsum("nar,nr->na", found.V, found.track.mean[:, place] - assumed)
    sigma = np.linalg.norm(found.track.factor[:, states], axis=2)
    np.testing.assert_allclose(blended / sigma, found.track.mean[:, states] / sigma, atol=1e-9)
    assert (found.sigma_x0 <= sigma * (1.0 + 1e-9)).all()  # as if there were no bias


def test_what_is_left_out_is_not_in_the_state_but_in_the_accuracy(make_problem, covariance_error):
    treatments = {"c": "considered", "z": "considered"}
    made = make_problem(seed=5, z="both", state_prior="own", treatments=treatments, truth=True)
    found, wanted = separated.solve_drifting(made), batch.solve(made)
    assert covariance_error(found.K_true, wanted.K_true) < 1e-9
    assert Moving.of(made).names == wanted.names


def test_a_parameter_without_a_prior_is_refused(make_problem):
    with pytest.raises(InputError, match="prior for every estimated parameter"):
        Moving.of(make_problem())
