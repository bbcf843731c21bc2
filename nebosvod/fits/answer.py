"""What a fit answers: the orbit at the epochs asked for, predictions, the comparison, residuals by record and station.

OrbitFit (arrays) -> Answer (numbers with names) -> summary, tables, report, terminal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Trajectory
from nebosvod.dynamics.impact import what_it_hits
from nebosvod.engine.quantity import Quantity, out_of_steps, prediction_row
from nebosvod.errors import CoverageError, EventError
from nebosvod.estimation import Estimate
from nebosvod.findings.blame import Worlds, prediction_rows, state_rows
from nebosvod.findings.foretold import foretell, in_order, unanswered_row, unknown_orbit
from nebosvod.findings.nonlinearity import nonlinearity
from nebosvod.fits import usual_force
from nebosvod.fits.engine import OrbitFit
from nebosvod.fits.orbit import OrbitAt, compared, orbit_at
from nebosvod.mission import FitMission
from nebosvod.mission.reading.places import place
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.recorded import long_span, long_trajectory
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """Everything a fit says.

    Attributes
    ----------
    fit : what it was made from.
    trajectory : the fitted orbit over all that is asked for; None where the fit has no covariance.
    orbit : state and elements at the epoch of the answer; further : at the other epochs asked for.
    budget, predictions, reference : rows for the summary.
    ended : rows for the epochs asked for at which the orbit has ended, status and reason.
    """

    fit: OrbitFit
    trajectory: Trajectory | None
    orbit: OrbitAt | None
    amid: OrbitAt | None
    further: tuple[OrbitAt, ...]
    budget: Rows
    predictions: Rows
    quantities: tuple[Quantity, ...]
    ended: Rows
    reference: Mapping[str, Any] | None
    cautions: tuple[str, ...]


def answer(found: OrbitFit) -> Answer:
    """Evaluate a fit where its file asks for it.

    Raises
    ------
    EventError, CoverageError
        If the orbit hits a body, or the ephemeris ends, before the last observation.
    """
    fit, mission = found.general.fit, found.mission
    estimate = fit.estimate
    nothing = Answer(
        fit=found, trajectory=None, orbit=None, amid=None, further=(), budget=(), predictions=_none_of(found),
        quantities=(), ended=(), reference=None, cautions=(),
    )  # fmt: skip
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
    scene = replace(found.general.scene, trajectory=trajectory, span_s=span, needed_s=needed, forces=forces)
    worlds = Worlds(now=estimate, then={})
    amid = orbit_at(estimate, trajectory, 0.0)
    asked, rows = _predicted(scene, found, trajectory, worlds)
    (first, *later), ended = _reached(mission, trajectory)
    reference, without = _comparison(mission, estimate, amid, forces)
    return Answer(
        fit=found,
        trajectory=trajectory,
        orbit=orbit_at(estimate, trajectory, first) if first is not None else amid,
        amid=amid,
        further=tuple(orbit_at(estimate, trajectory, t) for t in later if t is not None),
        ended=ended,
        budget=state_rows(scene, fit, worlds),
        predictions=rows,
        quantities=asked,
        reference=reference,
        cautions=(*usual_force.cautions(found, scene, asked, rows), *without),
    )


def _comparison(
    mission: FitMission, estimate: Estimate, amid: OrbitAt, forces: ForceModel
) -> tuple[dict[str, Any] | None, list[str]]:
    """The comparison with the orbit asked for, if any; or why there is none: an impact of the one that was given."""
    reference = mission.fit.reference
    if reference is None:
        return None, []
    try:
        return compared(reference, estimate, amid, forces), []
    except (EventError, CoverageError) as error:
        return None, [f"{place(mission, ('fit', 'reference', 'orbit'))}: not compared with {reference.name}: {error}"]


def _reached(mission: FitMission, trajectory: Trajectory) -> tuple[list[float | None], list[dict[str, Any]]]:
    """Times, s, of the epoch of the answer and of the others, None where the orbit has ended or none is named; why."""
    asked = (mission.fit.epoch, *mission.fit.epochs)
    epoch, hit = mission.reference_epoch, what_it_hits(trajectory) if any(when is not None for when in asked) else None
    end = trajectory.span_s[1] if hit is None else hit.epoch - epoch
    times: list[float | None] = []
    rows = []
    for when in asked:
        if when is None or when - epoch < end or (hit is None and when - epoch == end):
            times.append(None if when is None else when - epoch)
            continue
        times.append(None)
        status, reason = "not_reached", out_of_steps(trajectory, when.scale)
        if hit is not None:
            status, reason = (
                "after_impact",
                f"the orbit hits {hit.body} on {hit.epoch.iso(when.scale, 0)} and ends there",
            )
        rows.append({"epoch_tdb": when.iso(), "status": status, "reason": reason})
    return times, rows


def _predicted(
    scene: Scene, found: OrbitFit, trajectory: Trajectory, worlds: Worlds
) -> tuple[tuple[Quantity, ...], list[dict[str, Any]]]:
    """The predictions asked for, and their rows with sigma, ellipse, budget and the curvature behind them."""
    mission, fit = found.mission, found.general.fit
    asked, missing = foretell(scene, fit, trajectory)
    curved = nonlinearity(scene, fit, asked) if asked else []
    rows = [
        prediction_row(
            one, fit.estimate, fit.estimator.name, prediction_rows(scene, worlds, one), bend, fit.mean_errors
        )
        for one, bend in zip(asked, curved)
    ]
    rows += [unanswered_row(one, fit.estimate, fit.estimator.name, fit.mean_errors) for one in missing]
    return tuple(asked), in_order(rows, mission.predictions)


def _none_of(found: OrbitFit) -> list[dict[str, Any]]:
    """The predictions of a fit that has no orbit."""
    reason = f"no orbit is known: {found.verdict.message}"
    name = found.general.fit.estimator.name
    return [unanswered_row(unknown_orbit(one, reason), None, name) for one in found.mission.predictions]


def station_rows(found: OrbitFit) -> list[dict[str, Any]]:
    """Residuals by station: how many observations, how many selected, root mean square and mean of the selected."""
    general, station = found.general, found.material.astrometry.station
    v = general.residual / ARCSEC
    rows = []
    for code in found.material.astrometry.stations:
        mine = station == code
        kept = mine & general.selected
        some = v[kept] if kept.any() else np.full((1, 2), np.nan)
        rms, mean = np.sqrt(np.mean(some**2, axis=0)), np.mean(some, axis=0)
        rows.append(
            {
                "station": code,
                "n_observations": int(mine.sum()),
                "n_selected": int(kept.sum()),
                "rms_ra_arcsec": _number(rms[0]),
                "rms_dec_arcsec": _number(rms[1]),
                "mean_ra_arcsec": _number(mean[0]),
                "mean_dec_arcsec": _number(mean[1]),
            }
        )
    return sorted(rows, key=lambda row: -row["n_observations"])


def rejected_rows(found: OrbitFit) -> list[dict[str, Any]]:
    """Every observation left out, in the order of time: residual, sigma of the record and of the residual, chi."""
    general, records = found.general, found.material.astrometry
    v, spread = general.residual / ARCSEC, general.spread / ARCSEC
    R = found.material.total_noise(general.seen) / ARCSEC**2
    return [
        {
            "utc": str(records.utc[row]),
            "station": str(records.station[row]),
            "residual_ra_arcsec": float(v[row, 0]),
            "residual_dec_arcsec": float(v[row, 1]),
            "sigma_ra_arcsec": float(np.sqrt(R[row, 0, 0])),
            "sigma_dec_arcsec": float(np.sqrt(R[row, 1, 1])),
            "residual_sigma_ra_arcsec": float(spread[row, 0]),
            "residual_sigma_dec_arcsec": float(spread[row, 1]),
            "chi": _number(np.sqrt(general.chi2[row])),
            "file": str(records.path[row]),
            "line": int(records.line[row]),
        }
        for row in np.flatnonzero(~general.selected)
    ]


def parameter_sigmas(found: OrbitFit) -> dict[str, tuple[float, float]]:
    """Value and sigma of every estimated quantity beside the state, in the units of its name."""
    fit = found.general.fit
    if fit.estimate.solution is None:
        return {}
    values = fit.point.values
    return {name: (values[name], fit.estimate.sigma(name)) for name in fit.estimate.names if name not in STATE_NAMES}


def rms_arcsec(found: OrbitFit) -> tuple[float, float, float]:
    """Root mean square of the selected residuals in RA*, Dec and both, arcsec."""
    v = found.general.residual[found.general.selected] / ARCSEC
    rms = np.sqrt(np.mean(v**2, axis=0))
    return float(rms[0]), float(rms[1]), float(np.sqrt(np.mean(v**2)))


def _number(value: float) -> float | None:
    """The number, or None where there is none."""
    return float(value) if np.isfinite(value) else None
