"""What a plan says on a terminal: the next measurement of each telescope, then the schedule beside an even one."""

from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from nebosvod.errors import counted
from nebosvod.planning.advice import CRITERIA, UNITS, advice, short_epoch


def print_plan(found: Mapping[str, Any], console: Console | None = None) -> None:
    """Print advice: best epochs and windows, greedy schedule, even schedule, and one sentence."""
    out = console or Console(highlight=False, soft_wrap=True)
    which, unit = found["criterion"], UNITS.get(found["unit"], found["unit"])
    out.print(f"[bold]{escape(found['title'])}[/bold]")
    asked = found["prediction"]
    now = found["sigma_now"][which]
    out.print(escape(f"{asked['name']} ({asked['plane']}, {asked['epoch_tdb']}), estimator {found['estimator']}"))
    out.print(f"sigma ({CRITERIA[which]}) with {counted(found['n_observations'], 'measurement')}: {now:.4g} {unit}")
    out.print(_windows(found, which, unit))
    out.print(_schedules(found, which, unit))
    out.print(escape(advice(found)))
    for warning in found["warnings"]:
        out.print(f"warning: {escape(warning)}")


def table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    """An empty table of the terminal: columns of words, then of numbers."""
    made = Table(title=title, title_justify="left", title_style="", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in left:
        made.add_column(heading)
    for heading in right:
        made.add_column(heading, justify="right")
    return made


def _windows(found: Mapping[str, Any], which: str, unit: str) -> Table:
    rows = table(
        "Next measurement (epochs TDB)",
        ("telescope", "best epoch", "good from", "good until"),
        (f"sigma, {unit}", "less by", f"{unit}/h"),
    )
    for row in found["windows"]:
        first, last = (short_epoch(epoch)[5:] for epoch in row["window_tdb"])
        less, hourly = f"{row['reduction_percent'][which]:.2g} %", f"{row['reduction_per_hour']:.3g}"
        sigma = f"{row['sigma_after'][which]:.4g}"
        rows.add_row(escape(row["telescope"]), short_epoch(row["epoch_tdb"]), first, last, sigma, less, hourly)
    return rows


def _schedules(found: Mapping[str, Any], which: str, unit: str) -> Table:
    rows = table(f"Schedule, chosen and even (epochs TDB, sigma in {unit})", ("", "chosen", "epoch"), ("sigma",))
    for heading in ("even", "epoch"):
        rows.add_column(heading)
    rows.add_column("sigma", justify="right")
    for number, (one, other) in enumerate(zip(found["greedy"][which], found["uniform"]), start=1):
        cells = [
            cell
            for row in (one, other)
            for cell in (escape(row["telescope"]), short_epoch(row["epoch_tdb"]), f"{row['sigma_after'][which]:.4g}")
        ]
        rows.add_row(str(number), *cells)
    return rows
