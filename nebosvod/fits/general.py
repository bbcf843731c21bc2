"""The converged orbit in the program's one estimator: every source of error with its treatment.

Where sources are only considered, ignored or already in the weights, this is one linear solve at the orbit that the
lean correction found. Where one is estimated, the orbit is iterated anew with it, and the observations are judged anew
by residuals from which it has been taken.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.dynamics.impact import fly
from nebosvod.engine.assembly import nominal_view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.estimation import Estimate
from nebosvod.estimation.solvers.rejection import Thresholds, chi_squared, reselect, settled, turning
from nebosvod.fits.correction import Correction
from nebosvod.mission import FitMission
from nebosvod.observation import Common, Observation
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.scene.material import Material
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.recorded import STATED, scene_of
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
ROUNDS = 15
TOLERANCE = 2e-3  # of a sigma: the lean correction stops at half of that


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class General:
    """What the estimator found.

    Attributes
    ----------
    residual : (n, 2) of every observation after the fit, estimated sources taken out, rad.
    spread : (n, 2) standard deviation of each residual, noise and the orbit's error together, rad.
    chi2 : (n,) by the covariance of each residual.
    stands : whether another round would select the same; without, the rounds went in a circle or to their limit.
    """

    scene: Scene
    fit: Fit
    selected: Flags
    seen: Observation
    residual: Array
    spread: Array
    chi2: Array
    stands: bool = True


def estimate(
    mission: FitMission,
    material: Material,
    sky: Sky,
    forces: ForceModel,
    state: Array,
    priors: PriorTable,
    selected: Flags,
    thresholds: Thresholds | None,
    near: Correction | None = None,
) -> General:
    """Estimate with every source of error, and select anew where that changes the residuals.

    Parameters
    ----------
    sky : with all white errors in its weights.
    forces : with every parameter that is not fixed as a column, at the values the lean correction found.
    state : (6,) where the lean correction ended.
    selected : (n,) its selection.
    near : that correction, of the same directions: where its columns are all there are, its orbit is used again.
    """
    history: list[Flags] = []
    held = np.zeros(len(sky), dtype=bool)
    known: Correction | None = None
    if near is not None and near.trajectory.parameter_names == forces.parameters:
        known = near
    found = _once(mission, material, sky, forces, state, priors, selected, known)
    anew = any(source.error.treatment == "estimated" for source in mission.sources)
    while thresholds is not None and anew and found.fit.estimate.solution is not None:
        latest = reselect(found.chi2, selected, thresholds, _count(found) // 2 + 1, held)
        if np.array_equal(latest, selected):
            break
        if settled(history, latest) and not held.any():
            held = turning([*history, selected], latest)
            latest = latest | held
            history = []
        if settled(history, latest) or len(history) == ROUNDS:
            return replace(found, stands=False)
        history.append(selected)
        selected = latest
        found = _once(mission, material, sky, forces, found.fit.point.state, priors, selected)
    return found


def _count(found: General) -> int:
    """How many parameters need measurements of their own: process noise has many, and each a prior."""
    noise = process_noise_of(found.scene.nuisances)
    return len(set(found.fit.estimate.names) - set(() if noise is None else noise.names))


def widened(mission: FitMission, material: Material, sky: Sky, forces: ForceModel, state: Array) -> Sky:
    """The sky with every source that will be estimated as more noise of each observation by itself.

    A selection that does not know a source yet would take all of a telescope for gross errors.

    Parameters
    ----------
    state : (6,) near the orbit, at the epoch of the sky.
    """
    if not any(source.error.treatment == "estimated" for source in mission.sources):
        return sky
    trajectory = fly(state, sky.epoch, sky.span_s, forces)
    scene = scene_of(mission, material, forces, trajectory, np.arange(len(sky)))
    R = sky.R.copy()
    for term in nominal_view(scene).terms:
        if term.treatment != "estimated" or term.name == STATED:
            continue
        if isinstance(term, Common):
            R += term.H @ term.covariance @ term.H.transpose(0, 2, 1)
        else:
            R[term.rows] += term.H @ term.marginals @ term.H.transpose(0, 2, 1)
    return sky.weighed(R)


def _once(
    mission: FitMission,
    material: Material,
    sky: Sky,
    forces: ForceModel,
    state: Array,
    priors: PriorTable,
    selected: Flags,
    known: Correction | None = None,
) -> General:
    """One selection: Gauss-Newton from the state until it stands.

    Parameters
    ----------
    known : the correction that ended at the state, where it knows all columns.
    """
    rows = np.flatnonzero(selected)
    first = fly(state, sky.epoch, sky.span_s, forces) if known is None else known.trajectory
    scene = scene_of(mission, material, forces, first, rows)
    start = nominal_view(scene, None if known is None else known.seen.light_time_s[rows])
    found = fit(
        scene, mission.estimators[0], start, material.observed[rows], priors, tolerance=TOLERANCE, history=False
    )
    return _judged(mission, material, sky, scene, found, selected)


def _judged(mission: FitMission, material: Material, sky: Sky, scene: Scene, found: Fit, selected: Flags) -> General:
    """Residual (n, 2), its standard deviation (n, 2) and chi squared (n,) of every observation, selected or not.

    Estimated nuisances common to many observations are taken out of the residuals; those of an observation that was
    left out and belongs to a station without any other are unknown, so their covariance joins its noise. So does that
    of errors drawn anew or correlated in time, which are in the weights.
    """
    estimate: Estimate = found.estimate
    everyone = scene_of(mission, material, scene.forces, found.trajectory, np.arange(len(sky)))
    whole = nominal_view(everyone)
    seen, R = whole.observation, sky.R.copy()
    v = sky.residual(seen.psi)
    if estimate.solution is None:
        spread, chi2 = np.sqrt(np.diagonal(R, axis1=1, axis2=2)), np.full(len(sky), np.nan)
        return General(scene=scene, fit=found, selected=selected, seen=seen, residual=v, spread=spread, chi2=chi2)
    H = np.zeros((len(sky), 2, len(estimate.names)))
    column = {name: place for place, name in enumerate(estimate.names)}
    known = dict(zip((*STATE_NAMES, *seen.parameter_names), range(seen.H.shape[2])))
    for name, place in known.items():
        if name in column:
            H[:, :, column[name]] = seen.H[:, :, place]
    for term in whole.terms:
        if not isinstance(term, Common):
            if (
                term.treatment == "estimated" and term.name != STATED
            ):  # in the weights; stated ones are in those of the sky
                R[term.rows] += term.H @ term.marginals @ term.H.transpose(0, 2, 1)
            continue
        for k, name in enumerate(term.names):
            if name in column:
                H[:, :, column[name]] = term.H[:, :, k]
                v -= term.H[:, :, k] * found.point.nuisances[name]
            elif term.treatment == "estimated":
                R += term.covariance[k, k] * term.H[:, :, k, None] * term.H[:, None, :, k]
    noise, orbit = np.diagonal(R, axis1=1, axis2=2), np.sum((H @ estimate.S_formal) ** 2, axis=2)
    spread = np.sqrt(np.maximum(noise + np.where(selected, -1.0, 1.0)[:, None] * orbit, 1e-3 * noise))
    chi2 = chi_squared(v, R, H, estimate.S_formal, selected)
    return General(scene=scene, fit=found, selected=selected, seen=seen, residual=v, spread=spread, chi2=chi2)
