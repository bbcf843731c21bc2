"""summary.json of a fit: every headline number, units in the key names."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.quantity import M_PER_KM
from nebosvod.estimation.accuracy.formed import matrices
from nebosvod.findings.outlook import answered, bent_words, impact_rows
from nebosvod.fits.answer import Answer, rejected_rows, rms_arcsec, station_rows
from nebosvod.fits.ending import arc_words
from nebosvod.fits.engine import OrbitFit
from nebosvod.fits.orbit import OrbitAt, elements_block
from nebosvod.fits.remarks import force_rows, notices, shared_rows
from nebosvod.results.run_summary import estimator_row, mean_error_notes, physics
from nebosvod.scene.recorded import beyond_tables
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
SCHEMA_VERSION = 1
KIND = "fit"


def summarise(found: Answer) -> dict[str, Any]:
    """Build the summary of one fit."""
    fit, mission = found.fit, found.fit.mission
    row = estimator_row(fit.general.scene, fit.priors, fit.general.fit)
    row |= {"status": str(fit.verdict.status), "message": fit.verdict.message}
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "mission": mission.name,
        "title": mission.title or f"Orbit of {mission.object.name}",
        "object": mission.object.name,
        "reference_epoch_tdb": mission.reference_epoch.iso(),
        "n_observations": len(fit.material),
        "telescopes": list(fit.material.names),
        "fit": fit_block(found),
        "orbit": None if found.orbit is None else orbit_block(found.orbit),
        "further": [*(orbit_block(one) for one in found.further), *found.ended],
        "estimators": [row],
        "budget": list(found.budget),
        "impacts": impact_rows(found.predictions),
        "predictions": list(found.predictions),
        "reference_orbit": None if found.reference is None else dict(found.reference),
        "physics": _physics(fit),
        "warnings": _warnings(found),
    }


def fit_block(found: Answer) -> dict[str, Any]:
    """How the fit ended and how well the observations agree with it."""
    fit, plan = found.fit, found.fit.mission.fit
    material, general, records = fit.material, fit.general, fit.material.astrometry
    estimate = general.fit.estimate
    solved = estimate.solution is not None
    selected = general.selected
    ra, dec, both = rms_arcsec(fit)
    dof = 2 * int(selected.sum()) - len(estimate.names)
    chi2 = float(fit.lean.correction.cost) if not solved else float(estimate.chi2)
    return {
        "status": str(fit.verdict.status),
        "message": fit.verdict.message,
        "cautions": list(fit.verdict.cautions),
        "start": fit.start,
        "first_observation_utc": str(records.utc[0]),
        "last_observation_utc": str(records.utc[-1]),
        "arc_days": float(np.ptp(records.t_s)) / SECONDS_PER_DAY,
        "arc": arc_words(material),
        "n_selected": int(selected.sum()),
        "n_rejected": int((~selected).sum()),
        "left_out": dict(records.left_out),
        "from_utc": None if plan.since is None else plan.since.iso("utc", 0),
        "to_utc": None if plan.until is None else plan.until.iso("utc", 0),
        "rejection_rounds": fit.lean.rounds,
        "rms_ra_arcsec": ra,
        "rms_dec_arcsec": dec,
        "rms_arcsec": both,
        "chi2": chi2,
        "dof": dof,
        "reduced_chi2": chi2 / dof if dof > 0 else None,
        "weights": _rules(material.rule),
        "stations": station_rows(fit),
        "rejected": rejected_rows(fit),
        "shared_errors": shared_rows(fit.found, general),
        "missing_forces": force_rows(fit.found),
        "notices": list(
            dict.fromkeys((*material.notices, *beyond_tables(general.scene), *notices(fit.found, general)))
        ),
    }


def orbit_block(orbit: OrbitAt) -> dict[str, Any]:
    """State and elements at one epoch, each with covariance."""
    variance = np.sum(orbit.S**2, axis=1)
    formal = np.sum(orbit.S_formal**2, axis=1)
    return {
        "epoch_tdb": orbit.epoch.iso(),
        "epoch_jd_tdb": [orbit.epoch.day, orbit.epoch.fraction],
        "state_km_km_s": orbit.state.tolist(),
        **matrices(covariance_km_km_s=orbit.S),
        "factor_km_km_s": orbit.S.tolist(),
        "sigma_km_km_s": np.sqrt(variance).tolist(),
        "sigma_position_km": float(np.sqrt(variance[:3].sum())),
        "sigma_velocity_m_s": float(M_PER_KM * np.sqrt(variance[3:].sum())),
        "sigma_formal_position_km": float(np.sqrt(formal[:3].sum())),
        "elements": elements_block(orbit),
    }


def _rules(rule: npt.NDArray[np.str_]) -> dict[str, int]:
    """How many observations each rule of the weights served, most first."""
    names, counts = np.unique(rule, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {str(names[k]): int(counts[k]) for k in order}


def _physics(fit: OrbitFit) -> dict[str, Any]:
    """As of a run, with what the fit itself left out and found."""
    general = fit.general
    return physics(general.scene) | {
        "excluded": list(general.fit.trajectory.forces.excluded),
        "parameters": dict(general.fit.point.parameters),
    }


def _warnings(found: Answer) -> list[str]:
    """What a reader must know before using the numbers."""
    said: Sequence[str] = found.fit.verdict.cautions
    bent = [
        f"the linear ellipse of {row['name']} misleads: {bent_words(row)}"
        for row in answered(found.predictions)
        if row["nonlinearity"]["misleads"]
    ]
    unknown = [
        f"how far the linear ellipse of {row['name']} holds is not known: {row['nonlinearity']['reason']}"
        for row in answered(found.predictions)
        if row["nonlinearity"]["reason"]
    ]
    fit = found.fit.general.fit
    ended = [f"no orbit at {row['epoch_tdb']}: {row['reason']}" for row in found.ended]
    return [*said, *found.cautions, *ended, *bent, *unknown, *fit.estimate.notes, *mean_error_notes(fit)]
