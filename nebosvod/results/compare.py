"""`nebosvod compare`: run folders side by side, and whether their numbers may be compared at all.

Only summary.json and manifest.json are read. Estimators are matched by name; predictions by name, each folder's
first estimator speaking for it.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nebosvod.borders.stored import held_together, read_arrays, read_object
from nebosvod.errors import InputError
from nebosvod.findings.kinds import kind_of
from nebosvod.results.folder import require_sound_summary
from nebosvod.results.outlook import answered, unit_of, without_answer
from nebosvod.results.result import require_run_folder

SAME_DISTANCE = 0.01  # relative
SCHEMA_VERSION = 1
MOST_FOLDERS = 20
SMALLEST_SHARE = 0.0005  # what would be shown as 0
Found = dict[str, Any] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """What is read of one run folder, under a label that no other one has."""

    label: str
    path: str
    summary: Mapping[str, Any]
    version: str

    @property
    def estimator(self) -> str:
        """The first estimator, which speaks for the run."""
        return str(self.summary["estimators"][0]["name"])


def read_runs(folders: Sequence[Path]) -> list[Run]:
    """Read run folders.

    Raises
    ------
    InputError
        If there are fewer than two or too many, one is not a whole run, or is of a newer program.
    """
    if not 2 <= len(folders) <= MOST_FOLDERS:
        raise InputError(f"compare: needs 2 to {MOST_FOLDERS} run folders (got {len(folders)})")
    names = [Path(os.path.abspath(folder)).name for folder in folders]
    runs = []
    for folder, name in zip(folders, names):
        require_run_folder(folder)
        summary, manifest = (read_object(folder / file) for file in ("summary.json", "manifest.json"))
        require_sound_summary(folder)
        read_arrays(folder / "arrays.npz")
        label = name if names.count(name) == 1 else str(folder)
        versions = manifest.get("versions")
        program = str(versions.get("nebosvod", "unknown")) if isinstance(versions, dict) else "unknown"
        runs.append(Run(label=label, path=str(folder), summary=summary, version=program))
    if len({run.label for run in runs}) < len(runs):
        raise InputError("compare: one folder is named twice")
    return runs


def compare(folders: Sequence[Path]) -> dict[str, Any]:
    """Compare run folders; returns what `nebosvod compare --json` prints."""
    runs = read_runs(folders)
    with held_together("compare"):
        return _compared(runs)


def _compared(runs: Sequence[Run]) -> dict[str, Any]:
    predictions = [_prediction(runs, name) for name in _names(run.summary["predictions"] for run in runs)]
    return {
        "schema_version": SCHEMA_VERSION,
        "runs": [_header(run) for run in runs],
        "warnings": [*_warnings(runs), *(row["warning"] for row in predictions if row["warning"])],
        "estimators": [_estimator(runs, name) for name in _names(run.summary["estimators"] for run in runs)],
        "predictions": predictions,
        "budget": _budget([_own(run, "budget") for run in runs], "share_position"),
        "ellipses": [_ellipse(row) for row in predictions if row["comparable"] and row["dimension"] == 2],
    }


def _names(parts: Iterable[Sequence[Mapping[str, Any]]], key: str = "name") -> list[str]:
    """Names that appear anywhere, in the order of their first appearance."""
    return list(dict.fromkeys(str(row[key]) for part in parts for row in part))


def _own(run: Run, part: str) -> list[Mapping[str, Any]]:
    """Rows of a part of the summary that belong to the run's first estimator."""
    return [row for row in run.summary[part] if row["estimator"] == run.estimator]


def _header(run: Run) -> dict[str, Any]:
    keys = ("mission", "title", "object", "reference_epoch_tdb", "n_observations", "telescopes")
    return {
        "label": run.label,
        "path": run.path,
        "nebosvod": run.version,
        "estimator": run.estimator,
        **{key: run.summary[key] for key in keys},
    }


def _warnings(runs: Sequence[Run]) -> list[str]:
    """What makes numbers of these runs different questions."""
    said = []
    questions = {
        "the objects differ": [run.summary["object"] for run in runs],
        "the reference epochs differ, so the sigmas of the orbit do not compare": [
            run.summary["reference_epoch_tdb"] for run in runs
        ],
        "they were made by different versions of the program": [run.version for run in runs],
        "their first estimators differ": [run.estimator for run in runs],
    }
    for words, answers in questions.items():
        if len(set(answers)) > 1:
            said.append(f"{words}: " + "; ".join(f"{run.label}: {answer}" for run, answer in zip(runs, answers)))
    said += _physics(runs)
    for run in runs:
        said += [
            f"{run.label}: {row['name']} did not converge ({row['status']})"
            for row in run.summary["estimators"]
            if row["status"] != "converged"
        ]
    return said


def _physics(runs: Sequence[Run]) -> list[str]:
    """Forces that differ, by name."""
    every = [run.summary.get("physics", {}) for run in runs]
    keys = dict.fromkeys(key for physics in every for key in physics)
    differ = [key for key in keys if len({json.dumps(physics.get(key), sort_keys=True) for physics in every}) > 1]
    return [f"the forces differ in {', '.join(differ)}"] if differ else []


def _estimator(runs: Sequence[Run], name: str) -> dict[str, Any]:
    """Sigmas of one estimator in every run that has it."""
    keys = ("method", "status", "sigma_position_km", "sigma_velocity_m_s", "sigma_formal_position_km")
    by_run: list[Found] = []
    for run in runs:
        row = next((row for row in run.summary["estimators"] if row["name"] == name), None)
        by_run.append(None if row is None else {key: row[key] for key in keys})
    return {"name": name, "by_run": by_run, "ratio_position": _ratios(by_run, "sigma_position_km")}


def _ratios(by_run: Sequence[Found], key: str) -> list[float | None]:
    """Each number over the first one that there is."""
    values = [None if row is None else row[key] for row in by_run]
    first = next((value for value in values if value), None)
    return [None if value is None or first is None else value / first for value in values]


def _prediction(runs: Sequence[Run], name: str) -> dict[str, Any]:
    """One prediction in every run that has it, by the run's first estimator."""
    rows = [next((row for row in answered(_own(run, "predictions")) if row["name"] == name), None) for run in runs]
    there = [(run, row) for run, row in zip(runs, rows) if row is not None]
    planes = {str(row["plane"]) for _, row in there}
    targets = {str(row.get("body") or row.get("telescope") or "") for _, row in there}
    units = [unit_of(row) for _, row in there]
    warning = ""
    if not there:
        warning = f"{name}: {_why_none(runs, name)}"
    elif len(planes) > 1:
        warning = f"{name}: the planes differ ({', '.join(sorted(planes))}); its sigmas do not compare"
    elif len(targets) > 1:
        warning = f"{name}: seen from or at different places ({', '.join(sorted(targets))}); its sigmas do not compare"
    elif _other_place([row for _, row in there]):
        warning = f"{name}: seen from different places of the same name; its sigmas do not compare"
    elif _far_apart([str(row["epoch_tdb"]) for _, row in there]):
        epochs = "; ".join(f"{run.label}: {row['epoch_tdb']}" for run, row in there)
        warning = f"{name}: the epochs differ ({epochs}); its sigmas do not compare"
    elif len(there) < len(runs):
        warning = f"{name}: only in {', '.join(run.label for run, _ in there)}{_elsewhere(runs, name)}"
    by_run = [None if row is None else _numbers(row) for row in rows]
    return {
        "name": name,
        "plane": sorted(planes)[0] if len(planes) == 1 else None,
        "unit": units[0] if len(set(units)) == 1 else None,
        "dimension": len(there[0][1][f"sigma_{units[0]}"]) if there else 0,
        "comparable": "do not compare" not in warning and len(there) > 1 and len(set(units)) == 1,
        "warning": warning,
        "by_run": by_run,
        "ratio": _ratios(by_run, "sigma_total"),
        "budget": _budget([[] if row is None else row["budget"] for row in rows], "share_total"),
    }


def _why_none(runs: Sequence[Run], name: str) -> str:
    """Why no run has a prediction."""
    said = [row["reason"] for run in runs for row in without_answer(_own(run, "predictions")) if row["name"] == name]
    return f"no answer: {said[0]}" if said else "no first estimator predicts it"


def _elsewhere(runs: Sequence[Run], name: str) -> str:
    """What the runs say in which a prediction does not exist for the orbit."""
    rows = [(run, row) for run in runs for row in without_answer(_own(run, "predictions")) if row["name"] == name]
    return "".join(f"; {run.label}: no answer: {row['reason']}" for run, row in rows)


def _numbers(row: Mapping[str, Any]) -> dict[str, Any]:
    """What is compared of a prediction; sigma_total is the root trace."""
    unit = unit_of(row)
    size = len(row[f"sigma_{unit}"])
    return {
        "estimator": row["estimator"],
        "epoch_tdb": row["epoch_tdb"],
        "unit": unit,
        "sigma": row[f"sigma_{unit}"],
        "sigma_total": float(np.linalg.norm(row[f"sigma_{unit}"])),
        "sigma_formal_total": float(np.linalg.norm(row[f"sigma_formal_{unit}"])),
        "semi_axes": row[f"semi_axes_{unit}"],
        "angle_deg": row.get("angle_deg"),
        "mean": row.get(f"mean_{unit}") or [0.0] * size,
        "covariance": row[f"covariance_{unit}2"],
        "factor": row.get(f"factor_{unit}"),
    }


def _other_place(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a prediction on the sky is seen from distances that no error of the orbit explains."""
    distances = [float(row["distance_km"]) for row in rows if row["plane"] == "sky" and "distance_km" in row]
    return bool(distances) and max(distances) > (1.0 + SAME_DISTANCE) * min(distances)


def _far_apart(epochs: Sequence[str]) -> bool:
    """More than a minute between the epochs of one prediction (an encounter's depends on the orbit a little)."""
    from nebosvod.timescale import Epoch

    times = [Epoch.parse(epoch) for epoch in epochs]
    return any(abs(time - times[0]) > 60.0 for time in times)


def _budget(parts: Sequence[Sequence[Mapping[str, Any]]], key: str) -> list[dict[str, Any]]:
    """Shares of every source in every run, the largest anywhere first; 0 where a run has no such source."""
    rows = []
    for source in _names(parts, "source"):
        shares = [next((float(row[key]) for row in part if row["source"] == source), 0.0) for part in parts]
        rows.append({"source": source, "share": shares})
    return sorted(rows, key=lambda row: -max(row["share"]))


def shown_budget(rows: Sequence[Mapping[str, Any]], telescopes: Sequence[str], most: int) -> list[dict[str, Any]]:
    """The sources with the largest shares, then the others of each kind together, without what would be shown as 0.

    Parameters
    ----------
    rows : of a `budget` of a comparison, largest share first; telescopes : of all its runs.
    """
    shown = [dict(row) for row in rows[:most]]
    named = {kind_of(row["source"], list(telescopes)) for row in shown}
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows[most:]:
        kinds.setdefault(kind_of(row["source"], list(telescopes)), []).append(row)
    rest: list[dict[str, Any]] = []
    for kind, members in kinds.items():
        words = "others together" if kind in named else "together"
        source = members[0]["source"] if len(members) == 1 else f"{kind}, {len(members)} {words}"
        shares = [sum(column) for column in zip(*(row["share"] for row in members))]
        rest.append({"source": source, "share": shares})
    rest.sort(key=lambda row: -max(row["share"]))
    return [row for row in [*shown, *rest] if max(row["share"]) >= SMALLEST_SHARE]


def _ellipse(row: Mapping[str, Any]) -> dict[str, Any]:
    """For a figure: one-sigma ellipses of a prediction over each other."""
    keys = ("mean", "covariance", "factor", "semi_axes", "angle_deg")
    shown = [None if one is None else {key: one[key] for key in keys} for one in row["by_run"]]
    return {"name": row["name"], "plane": row["plane"], "unit": row["unit"], "sigma_level": 1.0, "by_run": shown}
