"""`nebosvod ephemeris`: where an orbit is seen, and how well that is known."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import EXIT_QUALITY, InputError


@click.command()
@click.argument("orbit", shell_complete=completion.orbits)
@click.option("--from", "since", required=True, help="First time of reception: a date, UTC.")
@click.option("--to", "until", required=True, help="Last time, included.")
@click.option("--step", default="1 d", show_default=True, help='From one time to the next, as "1 d" or "10 min".')
@click.option(
    "--from-site",
    "site",
    default="500",
    show_default=True,
    help="Who looks: an observatory code (500: geocentre), MISSION.yaml:TELESCOPE, or a spacecraft's .oem or .bsp.",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write a folder: tables, JSON, a page.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier ephemeris in the same folder.")
@click.option("--ecsv", is_flag=True, help="Print the table as ECSV, and nothing else, on stdout.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and nothing else, on stdout.")
def ephemeris(
    orbit: str,
    since: str,
    until: str,
    step: str,
    site: str,
    output: Path | None,
    overwrite: bool,
    ecsv: bool,
    as_json: bool,
) -> int:
    """Directions of ORBIT with rates and ellipses, distances, phase, elongation, brightness; altitude and twilight.

    ORBIT has a covariance: the folder of a fit or a run, a mission, SBDB JSON (cov=mat), .ke0 .ke1 .eq0 .fel,
    mpc_orb.json, or an OEM. Nothing is fitted again.

    Exit code 1 when the orbit hits something, and times after that were asked for.

    \b
    Example:  nebosvod ephemeris 2024YR4.ke0 --from 2028-11-01 --to 2028-12-31 --from-site X05
    """
    from nebosvod.commands.ephemeris_answer import print_ephemeris
    from nebosvod.commands.orbit_work import ephemeris_of
    from nebosvod.results.ephemeris_folder import table
    from nebosvod.results.result import ecsv_text, json_text

    if ecsv and as_json:
        raise InputError("--ecsv and --json: choose one of the two")
    made = ephemeris_of(orbit, since, until, step, site)
    if output is not None:
        from nebosvod.report.pages import report_text
        from nebosvod.results.result import OwnedFolder

        with OwnedFolder(output, report_text, overwrite=overwrite) as target:
            target.publish(made.result)
    if as_json:
        click.echo(json_text(made.summary), nl=False)
    elif ecsv:
        click.echo(ecsv_text(table(made.summary)), nl=False)
    else:
        print_ephemeris(made.summary, output)
    return EXIT_QUALITY if made.summary["ended"] else 0
