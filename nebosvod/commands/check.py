"""`nebosvod check`: is a file right, what does it mean, and what will it cost."""

from collections.abc import Callable, Mapping
from typing import Any

import click


@click.command()
@click.argument("mission")
def check(mission: str) -> int:
    """Validate MISSION, print what it resolves to and what it will cost; run nothing."""
    from nebosvod.commands import check_answer, check_fit_answer
    from nebosvod.mission import load_any

    loaded = load_any(mission)
    answers: Mapping[str, Callable[[Any], tuple[str, tuple[str, ...]]]] = {
        "mission": check_answer.answer, "fit": check_fit_answer.answer
    }  # fmt: skip
    said, notices = answers[loaded.kind](loaded)
    click.echo(said)
    for notice in notices:
        click.echo(f"notice: {notice}", err=True)
    return 0
