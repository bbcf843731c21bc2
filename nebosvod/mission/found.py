"""An orbit with its covariance from a file or a folder of any kind; what is in it is filled in when it is read."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from nebosvod.errors import InputError
from nebosvod.mission.covariance import Array
from nebosvod.mission.fields import Block, Complaints, KeyPath, Parsed, Several, Text
from nebosvod.mission.orbit import INVERSE_SQUARE, Frame, Representation, Six
from nebosvod.timescale import Epoch

STATE_LABELS = ("x", "y", "z", "vx", "vy", "vz")
# labels of a joint covariance -> parameters of the force model; a state's are their own
PARAMETER_OF = {"A1": "a1_au_d2", "A2": "a2_au_d2", "A3": "a3_au_d2", "radius": "radius_m", "mass": "mass_kg"}
FOUND = "found"  # the key that reading fills in; no user writes it
SPHERE = ("radius", "mass", "albedo", "thermal_emission")


def parameter_of(label: str) -> str:
    """The parameter of the force model that a label of a joint covariance means."""
    return PARAMETER_OF.get(label, label)


def files_of(path: Path) -> tuple[Path, ...]:
    """The files behind what a mission names: of a folder of ours those that its orbit is read from."""
    return (path / "summary.json", path / "arrays.npz") if path.is_dir() else (path,)


def _moment(value: Any) -> Epoch:
    """Day and fraction."""
    try:
        day, fraction = (float(part) for part in value)
    except (TypeError, ValueError):
        raise InputError("needs day and fraction of a TDB Julian date") from None
    return Epoch(day, fraction)


def _triangle(value: Any) -> Array:
    """A lower triangular factor from lists of numbers."""
    try:
        factor = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("needs a square matrix of numbers") from None
    if factor.ndim != 2 or factor.shape[0] != factor.shape[1] or not np.isfinite(factor).all():
        raise InputError("needs a square matrix of finite numbers")
    if np.triu(factor, 1).any() or not (np.diag(factor) > 0.0).all():
        raise InputError("needs a lower triangle with a positive diagonal")
    factor.setflags(write=False)
    return factor


def without_found(block: JsonSchemaValue) -> JsonSchemaValue:
    """The schema of a block as a user writes it: the file alone."""
    block["properties"].pop(FOUND, None)
    return block


class FoundOrbit(Block):
    """What a file says of an orbit: its state, and the joint covariance of state and parameters."""

    epoch: Annotated[Epoch, Parsed(_moment, {}, lambda epoch: [epoch.day, epoch.fraction])]
    state: Annotated[Several[float], Field(min_length=6, max_length=6)]
    labels: Several[str]
    factor: Annotated[Array, Parsed(_triangle, {}, lambda factor: factor.tolist())]
    values: dict[str, float] = Field(default_factory=dict)
    law: dict[str, float] | None = None
    notices: Several[str] = ()

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Labels fit the factor."""
        fits = self.labels[:6] == STATE_LABELS and len(self.labels) == len(self.factor)
        return [] if fits else [(("labels",), "do not fit the factor")]


class FileOrbit(Block):
    """An orbit with its covariance in a file or folder: of a fit or a run, SBDB JSON, OEF, mpc_orb.json, OEM."""

    kind: Literal["file"]
    file: Text = Field(description="Beside the mission: a folder of nebosvod fit or run, or an orbit file of others")
    found: FoundOrbit | None = None

    @model_validator(mode="before")
    @classmethod
    def _absent(cls, data: Any) -> Any:
        """A bad file has been reported where it was read."""
        if isinstance(data, dict) and data.get("file") and data.get("found") is None:
            raise Complaints([])
        return data

    @classmethod
    def __get_pydantic_json_schema__(cls, source: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The file alone is what a user writes."""
        return without_found(handler.resolve_ref_schema(handler(source)))

    @property
    def read(self) -> FoundOrbit:
        if self.found is None:
            raise InputError(f"{self.file}: has not been read; load the mission from its file")
        return self.found

    @property
    def epoch(self) -> Epoch:
        """Of the state and its covariance."""
        return self.read.epoch

    @property
    def frame(self) -> Frame:
        """Axes of the state."""
        return "icrf"

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "state"

    @property
    def elements(self) -> Six:
        """[x, y, z km, vx, vy, vz km/s]."""
        return self.read.state  # type: ignore[return-value]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the joint covariance: x y z vx vy vz, then A1, A2, A3, radius, mass, albedo, thermal_emission."""
        return self.read.labels

    @property
    def covariance(self) -> Array:
        """Joint covariance by `labels`: km, km/s, and the units of the force model."""
        joint: Array = self.read.factor @ self.read.factor.T
        return joint

    @property
    def law(self) -> dict[str, float] | None:
        """Constants of g(r) of its A1..A3; None without A."""
        if not any(label in self.read.values for label in ("A1", "A2", "A3")):
            return None
        return dict(self.read.law or INVERSE_SQUARE)

    def nongrav_value(self, label: str) -> float | None:
        """The value of A1, A2 or A3 (au/d^2) that came with the orbit, if any."""
        return self.read.values.get(label)

    @property
    def a1(self) -> float | None:
        """A1 of the orbit (au/d^2), if any."""
        return self.nongrav_value("A1")

    @property
    def sphere(self) -> dict[str, float]:
        """Radius (m), mass (kg), albedo and thermal emission that came with the orbit; empty where none did."""
        return {name: self.read.values[name] for name in SPHERE if name in self.read.values}
