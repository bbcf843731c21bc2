"""What a fit answers: the orbit at the epochs asked for, predictions, the comparison, residuals by record and station.

OrbitFit (arrays) -> Answer (numbers with names) -> summary, tables, report, terminal.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Trajectory
from nebosvod.dynamics.impact import what_it_hits
from nebosvod.engine.evaluation import out_of_steps
from nebosvod.errors import CoverageError, EventError
from nebosvod.estimation import Estimate
from nebosvod.findings.blame import StateShare, Worlds, state_shares
from nebosvod.findings.doctor import Diagnosis, diagnose
from nebosvod.findings.foretold import foretell, unknown_orbit
from nebosvod.findings.nonlinearity import nonlinearity
from nebosvod.findings.prediction import Prediction, existing, of_fit, unanswered
from nebosvod.fits import usual_force
from nebosvod.fits.ahead import Ahead, look_ahead
from nebosvod.fits.engine import OrbitFit
from nebosvod.fits.orbit import Comparison, OrbitAt, compared, orbit_at
from nebosvod.mission import FitMission
from nebosvod.mission.reading.places import place
from nebosvod.observation import ProcessNoise
from nebosvod.scene.process_noise import process_noise_of, reached
from nebosvod.scene.recorded import long_span, long_trajectory
from nebosvod.scene.scene import Scene
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ended:
    """An epoch asked for to which the orbit does not reach: one word, and the sentence that says why."""

    epoch: Epoch
    status: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """Everything a fit says.

    Attributes
    ----------
    fit : what it was made from.
    trajectory : the fitted orbit over all that is asked for; None where the fit has no covariance.
    orbit : state and elements at the epoch of the answer; amid : at that of the fit; further : at the other epochs
        asked for.
    budget : of the state; predictions : those that do not exist among them; reference : how far from another orbit.
    ended : the epochs asked for at which the orbit has ended.
    ahead : what comes after the last observation.
    diagnosis : what the residuals say.
    """

    fit: OrbitFit
    trajectory: Trajectory | None = None
    orbit: OrbitAt | None = None
    amid: OrbitAt | None = None
    further: tuple[OrbitAt, ...] = ()
    budget: tuple[StateShare, ...] = ()
    predictions: tuple[Prediction, ...] = ()
    ended: tuple[Ended, ...] = ()
    reference: Comparison | None = None
    cautions: tuple[str, ...] = ()
    ahead: Ahead | None = None
    diagnosis: Diagnosis | None = None


def answer(found: OrbitFit) -> Answer:
    """Evaluate a fit where its file asks for it.

    Raises
    ------
    EventError, CoverageError
        If the orbit hits a body, or the ephemeris ends, before the last observation.
    """
    fit, mission = found.general.fit, found.mission
    estimate = fit.estimate
    nothing = Answer(fit=found, predictions=_none_of(found))
    if estimate.solution is None:
        return nothing
    forces = found.general.scene.forces.with_values(fit.point.parameters)
    t_s = fit.observation.t_s
    try:
        trajectory = long_trajectory(mission, fit.point.state, forces, (float(t_s.min()), float(t_s.max())))
    except EventError:
        if found.verdict.failed:
            return nothing  # an orbit nobody believes ran into a body
        raise
    span, needed = long_span(mission, forces, (float(t_s.min()), float(t_s.max())))
    if not what_it_hits(trajectory):
        span = span[0], min(span[1], trajectory.span_s[1])  # its steps may have come to their end before
    scene = replace(
        found.general.scene, trajectory=trajectory, span_s=span, needed_s=needed, forces=forces,
        nuisances=tuple(reached(one, trajectory) for one in found.general.scene.nuisances),
    )  # fmt: skip
    noise = process_noise_of(scene.nuisances)
    worlds = Worlds(now=estimate, then={})
    amid = orbit_at(estimate, trajectory, 0.0)
    predictions = _predicted(scene, found, trajectory, worlds)
    (first, *later), ended = _reached(mission, trajectory)
    reference, without = _comparison(mission, estimate, amid, forces, noise)
    return Answer(
        fit=found,
        trajectory=trajectory,
        orbit=orbit_at(estimate, trajectory, first, noise) if first is not None else amid,
        amid=amid,
        further=tuple(orbit_at(estimate, trajectory, t, noise) for t in later if t is not None),
        ended=tuple(ended),
        budget=tuple(state_shares(scene, fit, worlds)),
        predictions=tuple(predictions),
        reference=reference,
        cautions=(*usual_force.cautions(found, scene, existing(predictions)), *without),
        ahead=look_ahead(found, trajectory, amid),
        diagnosis=diagnose(found.general.scene, fit, recorded=True),
    )


def _comparison(
    mission: FitMission, estimate: Estimate, amid: OrbitAt, forces: ForceModel, noise: ProcessNoise | None
) -> tuple[Comparison | None, list[str]]:
    """The comparison with the orbit asked for, if any; or why there is none: an impact of the one that was given."""
    reference = mission.fit.reference
    if reference is None:
        return None, []
    try:
        return compared(reference, estimate, amid, forces, noise), []
    except (EventError, CoverageError) as error:
        return None, [f"{place(mission, ('fit', 'reference', 'orbit'))}: not compared with {reference.name}: {error}"]


def _reached(mission: FitMission, trajectory: Trajectory) -> tuple[list[float | None], list[Ended]]:
    """Times, s, of the epoch of the answer and of the others, None where the orbit has ended or none is named; why."""
    asked = (mission.fit.epoch, *mission.fit.epochs)
    epoch, hit = mission.reference_epoch, what_it_hits(trajectory) if any(when is not None for when in asked) else None
    end = trajectory.span_s[1] if hit is None else hit.epoch - epoch
    times: list[float | None] = []
    ended = []
    for when in asked:
        if when is None or when - epoch < end or (hit is None and when - epoch == end):
            times.append(None if when is None else when - epoch)
            continue
        times.append(None)
        status, reason = "not_reached", out_of_steps(trajectory, when.scale)
        if hit is not None:
            status = "after_impact"
            reason = f"the orbit hits {hit.body} on {hit.epoch.iso(when.scale, 0)} and ends there"
        ended.append(Ended(epoch=when, status=status, reason=reason))
    return times, ended


def _predicted(scene: Scene, found: OrbitFit, trajectory: Trajectory, worlds: Worlds) -> list[Prediction]:
    """The predictions asked for, with sigma, ellipse, budget and the curvature behind them."""
    fit = found.general.fit
    asked, missing = foretell(scene, fit, trajectory)
    curved = nonlinearity(scene, fit, asked) if asked else []
    return of_fit(scene, fit, worlds, asked, missing, curved)


def _none_of(found: OrbitFit) -> tuple[Prediction, ...]:
    """The predictions of a fit that has no orbit."""
    reason = f"no orbit is known: {found.verdict.message}"
    name = found.general.fit.estimator.name
    return tuple(unanswered(unknown_orbit(one, reason), None, name) for one in found.mission.predictions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationResiduals:
    """Residuals of one station.

    Attributes
    ----------
    rms_arcsec, mean_arcsec : (2,) of the selected ones, RA* and Dec; nan where none is selected.
    """

    station: str
    n_observations: int
    n_selected: int
    rms_arcsec: Array
    mean_arcsec: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rejected:
    """An observation that was left out.

    Attributes
    ----------
    residual_arcsec, sigma_arcsec, residual_sigma_arcsec : (2,) RA* and Dec: observed minus computed, 1 sigma of the
        record, and of the residual.
    chi : by the covariance of the residual; nan where it has none.
    file, line : where it stands.
    """

    utc: str
    station: str
    residual_arcsec: Array
    sigma_arcsec: Array
    residual_sigma_arcsec: Array
    chi: float
    file: str
    line: int


def residuals_by_station(found: OrbitFit) -> list[StationResiduals]:
    """How many observations, how many selected, root mean square and mean of these; most observations first."""
    general, station = found.general, found.material.astrometry.station
    v = general.residual / ARCSEC
    rows = []
    for code in found.material.astrometry.stations:
        mine = station == code
        kept = mine & general.selected
        some = v[kept] if kept.any() else np.full((1, 2), np.nan)
        rows.append(
            StationResiduals(
                station=code,
                n_observations=int(mine.sum()),
                n_selected=int(kept.sum()),
                rms_arcsec=np.sqrt(np.mean(some**2, axis=0)),
                mean_arcsec=np.mean(some, axis=0),
            )
        )
    return sorted(rows, key=lambda row: -row.n_observations)


def rejected(found: OrbitFit) -> list[Rejected]:
    """Every observation left out, in the order of time."""
    general, records = found.general, found.material.astrometry
    v, spread = general.residual / ARCSEC, general.spread / ARCSEC
    R = found.material.total_noise(general.seen) / ARCSEC**2
    return [
        Rejected(
            utc=str(records.utc[row]),
            station=str(records.station[row]),
            residual_arcsec=v[row],
            sigma_arcsec=np.sqrt(np.diagonal(R[row])),
            residual_sigma_arcsec=spread[row],
            chi=float(np.sqrt(general.chi2[row])),
            file=str(records.path[row]),
            line=int(records.line[row]),
        )
        for row in np.flatnonzero(~general.selected)
    ]


def rms_arcsec(found: OrbitFit) -> tuple[float, float, float]:
    """Root mean square of the selected residuals in RA*, Dec and both, arcsec."""
    v = found.general.residual[found.general.selected] / ARCSEC
    rms = np.sqrt(np.mean(v**2, axis=0))
    return float(rms[0]), float(rms[1]), float(np.sqrt(np.mean(v**2)))
