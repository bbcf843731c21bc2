"""What a validation says on a terminal when it is done: a table of verdicts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from nebosvod.errors import counted


def print_validation(found: Mapping[str, Any], folder: Path, console: Console | None = None) -> None:
    """Print the verdict, a table by estimator and covariance, and where the numbers are."""
    out = console or Console(highlight=False, soft_wrap=True)
    out.print(f"[bold]{escape(found['title'])}[/bold]")
    measured = counted(found["n_observations"], "measurement")
    out.print(f"{found['n_runs']} runs, seed {found['seed']}, {found['mode']}; {measured}")
    table = Table(box=SIMPLE, pad_edge=False)
    for heading in ("estimator", "judged with", "claimed", "NEES/6", "50 %", "90 %", "99 %", "passed"):
        table.add_column(heading, justify="left" if heading in ("estimator", "judged with") else "right")
    for row in found["estimators"]:
        for name, judged in row["judged"].items():
            inside = (f"{100.0 * level['value']:.1f}" for level in judged["coverage"])
            claimed, passed = ("yes" if judged[key] else "no" for key in ("claimed", "consistent"))
            nees = f"{judged['nees']['value']:.3f}"
            table.add_row(escape(row["name"]), f"K_{name}", claimed, nees, *inside, passed)
    out.print(table)
    for row in found["estimators"]:
        for name, judged in row["judged"].items():
            out.print(escape(f"{row['name']}, K_{name}: {judged['verdict']}"))
        if not row["passed"]:
            out.print(escape(f"{row['name']}: {row['reason']}"))
    out.print(_resolution(found))
    out.print(f"{'passed' if found['passed'] else 'FAILED'}: {escape(found['verdict'])}")
    out.print(f"numbers: {escape(str(folder / 'validation.json'))}")


def _resolution(found: Mapping[str, Any]) -> str:
    """How small an error of a sigma these runs can see."""
    percents = [judged["resolution_percent"] for row in found["estimators"] for judged in row["judged"].values()]
    if not percents:
        return "no estimator could be judged"
    return f"a sigma wrong by {max(percents):.2g} % in one direction is seen in every second such campaign"
