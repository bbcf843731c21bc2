"""`nebosvod approaches`: what an orbit comes near to, and how near."""

from pathlib import Path

import click

from nebosvod.commands import completion


@click.command()
@click.argument("orbit", shell_complete=completion.orbits)
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
    from nebosvod.commands.approaches_answer import print_approaches
    from nebosvod.commands.orbit_work import approaches_of
    from nebosvod.commands.progress import stages
    from nebosvod.results.result import json_text

    with stages() as progress:
        made = approaches_of(orbit, since, until, within, progress)
        if output is not None:
            from nebosvod.report.pages import report_text
            from nebosvod.results.result import OwnedFolder

            with OwnedFolder(output, report_text, overwrite=overwrite) as target:
                target.publish(made.result)
    if as_json:
        click.echo(json_text(made.summary), nl=False)
    else:
        print_approaches(made.summary, output)
    return 0
