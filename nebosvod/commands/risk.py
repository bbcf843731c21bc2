"""`nebosvod risk`: whether an orbit may hit the Earth or the Moon, and how probable that is."""

from pathlib import Path
from typing import Literal

import click

from nebosvod.errors import InputError

Coordinates = Literal["cartesian", "equinoctial"]


@click.command()
@click.argument("orbit")
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
    import time

    from nebosvod.commands.progress import stages
    from nebosvod.commands.risk_answer import asked_bodies, asked_date, asked_size, print_risk
    from nebosvod.commands.risk_history import NIGHTLY, records_of, told
    from nebosvod.dynamics import Ephemeris
    from nebosvod.impacts.risk import risk as search
    from nebosvod.results.result import json_text
    from nebosvod.results.risk_folder import risk_result, summarise
    from nebosvod.scene.orbit import read_orbit

    started = time.time()
    last, targets = asked_date("until", until), asked_bodies(bodies)
    since = None if on is None else asked_date("on", on)
    if not 1 <= draws <= 10_000_000:
        raise InputError(f"--draws: {draws} (allowed: 1 to 10000000)")
    if seed < 0:
        raise InputError(f"--seed: {seed} (allowed: 0 or more)")
    recorded = records_of(orbit) if history else None
    given, ephemeris = read_orbit(orbit), Ephemeris.load()
    size = asked_size(given.magnitude, diameter, density)
    with stages() as progress:
        found = search(
            given, last, ephemeris, bodies=targets, on=since, draws=draws, seed=seed, coordinates=coordinates,
            diameter_km=None if size is None else size.diameter_km, say=progress,
        )  # fmt: skip
        summary = summarise(found, targets, seed, size)
        if recorded is not None:
            summary |= told(recorded, found, summary, ephemeris, min(draws, NIGHTLY), seed, progress)
        if output is not None:
            from nebosvod.report.pages import report_text
            from nebosvod.results.result import OwnedFolder

            with OwnedFolder(output, report_text, overwrite=overwrite) as target:
                target.publish(risk_result(summary, found, ephemeris, orbit, started))
    if as_json:
        click.echo(json_text(summary), nl=False)
    else:
        print_risk(summary, output)
    return 0
