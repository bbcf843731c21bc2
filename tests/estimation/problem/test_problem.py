"""What a LinearProblem refuses, and in which words."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Markov, Prior, White
from nebosvod.estimation.solvers import batch

H = np.ones((3, 2, 1))


def problem(**changes):
    """A minimal problem with some fields changed."""
    fields = {
        "residual": np.zeros((3, 2)),
        "R": np.eye(2),
        "blocks": (Block(name="a", names=("a",), H=H),),
    }
    return LinearProblem(**(fields | changes))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: problem(residual=np.zeros(3)), r"residual: needs shape \(any, any\), got \(3,\)"),
        (lambda: problem(residual=np.zeros((0, 2))), "no measurements"),
        (lambda: problem(residual=np.full((3, 2), np.nan)), "not finite"),
        (lambda: problem(R=np.diag([1.0, -1.0])), "R: covariance has a negative variance"),
        (lambda: problem(R=np.stack([np.eye(2), np.eye(2), [[1, 2], [2, 1]]])), "R of row 2.*eigenvalue -1"),
        (lambda: problem(R=np.eye(3)), r"R: needs shape \(1, 2, 2\)"),
        (lambda: problem(blocks=(Block(name="a", names=("a",), H=H[:2]),)), r"block a: H needs shape \(3, 2, 1\)"),
        (lambda: Block(name="a", names=("a", "b"), H=H), r"needs shape \(any, any, 2\)"),
        (lambda: Block(name="a", names=("a", "a"), H=np.ones((3, 2, 2))), "no name twice"),
        (lambda: Block(name="a", names="ab", H=np.ones((3, 2, 2))), "tuple of names"),
        (lambda: Block(name="a", names=("a",), H=H, treatment="guessed"), "fixed, ignored, considered, estimated"),
        (lambda: problem(blocks=(Block(name="a", names=("a",), H=H),) * 2), "name is used twice"),
        (lambda: problem(blocks=(Block(name="a", names=("a",), H=H, treatment="fixed"),)), "nothing is estimated"),
        (
            lambda: problem(blocks=(Block(name="a", names=("a",), H=H, treatment="ignored"),)),
            "ignored but has no prior",
        ),
        (lambda: problem(priors=(Prior(name="p", names=("albed",), covariance=[[1]]),)), "no parameter 'albed'"),
        (lambda: problem(priors=(Prior(name="p", names=("a",), covariance=[[1]]),) * 2), "names must differ"),
        (
            lambda: problem(priors=[Prior(name=n, names=("a",), covariance=[[1]]) for n in "pq"]),
            "two priors, p and q; combine",
        ),
        (lambda: Prior(name="p", names=("a",), covariance=[[-1.0]]), "negative variance"),
        (lambda: Prior(name="p", names=("a", "b"), covariance=[[1, 2], [2, 1]]), "smallest eigenvalue -1"),
        (lambda: problem(noise_label=np.array([0, 1, 0])), "must lie in 0..0"),
        (lambda: problem(noise_label=np.array([0.0, 0.0, 0.0])), "must be 3 integers"),
        (lambda: White(name="z", H=np.ones((2, 2, 1)), Q=np.eye(1), rows=np.array([0, 0])), "twice"),
        (
            lambda: problem(white=(White(name="z", H=H, Q=np.eye(1), rows=np.array([0, 1, 5])),)),
            "rows must lie in 0..2",
        ),
        (
            lambda: Markov(name="z", H=H, F=np.ones((3, 1, 1)), Q=H[:, :1], P0=np.eye(1), rows=np.array([2, 1, 0])),
            "increase strictly",
        ),
    ],
)
def test_wrong_input_is_refused_in_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_misspelt_parameter_gets_a_suggestion():
    with pytest.raises(InputError, match="'albedo'"):
        problem(
            blocks=(Block(name="albedo", names=("albedo",), H=H),),
            priors=(Prior(name="p", names=("albed",), covariance=[[1.0]]),),
        )


def test_arrays_are_read_only_and_the_callers_array_stays_writable():
    mine = np.ones((3, 2, 1))
    block = Block(name="a", names=("a",), H=mine)
    with pytest.raises(ValueError, match="read-only"):
        block.H[0, 0, 0] = 2.0
    mine[0, 0, 0] = 2.0


def test_a_prior_that_ties_a_fixed_parameter_to_others_is_refused():
    blocks = (
        Block(name="a", names=("a",), H=H),
        Block(name="b", names=("b",), H=H, treatment="fixed"),
    )
    tied = Prior(name="both", names=("a", "b"), covariance=[[1.0, 0.5], [0.5, 1.0]])
    with pytest.raises(InputError, match="b is fixed but correlated"):
        batch.solve(problem(blocks=blocks, priors=(tied,)))
    free = replace(tied, covariance=np.eye(2))
    assert batch.solve(problem(blocks=blocks, priors=(free,))).sources == ("measurement noise", "both")


def test_an_error_where_the_assumed_prior_is_singular_is_refused():
    prior = Prior(name="p", names=("a",), covariance=[[0.0]], true_covariance=[[1.0]])
    with pytest.raises(InputError, match="holds exactly"):
        batch.solve(problem(priors=(prior,)))


def test_a_large_stack_of_valid_covariances_is_accepted_and_one_bad_one_is_named():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(20000, 3, 2))
    Q = A @ A.transpose(0, 2, 1)  # all singular
    rows = np.arange(20000)
    White(name="z", H=np.ones((20000, 2, 3)), Q=Q, rows=rows)
    Q[17000] -= 0.1 * np.eye(3) * np.trace(Q[17000])
    with pytest.raises(InputError, match="row 17000"):
        White(name="z", H=np.ones((20000, 2, 3)), Q=Q, rows=rows)
