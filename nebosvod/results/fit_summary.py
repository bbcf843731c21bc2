"""summary.json of a fit: every headline number, units in the key names."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.quantity import M_PER_KM
from nebosvod.estimation import lower_factor
from nebosvod.estimation.accuracy.formed import matrices
from nebosvod.findings.impacts import impacts_of
from nebosvod.findings.prediction import existing
from nebosvod.fits.ahead import WITHIN_AU, Ahead
from nebosvod.fits.answer import Answer, Ended, Rejected, StationResiduals, rejected, residuals_by_station, rms_arcsec
from nebosvod.fits.ending import arc_words
from nebosvod.fits.engine import OrbitFit
from nebosvod.fits.general import General
from nebosvod.fits.leading import Led
from nebosvod.fits.missing_force import MissingForce
from nebosvod.fits.orbit import ELEMENTS, KEPLERIAN, Comparison, OrbitAt
from nebosvod.fits.photometry import SLOPE
from nebosvod.fits.remarks import UNITS, notices, told
from nebosvod.fits.shared_errors import SharedError
from nebosvod.fits.suggestion import entry, flow
from nebosvod.results import prediction_rows, rows
from nebosvod.results.approaches_folder import row_of as approach_row
from nebosvod.results.diagnosis_rows import diagnosis_block
from nebosvod.results.outlook import bent_words
from nebosvod.results.run_summary import estimator_row, mean_error_notes, physics
from nebosvod.scene.recorded import beyond_tables
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

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
        "further": [*(orbit_block(one) for one in found.further), *(ended(one) for one in found.ended)],
        "estimators": [row],
        "budget": [rows.state_share(one) for one in found.budget],
        "impacts": [prediction_rows.impact(one) for one in impacts_of(found.predictions)],
        "predictions": [prediction_rows.prediction(one) for one in found.predictions],
        "reference_orbit": None if found.reference is None else reference_orbit(found.reference),
        "ahead": None if found.ahead is None else ahead_block(found.ahead),
        "physics": _physics(fit),
        "warnings": _warnings(found),
        **diagnosis_block(found.diagnosis, mission.reference_epoch),
    }


def ahead_block(ahead: Ahead) -> dict[str, Any]:
    """What comes after the last observation."""
    H = ahead.magnitude
    return {
        "from_utc": ahead.first.iso("utc", 0),
        "to_utc": ahead.last.iso("utc", 0),
        "within_au": WITHIN_AU,
        "approaches": [approach_row(one) for one in ahead.approaches],
        "in_reach": [
            {
                "body": one.approach.body,
                "epoch_utc": one.approach.epoch.iso("utc"),
                "sigmas": one.sigmas,
                "impact_probability_linear": one.approach.probability,
            }
            for one in ahead.in_reach
        ],
        "reason": ahead.reason or None,
        "period_d": ahead.period_d,
        "sigma_period_d": ahead.sigma_period_d,
        "moid_earth_au": ahead.moid_au,
        "sigma_moid_earth_au": ahead.sigma_moid_au,
        "magnitude": None if H is None else {"H": H.H, "G": SLOPE, "scatter_mag": H.scatter, "n": H.count},
    }


def fit_block(found: Answer) -> dict[str, Any]:
    """How the fit ended and how well the observations agree with it."""
    fit, plan = found.fit, found.fit.mission.fit
    material, general, records = fit.material, fit.general, fit.material.astrometry
    estimate = general.fit.estimate
    solved = estimate.solution is not None
    selected = general.selected
    ra, dec, both = rms_arcsec(fit)
    dof = estimate.dof  # a parameter with a prior brings its own row
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
        "stations": [station(one) for one in residuals_by_station(fit)],
        "rejected": [rejected_observation(one) for one in rejected(fit)],
        "shared_errors": [shared_error(one, fit.found, general) for one in fit.found.errors],
        "missing_forces": [missing_force(one) for one in fit.found.forces],
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
        "elements": elements(orbit),
    }


def elements(orbit: OrbitAt) -> rows.Row | None:
    """Elements with sigmas; None where they are undefined."""
    cometary, keplerian = orbit.cometary(), orbit.keplerian()
    if cometary is None or keplerian is None:
        return None
    block: rows.Row = {"frame": "ecliptic of J2000, heliocentric"}
    for names, (values, factor) in ((ELEMENTS, cometary), (KEPLERIAN, keplerian)):
        sigma = np.linalg.norm(factor, axis=1)
        block |= {name: {"value": float(v), "sigma": float(s)} for name, v, s in zip(names, values, sigma)}
    block["names"] = list(ELEMENTS)
    S = lower_factor(cometary[1])
    return block | matrices(covariance=S) | {"factor": S.tolist()}


def ended(found: Ended) -> rows.Row:
    """An entry of `further` for an epoch at which the orbit has ended."""
    return {"epoch_tdb": found.epoch.iso(), "status": found.status, "reason": found.reason}


def reference_orbit(found: Comparison) -> rows.Row:
    """The `reference_orbit` block."""
    return {
        "name": found.name,
        "epoch_tdb": found.epoch.iso(),
        "difference_km_km_s": found.difference.tolist(),
        "difference_position_km": float(np.linalg.norm(found.difference[:3])),
        "chi2": found.chi2,
        "dof": found.dof,
        "sigmas": found.sigmas.tolist(),
        "chi2_by_reference": found.chi2_by_reference,
        "sigma_ratio": rows.listed(found.sigma_ratio),
    }


def station(found: StationResiduals) -> rows.Row:
    """One entry of `stations`."""
    return {
        "station": found.station,
        "n_observations": found.n_observations,
        "n_selected": found.n_selected,
        **_pair("rms", found.rms_arcsec),
        **_pair("mean", found.mean_arcsec),
    }


def rejected_observation(found: Rejected) -> rows.Row:
    """One entry of `rejected`."""
    return {
        "utc": found.utc,
        "station": found.station,
        **_pair("residual", found.residual_arcsec),
        **_pair("sigma", found.sigma_arcsec),
        **_pair("residual_sigma", found.residual_sigma_arcsec),
        "chi": rows.number(found.chi),
        "file": found.file,
        "line": found.line,
    }


def _pair(what: str, arcsec: Array) -> rows.Row:
    """Numbers (2,) of RA* and Dec."""
    return {f"{what}_{axis}_arcsec": rows.number(value) for axis, value in zip(("ra", "dec"), arcsec)}


def shared_error(found: SharedError, led: Led, general: General) -> rows.Row:
    """One entry of `shared_errors`."""
    return {
        "station": found.station,
        "n_observations": len(found.rows),
        "kind": found.kind,
        "sigmas": {kind: float(value) for kind, value in found.significance.items()},
        "sigmas_corrected": float(found.corrected),
        "n_tests": found.tried,
        "estimate": [float(value) for value in found.estimate],
        "sigma": [float(value) for value in found.sigma],
        "unit": UNITS[found.kind],
        "rms_ra_arcsec": float(found.size_rad[0] / ARCSEC),
        "rms_dec_arcsec": float(found.size_rad[1] / ARCSEC),
        "told": told(found, led.material),
        "settings": flow(entry(found, general.scene.epoch)),
    }


def missing_force(found: MissingForce) -> rows.Row:
    """One entry of `missing_forces`."""
    return {
        "name": found.label,
        "sigmas_before": float(found.before),
        "sigmas_after": float(found.after),
        "estimate_au_d2": float(found.estimate),
        "sigma_au_d2": float(found.sigma),
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
    bent = [(one.request.name, one.nonlinearity) for one in existing(found.predictions)]
    misleading = [
        f"the linear ellipse of {name} misleads: {bent_words(one.measure, one.shortest_chord_sigma)}"
        for name, one in bent
        if one.misleads
    ]
    unknown = [
        f"how far the linear ellipse of {name} holds is not known: {one.reason}" for name, one in bent if one.reason
    ]
    fit = found.fit.general.fit
    over = [f"no orbit at {one.epoch.iso()}: {one.reason}" for one in found.ended]
    cautions = (*found.fit.verdict.cautions, *found.cautions)
    return [*cautions, *over, *misleading, *unknown, *fit.estimate.notes, *mean_error_notes(fit)]
