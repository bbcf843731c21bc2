"""What `nebosvod fit` answers where observations are too few for an orbit: the first hour of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from nebosvod.commands.alert_answer import alert_lines, print_alert
from nebosvod.commands.alert_made import Answered, Asked, of_records
from nebosvod.dynamics import Ephemeris
from nebosvod.errors import NebosvodError
from nebosvod.mission import FitMission
from nebosvod.observation.formats.records import Astrometry
from nebosvod.results.alert_folder import alert_result
from nebosvod.results.result import Result

Say = Callable[[str], None]
FEWEST = 3  # times of observation: of two a probability is that of the prior
TOLD = (
    "object", "status", "orbit_status", "message", "reference_epoch_tdb", "within_d", "headline", "probability", "low",
    "high", "bound", "hits", "by_prior", "impact", "scores", "quantities", "regions", "n_observations",
)  # fmt: skip


def first_hour(records: Astrometry, mission: FitMission, ephemeris: Ephemeris, say: Say) -> Answered | None:
    """The answer for an arc too short; None where that has none, or where an orbit or a prior was given.

    A probability from the observations alone would contradict what is known beforehand.
    """
    if mission.prior != "none" or mission.object.orbit is not None or len(np.unique(records.t_s)) < FEWEST:
        return None
    asked = Asked.of(hours="1,3,6,12,24")
    try:
        found = of_records(records, mission, ephemeris, asked, say)
    except NebosvodError:
        return None
    return found if found.alert.enough else None


def with_first_hour(result: Result, found: Answered) -> Result:
    """The result of a fit that is not observable, with what is known all the same."""
    told = {name: found.summary[name] for name in TOLD}
    return replace(result, summary={**result.summary, "first_hour": told})


def is_short(result: Result) -> bool:
    """Whether a fit ended without an orbit for want of observations."""
    return bool(result.summary["fit"]["status"] == "not_observable")


def in_place_of(error: NebosvodError, found: Answered, ephemeris: Ephemeris, source: str, started: float) -> Result:
    """The folder of an answer where there is no orbit at all; why stands among its warnings."""
    name = found.summary["object"]
    text = f"no orbit by least squares: {str(error).removeprefix(f'{name}: ')}"
    found.summary["warnings"] = [text, *found.summary["warnings"]]
    return alert_result(found.summary, found.alert, ephemeris, source, started)


def say_instead(found: Answered, folder: Path | None) -> None:
    """Print the answer: below that of a fit, which has said the notices, or with them and its folder in place of it."""
    if folder is not None:
        print_alert(found.summary, folder, fitted=True)
        return
    click.echo("")
    for line in alert_lines(found.summary, fitted=True):
        click.echo(line)
