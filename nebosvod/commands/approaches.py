"""`nebosvod approaches`: what an orbit comes near to, and how near."""

from pathlib import Path

import click

from nebosvod.errors import InputError


@click.command()
@click.argument("orbit")
@click.option("--from", "since", required=True, help="First date, UTC.")
@click.option("--to", "until", required=True, help="Last date, UTC.")
@click.option("--within", default="0.1 au", show_default=True, help="Only nearer than this, in au or km.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write a folder: tables, JSON, a page.")
@click.option("--overwrite", is_flag=True, help="Replace earlier approaches in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print them as JSON, and nothing else, on stdout.")
def approaches(
    orbit: str, since: str, until: str, within: str, output: Path | None, overwrite: bool, as_json: bool
) -> int:
    """Every approach of ORBIT to planets and the Moon: when, how near, with sigmas, b-plane and chance of impact.

    ORBIT has a covariance: the folder of a fit or a run, a mission, SBDB JSON (cov=mat), .ke0 .ke1 .eq0 .fel,
    mpc_orb.json, or an OEM.

    \b
    Example:  nebosvod approaches 2024YR4.ke0 --from 2024-01-01 --to 2040-01-01
    """
    import time

    from nebosvod.commands.approaches_answer import print_approaches
    from nebosvod.commands.ephemeris_answer import asked_dates
    from nebosvod.commands.progress import stages
    from nebosvod.dynamics import Ephemeris
    from nebosvod.impacts.approaches import approaches as search
    from nebosvod.results.approaches_folder import approaches_result, summarise
    from nebosvod.results.result import json_text
    from nebosvod.scene.orbit import read_orbit
    from nebosvod.units import AU_KM, LENGTH, quantity

    started = time.time()
    first, last = asked_dates(since, until)
    try:
        within_au = quantity(within, LENGTH) / AU_KM
    except InputError as error:
        raise InputError(f"--within: {error}") from None
    given, bodies = read_orbit(orbit), Ephemeris.load()
    with stages() as progress:
        progress("flying the orbit and looking for approaches")
        found = search(given, first, last, within_au, bodies)
        summary = summarise(given, found, first, last, within_au)
        if output is not None:
            from nebosvod.report.pages import report_text
            from nebosvod.results.result import OwnedFolder

            with OwnedFolder(output, report_text, overwrite=overwrite) as target:
                target.publish(approaches_result(summary, found, bodies, orbit, started))
    if as_json:
        click.echo(json_text(summary), nl=False)
    else:
        print_approaches(summary, output)
    return 0
