"""One factorisation for many residuals gives what solving each time gives, and innovations that are white."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.estimation import Estimate, LinearProblem
from nebosvod.estimation.accuracy.repeated import Innovations, Repeated
from nebosvod.estimation.problem.subset import subset
from nebosvod.estimation.solvers import batch, recursive

Array = npt.NDArray[np.float64]
MakeProblem = Callable[..., LinearProblem]
SOLVERS: Mapping[str, Callable[[LinearProblem], Estimate]] = {
    "qr": batch.solve,
    "blocks": partial(batch.solve, way="blocks"),
    "identity": partial(batch.solve, way="identity"),
    "recursive": partial(recursive.solve, history=False),
}
TREATMENTS = [{}, {"c": "considered"}, {"bias": "ignored", "z": "ignored"}]


@pytest.mark.parametrize("z", ["white", "markov"])
@pytest.mark.parametrize("treatments", TREATMENTS)
@pytest.mark.parametrize("way", SOLVERS)
def test_the_affine_map_equals_solving_anew_to_1e_10_sigma(
    make_problem: MakeProblem, way: str, treatments: dict[str, str], z: str
) -> None:
    """Prior means are not zero in the joint prior, and the map is taken at a residual that is not zero either."""
    problem = make_problem(seed=2, z=z, treatments=treatments, state_prior="joint" if "c" not in treatments else "none")
    reference = SOLVERS[way](problem)
    residuals = np.random.default_rng(1).normal(size=(5, problem.n, problem.p))
    means = Repeated.of(problem, reference).means(residuals)
    sigma = np.linalg.norm(reference.S_formal, axis=1)
    for one, mean in zip(residuals, means):
        anew = SOLVERS[way](replace(problem, residual=one)).mean
        assert np.abs((anew - mean) / sigma).max() < 1e-10


@pytest.mark.parametrize("z", ["white", "markov"])
def test_innovations_are_the_residuals_predicted_from_the_measurements_before(
    make_problem: MakeProblem, z: str
) -> None:
    """Each normalised square equals the growth of the batch cost by that measurement, an identity of least squares."""
    problem = make_problem(seed=7, z=z, state_prior="joint")
    through = Innovations.of(problem)
    assert through is not None
    residuals = np.random.default_rng(2).normal(size=(3, problem.n, problem.p))
    formal, true = through.squares(residuals)
    assert true is not None
    assert np.allclose(formal, true, rtol=1e-8)
    for one, squares in zip(residuals, formal):
        full = replace(problem, residual=one)
        costs = [batch.solve(subset(full, np.arange(problem.n) < k)).chi2 for k in range(through.first, problem.n + 1)]
        assert np.abs(np.diff(costs) - squares).max() < 1e-8 * max(costs)


def test_true_innovation_covariances_are_those_of_drawn_truths(make_problem: MakeProblem) -> None:
    """20000 truths with c considered and bias ignored; the mean normalised square is p within 5 standard errors."""
    problem = make_problem(seed=8, treatments={"c": "considered", "bias": "ignored"})
    through = Innovations.of(problem)
    assert through is not None
    rng = np.random.default_rng(3)
    count = 20000
    residuals = np.einsum("npq,cnq->cnp", np.linalg.cholesky(problem.truth), rng.normal(size=(count, problem.n, 2)))
    for prior in problem.priors:
        truth = np.asarray(prior.mean) + rng.normal(size=(count, len(prior.names))) @ np.linalg.cholesky(prior.truth).T
        for block in problem.blocks:
            columns = [i for i, name in enumerate(block.names) if name in prior.names]
            place = [prior.names.index(block.names[i]) for i in columns]
            residuals += np.einsum("npk,ck->cnp", block.H[:, :, columns], truth[:, place])
    for white in problem.white:
        draws = rng.normal(size=(count, len(white.rows), white.Q.shape[1]))
        z = np.einsum("nqr,cnr->cnq", np.broadcast_to(np.linalg.cholesky(white.truth), (len(white.rows), 3, 3)), draws)
        residuals[:, white.rows] += np.einsum("npq,cnq->cnp", white.H, z)
    formal, true = through.squares(residuals)
    assert true is not None
    assert np.abs(true.mean(axis=0) / problem.p - 1.0).max() < 5.0 / np.sqrt(count)
    assert formal.mean() / problem.p > 1.2


def test_no_pass_where_the_parameters_are_never_determined(make_problem: MakeProblem) -> None:
    problem = make_problem(seed=9, n=2, treatments={"z": "estimated"})
    thin = subset(problem, np.array([True, False]))
    assert Innovations.of(thin) is None


def test_truth_is_not_claimed_where_a_correlated_nuisance_is_left_out(make_problem: MakeProblem) -> None:
    problem = make_problem(seed=10, z="markov", treatments={"z": "considered"})
    through = Innovations.of(problem)
    assert through is not None
    assert through.true is None
