"""`nebosvod check`: is a file right, what does it mean, and what will it cost."""

import click


@click.command()
@click.argument("mission")
def check(mission: str) -> int:
    """Validate MISSION, print what it resolves to and what it will cost; run nothing."""
    from nebosvod.commands.check_answer import describe
    from nebosvod.mission import FitMission, load_any

    loaded = load_any(mission)
    # the files it names are opened: a damaged one is told before a run
    if loaded.ephemeris_path is not None or isinstance(loaded, FitMission):
        from nebosvod.scene.scene import load_ephemeris, require_epochs

        require_epochs(loaded, ephemeris := load_ephemeris(loaded))
    if isinstance(loaded, FitMission):
        from nebosvod.commands.check_fit_answer import describe_fit
        from nebosvod.scene.material import looked_at

        records = looked_at(loaded, ephemeris)
        click.echo(describe_fit(loaded, records))
        for notice in records.notices:
            click.echo(f"notice: {notice}", err=True)
        return 0
    if any(getattr(telescope.orbit, "file", None) for telescope in loaded.telescopes):
        from nebosvod.scene.instruments import telescopes

        telescopes(loaded)
    click.echo(describe(loaded))
    return 0
