"""What becomes of an estimate when the size of one source of error changes and the weights are solved anew.

Two answers belong to the question "were this source smaller": with the estimate and its weights held, only its part of
the covariance shrinks; with the weights re-solved from the same residuals the estimate moves as well, and errors that
are only considered reach it by other gains.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import solve_lower

Array = npt.NDArray[np.float64]
STEP = 0.02  # of ln sigma, either way


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Of some parameters, in units of the lower factor S of their true covariance K.

    Attributes
    ----------
    shift : shape (k,), S^-1 d(estimate)/d ln sigma.
    growth : shape (k, k), S^-1 dK/d ln sigma S^-T; symmetric.
    """

    shift: Array
    growth: Array


def scaled(problem: LinearProblem, source: str, factor: float) -> LinearProblem:
    """The problem with the sigma of one source times a factor, in what is assumed and in what is true.

    Raises
    ------
    InputError
        If there is no such source.
    """
    f = factor * factor
    terms = [one.name for kind in (problem.priors, problem.white, problem.markov) for one in kind]
    known = (*problem.noise_names, *terms)
    if source not in known:
        raise InputError(f"scaled: no source {source!r}; there are {', '.join(known)}")
    change: dict[str, object] = {}
    if source in problem.noise_names:
        mine = problem.noise_label == problem.noise_names.index(source)
        size = np.where(mine, f, 1.0)[:, None, None]
        change["R"] = problem.R * size
        change["true_R"] = None if problem.true_R is None else problem.true_R * size
    change["priors"] = tuple(
        replace(one, covariance=f * one.covariance, true_covariance=_times(f, one.true_covariance))
        if one.name == source else one for one in problem.priors
    )  # fmt: skip
    change["white"] = tuple(
        replace(one, Q=f * one.Q, true_Q=_times(f, one.true_Q)) if one.name == source else one for one in problem.white
    )
    change["markov"] = tuple(
        replace(
            one, Q=f * one.Q, P0=f * one.P0, true_Q=_times(f, one.true_Q), true_P0=_times(f, one.true_P0)
        ) if one.name == source else one for one in problem.markov
    )  # fmt: skip
    return replace(problem, **change)  # type: ignore[arg-type]


def _times(f: float, matrix: Array | None) -> Array | None:
    return None if matrix is None else f * matrix


def responses(
    problem: LinearProblem, estimate: Estimate, names: Sequence[str], solve: Callable[[LinearProblem], Estimate]
) -> Mapping[str, Response]:
    """How the estimate of some parameters answers to each source, by central differences of solutions anew.

    Parameters
    ----------
    problem, estimate : and what `solve` makes of it.
    names : k parameters; those left out may be among them.

    Notes
    -----
    Where no error is only considered, dK/d ln sigma_s is 2 K_s: to first order the best weights do not matter to K.
    """
    S = estimate.factor(names)
    found: dict[str, Response] = {}
    for source in estimate.sources:
        try:
            sides = [solve(scaled(problem, source, float(np.exp(sign * STEP)))) for sign in (1.0, -1.0)]
            values = [np.array([one.value(name) for name in names]) for one in sides]
            whitened = [solve_lower(S, one.factor(names)) for one in sides]
        except (GeometryError, InputError):  # not observable then, or a source that cannot be scaled
            continue
        growth = (whitened[0] @ whitened[0].T - whitened[1] @ whitened[1].T) / (2.0 * STEP)
        shift = solve_lower(S, values[0] - values[1]) / (2.0 * STEP)
        found[source] = Response(shift=shift, growth=0.5 * (growth + growth.T))
    return found
