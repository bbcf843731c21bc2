"""`nebosvod compare`: run folders side by side."""

from pathlib import Path

import click


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path), metavar="DIR DIR ...")
@click.option(
    "--page", type=click.Path(path_type=Path), help="Also write tables and overlaid ellipses to this new .html."
)
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as JSON, and nothing else, on stdout.")
def compare(folders: tuple[Path, ...], page: Path | None, as_json: bool) -> int:
    """Show the runs in several folders side by side, and warn where they do not compare.

    \b
    Example:  nebosvod compare apophis-2029-run apophis-heliocentric-run
    """
    from nebosvod.borders.stored import held_together
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.compare_answer import print_comparison
    from nebosvod.results.compare import compare as compare_runs
    from nebosvod.results.ownership import changed_said
    from nebosvod.results.result import json_text

    require_places(page)
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
