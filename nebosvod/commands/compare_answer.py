"""What a comparison says on a terminal: warnings first, then one column for each run."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from nebosvod.errors import counted, listed
from nebosvod.results.compare import shown_budget

UNITS = {"m_s": "m/s", "km2_s2": "km^2/s^2", "deg_d": "deg/d", "1": ""}
BUDGET_ROWS = 8
SAME = 1e-3  # sigmas that differ by less are told as one


def print_comparison(found: Mapping[str, Any], console: Console | None = None) -> None:
    """Print warnings, runs, sigmas of orbit and predictions, and what is to blame in each."""
    out = console or Console(highlight=False, soft_wrap=True)
    for line in leading_lines(found):
        out.print(escape(line), style="bold")
    for run in found["runs"]:
        by = listed(run["telescopes"])
        said = f"{run['label']}: {run['object']}, {counted(run['n_observations'], 'measurement')} by {by}"
        out.print(escape(f"{said}; estimator {run['estimator']}"))
    for warning in found["warnings"]:
        out.print(f"warning: {escape(warning)}")
    labels = [run["label"] for run in found["runs"]]
    out.print(_estimators(found, labels))
    if found["predictions"]:
        out.print(_predictions(found, labels))
    telescopes = sorted({name for run in found["runs"] for name in run["telescopes"]})
    blamed = [("the position sigma", found["budget"])]
    blamed += [(row["name"], row["budget"]) for row in found["predictions"] if row["comparable"]]
    for what, rows in blamed:
        shown = shown_budget(rows, telescopes, BUDGET_ROWS)
        out.print(_shares(f"What is to blame for {escape(what)}, %", shown, labels))


def leading_lines(found: Mapping[str, Any]) -> list[str]:
    """The answer: of each prediction that can be compared, else of the position, which run knows it best and why."""
    labels = [run["label"] for run in found["runs"]]
    lines = []
    for row in found["predictions"]:
        known = [(one["sigma_total"], k) for k, one in enumerate(row["by_run"]) if one is not None]
        if row["comparable"] and len(known) > 1:
            unit = UNITS.get(row["by_run"][known[0][1]]["unit"], row["by_run"][known[0][1]]["unit"])
            lines.append(_best(f"{row['name']} ({row['plane']})", known, unit, row["budget"], labels))
    apart = any(text.startswith("the reference epochs differ") for text in found["warnings"])
    if lines or apart or not found["estimators"]:
        return lines
    first = found["estimators"][0]["by_run"]
    known = [(one["sigma_position_km"], k) for k, one in enumerate(first) if one and one["sigma_position_km"]]
    return [_best("position at the reference epoch", known, "km", found["budget"], labels)] if len(known) > 1 else []


def _best(
    what: str,
    known: Sequence[tuple[float, int]],
    unit: str,
    budget: Sequence[Mapping[str, Any]],
    labels: Sequence[str],
) -> str:
    """`encounter (b_plane): A is best, 1.2 km (1 sigma); B 2.4 km, x2, above all by bias`."""
    (sigma, best), *others = sorted(known)
    if all(one <= sigma * (1.0 + SAME) for one, _ in others):
        return f"{what}: the same in all, {_number(sigma)} {unit} (1 sigma)".rstrip()
    told = []
    for worse, k in others:
        more = [(row["share"][k] * worse**2 - row["share"][best] * sigma**2, row["source"]) for row in budget]
        cause = max(more, default=(0.0, ""))
        why = f", above all by {cause[1]}" if cause[0] > 0.5 * (worse**2 - sigma**2) else ""
        told.append(f"{labels[k]} {_number(worse)} {unit}, x{worse / sigma:.3g}{why}")
    return f"{what}: {labels[best]} is best, {_number(sigma)} {unit} (1 sigma); {'; '.join(told)}"


def _table(title: str, left: str, labels: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", title_style="", box=SIMPLE, pad_edge=False)
    table.add_column(left)
    for label in labels:
        table.add_column(escape(label), justify="right")
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _estimators(found: Mapping[str, Any], labels: Sequence[str]) -> Table:
    table = _table("Orbit at the reference epoch, 1 sigma (root trace)", "estimator", labels)
    for key, words in (("sigma_position_km", "position, km"), ("sigma_velocity_m_s", "velocity, m/s")):
        for row in found["estimators"]:
            cells = ["-" if one is None else _number(one[key]) for one in row["by_run"]]
            table.add_row(escape(f"{row['name']}: {words}"), *cells)
    return table


def _predictions(found: Mapping[str, Any], labels: Sequence[str]) -> Table:
    table = _table("Predictions, 1 sigma (root trace) and ratio to the first", "prediction", labels)
    for row in found["predictions"]:
        cells = []
        for one, ratio in zip(row["by_run"], row["ratio"]):
            unit = "" if one is None else " " + UNITS.get(one["unit"], one["unit"])
            times = f" x{ratio:.3g}" if ratio is not None and row["comparable"] else ""
            cells.append("-" if one is None else f"{_number(one['sigma_total'])}{unit}{times}")
        table.add_row(escape(f"{row['name']} ({row['plane'] or 'planes differ'})"), *cells)
    return table


def _shares(title: str, rows: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> Table:
    table = _table(title, "source", labels)
    for row in rows:
        table.add_row(escape(row["source"]), *(f"{100.0 * share:.1f}" for share in row["share"]))
    return table
