"""`nebosvod validate`: can the sigmas be believed."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.commands.workers import workers_from, workers_options
from nebosvod.errors import EXIT_QUALITY


@click.command()
@click.argument("mission", shell_complete=completion.missions)
@click.option("--runs", "-n", type=int, default=2000, show_default=True, help="Simulated truths.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder [default: ./<mission name>-validation].")
@workers_options
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of the simulation.")
@click.option("--full", is_flag=True, help="Propagate every truth and iterate every estimate: slower, tests linearity.")
@click.option("--overwrite", is_flag=True, help="Replace another campaign, or a larger one, in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print validation.json, and nothing else, on stdout.")
def validate(
    mission: str,
    runs: int,
    output: Path | None,
    workers: int | None,
    scheduler: str,
    cluster: str | None,
    seed: int,
    full: bool,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Simulate MISSION many times: do the errors look as the sigmas say?

    Every uncertainty is drawn anew in every run; all estimators of the mission see the same runs. An interrupted
    campaign continues with the same command; more --runs add to those that are there. Exit code 1 when an estimator
    is found wrong about its own accuracy.

    \b
    Example:  nebosvod validate minimal --runs 2000
    """
    from nebosvod.commands.progress import counting
    from nebosvod.commands.validate_answer import print_validation
    from nebosvod.mission import load_mission
    from nebosvod.report.validation_page import write_validation_report
    from nebosvod.results.result import json_text

    loaded = load_mission(mission)
    folder = output if output is not None else Path(f"{loaded.slug}-validation")
    with counting("runs") as progress:
        from nebosvod.studies.validation import validate as validate_mission

        found = validate_mission(
            loaded,
            folder,
            runs=runs,
            seed=seed,
            workers=workers_from(workers, scheduler, cluster),
            full=full,
            overwrite=overwrite,
            progress=progress,
            say=lambda sentence: click.echo(f"notice: {sentence}", err=True),
        )
    page = write_validation_report(folder, found)
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        print_validation(found, folder)
        click.echo(f"report: {page}")
    return 0 if found["passed"] else EXIT_QUALITY
