"""One more measurement by a rank-p update equals solving again with it, whatever is left out."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.addition import Belief, additions, predicted, take
from nebosvod.estimation.problem.subset import subset
from nebosvod.estimation.solvers import batch

Array = npt.NDArray[np.float64]
MakeProblem = Callable[..., LinearProblem]
FIRST = 14  # of 24 measurements are there, the others are candidates
TREATMENTS = [
    {},
    {"c": "considered"},
    {"bias": "ignored", "z": "considered"},
    {"c": "considered", "bias": "considered", "z": "ignored"},
]


def head_and_all(problem: LinearProblem) -> tuple[LinearProblem, Belief]:
    head = subset(problem, np.arange(problem.n) < FIRST)
    return head, Belief.of(batch.solve(head))


@pytest.mark.parametrize("truth", [False, True])
@pytest.mark.parametrize("treatments", TREATMENTS)
def test_each_candidate_gives_the_covariance_of_a_new_solution(
    make_problem: MakeProblem, treatments: dict[str, str], truth: bool
) -> None:
    """Tolerance: 1e-10 of the prediction's covariance; condition numbers are near 10."""
    problem = make_problem(seed=3, treatments=treatments, truth=truth)
    _, belief = head_and_all(problem)
    added = additions(problem)
    W = np.random.default_rng(5).normal(size=(2, len(belief.names)))
    factors = predicted(belief, added, W)
    for k in range(FIRST, problem.n):
        again = batch.solve(subset(problem, (np.arange(problem.n) < FIRST) | (np.arange(problem.n) == k)))
        wanted = again.predict(W, belief.names).covariance
        found = factors[k] @ factors[k].T
        assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.parametrize("treatments", TREATMENTS)
def test_taking_all_candidates_one_by_one_ends_at_the_batch(
    make_problem: MakeProblem, treatments: dict[str, str]
) -> None:
    problem = make_problem(seed=4, treatments=treatments)
    _, belief = head_and_all(problem)
    added = additions(problem)
    for k in range(FIRST, problem.n):
        belief = take(belief, added, k)
    whole = batch.solve(problem)
    K_true = whole.covariance(belief.names)
    assert np.abs(belief.S @ belief.S.T - whole.K_formal).max() < 1e-10 * np.abs(whole.K_formal).max()
    assert np.abs(belief.G @ belief.G.T - K_true).max() < 1e-10 * np.abs(K_true).max()


def test_a_subset_of_a_correlated_nuisance_equals_the_dense_covariance_of_the_kept_rows(
    make_problem: MakeProblem, dense_noise: Callable[[LinearProblem], Array]
) -> None:
    problem = make_problem(seed=5, z="markov")
    keep = np.random.default_rng(1).random(problem.n) < 0.5
    keep[0] = False  # the chain then starts late
    rows = np.repeat(keep, problem.p)
    wanted = dense_noise(problem)[np.ix_(rows, rows)]
    found = dense_noise(subset(problem, keep))
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_an_empty_subset_and_an_unknown_noise_are_refused(make_problem: MakeProblem) -> None:
    problem = make_problem(seed=6)
    with pytest.raises(InputError, match="at least one"):
        subset(problem, np.zeros(problem.n, dtype=bool))
    with pytest.raises(InputError, match="time-correlated"):
        additions(make_problem(seed=6, z="markov", truth=True))
