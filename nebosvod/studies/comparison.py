"""Studies side by side: answers of one name, and points that both have."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.studies.stored import is_study, read_study

Item = Mapping[str, Any]
Columns = Mapping[str, npt.NDArray[Any]]


def all_studies(folders: Sequence[Path]) -> bool:
    """Whether folders are studies, all of them.

    Raises
    ------
    InputError
        If some are and some are not.
    """
    which = [is_study(folder) for folder in folders]
    if any(which) and not all(which):
        other = folders[which.index(False)]
        raise InputError(f"compare: {other} is no study, as {folders[which.index(True)]} is; compare like with like")
    return bool(which) and all(which)


def compare_studies(folders: Sequence[Path]) -> dict[str, Any]:
    """What several studies answer, and how they differ at points that the first one has as well.

    Raises
    ------
    InputError
        If there are fewer than two, or one cannot be read.
    """
    if len(folders) < 2:
        raise InputError("compare: needs two folders or more")
    read = [read_study(folder) for folder in folders]
    names = [one["name"] for one in read[0][0]["answers"] if not one["shares"]]
    common = [name for name in names if all(_of(found, name) for found, _ in read)]
    return {
        "kind": "studies",
        "studies": [_study(folder, found) for folder, (found, _) in zip(folders, read)],
        "answers": [_row(name, read) for name in common],
        "warnings": list(_warnings(folders, read, common)),
    }


def _study(folder: Path, found: Item) -> dict[str, Any]:
    keys = ("title", "mission", "method", "n_points", "n_failed", "n_without_answer", "find")
    return {"folder": str(folder), **{key: found[key] for key in keys}}


def _of(found: Item, name: str) -> Item | None:
    return next((one for one in found["answers"] if one["name"] == name and not one["shares"]), None)


def _row(name: str, read: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Any]:
    """One answer in each study, and the ratio to the first at the points that both have."""
    cells = []
    for found, columns in read:
        one = _of(found, name) or {}
        ratio = _ratio(read[0], (found, columns), name)
        cells.append({key: one.get(key) for key in ("unit", "n", "least", "median", "largest")} | {"to_first": ratio})
    return {"name": name, "studies": cells}


def _ratio(first: tuple[Item, Columns], other: tuple[Item, Columns], name: str) -> dict[str, Any] | None:
    """An answer over that of the first, point by point; None where they have no point in common."""
    units = [_units(found) for found, _ in (first, other)]
    if units[0] != units[1] or (_of(first[0], name) or {}).get("unit") != (_of(other[0], name) or {}).get("unit"):
        return None
    tables = []
    for _, columns in (first, other):
        keys = zip(*(_keys(columns[axis]) for axis in sorted(units[0])))
        tables.append(dict(zip(keys, np.asarray(columns[name], dtype=float).tolist())))
    ratios = np.array([tables[1][key] / value for key, value in tables[0].items() if key in tables[1] and value])
    ratios = ratios[np.isfinite(ratios)]
    if not ratios.size:
        return None
    return {
        "n": int(ratios.size), "median": float(np.median(ratios)), "least": float(ratios.min()),
        "largest": float(ratios.max()),
    }  # fmt: skip


def _units(found: Item) -> dict[str, str]:
    return {one["name"]: one["unit"] for one in found["vary"]}


def _keys(column: npt.NDArray[Any]) -> list[Any]:
    """Values to ten digits: the same point reached by other steps is the same."""
    return [f"{value:.10g}" if isinstance(value, float) else value for value in column.tolist()]


def _warnings(
    folders: Sequence[Path], read: Sequence[tuple[dict[str, Any], dict[str, Any]]], common: Sequence[str]
) -> Any:
    if not common:
        yield "no answer has the same name in all studies"
    for folder, (found, _) in zip(folders[1:], read[1:]):
        if _units(found) != _units(read[0][0]):
            yield f"{folder}: varies other things, or in other units, than {folders[0]}: no point by point"
        if found["method"] != read[0][0]["method"]:
            yield f"{folder}: its points are evaluated in another way ({found['method']})"
