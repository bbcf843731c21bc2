"""`nebosvod plan`: what to measure next, and what the next measurement may decide."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from nebosvod.commands import completion
from nebosvod.errors import InputError

if TYPE_CHECKING:
    from nebosvod.mission import Mission

OF_PREDICTIONS = ("prediction", "visits", "estimator", "criterion", "visit_time")
OF_DECISIONS = ("until", "bodies", "telescope", "sigma", "draws", "truths", "seed", "below", "above")


@click.command()
@click.argument("mission", metavar="MISSION | ORBIT", shell_complete=completion.orbits)
@click.option(
    "--prediction", "-p", shell_complete=completion.named("predictions"),
    help="Name of a prediction of the mission [default: its first encounter, or first].",
)  # fmt: skip
@click.option("--visits", "-k", type=int, default=5, show_default=True, help="How many visits to schedule.")
@click.option(
    "--estimator", shell_complete=completion.named("estimators"), help="Name of an estimator [default: the first]."
)
@click.option(
    "--criterion",
    type=click.Choice(["a", "d", "minimax", "guaranteed"]),
    default="a",
    show_default=True,
    help="a: root trace; d: area, volume; minimax: worst correlation of errors; guaranteed: each within 3 sigma.",
)
@click.option("--from", "start", help="First candidate epoch, as in a mission file [default: of the schedule].")
@click.option("--to", "end", help="Last candidate epoch [default: when what is predicted happens].")
@click.option("--step", help='From one candidate epoch to the next, as "6 h".')
@click.option("--exposures", type=int, default=1, show_default=True, help="Exposures of a visit.")
@click.option("--spacing", help='From one exposure of a visit to the next, as "1 min".')
@click.option("--visit-time", multiple=True, help='Time of a visit, "2 h" or TELESCOPE="30 min" [default: 1 h].')
@click.option("--decide", is_flag=True, help="Foresee the probability that ORBIT hits, after each candidate visit.")
@click.option("--until", help="With --decide: last date of an impact, UTC.")
@click.option("--bodies", default="earth,moon", show_default=True, help="With --decide: what may be hit.")
@click.option(
    "--telescope", "-t", multiple=True,
    help="With --decide: who may observe, an observatory code, MISSION.yaml, MISSION.yaml:NAME or a spacecraft's file "
    "[default: those of the mission or run that ORBIT is].",
)  # fmt: skip
@click.option("--sigma", help='With --decide: of an exposure of a telescope that no mission describes, "0.2 arcsec".')
@click.option("--draws", default=20_000, show_default=True, help="With --decide: orbits of the cloud.")
@click.option("--truths", default=2000, show_default=True, help="With --decide: simulated truths of each visit.")
@click.option("--seed", default=1, show_default=True, help="With --decide: of the random draws.")
@click.option("--below", type=float, help="With --decide: a probability that would clear it [default: a tenth of now].")
@click.option("--above", type=float, help="With --decide: one that would confirm it [default: midway from now to 1].")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write the result to this new .json file.")
@click.option("--page", type=click.Path(path_type=Path), help="Also write figures and tables to this new .html file.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else, on stdout.")
def plan(mission: str, decide: bool, output: Path | None, page: Path | None, as_json: bool, **said: Any) -> int:
    """Find the measurements that would make a PREDICTION of MISSION better, and by how much.

    With --decide: what the probability that ORBIT hits may be after the next visit, and the chance that it falls below
    or rises above a threshold. ORBIT has a covariance: the folder of a fit or a run, a mission, SBDB JSON, and others.

    \b
    Example:  nebosvod plan apophis-2029 --prediction encounter --visits 5
    Example:  nebosvod plan 2027AB-fit --decide --until 2040-01-01 --telescope F51 --sigma "0.2 arcsec"
                --from 2027-03-01 --to 2027-03-31 --step "5 d"
    """
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.plan_answer import print_plan
    from nebosvod.commands.plan_decide import decided, print_decision
    from nebosvod.mission import load_mission
    from nebosvod.results.result import json_text

    _require_together(decide)
    require_places(output, page)
    found = decided(mission, said) if decide else planned(load_mission(mission), said)
    if output is not None:
        write_new_text(output, json_text(found))
    if page is not None:
        from nebosvod.report.decision_page import make_decision_page
        from nebosvod.report.plan_page import make_plan_page

        write_new_text(page, make_decision_page(found) if decide else make_plan_page(found))
    if as_json:
        click.echo(json_text(found), nl=False)
    elif decide:
        print_decision(found)
    else:
        print_plan(found)
    return 0


def planned(mission: "Mission", said: Mapping[str, Any]) -> dict[str, Any]:
    """The plan for a prediction of a mission, by the options as typed."""
    from nebosvod.commands.progress import stages
    from nebosvod.planning.planner import plan as plan_mission
    from nebosvod.planning.wish import read_wish

    window = (said["start"], said["end"], said["step"])
    wish = read_wish(
        mission, said["prediction"], said["visits"], said["estimator"], said["criterion"], window, said["visit_time"],
        said["exposures"], said["spacing"],
    )  # fmt: skip
    with stages() as progress:
        return plan_mission(mission, wish, progress)


def _require_together(decide: bool) -> None:
    """Raise InputError for an option of the other question."""
    context = click.get_current_context()
    for name in OF_PREDICTIONS if decide else OF_DECISIONS:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: goes {'without' if decide else 'with'} --decide")
