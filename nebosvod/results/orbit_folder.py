"""What folders of an orbit's ephemeris and approaches have in common: where they come from, and the orbit itself."""

import platform
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results.manifest import LIBRARIES
from nebosvod.results.ownership import sha256_of
from nebosvod.results.result import Result, Table
from nebosvod.version import __version__

SCHEMA_VERSION = 1


def orbit_row(orbit: UncertainOrbit) -> dict[str, Any]:
    """The orbit a folder was made from."""
    return {
        "origin": orbit.origin,
        "epoch_tdb": orbit.epoch.iso(),
        "epoch_jd_tdb": [orbit.epoch.day, orbit.epoch.fraction],
        "state_km_km_s": orbit.state.tolist(),
        "names": list(orbit.names),
        "factor": orbit.factor.tolist(),
        "sigma": orbit.sigma.tolist(),
        "sigma_position_km": orbit.sigma_position_km,
        "parameters": {name: orbit.parameters[name] for name in orbit.parameter_names},
        "magnitude": None if orbit.magnitude is None else dict(zip(("H", "G"), orbit.magnitude, strict=True)),
    }


def result(
    summary: Mapping[str, Any],
    tables: Mapping[str, Table],
    arrays: Mapping[str, npt.NDArray[Any]],
    ephemeris: Ephemeris,
    path: str,
    started: float,
) -> Result:
    """The folder of a summary: with what it was made and from which file."""
    first, last = ephemeris.span
    source = Path(path)
    files = (
        [source] if source.is_file() else [source / "summary.json", source / "arrays.npz"] if source.is_dir() else []
    )
    manifest = {
        "schema_version": SCHEMA_VERSION,
        "kind": summary["kind"],
        "versions": {
            "nebosvod": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        "orbit": path,
        "ephemeris": {
            "source": ephemeris.source,
            "sha256": dict(ephemeris.sha256),
            "span": f"{first.iso(digits=0)} to {last.iso(digits=0)}",
        },
        "inputs_sha256": {str(file): sha256_of(file) for file in files},
        "times": {
            "started_utc": datetime.fromtimestamp(started, UTC).isoformat(timespec="seconds"),
            "elapsed_s": round(time.time() - started, 3),
        },
    }
    return Result(summary=summary, manifest=manifest, arrays=arrays, tables=tables)


def columns(rows: Sequence[Mapping[str, Any]], names: Sequence[str], description: str) -> Table:
    """A table of some keys of rows; None becomes nan in numbers, "" in text."""
    made: dict[str, npt.NDArray[Any]] = {}
    for name in names:
        values = [row[name] for row in rows]
        text = any(isinstance(value, str) for value in values)
        made[name] = np.array([("" if text else np.nan) if value is None else value for value in values])
    return Table(columns=made, units={}, description=description)
