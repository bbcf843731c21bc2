"""What a filter believed after each measurement: the state where the object is then, and all that is estimated beside.

A filter of constants (`nebosvod.estimation.solvers.tracked`) knows x0, c and nuisances; the state at measurement k is
x_k = X_k + Phi_k dx0 + zeta_k dc, and where the motion itself is uncertain its accumulated noise goes the way of dx0.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import LinearProblem
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.estimation.solvers import separated, tracked
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.estimation.solvers.separated import Stages
from nebosvod.estimation.solvers.tracked import Moving, Track
from nebosvod.mission.request import TWO_STAGE
from nebosvod.observation import Markov, ProcessNoise
from nebosvod.scene.point import Point, View
from nebosvod.scene.prior import STATE_NAMES

Array = npt.NDArray[np.float64]
MOST = 20_000  # measurements; of longer arcs no history is kept
Names = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A filter's way through the measurements.

    Attributes
    ----------
    moving, track : the system, and what was believed of its w components.
    state : (n, 6) heliocentric states at the measurements, at the values `about` (n, w) of the components.
    W : (n, 6, w), how components move the state there.
    stages : of a filter that has two, in the components' units.
    """

    moving: Moving
    track: Track
    state: Array
    about: Array
    W: Array
    stages: Stages | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beliefs:
    """State (n, 6), factor (n, 6, 6) of its covariance, and what is estimated beside it with sigmas, (n, r) each."""

    state: Array
    factor: Array
    beside: Array
    sigma: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filtered:
    """The history of a filter, measurement by measurement.

    Attributes
    ----------
    names : of the r numbers beside the state: parameters, biases, values of nuisances that change.
    now, smoothed : from the measurements so far, and from all of them.
    innovation : (n, 2) observed minus predicted, rad, with its standard deviation. nis : (n,) normalised squares.
    free_state, blend : (n, 6) and (n, 6, b), of a filter with two stages: the state as if the `blended` of the names
        were what they are assumed to be beforehand, and how the state moves with what they are found to be beyond that.
    """

    names: Names
    now: Beliefs
    smoothed: Beliefs
    innovation: Array
    innovation_sigma: Array
    nis: Array
    free_state: Array | None = None
    blend: Array | None = None
    blended: Names = ()


def linear_path(problem: LinearProblem, deviation: Mapping[str, float], seen: View, method: str) -> Path:
    """Filter a problem linearised at the view, `deviation` from where its priors count."""
    here = recentred(problem, deviation)
    stages = separated.stages(here) if method in TWO_STAGE else None
    moving = Moving.of(here)
    at = seen.trajectory.at(seen.observation.t_s)
    return Path(
        moving=moving,
        track=tracked.follow(moving) if stages is None else stages.track,
        state=at.state,
        about=np.zeros((len(at.state), len(moving.names))),
        W=state_columns(moving, np.concatenate([at.Phi, at.zeta], axis=2), seen.observation.parameter_names),
        stages=stages,
    )


def state_columns(moving: Moving, partials: Array, parameters: Names) -> Array:
    """How the components of a system (w) move the state (n, 6, w), from partials (n, 6, 6 + m) by x0 and parameters."""
    place = {name: k for k, name in enumerate((*STATE_NAMES, *parameters))}
    W = np.zeros((*partials.shape[:2], len(moving.names)))
    for column, name in enumerate(moving.names):
        if name in place:
            W[:, :, column] = partials[:, :, place[name]]
    return W


def with_process_noise(path: Path, noise: ProcessNoise | None, point: Point, t_s: Array) -> Path:
    """The path with what the process noise of the object does to the state at the measurements (n,).

    Accelerations on the reference orbit add Phi_k B_k a to the state, a counted from zero and not from the point.
    """
    if noise is None or not set(noise.names) <= set(path.moving.names):
        return path
    columns, state = ([path.moving.names.index(name) for name in names] for names in (noise.names, STATE_NAMES))
    W, about = path.W.copy(), path.about.copy()
    W[:, :, columns] = W[:, :, state] @ noise.moved_by(t_s)
    about[:, columns] = [-point.values.get(name, 0.0) for name in noise.names]
    return replace(path, W=W, about=about)


def filtered(path: Path, point: Point, seen: View) -> Filtered:
    """The history of a filter whose components count from the values of a point."""
    moving, track = path.moving, path.track
    names = component_names(moving, seen)
    known = point.values
    zero = np.array([known.get(name, 0.0) for name in names])
    beside = [k for k, name in enumerate(names) if name not in STATE_NAMES]
    whitened = np.linalg.solve(track.spread, track.innovation[:, :, None])[:, :, 0]

    def beliefs(of: Track) -> Beliefs:
        wide = path.W @ of.factor
        return Beliefs(
            state=path.state + (path.W @ (of.mean - path.about)[:, :, None])[:, :, 0],
            factor=np.array([lower_factor(one) for one in wide]),
            beside=(zero + of.mean)[:, beside],
            sigma=np.linalg.norm(of.factor[:, beside], axis=2),
        )

    free, blend, blended = _staged(path, names)
    return Filtered(
        names=tuple(names[k] for k in beside),
        now=beliefs(track),
        smoothed=beliefs(tracked.smoothed(moving, track)),
        innovation=track.innovation,
        innovation_sigma=np.linalg.norm(track.spread, axis=2),
        nis=np.sum(whitened**2, axis=1),
        free_state=free,
        blend=blend,
        blended=blended,
    )


def component_names(moving: Moving, seen: View) -> Names:
    """The names of a system's components, nuisances that change by the names of their terms."""
    own = {term.name: term.names for term in seen.terms if isinstance(term, Markov)}
    names = list(moving.names)
    for chain in moving.chains:
        names[chain.span] = own[chain.name]
    return tuple(names)


def _staged(path: Path, names: Names) -> tuple[Array | None, Array | None, Names]:
    """The bias-free state (n, 6) where the object is, and the blend (n, 6, b) of the bias into it."""
    found = path.stages
    if found is None:
        return None, None, ()
    inside = found.inside
    outside = np.flatnonzero(~inside)
    free = path.state + (path.W[:, :, inside] @ found.x0[:, :, None])[:, :, 0]
    free += path.W[:, :, outside] @ path.moving.mean[outside]
    blend = path.W[:, :, inside] @ found.V + path.W[:, :, outside]
    return free, blend, tuple(names[k] for k in outside)
