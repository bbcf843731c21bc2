"""`nebosvod plan`: what to measure next."""

from pathlib import Path
from typing import Any

import click


@click.command()
@click.argument("mission")
@click.option(
    "--prediction", "-p", help="Name of a prediction of the mission [default: its first encounter, or first]."
)
@click.option("--visits", "-k", type=int, default=5, show_default=True, help="How many visits to schedule.")
@click.option("--estimator", help="Name of an estimator [default: the first].")
@click.option(
    "--criterion",
    type=click.Choice(["a", "d", "minimax", "guaranteed"]),
    default="a",
    show_default=True,
    help="a: root trace; d: area, volume; minimax: worst correlation of errors; guaranteed: each within 3 sigma.",
)
@click.option("--from", "start", help="First candidate epoch, as in a mission file [default: the mission's schedule].")
@click.option("--to", "end", help="Last candidate epoch.")
@click.option("--step", help='From one candidate epoch to the next, as "6 h".')
@click.option("--exposures", type=int, default=1, show_default=True, help="Exposures of a visit.")
@click.option("--spacing", help='From one exposure of a visit to the next, as "1 min".')
@click.option("--visit-time", multiple=True, help='Time of a visit, "2 h" or TELESCOPE="30 min" [default: 1 h].')
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write the result to this new .json file.")
@click.option("--page", type=click.Path(path_type=Path), help="Also write figures and tables to this new .html file.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else, on stdout.")
def plan(
    mission: str,
    prediction: str | None,
    visits: int,
    estimator: str | None,
    criterion: Any,
    start: str | None,
    end: str | None,
    step: str | None,
    exposures: int,
    spacing: str | None,
    visit_time: tuple[str, ...],
    output: Path | None,
    page: Path | None,
    as_json: bool,
) -> int:
    """Find the measurements that would make a PREDICTION of MISSION better, and by how much.

    \b
    Example:  nebosvod plan apophis-2029 --prediction encounter --visits 5
    """
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.plan_answer import print_plan
    from nebosvod.commands.progress import stages
    from nebosvod.mission import load_mission
    from nebosvod.planning.planner import plan as plan_mission
    from nebosvod.planning.planner import read_wish
    from nebosvod.results.result import json_text

    require_places(output, page)
    loaded = load_mission(mission)
    window = (start, end, step)
    wish = read_wish(loaded, prediction, visits, estimator, criterion, window, visit_time, exposures, spacing)
    with stages() as progress:
        found = plan_mission(loaded, wish, progress)
    if output is not None:
        write_new_text(output, json_text(found))
    if page is not None:
        from nebosvod.report.plan_page import make_plan_page

        write_new_text(page, make_plan_page(found))
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        print_plan(found)
    return 0
