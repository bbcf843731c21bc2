"""Orbits of the Minor Planet Center (mpc_orb.json): the Cartesian block, which needs no elements, with its covariance.

Positions are au, velocities au/d, on the ecliptic of J2000; a Yarkovsky parameter is 1e-10 au/d^2.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nebosvod.dynamics import Nongrav, RadiationPressure
from nebosvod.errors import InputError
from nebosvod.orbits.conversion import Given, factor_of, full, sphere_of
from nebosvod.timescale import SCALES, Epoch
from nebosvod.units import AU_KM, DAY_S

SPEED = AU_KM / DAY_S
STATE = ("x", "y", "z", "vx", "vy", "vz")
UNITS = (AU_KM, AU_KM, AU_KM, SPEED, SPEED, SPEED)
ACCELERATION, AREA = 1e-10, 1e-3  # au/d^2; m^2/t -> m^2/kg
COEFFICIENTS = {"yarkovski": "a2_au_d2", "yarkovsky": "a2_au_d2", "A1": "a1_au_d2", "A2": "a2_au_d2", "A3": "a3_au_d2"}
SCALE_OF = {"TDT": "tt", "TT": "tt", "TDB": "tdb"}
OBLIQUITY_ARCSEC = 84381.448


def is_mpc_orb(content: Mapping[str, Any]) -> bool:
    """Whether a JSON object is an orbit of the MPC, perhaps in the answer of its service."""
    return "CAR" in _inner(content) or "COM" in _inner(content)


def _inner(content: Mapping[str, Any]) -> Mapping[str, Any]:
    inner = content.get("mpc_orb", content)
    return inner if isinstance(inner, dict) else {}


def read_mpc_orb(path: Path, content: Mapping[str, Any]) -> Given:
    """The orbit of an mpc_orb file.

    Raises
    ------
    InputError
        With file and key, for whatever cannot be used.
    """
    name, orbit = path.name, _inner(content)
    block = _part(name, orbit, "CAR")
    _require_axes(name, orbit)
    names = block.get("coefficient_names") or block.get("element_order")
    values = block.get("coefficient_values") or block.get("element_values")
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names) or tuple(names[:6]) != STATE:
        raise InputError(f"{name}: CAR.coefficient_names: needs {', '.join(STATE)} first (got {str(names)[:80]})")
    numbers = _numbers(values, len(names), f"{name}: CAR.coefficient_values")
    n = len(names)
    matrix = full(np.array(_triangle(name, block.get("covariance"), n)), n)
    forces = _Forces(name, names[6:], numbers[6:])
    units = np.array([*UNITS, *forces.units])
    factor, notices = factor_of(matrix, f"{name}: CAR.covariance")
    return Given(
        name=_name(orbit, name),
        epoch=_epoch(name, orbit),
        kind="state",
        values=np.array(numbers[:6]) * units[:6],
        factor=units[:, None] * factor,
        gm_km3_s2=float("nan"),  # a state needs none
        parameter_names=forces.names,
        radiation=forces.radiation,
        nongrav=forces.nongrav,
        magnitude=_magnitude(orbit),
        notices=notices,
    )


def _part(name: str, orbit: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = orbit.get(key)
    if not isinstance(found, dict):
        raise InputError(f"{name}: {key}: is missing; is it an mpc_orb.json of the Minor Planet Center?")
    return found


def _require_axes(name: str, orbit: Mapping[str, Any]) -> None:
    system = orbit.get("system_data")
    system = system if isinstance(system, dict) else {}
    said = (str(system.get("refsys", "Ecliptic")).lower(), str(system.get("refframe", "ICRF")).upper())
    same = str(system.get("EclipticObliquityArcseconds", OBLIQUITY_ARCSEC)).rstrip("0") == str(OBLIQUITY_ARCSEC)
    if not said[0].startswith("ecliptic") or said[1] not in ("ICRF", "J2000") or not same:
        raise InputError(
            f"{name}: system_data: only the ecliptic of J2000 on ICRF, 84381.448 arcsec, is read (got {said})"
        )


def _numbers(values: Any, count: int, where: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{where}: needs {count} numbers, as their names say")
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise InputError(f"{where}: needs numbers only")
    return [float(value) for value in values]


def _triangle(name: str, covariance: Any, n: int) -> list[float]:
    """Upper triangle, row by row, of cov00, cov01, ..."""
    if not isinstance(covariance, dict):
        raise InputError(f"{name}: CAR.covariance: is missing; an orbit without one cannot be used here")
    keys = [f"cov{i}{j}" for i in range(n) for j in range(i, n)]
    absent = [key for key in keys if not isinstance(covariance.get(key), int | float)]
    if absent:
        raise InputError(f"{name}: CAR.covariance.{absent[0]}: needs a number")
    return [float(covariance[key]) for key in keys]


def _epoch(name: str, orbit: Mapping[str, Any]) -> Epoch:
    said = _part(name, orbit, "epoch_data")
    scale = SCALE_OF.get(str(said.get("timesystem", "")).upper())
    if said.get("timeform") != "MJD" or scale not in SCALES or not isinstance(said.get("epoch"), int | float):
        raise InputError(f"{name}: epoch_data: needs epoch, timeform MJD and timesystem TDT, TT or TDB")
    return Epoch.from_jd(2400000.5, float(said["epoch"]), scale)


class _Forces:
    """Forces of the object's own and the factors to our units."""

    def __init__(self, name: str, labels: list[Any], values: list[float]) -> None:
        alien = [str(label) for label in labels if label not in COEFFICIENTS and label != "srp"]
        if alien:
            raise InputError(
                f"{name}: CAR.coefficient_names: the force of {', '.join(alien)[:60]} is not in this version"
            )
        value = dict(zip(labels, values, strict=True))
        ratio = value.get("srp", 0.0) * AREA
        if "srp" in value and ratio <= 0.0:
            raise InputError(f"{name}: CAR.coefficient_values: srp = {value['srp']} cannot be used (allowed: above 0)")
        self.names = tuple(COEFFICIENTS.get(label, "thermal_emission") for label in labels)
        self.units = tuple(AREA / ratio if label == "srp" else ACCELERATION for label in labels)
        self.radiation: RadiationPressure | None = sphere_of(ratio) if ratio else None
        own = {COEFFICIENTS[label]: value[label] * ACCELERATION for label in labels if label != "srp"}
        self.nongrav: Nongrav | None = Nongrav(**own) if own else None


def _name(orbit: Mapping[str, Any], file: str) -> str:
    said = orbit.get("designation_data")
    said = said if isinstance(said, dict) else {}
    keys = ("permid", "unpacked_primary_provisional_designation")
    return next((str(said[key]) for key in keys if said.get(key)), Path(file).stem)


def _magnitude(orbit: Mapping[str, Any]) -> tuple[float, float] | None:
    said = orbit.get("magnitude_data")
    said = said if isinstance(said, dict) else {}
    H, G = said.get("H"), said.get("G")
    if not isinstance(H, int | float):
        return None
    return float(H), float(G) if isinstance(G, int | float) else 0.15
