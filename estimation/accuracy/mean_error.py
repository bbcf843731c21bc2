"""What an error with a mean does to an estimate: a noise, a nuisance or a common parameter that is off on average.

Covariances are of the spread about the mean; the mean itself shifts the estimate, M(v), M(z) and M(c) of Guo and
Ivashkin (3.2), and every prediction with it. The largest deviation to expect holds both: |mean| + 3 sigma, (3.5).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.problem import LinearProblem, Markov, White
from nebosvod.estimation.solvers.batch import solve as solve_batch

Array = npt.NDArray[np.float64]


def shift(
    problem: LinearProblem,
    means: Mapping[str, npt.ArrayLike],
    solve: Callable[[LinearProblem], Estimate] = solve_batch,
) -> dict[str, float]:
    """Mean of estimate minus truth, by parameter name, those left out included.

    Parameters
    ----------
    means : what is off on average. By parameter name: mean of truth minus assumed value, a number. By the name of a
        noise source: (p,) or one for each of its measurements (m, p), in the unit of the measurement. By the name of a
        white or time-correlated nuisance: (q,) or one for each of its rows (n_r, q).
    solve : the estimator; any that is linear in the residuals, those with a gain of their own too.

    Raises
    ------
    InputError
        If a name or a shape is unknown, or a parameter is fixed.
    GeometryError
        If the problem is not observable.

    Notes
    -----
    The estimator is asked what it makes of the means alone: its response to the residuals they cause, minus the means
    of the parameters themselves. Where only common parameters are off, `Estimate.mean_shift` has it without a solution.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (3.2), (3.5).
    """
    known = {name for block in problem.blocks if block.treatment != "fixed" for name in block.names}
    offset = {name: float(np.asarray(value, dtype=np.float64)) for name, value in means.items() if name in known}
    priors = tuple(replace(prior, mean=None) for prior in problem.priors)
    answer = solve(replace(problem, residual=caused(problem, means), priors=priors))
    values = dict.fromkeys(answer.left_out, 0.0) | dict(zip(answer.names, (float(x) for x in answer.mean)))
    return {name: values[name] - offset.get(name, 0.0) for name in (*answer.names, *answer.left_out)}


def caused(problem: LinearProblem, means: Mapping[str, npt.ArrayLike]) -> Array:
    """Residuals (n, p) that means of errors cause; they, and what is raised, are those of `shift`."""
    columns = {
        name: block.H[:, :, k] for block in problem.blocks if block.treatment != "fixed"
        for k, name in enumerate(block.names)
    }  # fmt: skip
    total = np.zeros((problem.n, problem.p))
    for name, value in means.items():
        if name in columns:
            total += float(np.asarray(value, dtype=np.float64)) * columns[name]
        else:
            _add_fresh(problem, name, np.asarray(value, dtype=np.float64), total)
    return total


def _add_fresh(problem: LinearProblem, name: str, mean: Array, caused: Array) -> None:
    """Add the residuals that the mean of a noise source or a fresh nuisance causes."""
    if name in problem.noise_names:
        label = np.zeros(problem.n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
        mine = np.flatnonzero(label == problem.noise_names.index(name))
        caused[mine] += _rows(mean, (len(mine), problem.p), name)
        return
    groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    for group in groups:
        if group.name == name:
            caused[group.rows] += np.einsum("npq,nq->np", group.H, _rows(mean, (len(group.H), group.H.shape[2]), name))
            return
    raise InputError(f"mean_error: {name!r} is neither a parameter with an error nor a source of fresh errors")


def _rows(mean: Array, shape: tuple[int, int], name: str) -> Array:
    if mean.shape not in (shape, shape[1:]) or not np.isfinite(mean).all():
        raise InputError(
            f"mean_error: the mean of {name!r} needs shape {shape[1:]} or {shape}, finite; got {mean.shape}"
        )
    return np.broadcast_to(mean, shape)
