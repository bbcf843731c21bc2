"""The short answer of a run on a terminal: status, sigmas, predictions, the first entries of the budget."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

BUDGET_ROWS = 6
UNITS = {"m_s": "m/s"}  # as read, where the key cannot say it


def print_answer(summary: Mapping[str, Any], folder: Path, console: Console | None = None) -> None:
    """Print what a reader wants first, and where the report is."""
    out = console or Console(highlight=False, soft_wrap=True)
    out.print(f"[bold]{_plain(summary['title'])}[/bold]")
    out.print(f"{summary['n_observations']} measurements; reference epoch {summary['reference_epoch_tdb']}")
    out.print(_estimators(summary))
    if summary["predictions"]:
        out.print(_predictions(summary))
    if summary["budget"]:
        out.print(_budget(summary))
    for warning in summary["warnings"]:
        out.print(f"warning: {_plain(warning)}")
    out.print(f"report: {_plain(str(folder / 'report.html'))}")


def _plain(text: str) -> str:
    """Text in which rich sees no markup."""
    return text.replace("[", r"\[")


def _table(title: str, left: str, *right: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="", box=SIMPLE, pad_edge=False)
    table.add_column(left)
    for heading in right:
        table.add_column(heading, justify="right")
    return table


def _number(value: float | None) -> str:
    """Three significant digits, or a dash where there is no number."""
    return "-" if value is None else f"{value:.3g}" if abs(value) < 1e6 else f"{value:.3e}"


def _estimators(summary: Mapping[str, Any]) -> Table:
    table = _table(
        "Orbit at the reference epoch, 1 sigma (root trace)",
        "estimator",
        "status",
        "position, km",
        "velocity, m/s",
        "formal position, km",
    )
    for row in summary["estimators"]:
        sigmas = (row["sigma_position_km"], row["sigma_velocity_m_s"], row["sigma_formal_position_km"])
        table.add_row(_plain(row["name"]), row["status"], *(_number(sigma) for sigma in sigmas))
    return table


def _predictions(summary: Mapping[str, Any]) -> Table:
    first = summary["predictions"][0]["estimator"]
    table = _table(f"Predictions of {_plain(first)}, 1 sigma", "prediction", "plane", "semi-axes or sigma")
    for row in summary["predictions"]:
        if row["estimator"] != first:
            continue
        unit = next(key.removeprefix("semi_axes_") for key in row if key.startswith("semi_axes_"))
        axes, shown = row[f"semi_axes_{unit}"], UNITS.get(unit, unit)
        table.add_row(_plain(row["name"]), row["plane"], " x ".join(_number(axis) for axis in axes) + f" {shown}")
    return table


def _budget(summary: Mapping[str, Any]) -> Table:
    first = summary["budget"][0]["estimator"]
    rows = sorted(
        (row for row in summary["budget"] if row["estimator"] == first), key=lambda row: -row["share_position"]
    )
    table = _table(
        f"What is to blame for the position sigma of {_plain(first)}",
        "source",
        "share",
        "position, km",
        "velocity, m/s",
    )
    for row in rows[:BUDGET_ROWS]:
        share = f"{100.0 * row['share_position']:.1f} %"
        sigmas = (row["sigma_position_km"], row["sigma_velocity_m_s"])
        table.add_row(_plain(row["source"]), share, *(_number(sigma) for sigma in sigmas))
    return table
