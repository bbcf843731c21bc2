"""A run folder as the report reads it: manifest, summary, arrays."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.shape import require_shape, schema_file
from nebosvod.borders.stored import read_arrays, read_object, require_version
from nebosvod.errors import InputError
from nebosvod.mission.slugs import array_name
from nebosvod.results.outlook import answered, impact_sentences, unanswered_sentences
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Item = Mapping[str, Any]
SCHEMA_VERSION = 1
HERE = Path(__file__).parent
SCHEMAS = {  # by the kind that a summary says; a run says none
    None: HERE / "summary.schema.json",
    "fit": HERE / "fit_summary.schema.json",
    "ephemeris": HERE / "ephemeris.schema.json",
    "approaches": HERE / "approaches.schema.json",
    "alert": HERE / "alert.schema.json",
    "risk": HERE / "risk.schema.json",
}
REQUIRED = ("mission", "object", "reference_epoch_tdb", "n_observations", "telescopes", "estimators")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunFolder:
    """What a run left behind.

    Parameters
    ----------
    manifest, summary : the two JSON files.
    arrays : everything in arrays.npz by name; empty where a run ended before it had any.
    """

    manifest: Item
    summary: Item
    arrays: Mapping[str, npt.NDArray[Any]]

    @property
    def epoch(self) -> Epoch:
        """The reference epoch, from which all times of the arrays count."""
        return Epoch.parse(self.summary["reference_epoch_tdb"])

    @property
    def estimators(self) -> list[Item]:
        """The estimators in the mission's order."""
        return list(self.summary["estimators"])

    @property
    def main(self) -> Item | None:
        """The estimator the report speaks of: the first that converged, else none."""
        return next((e for e in self.estimators if e["status"] == "converged"), None)

    @property
    def telescopes(self) -> list[str]:
        """Telescope names, in the order of `telescope_index`."""
        if "telescope_names" in self.arrays:
            return [str(name) for name in self.arrays["telescope_names"]]
        return [t if isinstance(t, str) else str(t["name"]) for t in self.summary["telescopes"]]

    def array(self, name: str, of: str | None = None) -> npt.NDArray[Any] | None:
        """An array by name, or the array `name` of an estimator or prediction; None where the run has none."""
        if of is None:
            return self.arrays.get(name)
        found = self.arrays.get(f"{name}_{of}")
        return found if found is not None else self.arrays.get(f"{name}_{array_name(of)}")

    def predictions(self, estimator: str | None = None) -> list[Item]:
        """The predictions that exist for their orbit, of one estimator if named."""
        every = answered(self.summary.get("predictions") or [])
        return [p for p in every if estimator is None or p["estimator"] == estimator]

    @property
    def unanswered(self) -> list[str]:
        """A sentence for each prediction that does not exist for its orbit."""
        return [f"{text}." for text in unanswered_sentences(self.summary.get("predictions") or [])]

    @property
    def impacts(self) -> list[str]:
        """A sentence for each encounter that may be an impact."""
        return [f"{text}." for text in impact_sentences(self.summary)]

    def budget(self, estimator: str) -> list[Item]:
        """Sources of one estimator's budget, largest share of the position variance first."""
        rows = [row for row in self.summary.get("budget") or [] if row["estimator"] == estimator]
        return sorted(rows, key=lambda row: (-row["share_position"], row["source"]))


def read_folder(path: Path) -> RunFolder:
    """Read a run folder.

    Raises
    ------
    InputError
        If a file is missing, damaged, or written by a newer schema; the message names the file.
    """
    summary = _read_json(path / "summary.json")
    manifest = _read_json(path / "manifest.json")
    require_version(path / "summary.json", summary, SCHEMA_VERSION)
    missing = [key for key in REQUIRED if key not in summary]
    if missing:
        raise InputError(f"{path / 'summary.json'}: {', '.join(missing)} missing; run the mission again")
    try:  # a run that stopped early may have left no arrays
        arrays = read_arrays(path / "arrays.npz")
    except FileNotFoundError:
        arrays = {}
    return RunFolder(manifest=manifest, summary=summary, arrays=arrays)


def require_sound_summary(path: Path) -> None:
    """Hold the summary of a run that somebody hands over against its schema.

    Raises
    ------
    InputError
        If it has not the shape; the message names file and key.
    """
    summary = _read_json(path / "summary.json")
    require_version(path / "summary.json", summary, SCHEMA_VERSION)
    require_shape(path / "summary.json", summary, schema_file(schema_of(summary)))


def schema_of(summary: Item) -> Path:
    """The JSON Schema of a summary; one of an unknown kind is held against that of a run."""
    kind = summary.get("kind")
    return SCHEMAS.get(kind if isinstance(kind, str) else None, SCHEMAS[None])


def _read_json(path: Path) -> dict[str, Any]:
    """One JSON object of a run folder."""
    try:
        return read_object(path)
    except FileNotFoundError:
        raise InputError(f"{path}: not found; a run folder is what `nebosvod run MISSION` leaves behind") from None
