"""The orbit of an estimate for arrays.npz: state and dynamic parameters jointly, and each source's part of it."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.estimation import Estimate
from nebosvod.estimation.accuracy.reweighed import responses
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.estimation.solvers import batch
from nebosvod.mission import Question
from nebosvod.scene.prior import STATE_NAMES

Arrays = dict[str, npt.NDArray[Any]]
MOST_SOLVED = 200_000  # measurements times sources: for more it is not told how the estimate answers to each source
MOST_SHARED = 600  # errors common to many measurements that are stored with the orbit; with more, none is


def orbit_arrays(mission: Question, estimate: Estimate, label: str) -> Arrays:
    """Names (n,), lower factor (n, n) of the true covariance, and source names (g,) with their factors (g, n, n).

    Considered and ignored parameters of the forces are among the names: the state depends on them. So it does on the
    biases and other errors common to many measurements (k), which coming measurements of the same telescopes will have
    as well: their rows (k, n + k) of the joint lower factor stand beside.
    """
    known = (*estimate.names, *estimate.left_out)
    names = (*STATE_NAMES, *(p.name for p in mission.free_parameters if p.name in known))
    shared = tuple(name for name in known if name not in names)
    if len(shared) > MOST_SHARED:
        shared = ()
    found = estimate.predict(np.eye(len(names)), names)
    joint = estimate.factor((*names, *shared))
    return {
        f"orbit_shared_names_{label}": np.array(shared, dtype=np.str_),
        f"orbit_shared_factor_{label}": joint[len(names) :],
        f"orbit_names_{label}": np.array(names),
        f"orbit_factor_{label}": found.factor,
        f"orbit_source_names_{label}": np.array(list(found.factors), dtype=np.str_),
        f"orbit_source_factors_{label}": np.array([lower_factor(G) for G in found.factors.values()]),
    }


def response_arrays(mission: Question, fit: Fit, label: str) -> Arrays:
    """How an estimate answers to the size of each of its sources, weights solved anew and the selection held.

    Source names (g,), d(estimate)/d ln sigma (g, n) and d(covariance)/d ln sigma (g, n, n), both in units of the
    orbit's factor and in the order of its names; nothing where there are too many to solve.
    """
    estimate = fit.estimate
    if fit.problem.n * len(estimate.sources) > MOST_SOLVED:
        return {}
    known = (*estimate.names, *estimate.left_out)
    names = (*STATE_NAMES, *(p.name for p in mission.free_parameters if p.name in known))
    found = responses(fit.problem, estimate, names, batch.solve)
    return {
        f"orbit_response_names_{label}": np.array(list(found), dtype=np.str_),
        f"orbit_response_shift_{label}": np.array([one.shift for one in found.values()]).reshape(-1, len(names)),
        f"orbit_response_growth_{label}": np.array([one.growth for one in found.values()]).reshape(
            -1, len(names), len(names)
        ),
    }
