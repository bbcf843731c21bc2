"""The answer of JPL's Small-Body Database service (sbdb.api?sstr=...&cov=mat): elements, covariance, forces."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Nongrav, RadiationPressure
from nebosvod.errors import InputError
from nebosvod.mission.covariance import COMETARY_SCALE
from nebosvod.mission.orbit import INVERSE_SQUARE, WATER_ICE
from nebosvod.orbits.conversion import Given, factor_of, sphere_of
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM, DEG

Array = npt.NDArray[np.float64]
NAMES = {"e": "e", "q": "q", "tp": "tp", "om": "node", "node": "node", "w": "peri", "peri": "peri", "i": "i"}
ORDER = ("e", "q", "tp", "node", "peri", "i")
ACCELERATIONS = ("A1", "A2", "A3")
LAW = {"ALN": "alpha", "R0": "r0_au", "NM": "m", "NN": "n", "NK": "k"}
# (101955) Bennu of Farnocchia et al. (2021) has the bulk density in place of A2, which goes as its inverse, on a law
# of its own: A2 = -4.6178e-14 au/d^2 at 1191.53 kg/m^3, g = r^-2.25
DENSITY_A2, DENSITY_LAW = -4.6178e-14 * 1191.53, {"m": 2.25}
TAKEN = (*ACCELERATIONS, *LAW, "RHO", "AMRAT", "DT")


def is_sbdb(answer: Mapping[str, Any]) -> bool:
    """Whether a JSON object is an answer of the service."""
    return "signature" in answer or isinstance(answer.get("orbit"), dict)


def read_sbdb(path: Path, answer: Mapping[str, Any]) -> Given:
    """The orbit of an answer of the service.

    Raises
    ------
    InputError
        With file and key, for whatever cannot be used; without a covariance says how to ask for one.
    """
    name = path.name
    orbit = answer.get("orbit")
    if not isinstance(orbit, dict):
        raise InputError(f"{name}: orbit: is missing; is it an answer of JPL's SBDB service?")
    covariance = orbit.get("covariance")
    if not isinstance(covariance, dict):
        raise InputError(f"{name}: orbit.covariance: is missing; ask the service for it: sbdb.api?sstr=OBJECT&cov=mat")
    epoch = _julian(covariance.get("epoch"), f"{name}: orbit.covariance.epoch")
    values = _elements(name, orbit, covariance, epoch)
    labels, matrix = _matrix(name, covariance)
    model = _model(name, orbit)
    forces = _Forces(name, model, labels)
    keep = [labels.index(label) for label in (*ORDER, *forces.labels)]
    dropped = [label for k, label in enumerate(labels) if k not in keep]
    factor, singular = factor_of(matrix, f"{name}: orbit.covariance.data")
    units = np.array([*(COMETARY_SCALE[label] for label in ORDER), *forces.units])
    return Given(
        name=_object_name(answer, name),
        epoch=epoch,
        kind="cometary",
        values=values,
        factor=units[:, None] * factor[keep],
        gm_km3_s2=_gm_sun(),
        parameter_names=forces.names,
        radiation=forces.radiation,
        nongrav=forces.nongrav,
        magnitude=_magnitude(answer),
        last_observation=_last_observation(orbit),
        notices=(*singular, *(f"{name}: {text}" for text in _left_out(model, dropped))),
    )


def _gm_sun() -> float:
    """That of the ephemeris: the planetary ephemerides of JPL differ by 5e-12 in it."""
    from nebosvod.dynamics import Ephemeris

    return float(Ephemeris.load().gm_km3_s2["sun"])


def _left_out(model: Mapping[str, float], dropped: list[str]) -> list[str]:
    """What the orbit has and this program does not."""
    said = []
    if "DT" in model:
        said.append(
            f"the outgassing lags by DT = {model['DT']:.4g} d, which the forces here do not have; A1 to A3 act without "
            "it, so that predictions far from the epoch differ from JPL's"
        )
    if others := [label for label in dropped if label != "DT"]:
        said.append(f"the covariance of {', '.join(others)} is left out")
    return said


def _elements(name: str, orbit: Mapping[str, Any], covariance: Mapping[str, Any], epoch: Epoch) -> Array:
    """[e, q_km, tp_s, node, peri, i] at the epoch of the covariance."""
    place, rows = "orbit.covariance.elements", covariance.get("elements")
    if rows is None and str(orbit.get("epoch")) == str(covariance.get("epoch")):
        place, rows = "orbit.elements", orbit.get("elements")
    if not isinstance(rows, list):
        raise InputError(f"{name}: {place}: is missing; the elements must be those at the epoch of the covariance")
    found = {NAMES[name]: value for name, value in _pairs(rows) if name in NAMES}
    missing = [label for label in ORDER if label not in found]
    if missing:
        raise InputError(f"{name}: {place}: lacks {', '.join(missing)} (needs e, q, tp, om, w, i)")
    e, q, _, node, peri, i = (_number(found[label], f"{name}: {place}.{label}") for label in ORDER)
    tp = _julian(found["tp"], f"{name}: {place}.tp") - epoch
    return np.array([e, q * AU_KM, tp, node * DEG, peri * DEG, i * DEG])


def _matrix(name: str, covariance: Mapping[str, Any]) -> tuple[list[str], Array]:
    """Labels (n) and the matrix (n, n), in JPL's units."""
    labels, rows = covariance.get("labels"), covariance.get("data")
    place = f"{name}: orbit.covariance"
    if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
        raise InputError(f"{place}.labels: needs a list of names")
    names = [str(NAMES.get(label, label)) for label in labels]
    missing = [label for label in ORDER if label not in names]
    if missing or len(set(names)) != len(names):
        raise InputError(f"{place}.labels: needs each of {', '.join(ORDER)} once (got {', '.join(labels)[:80]})")
    if not isinstance(rows, list) or [len(row) if isinstance(row, list) else -1 for row in rows] != [len(names)] * len(
        names
    ):
        raise InputError(f"{place}.data: needs {len(names)} rows of {len(names)} numbers, as labels say")
    return names, np.array(
        [[_number(item, f"{place}.data[{i}][{j}]") for j, item in enumerate(row)] for i, row in enumerate(rows)]
    )


def _model(name: str, orbit: Mapping[str, Any]) -> dict[str, float]:
    """Model parameters by name."""
    rows = orbit.get("model_pars") or []
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{name}: orbit.model_pars: needs a list of parameters")
    model = {
        str(row.get("name")): _number(row.get("value"), f"{name}: orbit.model_pars.{row.get('name')}") for row in rows
    }
    alien = [label for label in model if label not in TAKEN]
    if alien:
        raise InputError(f"{name}: orbit.model_pars: this version does not have the force of {', '.join(alien)[:60]}")
    return model


class _Forces:
    """Forces of the object's own: uncertain ones with their label in the covariance and the factor to our unit."""

    def __init__(self, name: str, model: Mapping[str, float], labels: list[str]) -> None:
        self.labels: tuple[str, ...] = ()
        self.names: tuple[str, ...] = ()
        self.units: tuple[float, ...] = ()
        self.radiation: RadiationPressure | None = None
        self.nongrav: Nongrav | None = None
        absent = [label for label in (*ACCELERATIONS, "RHO", "AMRAT") if label in labels and label not in model]
        if absent:
            raise InputError(
                f"{name}: orbit.model_pars: lacks the value of {', '.join(absent)}, which has a covariance"
            )
        self._accelerations(model, labels)
        self._density(name, model, labels)
        self._area(name, model, labels)

    def _add(self, label: str, parameter: str, unit: float, labels: list[str]) -> None:
        if label in labels:
            self.labels, self.names, self.units = (*self.labels, label), (*self.names, parameter), (*self.units, unit)

    def _accelerations(self, model: Mapping[str, float], labels: list[str]) -> None:
        given = {label: model[label] for label in ACCELERATIONS if label in model}
        if not given:
            return
        said = {LAW[label]: model[label] for label in LAW if label in model}
        law = {**(INVERSE_SQUARE if said else WATER_ICE), **said}
        self.nongrav = Nongrav(**{f"{label.lower()}_au_d2": value for label, value in given.items()}, **law)
        for label in given:
            self._add(label, f"{label.lower()}_au_d2", 1.0, labels)

    def _density(self, name: str, model: Mapping[str, float], labels: list[str]) -> None:
        if "RHO" not in model:
            return
        if self.nongrav is not None or model["RHO"] <= 0.0:
            raise InputError(f"{name}: orbit.model_pars: RHO stands for A2; it needs to be positive and alone")
        a2 = DENSITY_A2 / model["RHO"]
        self.nongrav = Nongrav(a2_au_d2=a2, **DENSITY_LAW)
        self._add("RHO", "a2_au_d2", -a2 / model["RHO"], labels)

    def _area(self, name: str, model: Mapping[str, float], labels: list[str]) -> None:
        ratio = model.get("AMRAT", 0.0)
        if ratio < 0.0 or (ratio == 0.0 and "AMRAT" in labels):
            raise InputError(f"{name}: orbit.model_pars: AMRAT = {ratio} cannot be used (allowed: more than 0)")
        if ratio > 0.0:
            self.radiation = sphere_of(ratio)
            self._add("AMRAT", "thermal_emission", 1.0 / ratio, labels)


def _object_name(answer: Mapping[str, Any], file: str) -> str:
    known = answer.get("object")
    known = known if isinstance(known, dict) else {}
    return str(known.get("fullname") or known.get("des") or Path(file).stem).strip()


def _last_observation(orbit: Mapping[str, Any]) -> Epoch | None:
    """The day of the last observation, which the service tells as a date."""
    said = orbit.get("last_obs")
    try:
        return Epoch.parse(f"{said} UTC") if isinstance(said, str) else None
    except InputError:
        return None


def _magnitude(answer: Mapping[str, Any]) -> tuple[float, float] | None:
    """H and G of the physical parameters; G = 0.15 where it is not said."""
    known = dict(_pairs(answer.get("phys_par")))
    H, G = known.get("H"), known.get("G")
    if H is None:
        return None
    return _number(H, "phys_par.H"), _number(0.15 if G is None else G, "phys_par.G")


def _pairs(rows: Any) -> list[tuple[str, Any]]:
    """Names and values of a list of JPL's, as far as it is one."""
    listed = rows if isinstance(rows, list) else []
    return [(str(row["name"]), row.get("value")) for row in listed if isinstance(row, dict) and "name" in row]


def _number(value: Any, where: str) -> float:
    """A number, also in quotes, as JPL prints it."""
    try:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError
        number = float(value)
    except ValueError:
        raise InputError(f"{where}: needs a number (got {str(value)[:40]!r})") from None
    if not np.isfinite(number):
        raise InputError(f"{where}: needs a finite number (got {str(value)[:40]!r})")
    return number


def _julian(value: Any, where: str) -> Epoch:
    """A Julian date TDB with all its digits."""
    _number(value, where)
    try:
        return Epoch.parse(f"{value} JD TDB")
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
