"""What a validation says on a terminal: one line of progress, then a table of verdicts."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from nebosvod.errors import counted


@contextmanager
def progress_line(what: str) -> Iterator[Callable[[int, int], None]]:
    """A function (done, all) that keeps one line on stderr, if that is a terminal; silent otherwise."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    started: list[tuple[float, int]] = []

    def show(done: int, total: int) -> None:
        now = time.monotonic()
        if not started:
            started.append((now, done))
        rate = (done - started[0][1]) / max(now - started[0][0], 1e-9)
        left = f", {(total - done) / rate:.0f} s left" if rate > 0.0 and done < total else ""
        click.echo(f"\r\x1b[K  {done} of {total} {what}{left}", nl=False, err=True)

    try:
        yield show
    except KeyboardInterrupt:
        click.echo("\n  finished runs are kept; the same command continues", err=True)
        raise
    finally:
        if started:
            click.echo("\r\x1b[K", nl=False, err=True)


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
