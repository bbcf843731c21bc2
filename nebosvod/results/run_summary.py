"""summary.json: every headline number of a run, units in the key names."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import SOLAR_IRRADIANCE_W_M2
from nebosvod.engine.assembly import nuisance_treatment
from nebosvod.engine.fitting import Fit
from nebosvod.engine.montecarlo import StateNees
from nebosvod.engine.quantity import M_PER_KM, SIGMAS
from nebosvod.estimation.accuracy import ellipse
from nebosvod.estimation.accuracy.formed import matrices
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.findings.assessment import Findings
from nebosvod.findings.blame import LARGE
from nebosvod.findings.impacts import impacts_of
from nebosvod.findings.kinds import kind_of
from nebosvod.findings.prediction import existing
from nebosvod.mission.parameter import MAGNITUDE
from nebosvod.observation import Telescope
from nebosvod.observation.earth.sites import GroundSite
from nebosvod.results import prediction_rows, rows
from nebosvod.results.diagnosis_rows import diagnosis_block
from nebosvod.results.outlook import bent_words
from nebosvod.results.what_if_rows import what_if_block
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.scene import PlannedScene, Scene
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
SCHEMA_VERSION = 1
NAMED = 2  # estimators named in a warning about several
UNDRAWN = "no error was drawn: what is measured is what the reference orbit shows"


def summarise(
    scene: PlannedScene,
    priors: PriorTable,
    fits: Sequence[Fit],
    findings: Findings,
    trials: Mapping[str, StateNees],
    *,
    drawn: bool = True,
) -> dict[str, Any]:
    """Build the summary of a run.

    Parameters
    ----------
    trials : what Monte Carlo says of each estimator, empty without.
    drawn : whether errors were drawn into the measurements.
    """
    mission = scene.mission
    return {
        "schema_version": SCHEMA_VERSION,
        "mission": mission.name,
        "title": mission.title or mission.name,
        "object": mission.object.name,
        "reference_epoch_tdb": scene.epoch.iso(),
        "time_scale": scene.epoch.scale,
        "n_observations": int(sum(seen.visible.sum() for seen in scene.visibilities)),
        "telescopes": [telescope.name for telescope in scene.telescopes],
        "reference": {"position_km": scene.state[:3].tolist(), "velocity_km_s": scene.state[3:].tolist()},
        "visibility": visibility_rows(scene),
        "physics": physics(scene),
        "assumptions": [*_assumptions(scene), *([] if drawn else [UNDRAWN])],
        "estimators": [estimator_row(scene, priors, fit) for fit in fits],
        "budget": [rows.state_share(one) for one in findings.budget],
        **({"shifts": [rows.shift(one) for one in findings.shifts]} if findings.shifts else {}),
        **({} if findings.inside is None else {"inside": rows.inside(findings.inside)}),
        "noise_to_nuisance": rows.noise_to_nuisance(findings.noise_to_nuisance, findings.required),
        "impacts": [prediction_rows.impact(one) for one in impacts_of(findings.predictions)],
        "predictions": [prediction_rows.prediction(one) for one in findings.predictions],
        "curves": [rows.curve(one) for one in findings.curves],
        "accuracy_comparison": rows.accuracy_comparison(findings.accuracies),
        "warnings": [*_unknown_prior(priors), *_warnings(scene, fits, findings)],
        **what_if_block(findings.what_if, scene.mission),
        **diagnosis_block(findings.diagnosis, scene.epoch),
        **rows.consistency_block(trials),
    }


def visibility_rows(scene: PlannedScene) -> list[dict[str, Any]]:
    """What each telescope could see and which limit removed the rest (limits overlap)."""
    return [
        {
            "telescope": telescope.name,
            "candidates": int(seen.t_s.size),
            "visible": int(np.count_nonzero(seen.visible)),
            "removed": {limit: count for limit, count in seen.counts.items() if count},
            "limits_deg": _limits_deg(telescope),
        }
        for telescope, seen in zip(scene.telescopes, scene.visibilities)
    ]


def _limits_deg(telescope: Telescope) -> dict[str, float]:
    """The angles a telescope keeps from Sun, Earth and Moon, and of a site the heights; those that it has."""
    angles = {
        "sun": telescope.exclusion_sun_rad, "sun_largest": telescope.largest_sun_rad,
        "earth": telescope.exclusion_earth_rad, "moon": telescope.exclusion_moon_rad,
        "altitude": telescope.altitude_rad, "sun_altitude": telescope.sun_altitude_rad,
    }  # fmt: skip
    return {name: round(math.degrees(angle), 9) for name, angle in angles.items() if angle is not None}


def estimator_row(scene: Scene, priors: PriorTable, fit: Fit) -> dict[str, Any]:
    """One entry of `estimators`; numbers are null where the problem is not observable."""
    estimate, mission = fit.estimate, scene.mission
    treatment = {p.group: mission.treatment(fit.estimator, p.group) for p in mission.free_parameters}
    treatment |= {
        nuisance.name: nuisance_treatment(scene, fit.estimator, nuisance.name) for nuisance in scene.nuisances
    }
    row: dict[str, Any] = {
        "name": fit.estimator.name,
        "method": fit.estimator.method,
        "treatment": treatment,
        "status": str(fit.status),
        "message": fit.message,
        "iterations": fit.iterations,
        "dof": estimate.dof,
        "condition_number": rows.number(estimate.condition_number),
        "n_estimated": len(estimate.names),
        "rank": estimate.rank,
        "weak_direction": {} if estimate.solution is not None else dict(estimate.weak_direction),
    }
    if estimate.solution is None:
        held = ("covariance_km_km_s", "covariance_formal_km_km_s", "factor_km_km_s")
        empty = ("chi2", "state_km_km_s", *held, "mean_error_km_km_s", "max_deviation_km_km_s")
        sigmas = ("sigma_position_km", "sigma_velocity_m_s", "sigma_formal_position_km", "sigma_formal_velocity_m_s")
        lost = {"covariance_reason": estimate.message, "factor_formal_km_km_s": None}
        return row | dict.fromkeys((*empty, *sigmas)) | lost | {"parameters": {}}
    if fit.filtered is not None:
        row["innovations"] = rows.innovations(fit.filtered)
    index = [estimate.names.index(name) for name in STATE_NAMES]
    formal = estimate.S_formal[index] @ estimate.S_formal[index].T
    true = estimate.covariance(STATE_NAMES)
    return row | {
        "chi2": estimate.chi2,
        "state_km_km_s": fit.point.state.tolist(),
        **matrices(covariance_km_km_s=estimate.factor(STATE_NAMES), covariance_formal_km_km_s=estimate.S_formal[index]),
        "factor_km_km_s": estimate.factor(STATE_NAMES).tolist(),
        "factor_formal_km_km_s": lower_factor(estimate.S_formal[index]).tolist(),
        **_mean_error(fit, np.sqrt(np.diag(true))),
        **_sigmas("sigma", true),
        **_sigmas("sigma_formal", formal),
        "parameters": _parameters(scene, priors, fit),
    }


def _mean_error(fit: Fit, sigma: Array) -> dict[str, Any]:
    """Mean of estimated minus true state, what each source left out adds to it, and |mean| + 3 sigma."""
    mean = fit.mean_errors.shift(fit.estimate, STATE_NAMES)
    parts = {source: part.tolist() for source, part in fit.mean_errors.by_source(fit.estimate, STATE_NAMES).items()}
    return {
        "mean_error_km_km_s": mean.tolist(),
        "mean_error_by_source_km_km_s": parts,
        "max_deviation_km_km_s": ellipse.maximum_deviation(mean, sigma, SIGMAS).tolist(),
    }


def _sigmas(prefix: str, covariance: Array) -> dict[str, float]:
    """Root traces of the position and velocity blocks."""
    return {
        f"{prefix}_position_km": float(np.sqrt(np.trace(covariance[:3, :3]))),
        f"{prefix}_velocity_m_s": float(M_PER_KM * np.sqrt(np.trace(covariance[3:, 3:]))),
    }


def _parameters(scene: Scene, priors: PriorTable, fit: Fit) -> dict[str, dict[str, float | None]]:
    """Prior and posterior sigma and value of everything beside the state; units of nuisances in the key names."""
    values = fit.point.values
    found: dict[str, dict[str, float | None]] = {}
    units = {name: parameter_unit(scene, term.name, name) for term in fit.seen.terms for name in term.names}
    noise = process_noise_of(scene.nuisances)
    accelerations = () if noise is None else noise.names
    for name in (*fit.estimate.names, *fit.estimate.left_out):
        if name in STATE_NAMES or name in accelerations:
            continue
        before = fit.prior_sigmas.get(name, priors.sigma(name))
        unit, scale = units.get(name, ("", 1.0))
        found[f"{name}_{unit}" if unit else name] = {
            "prior_sigma": None if before is None else before * scale,
            "sigma": fit.estimate.sigma(name) * scale,
            "estimate": values[name] * scale,
            "mean_error": float(fit.mean_errors.shift(fit.estimate, (name,))[0]) * scale,
        }
    return found


def parameter_unit(scene: Scene, source: str, name: str) -> tuple[str, float]:
    """Unit of a parameter of a source in the summary, and the factor from the internal one."""
    group = scene.sources[source].group
    if group == "bias":
        return ("arcsec_d", SECONDS_PER_DAY / ARCSEC) if name.endswith(" drift") else ("arcsec", 1.0 / ARCSEC)
    if group == "position":
        return ("km_s", 1.0) if name.endswith(" rate") else ("km", 1.0)
    return ("s", 1.0) if group == "timing" else ("", 1.0)


def physics(scene: Scene) -> dict[str, Any]:
    """The forces of a mission, as the summary has them."""
    mission = scene.mission
    values = dict(parameter.quantity for parameter in mission.parameters)
    sphere = ("radius_m", "mass_kg", "albedo", "thermal_emission")
    radiation: Any = False
    if mission.object.radiation_parameters:
        radiation = {name: values[name] for name in sphere} | {"solar_irradiance_w_m2": SOLAR_IRRADIANCE_W_M2}
    magnitude = mission.object.magnitude
    accelerations = {name: value for name, value in values.items() if name not in (*sphere, MAGNITUDE)}
    facts = mission.force_model.facts
    shadow, excluded = facts.pop("earth_shadow"), list(facts.pop("excluded"))
    return {
        "ephemeris": scene.ephemeris.source,
        "asteroids": facts.pop("asteroids"),
        "asteroids_excluded": excluded,
        **facts,
        "radiation_pressure": radiation,
        **({"earth_shadow": shadow} if radiation else {}),
        "nongrav_au_d2": accelerations,
        **({"nongrav_law": mission.object.nongrav_law} if accelerations else {}),
        **({"magnitude": {"H": magnitude.H, "G": magnitude.G}} if magnitude is not None else {}),
    }


def _assumptions(scene: Scene) -> list[str]:
    """What the numbers rest on, in words."""
    said = list(scene.mission.object.statements)
    if scene.mission.object.has_radiation:
        said.append("albedo in the radiation pressure is the Bond albedo")
    said.append("errors of different sources are independent and Gaussian; measurements are simulated")
    said.append("UTC after the last known leap second keeps TAI - UTC = 37 s; geostationary telescopes use UT1 = UTC")
    return said


def _unknown_prior(priors: PriorTable) -> list[str]:
    """That of a prior as wide as the orbit itself the mean is drawn and not the truth."""
    words = "the prior orbit is as wide as the orbit itself: its mean is off, and the simulated truth the nominal orbit"
    return [words] if priors.says_nothing else []


def _warnings(scene: PlannedScene, fits: Sequence[Fit], findings: Findings) -> list[str]:
    """What a reader must know before trusting the numbers."""
    said = list(scene.mission.notices)
    if any(fit.problem.n > LARGE for fit in fits):
        said.append(
            f"more than {LARGE:,} measurements: re-optimised remedies, required positions, curves and the worst "
            "correlation are left out"
        )
    for row in existing(findings.predictions):
        name, bent, cloud = row.request.name, row.nonlinearity, None if row.drawn is None else row.drawn.cloud
        if bent.misleads:
            words = bent_words(bent.measure, bent.shortest_chord_sigma)
            said.append(f"{row.estimator}: the linear ellipse of {name} misleads: {words}")
        if cloud is not None and cloud.against.misleads:
            said.append(f"{row.estimator}: {name}, by orbits drawn and propagated: {cloud.statement}")
    for telescope, seen in zip(scene.telescopes, scene.visibilities):
        if isinstance(telescope.spacecraft, GroundSite):
            said += [f"{telescope.name}: {text}" for text in telescope.spacecraft.notices(scene.epoch, seen.t_s)]
        if not seen.visible.any():
            said.append(f"{telescope.name} never sees the object: {seen.explain()}")
    for fit in fits:
        if str(fit.status) != "converged":
            said.append(f"{fit.estimator.name}: {fit.message}")
        said += [f"{fit.estimator.name}: {note}" for note in fit.estimate.notes]
        said += [f"{fit.estimator.name}: {note}" for note in mean_error_notes(fit)]
    return said + fixed_notes(scene, fits)


def fixed_notes(scene: PlannedScene, fits: Sequence[Fit]) -> list[str]:
    """One sentence on the estimators that hold fixed what the mission calls uncertain; none where none does."""
    held = {fit.estimator.name: kinds for fit in fits if (kinds := _held(scene, fit))}
    if not held:
        return []
    every = list(dict.fromkeys(kind for kinds in held.values() for kind in kinds))
    always = [kind for kind in every if all(kind in kinds for kinds in held.values())]
    sometimes = [kind for kind in every if kind not in always]
    what = ", ".join(always) + (f"; some of them {', '.join(sometimes)}" if always and sometimes else "")
    if len(held) == 1:
        return [f"{next(iter(held))} holds fixed {what}: its accuracy leaves their errors out"]
    names = ", ".join([*held][:NAMED]) + (", ..." if len(held) > NAMED else "")
    return [
        f"{len(held)} estimators ({names}) hold fixed {what or 'one or another of ' + ', '.join(sometimes)}: their "
        "accuracy leaves those errors out"
    ]


def _held(scene: PlannedScene, fit: Fit) -> list[str]:
    """Kinds of what is uncertain by the mission and fixed by an estimator."""
    mission, estimator = scene.mission, fit.estimator
    kinds = [
        parameter.group
        for parameter in mission.free_parameters
        if parameter.treatment != "fixed" and mission.treatment(estimator, parameter.group) == "fixed"
    ]
    kinds += [
        kind_of(source.name, [telescope.name for telescope in scene.telescopes])
        for source in scene.sources.values()
        if source.error.treatment != "fixed" and mission.source_treatment(estimator, source) == "fixed"
    ]
    return list(dict.fromkeys(kinds))


def mean_error_notes(fit: Fit) -> list[str]:
    """What means of errors left out do to the orbit, in words; empty where there are none."""
    if not fit.mean_errors or fit.estimate.solution is None:
        return []
    behind = list(fit.mean_errors.by_source(fit.estimate, STATE_NAMES))
    x, y, z = fit.mean_errors.shift(fit.estimate, STATE_NAMES)[:3]
    return [
        f"{', '.join(behind)} with a mean error: the estimate is off on average by ({x:.3g}, {y:.3g}, "
        f"{z:.3g}) km from the truth at the reference epoch; sigmas are about this mean, largest deviations hold it"
    ]
