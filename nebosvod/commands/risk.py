"""`nebosvod risk`: whether an orbit may hit the Earth or the Moon, and how probable that is."""

from pathlib import Path
from typing import Literal

import click

from nebosvod.commands import completion

Coordinates = Literal["cartesian", "equinoctial"]


@click.command()
@click.argument("orbit", shell_complete=completion.orbits)
@click.option("--until", required=True, help="Last date, UTC.")
@click.option("--bodies", default="earth,moon", show_default=True, help="What may be hit: planets and moon, by commas.")
@click.option("--on", help="From when the years of the Palermo scale count, UTC; the last observation by default.")
@click.option("--draws", default=10_000, show_default=True, help="Orbits of the plain sampling.")
@click.option(
    "--coordinates",
    default="cartesian",
    show_default=True,
    type=click.Choice(["cartesian", "equinoctial"]),
    help="In which the uncertainty is an ellipsoid.",
)
@click.option("--diameter", help="Of the object, such as 490 m; from H with albedo 0.154 by default.")
@click.option("--density", type=float, help="kg/m3; 2600 by default.")
@click.option("--seed", default=1, show_default=True, help="Of the random draws.")
@click.option("--history", is_flag=True, help="Also how it came: of the folder of a fit, after each of its nights.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write a folder: JSON, draws, a page.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier answer in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and nothing else, on stdout.")
def risk(
    orbit: str, until: str, bodies: str, on: str | None, draws: int, coordinates: Coordinates, diameter: str | None,
    density: float | None, seed: int, history: bool, output: Path | None, overwrite: bool, as_json: bool,
) -> int:  # fmt: skip
    """How probable it is that ORBIT hits, by several ways, for each virtual impactor.

    ORBIT has a covariance: the folder of a fit or a run, a mission, SBDB JSON (cov=mat), .ke0 .ke1 .eq0 .fel,
    mpc_orb.json, or an OEM.

    \b
    Example:  nebosvod risk 2024YR4.ke0 --until 2033-01-01 -o yr4-risk
    Example:  nebosvod risk 2027AB-fit --until 2040-01-01 --history
    """
    from nebosvod.commands.orbit_work import risk_of
    from nebosvod.commands.progress import stages
    from nebosvod.commands.risk_answer import print_risk
    from nebosvod.results.result import json_text

    with stages() as progress:
        made = risk_of(
            orbit, until, bodies, on, draws, coordinates, diameter, density, seed, history, progress
        )  # fmt: skip
        if output is not None:
            from nebosvod.report.pages import report_text
            from nebosvod.results.result import OwnedFolder

            with OwnedFolder(output, report_text, overwrite=overwrite) as target:
                target.publish(made.result)
    if as_json:
        click.echo(json_text(made.summary), nl=False)
    else:
        print_risk(made.summary, output)
    return 0
