"""`nebosvod study`: a mission varied over many points."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.commands.workers import workers_from, workers_options
from nebosvod.errors import EXIT_QUALITY, InputError


@click.command()
@click.argument("words", nargs=-1, metavar="[check] STUDY.yaml", shell_complete=completion.studies)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder [default: ./<study name>-study].")
@click.option("--check", "only_check", is_flag=True, help="Check the file, say what it costs; run nothing.")
@click.option("--resume", is_flag=True, help="Go on with a study that is there; refuse to begin one.")
@workers_options
@click.option("--overwrite", is_flag=True, help="Replace another study in the same folder.")
@click.option("--parquet", is_flag=True, help="Write the table as Parquet, not ECSV.")
@click.option("--json", "as_json", is_flag=True, help="Print study.json, and nothing else, on stdout.")
def study(
    words: tuple[str, ...],
    output: Path | None,
    only_check: bool,
    resume: bool,
    workers: int | None,
    scheduler: str,
    cluster: str | None,
    overwrite: bool,
    parquet: bool,
    as_json: bool,
) -> int:
    """Vary a mission as STUDY.yaml says; write a folder with one table, and say what was found.

    An interrupted study goes on with the same command, to the same bytes. Exit code 1 when a point failed, or none is
    what the study looks for.

    \b
    Example:  nebosvod study check noise.yaml
              nebosvod study noise.yaml --workers 8
    """
    file, only_check = _file(words, only_check)
    from nebosvod.commands.progress import counting
    from nebosvod.commands.study_answer import print_check, print_study
    from nebosvod.mission.slugs import slug
    from nebosvod.report.study_page import make_study_page
    from nebosvod.results.result import json_text
    from nebosvod.studies.reading import load_study
    from nebosvod.studies.study import run_study

    who = workers_from(workers, scheduler, cluster)
    loaded = load_study(file)
    if only_check:
        print_check(loaded, who.count)
        return 0
    folder = output if output is not None else Path(f"{slug(loaded.name, 'study')}-study")
    with counting("points") as progress:
        found = run_study(
            loaded,
            folder,
            workers=who,
            resume=resume,
            overwrite=overwrite,
            parquet=parquet,
            page=lambda result, table: make_study_page(result, table.columns),
            progress=progress,
            say=lambda sentence: click.echo(f"notice: {sentence}", err=True),
        )
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        print_study(found, folder)
    lost = found["n_failed"] + found["n_without_answer"]
    return EXIT_QUALITY if lost or (found["find"] and not found["find"]["found"]) else 0


def _file(words: tuple[str, ...], only_check: bool) -> tuple[str, bool]:
    """The file, and whether it is only to be checked: `study check FILE` is `study FILE --check`."""
    if len(words) == 2 and words[0] == "check":
        return words[1], True
    if len(words) == 1:
        return words[0], only_check
    raise InputError("study: needs one file: nebosvod study STUDY.yaml, or nebosvod study check STUDY.yaml")
