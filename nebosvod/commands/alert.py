"""`nebosvod alert`: how likely an impact is, where, and what to look at next, from the first observations on."""

from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import EXIT_QUALITY, InputError


@click.command()
@click.argument("files", nargs=-1, metavar="FILE...", shell_complete=completion.files)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write a folder: JSON, draws, a page.")
@click.option(
    "--object", "designations", multiple=True, help="Any designation of the object, where files hold several."
)
@click.option("--from", "since", help="Leave out earlier observations: a date, UTC.")
@click.option("--to", "until", help="Leave out observations at this date, UTC, and later.")
@click.option("--split", is_flag=True, help="Answer for every object of the files, a line and a folder for each.")
@click.option("--within", default="100 d", show_default=True, help="In which time an impact counts.")
@click.option("--unbound", is_flag=True, help="Count orbits that are not bound to the Sun as well.")
@click.option("--smallest", default="0.3 m", show_default=True, help="Diameter of the smallest object that counts.")
@click.option(
    "--from-site",
    "sites",
    multiple=True,
    help="Where to look next from: an observatory code, MISSION.yaml:TELESCOPE, .oem or .bsp; may be given again. "
    "[default: who observed last]",
)
@click.option(
    "--by", multiple=True, help="Of a mission: count the measurements of this telescope alone; again for more."
)
@click.option("--hours", default="1,3,6,12,24", show_default=True, help="When: hours after the last observation.")
@click.option("--history", "with_history", is_flag=True, help="Also after each observation.")
@click.option("--decide", "with_decision", is_flag=True, help="Also which of these observations would settle it.")
@click.option("--seed", default=1, show_default=True, help="Of the random draws.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier answer in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and nothing else, on stdout.")
def alert(
    files: tuple[str, ...], output: Path | None, designations: tuple[str, ...], since: str | None, until: str | None,
    split: bool, within: str, unbound: bool, smallest: str, sites: tuple[str, ...],
    by: tuple[str, ...], hours: str, with_history: bool, with_decision: bool, seed: int, overwrite: bool, as_json: bool,
) -> int:  # fmt: skip
    """Probability of impact from observations too few for an orbit, under three priors, with what to do next.

    FILE... are observations (ADES or MPC 80-column), or one .yaml with a fit block; or a mission, whose measurements
    are simulated.

    Exit code 1 when nothing can be said: one time of observation, no orbit that fits, too few nodes of the grid.

    \b
    Example:  nebosvod alert 2018LA.txt --to 2018-06-02T08:40 --history
              nebosvod alert night.psv --split -o night
    """
    from nebosvod.commands.alert_made import Asked
    from nebosvod.commands.alert_work import answer_every, answer_one
    from nebosvod.commands.progress import stages

    if split and (with_history or with_decision):
        raise InputError("--split: answers in a line; choose one object by --object for --history or --decide")
    asked = Asked.of(
        within=within, bound=not unbound, smallest=smallest, sites=sites, by=by, hours=hours, seed=seed,
        history=with_history, decide=with_decision, output=output, overwrite=overwrite, as_json=as_json,
    )  # fmt: skip
    with stages() as say:
        if split:
            failed = answer_every(files, designations, since, until, asked, say)
        else:
            failed = answer_one(files, designations, since, until, asked, say)
    return EXIT_QUALITY if failed else 0
