"""`nebosvod report`: the page of a folder made again."""

from pathlib import Path

import click

from nebosvod.commands import completion


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), shell_complete=completion.run_folders)
@click.option("--pdf", is_flag=True, help="Also print it to report.pdf, by a Chromium of this machine.")
def report(folder: Path, pdf: bool) -> int:
    """(Re)make report.html of the run in FOLDER (of a study study.html), from its files alone."""
    from nebosvod.borders.wholefile import refuse_link
    from nebosvod.report.kit.pdf import print_pdf
    from nebosvod.report.pages import report_text
    from nebosvod.results.result import rewrite_report
    from nebosvod.studies.stored import is_study

    if folder.is_symlink():
        refuse_link(folder, folder.lstat().st_mode)
    if is_study(folder):
        return _of_study(folder, pdf)
    made = rewrite_report(
        folder,
        report_text,
        printer=print_pdf if pdf else None,
        say=lambda sentence: click.echo(f"notice: {sentence}", err=True),
    )
    click.echo(f"report: {made}")
    if pdf:
        click.echo(f"pdf: {folder / 'report.pdf'}")
    return 0


def _of_study(folder: Path, pdf: bool) -> int:
    """The page of a study."""
    from nebosvod.errors import InputError
    from nebosvod.report.study_page import make_study_page
    from nebosvod.studies.stored import rewrite_page

    if pdf:
        raise InputError(f"--pdf: {folder} is a study; print its study.html with a browser")
    made = rewrite_page(folder, make_study_page, lambda sentence: click.echo(f"notice: {sentence}", err=True))
    click.echo(f"report: {made}")
    return 0
