"""Options of commands that compute many tasks: how many processes, or which cluster."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from nebosvod.tasks.engine import Workers


def workers_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """`--workers`, `--scheduler` and `--cluster`."""
    options = (
        click.option("--workers", type=click.IntRange(1), help="Processes, or jobs [default: one for each processor]."),
        click.option("--scheduler", default="", metavar="ADDRESS", help="A dask scheduler that runs: tcp://HOST:8786."),
        click.option("--cluster", type=click.Choice(["slurm"]), help="Start workers as jobs of a cluster."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def workers_from(count: int | None, scheduler: str, cluster: str | None) -> "Workers":
    """What the options say."""
    from nebosvod.tasks.engine import Workers, processors

    return Workers(count=count or processors(), scheduler=scheduler, cluster="slurm" if cluster else "")
