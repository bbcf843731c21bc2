"""`nebosvod check`: is a file right, what does it mean, and what will it cost."""

from importlib import import_module

import click

from nebosvod.commands import completion


@click.command()
@click.argument("mission", shell_complete=completion.missions)
def check(mission: str) -> int:
    """Validate MISSION, print what it resolves to and what it will cost; run nothing."""
    from nebosvod.mission import load_any

    loaded = load_any(mission)
    described = import_module(
        "nebosvod.commands." + {"mission": "check_answer", "fit": "check_fit_answer"}[loaded.kind]
    )
    said, notices = described.answer(loaded)
    click.echo(said)
    for notice in notices:
        click.echo(f"notice: {notice}", err=True)
    return 0
