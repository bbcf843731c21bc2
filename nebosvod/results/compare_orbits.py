"""`nebosvod compare` of ephemerides, approaches or risks: what several orbits say of the same times and bodies.

Rows of ephemerides are matched by their time, approaches and virtual impactors by their body and the nearest time.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import eq
from pathlib import Path
from typing import Any

import numpy as np

from nebosvod.borders.stored import read_object
from nebosvod.errors import InputError
from nebosvod.results.folder import require_sound_summary
from nebosvod.results.result import require_run_folder
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

SCHEMA_VERSION = 1
KINDS = ("ephemeris", "approaches", "risk")
UNCOMPARED = ("alert",)
MOST_FOLDERS = 20
SAME_S = 0.001  # times of ephemerides nearer than this are one
NEAR_D = 5.0  # approaches farther apart than this, and than five sigmas, are two
Row = Mapping[str, Any]
ENCOUNTERS: Mapping[
    str, tuple[str, tuple[str, ...]]
] = {  # kind -> list of the summary, and what is compared of its rows
    "approaches": (
        "approaches",
        ("epoch_utc", "sigma_time_s", "distance_km", "sigma_distance_km", "impact_probability_linear"),
    ),
    "risk": (
        "virtual_impactors",
        ("epoch_utc", "sigma_time_s", "probability", "low", "high", "bound", "recommended", "palermo"),
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class One:
    """One folder under a label that no other one has."""

    label: str
    path: str
    summary: Row


def kind_of_folders(folders: Sequence[Path]) -> str | None:
    """The kind of all folders, if it is one of these; None leaves them to the comparison of runs.

    Raises
    ------
    InputError
        If they are of several kinds, or of one that is not compared.
    """
    kinds = []
    for folder in folders:
        path = folder / "summary.json"
        kinds.append(read_object(path).get("kind") if path.is_file() and not path.is_symlink() else None)
    for folder, kind in zip(folders, kinds, strict=True):
        if kind in UNCOMPARED:
            raise InputError(f"compare: {folder}: is the answer of nebosvod {kind}, of which no two are compared")
    ours = [kind for kind in kinds if kind in KINDS]
    if ours and len(set(map(str, kinds))) > 1:
        said = ", ".join(f"{folder}: {kind or 'run'}" for folder, kind in zip(folders, kinds, strict=True))
        raise InputError(f"compare: folders of one kind compare with each other (got {said})")
    return str(ours[0]) if ours else None


def compare_orbits(folders: Sequence[Path], kind: str) -> dict[str, Any]:
    """Compare folders of one kind; returns what `nebosvod compare --json` prints."""
    if not 2 <= len(folders) <= MOST_FOLDERS:
        raise InputError(f"compare: needs 2 to {MOST_FOLDERS} folders (got {len(folders)})")
    ones = _read(folders)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": kind,
        "runs": [_header(one) for one in ones],
        "warnings": _warnings(ones),
        "rows": _places(ones) if kind == "ephemeris" else _encounters(ones, *ENCOUNTERS[kind]),
    }


def _read(folders: Sequence[Path]) -> list[One]:
    names = [Path(os.path.abspath(folder)).name for folder in folders]
    found = []
    for folder, name in zip(folders, names, strict=True):
        require_run_folder(folder)
        require_sound_summary(folder)
        label = name if names.count(name) == 1 else str(folder)
        found.append(One(label=label, path=str(folder), summary=read_object(folder / "summary.json")))
    if len({one.label for one in found}) < len(found):
        raise InputError("compare: one folder is named twice")
    return found


def _header(one: One) -> dict[str, Any]:
    orbit = one.summary["orbit"]
    return {
        "label": one.label,
        "path": one.path,
        "object": one.summary["object"],
        "orbit": orbit["origin"],
        "observer": one.summary.get("observer"),
        "sigma_position_km": orbit["sigma_position_km"],
        "epoch_tdb": orbit["epoch_tdb"],
        **({key: one.summary[key] for key in ("until_utc", "bodies", "sampling")} if _is_risk(one) else {}),
    }


def not_asked(row: Row, run: Row) -> str | None:
    """Why a risk says nothing of an impact that others find: a body it was not asked about, a date after its last."""
    if row["body"] not in run["bodies"]:
        return "not asked about"
    first = min(Epoch.parse(one["epoch_utc"]) - Epoch.parse(run["until_utc"]) for one in row["by_run"] if one)
    return f"after its last date, {run['until_utc'][:10]}" if first > 0.0 else None


def _is_risk(one: One) -> bool:
    return bool(one.summary["kind"] == "risk")


def _warnings(ones: Sequence[One]) -> list[str]:
    """What makes these answers to different questions."""
    said = []
    asked: tuple[tuple[str, str, Callable[[str, str], bool]], ...] = (
        ("the objects differ", "object", _one_name),
        ("the observers differ", "observer", _one_name),
        ("the bodies that may be hit differ", "bodies", eq),
        ("the last dates differ", "until_utc", eq),
    )
    for words, key, same in asked:
        found = [one.summary.get(key) for one in ones]
        answers = [", ".join(map(str, answer)) if isinstance(answer, list) else str(answer) for answer in found]
        if not all(same(answers[0], answer) for answer in answers):
            pairs = (f"{one.label}: {answer}" for one, answer in zip(ones, answers, strict=True))
            said.append(f"{words}: " + "; ".join(pairs))
    said += [f"{one.label}: {one.summary['ended']}" for one in ones if one.summary["ended"]]
    return said


def _one_name(first: str, other: str) -> bool:
    """Whether two names may be of one thing: `2024YR4` and `(2024 YR4)`, `99942` and `99942 Apophis (2004 MN4)`."""
    short, long = sorted(("".join(filter(str.isalnum, name)).lower() for name in (first, other)), key=len)
    return long.startswith(short) or long.endswith(short)


def _places(ones: Sequence[One]) -> list[dict[str, Any]]:
    """Offsets of each ephemeris from the first at the times of the first, in arcsec and in its own sigmas."""
    first, *others = ones
    times = [np.array([_seconds(row) for row in one.summary["rows"]]) for one in others]
    rows = []
    for row in first.summary["rows"]:
        by_run: list[dict[str, Any] | None] = [_place(row, row)]
        for one, t in zip(others, times, strict=True):
            k = int(np.argmin(np.abs(t - _seconds(row)))) if len(t) else -1
            there = k >= 0 and abs(t[k] - _seconds(row)) < SAME_S
            by_run.append(_place(row, one.summary["rows"][k]) if there else None)
        rows.append({"epoch_utc": row["epoch_utc"], "by_run": by_run})
    return rows


def _seconds(row: Row) -> float:
    """TDB seconds after J2000."""
    return Epoch.parse(str(row["epoch_utc"])) - Epoch.from_jd(2451545.0)


def _place(base: Row, row: Row) -> dict[str, Any]:
    """Offset (row minus base) in RA cos Dec and Dec, and how many sigmas of the row's own ellipse that is."""
    turn = (row["ra_deg"] - base["ra_deg"] + 180.0) % 360.0 - 180.0
    offset = 3600.0 * np.array([turn * np.cos(np.radians(base["dec_deg"])), row["dec_deg"] - base["dec_deg"]])
    angle = np.radians(row["position_angle_deg"])
    long = np.array([np.sin(angle), np.cos(angle)])
    along, across = offset @ long, offset @ np.array([long[1], -long[0]])
    axes = max(row["semi_major_arcsec"], 1e-300), max(row["semi_minor_arcsec"], 1e-300)
    return {
        "offset_ra_arcsec": float(offset[0]),
        "offset_dec_arcsec": float(offset[1]),
        "offset_sigmas": float(np.hypot(along / axes[0], across / axes[1])),
        "semi_major_arcsec": row["semi_major_arcsec"],
        "semi_minor_arcsec": row["semi_minor_arcsec"],
    }


def _encounters(ones: Sequence[One], list_name: str, keys: Sequence[str]) -> list[dict[str, Any]]:
    """Encounters of all folders, those of one body and about one time in one row."""
    groups: list[tuple[str, float, list[Row | None]]] = []
    for number, one in enumerate(ones):
        for row in one.summary[list_name]:
            t, reach = _seconds(row), max(NEAR_D * SECONDS_PER_DAY, 5.0 * row["sigma_time_s"])
            same = [g for g in groups if g[0] == row["body"] and abs(g[1] - t) < reach and g[2][number] is None]
            if same:
                min(same, key=lambda g: abs(g[1] - t))[2][number] = row
            else:
                by_run: list[Row | None] = [None] * len(ones)
                by_run[number] = row
                groups.append((row["body"], t, by_run))
    return [
        {
            "body": body,
            "by_run": [None if row is None else {key: row[key] for key in keys} for row in by_run],
        }
        for body, _, by_run in sorted(groups, key=lambda group: group[1])
    ]
