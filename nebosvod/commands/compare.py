"""`nebosvod compare`: run folders side by side."""

from pathlib import Path

import click

from nebosvod.commands import completion


@click.command()
@click.argument(
    "folders", nargs=-1, type=click.Path(path_type=Path), metavar="DIR DIR ...", shell_complete=completion.run_folders
)
@click.option(
    "--page", type=click.Path(path_type=Path), help="Also write tables and overlaid ellipses to this new .html."
)
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as JSON, and nothing else, on stdout.")
def compare(folders: tuple[Path, ...], page: Path | None, as_json: bool) -> int:
    """Show the runs in several folders side by side, and warn where they do not compare.

    Of ephemerides, approaches and risks, offsets, distances and probabilities are compared, time by time and body by
    body; of studies answers, point by point.

    \b
    Example:  nebosvod compare apophis-2029-run apophis-heliocentric-run
    """
    from nebosvod.borders.stored import held_together
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.compare_answer import print_comparison
    from nebosvod.commands.compare_orbits_answer import print_orbit_comparison
    from nebosvod.results.compare import compare as compare_runs
    from nebosvod.results.compare_orbits import compare_orbits, kind_of_folders
    from nebosvod.results.ownership import changed_said
    from nebosvod.results.result import json_text
    from nebosvod.studies.comparison import all_studies

    require_places(page)
    if all_studies(folders):
        return _of_studies(folders, page, as_json)
    if (kind := kind_of_folders(folders)) is not None:
        with held_together("compare"):
            orbits = compare_orbits(folders, kind)
            for sentence in (sentence for folder in folders for sentence in changed_said(folder)):
                click.echo(f"notice: {sentence}", err=True)
            if page is not None:
                from nebosvod.report.orbit_comparison_page import make_orbit_comparison_page

                write_new_text(page, make_orbit_comparison_page(orbits))
            click.echo(json_text(orbits), nl=False) if as_json else print_orbit_comparison(orbits)
        return 0
    found = compare_runs(folders)
    for sentence in (sentence for folder in folders for sentence in changed_said(folder)):
        click.echo(f"notice: {sentence}", err=True)
    if page is not None:
        from nebosvod.report.comparison_page import make_comparison_page

        with held_together("compare"):
            text = make_comparison_page(found)
        write_new_text(page, text)
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        with held_together("compare"):
            print_comparison(found)
    return 0


def _of_studies(folders: tuple[Path, ...], page: Path | None, as_json: bool) -> int:
    """Studies side by side."""
    from nebosvod.commands.study_answer import print_studies
    from nebosvod.errors import InputError
    from nebosvod.results.result import json_text
    from nebosvod.studies.comparison import compare_studies

    if page is not None:
        raise InputError("--page: there is no page of compared studies; each folder has its own study.html")
    found = compare_studies(folders)
    click.echo(json_text(found), nl=False) if as_json else print_studies(found)
    return 0
