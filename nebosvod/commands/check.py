"""`nebosvod check`: is a file right, what does it mean, and what will it cost."""

import click


@click.command()
@click.argument("mission")
def check(mission: str) -> int:
    """Validate MISSION, print what it resolves to and what it will cost; run nothing."""
    from nebosvod.commands.check_answer import describe
    from nebosvod.mission import FitMission, load_any

    loaded = load_any(mission)
    # files of orbits and weights are opened: a damaged one is told before a run
    if isinstance(loaded, FitMission):
        from nebosvod.commands.check_fit_answer import describe_fit

        if loaded.fit.spacecraft or loaded.fit.weights:
            from nebosvod.scene.material import require_readable

            require_readable(loaded)
        click.echo(describe_fit(loaded))
        return 0
    if any(getattr(telescope.orbit, "file", None) for telescope in loaded.telescopes):
        from nebosvod.scene.instruments import telescopes

        telescopes(loaded)
    click.echo(describe(loaded))
    return 0
