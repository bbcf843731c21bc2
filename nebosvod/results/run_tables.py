"""The arrays and tables of a run folder."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.findings.assessment import Findings
from nebosvod.findings.blame import REMEDIES, UNKNOWN, QuantitySigmas, StateShare
from nebosvod.findings.prediction import Answered, existing
from nebosvod.mission.slugs import array_name
from nebosvod.observation import Common, residual
from nebosvod.results import rows
from nebosvod.results.filter_tables import filter_arrays, filter_table
from nebosvod.results.orbit_arrays import orbit_arrays
from nebosvod.results.result import Table
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import PlannedScene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Arrays = dict[str, npt.NDArray[Any]]
TRACK_POINTS = 241


def all_arrays(scene: PlannedScene, nominal: View, fits: Sequence[Fit], psi: Array) -> Arrays:
    """Everything in arrays.npz; the computed rows are those of the nominal orbit."""
    seen = nominal.observation
    at = nominal.trajectory.at(seen.t_s)
    biases = [term for term in nominal.terms if isinstance(term, Common) and scene.sources[term.name].group == "bias"]
    sun = scene.ephemeris.position_km("sun", scene.epoch, seen.t_s)
    track_t_s = np.linspace(seen.t_s[0], seen.t_s[-1], TRACK_POINTS)
    arrays: Arrays = {
        "epoch_s": seen.t_s,
        "telescope_index": seen.telescope_index,
        "telescope_names": np.array([telescope.name for telescope in seen.telescopes]),
        "state": at.state,
        "Phi": at.Phi,
        "zeta": at.zeta,
        "reference_epoch_jd_tdb": np.array([scene.epoch.day, scene.epoch.fraction]),
        "parameter_names": np.array(seen.parameter_names, dtype=np.str_),
        "psi": psi,
        "residual": residual(psi, seen.psi),
        "R": seen.noise,
        "sigma_measurement": np.sqrt(np.einsum("nii->ni", seen.noise)),
        "H_x": seen.H_x,
        "H_z": seen.H_z,
        "H_c": seen.H_c,
        "H_b": np.concatenate([np.zeros((seen.t_s.size, 2, 0)), *(term.H for term in biases)], axis=2),
        "bias_names": np.array([name for term in biases for name in term.names], dtype=np.str_),
        "distance_km": seen.distance_km,
        "telescope_position_km": seen.telescope_state[:, :3] - sun,
        "earth_position_km": scene.ephemeris.position_km("earth", scene.epoch, seen.t_s) - sun,
        "object_track_t_s": track_t_s,
        "object_track_km": nominal.trajectory.at(track_t_s).state[:, :3],
    }
    for one in fits:
        if one.estimate.solution is not None:
            arrays |= _estimator_arrays(one) | filter_arrays(scene, one)
            arrays |= orbit_arrays(scene.mission, one.estimate, array_name(one.estimator.name))
    return arrays


def _estimator_arrays(one: Fit) -> Arrays:
    """Factor, names, residuals after the fit and sigma history of one estimator."""
    name = array_name(one.estimator.name)
    arrays: Arrays = {
        f"factor_{name}": one.estimate.S_true,
        f"names_{name}": np.array(one.estimate.names),
        f"residual_after_{name}": one.estimate.residual_after,
    }
    history = one.history
    if history is not None:
        place = [history.names.index(axis) for axis in STATE_NAMES[:3]]
        arrays[f"history_t_s_{name}"] = one.observation.t_s
        arrays[f"history_sigma_formal_position_km_{name}"] = _root_sum(history.sigma_formal[:, place])
        if history.sigma is not None:
            arrays[f"history_sigma_position_km_{name}"] = _root_sum(history.sigma[:, place])
    return arrays


def _root_sum(sigma: Array) -> Array:
    """Root sum of squares along the axes; infinite while not determined."""
    total: Array = np.sqrt(np.sum(sigma**2, axis=1))
    return total


def all_tables(
    scene: PlannedScene, nominal: View, fits: Sequence[Fit], psi: Array, findings: Findings
) -> dict[str, Table]:
    """The tables of a run, for people and spreadsheets."""
    found = [one for one in fits if one.estimate.solution is not None]
    tables = {
        "measurements": _measurements(scene, nominal, psi),
        "residuals": _residuals(nominal, found, psi),
        "visibility": visibility_table(scene),
    }
    if found:
        tables["budget"] = _rows_table(
            [_flat_budget(share) for share in findings.budget],
            BUDGET_UNITS,
            "What each source contributes to the state at the reference epoch, squares of the sigmas add up; and the "
            "sigma if it vanished or halved, with the gain as it is and re-optimised",
        )
    for one in found:
        if one.history is not None:
            tables[f"sigma_history_{array_name(one.estimator.name)}"] = _history(one)
        if one.filtered is not None:
            tables[f"filter_{array_name(one.estimator.name)}"] = filter_table(scene, one, one.filtered)
    predictions = existing(findings.predictions)
    if predictions:
        tables["predictions"] = _rows_table(
            [_flat(one) for one in predictions], {}, "Predicted quantities, one component a row, 1 sigma"
        )
        tables["prediction_budget"] = _rows_table(
            [line for one in predictions for line in _flat_sources(one)],
            {},
            "What each source contributes to each component of a prediction, and the sigma if its error vanished (of a "
            "prior: known exactly) or halved, or if a prior were missing (unknown)",
        )
    return tables


def _measurements(scene: PlannedScene, nominal: View, psi: Array) -> Table:
    seen = nominal.observation
    names = np.array([telescope.name for telescope in seen.telescopes])
    sigma = np.sqrt(np.einsum("nii->ni", seen.noise)) / ARCSEC
    return Table(
        columns={
            "epoch_tdb": np.array([(scene.epoch + t).iso() for t in seen.t_s]),
            "t": seen.t_s,
            "telescope": names[seen.telescope_index],
            "ra": np.degrees(psi[:, 0]),
            "dec": np.degrees(psi[:, 1]),
            "sigma_ra": sigma[:, 0],
            "sigma_dec": sigma[:, 1],
            "distance": seen.distance_km,
        },
        units={"t": "s", "ra": "deg", "dec": "deg", "sigma_ra": "arcsec", "sigma_dec": "arcsec", "distance": "km"},
        description="Simulated measurements: astrometric ICRF right ascension and declination",
    )


def visibility_table(scene: PlannedScene) -> Table:
    """Every scheduled epoch of each telescope, and why it was lost."""
    """Every scheduled epoch of every telescope: seen, or the first limit that removes it."""
    seen = scene.visibilities
    names = [np.full(one.t_s.size, telescope.name) for telescope, one in zip(scene.telescopes, seen)]
    t_s = np.concatenate([one.t_s for one in seen])
    order = np.argsort(t_s, kind="stable")
    reason = np.concatenate([one.reason for one in seen])
    columns: Arrays = {
        "epoch_tdb": np.array([(scene.epoch + float(t)).iso() for t in t_s]),
        "t": t_s,
        "telescope": np.concatenate(names),
        "visible": np.concatenate([one.visible for one in seen]),
        "reason": np.where(reason == "", "-", reason),
        "sun_angle": np.degrees(np.concatenate([one.sun_angle_rad for one in seen])),
        "earth_limb": np.degrees(np.concatenate([one.earth_limb_rad for one in seen])),
        "moon_limb": np.degrees(np.concatenate([one.moon_limb_rad for one in seen])),
        "phase": np.degrees(np.concatenate([one.phase_rad for one in seen])),
        "magnitude": np.concatenate([one.apparent_magnitude for one in seen]),
    }
    angles = dict.fromkeys(("sun_angle", "earth_limb", "moon_limb", "phase"), "deg")
    heights = np.concatenate([one.altitude_rad for one in seen])
    if np.isfinite(heights).any():
        columns |= {
            "altitude": np.degrees(heights),
            "sun_altitude": np.degrees(np.concatenate([one.sun_altitude_rad for one in seen])),
        }
        angles |= dict.fromkeys(("altitude", "sun_altitude"), "deg")
    return Table(
        columns={name: values[order] for name, values in columns.items()},
        units={"t": "s", "magnitude": "mag", **angles},
        description="Scheduled exposures: seen, or the first limit that removes them (- where none does); angles from "
        "the Sun's centre and from the limb of Earth and Moon, altitudes at sites on the ground; V without trailing "
        "loss, nan without H and G",
    )


def _residuals(nominal: View, fits: Sequence[Fit], psi: Array) -> Table:
    """Observed minus computed on the nominal orbit and after each fit."""
    seen = nominal.observation
    before = residual(psi, seen.psi) / ARCSEC
    columns: Arrays = {"t": seen.t_s, "ra_before": before[:, 0], "dec_before": before[:, 1]}
    for one in fits:
        after = one.estimate.residual_after / ARCSEC
        name = array_name(one.estimator.name)
        columns |= {f"ra_{name}": after[:, 0], f"dec_{name}": after[:, 1]}
    units = dict.fromkeys(columns, "arcsec") | {"t": "s"}
    return Table(columns=columns, units=units, description="Residuals, RA times cos Dec and Dec, before and after")


def _history(one: Fit) -> Table:
    history = one.history
    if history is None:
        raise ValueError(f"{one.estimator.name} has no history")
    columns: Arrays = {"t": one.observation.t_s}
    for column, name in enumerate(history.names):
        columns[f"formal_{name}"] = history.sigma_formal[:, column]
        if history.sigma is not None:
            columns[f"true_{name}"] = history.sigma[:, column]
    return Table(columns=columns, units={"t": "s"}, description="1 sigma of each estimated parameter so far")


def _flat(found: Answered) -> dict[str, Any]:
    """The scalar facts of a prediction, and its sigmas as text in one unit."""
    asked = found.quantity
    return {
        "name": asked.request.name,
        "estimator": found.estimator,
        "plane": asked.request.plane,
        "epoch_tdb": asked.epoch.iso(),
        "unit": asked.unit,
        "semi_axes": _text(found.semi_axes),
        "sigma": _text(found.sigma),
        "sigma_formal": _text(found.sigma_formal),
    }


def _text(values: Array) -> str:
    """Numbers (d,) in one cell."""
    return " ".join(f"{value:.9g}" for value in values)


BUDGET_UNITS = {
    f"{prefix}sigma_{what}{suffix}": unit
    for what, unit in (("position_km", "km"), ("velocity_m_s", "m / s"))
    for prefix, suffix in (
        ("", ""),
        *((f"{remedy}_", f"_{gain}_gain") for remedy in REMEDIES for gain in ("same", "new")),
        (f"{UNKNOWN}_", "_new_gain"),
    )
}


def _flat_budget(share: StateShare) -> dict[str, Any]:
    """One source of the state's budget as scalars."""
    row = rows.state_share(share)
    plain = ("estimator", "source", "sigma_position_km", "sigma_velocity_m_s", "share_position", "share_velocity")
    flat = {key: row[key] for key in plain}
    unknown = dict.fromkeys(("sigma_position_km_new_gain", "sigma_velocity_m_s_new_gain"))
    for remedy in (*REMEDIES, UNKNOWN):
        values = unknown if row[remedy] is None else row[remedy]
        flat |= {f"{remedy}_{key}": np.nan if value is None else value for key, value in values.items()}
    return flat


def _flat_sources(found: Answered) -> list[dict[str, Any]]:
    """The budget of one prediction, a line for each source and component."""
    asked = found.quantity
    lines = []
    for share in found.budget:
        vanished, halved, unknown = share.remedies.if_vanished, share.remedies.if_halved, share.remedies.if_unknown
        for k in range(len(share.share)):
            lines.append(
                {
                    "name": asked.request.name,
                    "estimator": found.estimator,
                    "source": share.source,
                    "component": k,
                    "unit": asked.unit,
                    "share": share.share[k],
                    "sigma": share.sigma.each[k],
                    "if_vanished_same_gain": vanished.same_gain.each[k],
                    "if_vanished_new_gain": _component(vanished.new_gain, k),
                    "if_halved_same_gain": halved.same_gain.each[k],
                    "if_halved_new_gain": _component(halved.new_gain, k),
                    "if_unknown_new_gain": np.nan if unknown is None else _component(unknown.new_gain, k),
                }
            )
    return lines


def _component(sigma: QuantitySigmas | None, k: int) -> float:
    """One component; nan where that world could not be solved."""
    return np.nan if sigma is None else float(sigma.each[k])


def _rows_table(lines: Sequence[Mapping[str, Any]], units: Mapping[str, str], description: str) -> Table:
    """A table from rows with the same keys."""
    columns = {name: np.array([line[name] for line in lines]) for name in lines[0]}
    return Table(columns=columns, units=units, description=description)
