"""Orbits of stored folders of ours: of a fit, or of a run its estimate (which is of a drawn truth)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.stored import held_together, read_arrays, read_object, require_version
from nebosvod.dynamics import Nongrav, RadiationPressure
from nebosvod.dynamics.model import SETTINGS
from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.reweighed import Response
from nebosvod.mission.slugs import array_name
from nebosvod.orbits.conversion import balanced_factor
from nebosvod.orbits.uncertain import STATE_NAMES, UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
SCHEMA_VERSION = 1
LOGARITHMS = {"ln_radius": "radius_m", "ln_mass": "mass_kg", "ln_albedo": "albedo"}


def is_folder_of_ours(path: Path) -> bool:
    """Whether a folder holds a run or a fit."""
    return all((path / name).is_file() for name in ("manifest.json", "summary.json", "arrays.npz"))


def read_folder_orbit(path: Path, estimator: str | None = None) -> UncertainOrbit:
    """The orbit of a fit or of a run: of an estimator by name, else of the first that converged.

    Raises
    ------
    InputError
        If the folder is damaged, or nothing in it converged.
    """
    summary = read_object(path / "summary.json")
    require_version(path / "summary.json", summary, SCHEMA_VERSION)
    kind = summary.get("kind")
    if isinstance(kind, str) and kind != "fit":
        raise InputError(f"{path}: is the answer of nebosvod {kind}, which holds no orbit; needs that of fit or run")
    arrays = read_arrays(path / "arrays.npz")
    with held_together(str(path)):
        return _orbit(path, summary, arrays, estimator)


def _orbit(
    path: Path, summary: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]], estimator: str | None
) -> UncertainOrbit:
    row = _row(path, summary["estimators"], estimator)
    label = "fit" if summary.get("kind") == "fit" else array_name(row["name"])
    if f"orbit_factor_{label}" not in arrays:
        raise InputError(f"{path / 'arrays.npz'}: lacks orbit_factor_{label}; made by an older nebosvod: make it again")
    names = tuple(str(name) for name in arrays[f"orbit_names_{label}"])
    if names[:6] != STATE_NAMES:
        raise InputError(f"{path / 'arrays.npz'}: orbit_names_{label}: needs the six of the state first")
    physics = summary["physics"]
    values = {name: float(said["estimate"]) for name, said in row["parameters"].items() if name in names}
    unit, physical = _physical(names[6:], values, physics)
    factor = np.asarray(arrays[f"orbit_factor_{label}"], dtype=np.float64)
    parts = zip(arrays[f"orbit_source_names_{label}"], arrays[f"orbit_source_factors_{label}"], strict=True)
    day, fraction = (float(part) for part in arrays["reference_epoch_jd_tdb"])
    kind = "a fit" if label == "fit" else f'a run, estimator "{row["name"]}"'
    radiation, nongrav = _forces(physics, physical)
    return UncertainOrbit(
        name=str(summary["object"]),
        epoch=Epoch(day, fraction),
        state=np.array(row["state_km_km_s"], dtype=np.float64),
        factor=balanced_factor(unit[:, None] * factor),
        parameter_names=tuple(LOGARITHMS.get(name, name) for name in names[6:]),
        radiation=radiation,
        nongrav=nongrav,
        settings=_settings(physics),
        sources={str(name): unit[:, None] * np.asarray(G, dtype=np.float64) for name, G in parts},
        shared=_shared(arrays, label, len(names)),
        responses=_responses(arrays, label),
        magnitude=_magnitude(summary),
        last_observation=_last_observation(summary),
        origin=f"{path} ({kind})",
    )


def _last_observation(summary: Mapping[str, Any]) -> Epoch | None:
    """Of a fit."""
    said = (summary.get("fit") or {}).get("last_observation_utc")
    return Epoch.parse(f"{said.removesuffix('Z')} UTC") if isinstance(said, str) else None


def _shared(arrays: Mapping[str, npt.NDArray[Any]], label: str, size: int) -> dict[str, Array]:
    """Errors common to many measurements by name, each a row over the unit draws of the orbit, then of all of these."""
    if f"orbit_shared_names_{label}" not in arrays:
        return {}
    names = [str(name) for name in arrays[f"orbit_shared_names_{label}"]]
    rows = np.asarray(arrays[f"orbit_shared_factor_{label}"], dtype=np.float64)
    if rows.shape != (len(names), size + len(names)):
        raise InputError(f"orbit_shared_factor_{label}: needs shape ({len(names)}, {size + len(names)})")
    return dict(zip(names, rows, strict=True))


def _responses(arrays: Mapping[str, npt.NDArray[Any]], label: str) -> dict[str, Response]:
    """How the estimate answers to each source; nothing in folders that do not say."""
    if f"orbit_response_names_{label}" not in arrays:
        return {}
    names, shift, growth = (arrays[f"orbit_response_{key}_{label}"] for key in ("names", "shift", "growth"))
    rows = zip(names, shift, growth, strict=True)
    return {str(name): Response(shift=np.asarray(m), growth=np.asarray(D)) for name, m, D in rows}


def _row(path: Path, rows: list[Mapping[str, Any]], estimator: str | None) -> Mapping[str, Any]:
    """The estimator whose orbit it is."""
    if estimator is not None:
        rows = [row for row in rows if row["name"] == estimator]
    found = next((row for row in rows if row["status"] == "converged"), None)
    if found is None:
        said = ", ".join(f"{row['name']} {row['status']}" for row in rows) or f'no estimator "{estimator}"'
        raise InputError(f"{path}: has no orbit that can be used ({said}); make a run or a fit that converges")
    return found


def _physical(
    names: tuple[str, ...], values: Mapping[str, float], physics: Mapping[str, Any]
) -> tuple[Array, dict[str, float]]:
    """Factors (6 + m,) from the rows to the physical parameters, and the estimated values of these.

    A logarithm becomes its quantity to first order: dR = R d ln R.
    """
    sphere = physics.get("radiation_pressure") or {}
    unit, physical = np.ones(6 + len(names)), dict[str, float]()
    for k, name in enumerate(names, start=6):
        quantity = LOGARITHMS.get(name)
        if quantity is None:
            if name in values:
                physical[name] = values[name]
            continue
        physical[quantity] = float(np.exp(values[name])) if name in values else float(sphere[quantity])
        unit[k] = physical[quantity]
    return unit, physical


def _forces(physics: Mapping[str, Any], values: Mapping[str, float]) -> tuple[RadiationPressure | None, Nongrav | None]:
    """Forces of the object's own at the estimated values; these may leave the physical range."""
    radiation, nongrav = None, None
    sphere = ("radius_m", "mass_kg", "albedo", "thermal_emission")
    if isinstance(physics.get("radiation_pressure"), dict):
        said = physics["radiation_pressure"]
        nominal = RadiationPressure(**{name: float(said[name]) for name in sphere})
        radiation = nominal.moved({name: values[name] for name in sphere if name in values})
    if physics.get("nongrav_au_d2"):
        law = {name: float(value) for name, value in physics["nongrav_law"].items()}
        own = {name: values.get(name, float(value)) for name, value in physics["nongrav_au_d2"].items()}
        nongrav = Nongrav(**own, **law)
    return radiation, nongrav


def _settings(physics: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of the force model."""
    excluded = physics.get("excluded", physics.get("asteroids_excluded", ()))
    return {name: physics[name] for name in SETTINGS if name in physics} | {"excluded": tuple(excluded)}


def _magnitude(summary: Mapping[str, Any]) -> tuple[float, float] | None:
    said = summary["physics"].get("magnitude") or (summary.get("ahead") or {}).get("magnitude")
    return (float(said["H"]), float(said["G"])) if isinstance(said, dict) else None
