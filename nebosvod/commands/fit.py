"""`nebosvod fit`: real observations in, an orbit out."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import EXIT_QUALITY, InputError


@click.command()
@click.argument("files", nargs=-1, metavar="FILE...", shell_complete=completion.files)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder [default: ./<name>-fit].")
@click.option(
    "--object",
    "designations",
    multiple=True,
    help="Any designation of the object to fit, where files hold several; again for each name that is to be joined.",
)
@click.option("--from", "since", help="Leave out earlier observations: a date, UTC.")
@click.option("--to", "until", help="Leave out observations at this date, UTC, and later.")
@click.option("--split", is_flag=True, help="Fit every object of the files by itself, a folder for each.")
@click.option(
    "--export", is_flag=True, help="Also write the orbit as orbit.oem (CCSDS, with covariance) and orbit.bsp."
)
@click.option(
    "--suggest",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the settings that would mend what the tests found, if anything.",
)
@click.option("--overwrite", is_flag=True, help="Replace an earlier fit in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json, and nothing else, on stdout.")
def fit(
    files: tuple[str, ...],
    output: Path | None,
    designations: tuple[str, ...],
    since: str | None,
    until: str | None,
    split: bool,
    export: bool,
    suggest: Path | None,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Fit an orbit to real astrometry: FILE... are observations (ADES or MPC 80-column), or one .yaml with a fit block.

    Exit code 1 when the observations do not give an orbit that can be relied on: not observable, not converged.

    \b
    Example:  nebosvod fit 2023DW.obs80
              nebosvod fit mission.yaml -o dw --overwrite
    """
    from nebosvod.commands.fit_work import fit_every, fit_one, resolved
    from nebosvod.commands.progress import stages

    mission = resolved(files, designations, since, until)
    folder = output if output is not None else Path(f"{mission.slug}-fit")
    if split and suggest is not None:
        raise InputError("--suggest: writes the settings of one object; choose it by --object instead of --split")
    with stages() as progress:
        if split:
            failed = fit_every(mission, folder, overwrite, as_json, export, progress)
        else:
            failed = fit_one(mission, folder, overwrite, as_json, export, progress, suggest)
    return EXIT_QUALITY if failed else 0
