"""`nebosvod run`: a mission in, its run folder and the answer out."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import EXIT_QUALITY


@click.command()
@click.argument("mission", shell_complete=completion.missions)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder [default: ./<mission name>-run].")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of the simulation.")
@click.option("--nominal", is_flag=True, help="Draw no error: the accuracy about the reference orbit itself.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier run in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json, and nothing else, on stdout.")
def run(mission: str, output: Path | None, seed: int, nominal: bool, overwrite: bool, as_json: bool) -> int:
    """Run MISSION (a file or a built-in name) and write its run folder and report.

    \b
    Example:  nebosvod run apophis-2029 -o apophis --seed 1
    """
    from nebosvod.commands.progress import stages
    from nebosvod.mission import load_mission
    from nebosvod.report.pages import report_text
    from nebosvod.results.result import OwnedFolder, default_folder

    loaded = load_mission(mission)
    folder = output if output is not None else default_folder(loaded.slug)
    with stages() as progress, OwnedFolder(folder, report_text, overwrite=overwrite) as target:
        from nebosvod.pipeline import run as run_mission

        result = run_mission(loaded, seed=seed, progress=progress, nominal=nominal)
        progress("writing the run folder and its report")
        target.publish(result)
    if as_json:
        click.echo(result.summary_text(), nl=False)
    else:
        from nebosvod.commands.run_answer import print_answer

        print_answer(result.summary, folder)
    return EXIT_QUALITY if result.failed else 0
