"""The answer of the first hour for records or for a mission, with everything a command line asks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import DAY_S
from nebosvod.engine.truth import draw
from nebosvod.ephemerides.observers import GEOCENTRE, observer
from nebosvod.errors import InputError, noting
from nebosvod.first_hour.alert import Alert, Question, alert
from nebosvod.first_hour.condensed import Few
from nebosvod.first_hour.decision import Decision, decide
from nebosvod.first_hour.history import history
from nebosvod.first_hour.look import Field
from nebosvod.first_hour.observed import prepared, tracklet_of, with_shared, without_gross_errors
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.simulated import simulated
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.mission import FitMission, load_mission
from nebosvod.observation import Telescope
from nebosvod.observation.earth import obscodes
from nebosvod.observation.formats.records import Astrometry
from nebosvod.results.alert_folder import summarise
from nebosvod.results.alert_words import span
from nebosvod.scene.material import Material
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene
from nebosvod.units import DURATION, LENGTH, Dimension, quantity

Array = npt.NDArray[np.float64]
Say = Callable[[str], None]
LONGEST_D, MOST_HOURS, MOST_MOMENTS, MOST_TOLD = 3650.0, 50, 40, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Asked:
    """What the command line asks, checked."""

    question: Question
    sites: tuple[Telescope, ...]
    by: tuple[str, ...]
    after_s: Array
    history: bool
    decide: bool
    output: Path | None
    overwrite: bool
    as_json: bool

    @classmethod
    def of(
        cls,
        *,
        hours: str,
        within: str = "100 d",
        bound: bool = True,
        smallest: str = "0.3 m",
        sites: Sequence[str] = (),
        by: Sequence[str] = (),
        seed: int = 1,
        history: bool = False,
        decide: bool = False,
        output: Path | None = None,
        overwrite: bool = False,
        as_json: bool = False,
    ) -> "Asked":
        """The options as typed.

        Raises
        ------
        InputError
            If one cannot be used; names it.
        """
        within_d = _quantity("within", within, DURATION, "100 d") / 86400.0
        if not 0.0 < within_d <= LONGEST_D:
            raise InputError(f"--within: {within_d:g} d (allowed: more than 0, up to {LONGEST_D:g} d)")
        smallest_m = 1e3 * _quantity("smallest", smallest, LENGTH, "0.3 m")
        if not 0.0 < smallest_m < 1e6:
            raise InputError(f"--smallest: {smallest_m:g} m (allowed: more than 0, below 1000 km)")
        if seed < 0:
            raise InputError(f"--seed: {seed} (allowed: 0 or more)")
        region = Region(bound=bound, smallest_m=smallest_m)
        return cls(
            question=Question(region=region, within_d=within_d, seed=seed), sites=tuple(observer(one) for one in sites),
            by=tuple(by),
            after_s=3600.0 * _hours(hours), history=history, decide=decide, output=output, overwrite=overwrite,
            as_json=as_json,
        )  # fmt: skip


def _quantity(option: str, text: str, dimension: Dimension, example: str) -> float:
    """A number of the command line with its unit; advice names the unit of the example, and no number that is none."""
    try:
        bare = float(text)
    except ValueError:
        bare = 1.0
    if not bare > 0.0:
        raise InputError(f'--{option}: needs more than 0, with a unit (got "{text[:40]}"); for example "{example}"')
    try:
        return quantity(text, replace(dimension, example=example))
    except InputError as error:
        raise InputError(f"--{option}: {error}") from None


def _hours(text: str) -> Array:
    """Hours, ascending, each once."""
    try:
        found = np.unique([float(word) for word in text.split(",")])
    except ValueError:
        raise InputError(f"--hours: needs numbers with commas between them (got {text[:40]})") from None
    if not np.isfinite(found).all() or found.min() < 0.0 or found.max() > 24.0 * LONGEST_D or found.size > MOST_HOURS:
        most = f"up to {MOST_HOURS} numbers from 0 to {24.0 * LONGEST_D:g}"
        raise InputError(f"--hours: needs {most} (got {text[:40]})")
    return np.asarray(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answered:
    """An answer and its summary."""

    alert: Alert
    summary: dict[str, Any]


def of_records(records: Astrometry, mission: FitMission, ephemeris: Ephemeris, asked: Asked, say: Say) -> Answered:
    """The answer for the records of one object.

    Raises
    ------
    GeometryError
        If there is one time of observation, or no orbit of the region fits.
    InputError, CoverageError, DataError
        As a fit.
    """
    with noting(records.notices):
        shared = with_shared(records, mission)
        say("placing the observations")
        material = prepared(records, shared, ephemeris)
    with noting(material.notices):
        whole = tracklet_of(material, records, shared)
        tracklet, kept, few = without_gross_errors(whole, asked.question.region, shared)
        who = asked.sites or (_last_observer(material),)
        moved = () if asked.sites else _without_place(material)
        left = np.setdiff1d(np.arange(len(whole)), kept).tolist()
        rejected = [{
            "utc": str(material.astrometry.utc[k]), "station": str(material.astrometry.station[k]),
            "file": str(material.astrometry.path[k]), "line": int(material.astrometry.line[k]),
        } for k in left]  # fmt: skip
        stations = list(dict.fromkeys(material.astrometry.station.tolist()))
        return _answered(tracklet, who, asked, say, (*material.notices, *moved), rejected, stations, few=few)


def _last_observer(material: Material) -> Telescope:
    """Who observed last, where that place is known in the hours to come; else the Earth's centre."""
    code, fixed = _last_code(material)
    return observer(code if fixed else GEOCENTRE)


def _last_code(material: Material) -> tuple[str, bool]:
    """The code of who observed last, and whether it has a fixed place."""
    code = str(material.astrometry.station[int(np.argmax(material.astrometry.t_s))])
    return code, obscodes.known(code) and not obscodes.needs_position(code)


def _without_place(material: Material) -> tuple[str, ...]:
    """That where to look next is told of the Earth's centre, for nobody knows where who observed last will be."""
    code, fixed = _last_code(material)
    if fixed:
        return ()
    called = obscodes.described(code) if obscodes.known(code) else code
    return (
        f"where to look next is told from the Earth's centre ({GEOCENTRE}): {called} observed last, and where it will "
        "be is not known; give its trajectory as --from-site FILE.oem or FILE.bsp",
    )


def of_mission(name: str, asked: Asked, say: Say) -> Answered:
    """The answer for the measurements that a mission simulates."""
    mission = load_mission(name)
    say("simulating the measurements")
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    truth = draw(scene, priors, np.random.default_rng(np.random.SeedSequence(asked.question.seed)))
    tracklet, numbers = simulated(scene, truth, asked.by)
    stations = [telescope.name for telescope in scene.telescopes if not asked.by or telescope.name in asked.by]
    who = asked.sites or tuple(telescope for telescope in scene.telescopes if telescope.name in stations)
    return _answered(tracklet, who, asked, say, (), [], stations, numbers)


NOTHING_TO_SETTLE = "the probability is a bound, by the number of drawn orbits: there is nothing to settle"


def _answered(
    tracklet: Tracklet, who: Sequence[Telescope], asked: Asked, say: Say, notices: Sequence[str],
    rejected: Sequence[dict[str, Any]], stations: Sequence[str], truth: dict[str, float] | None = None,
    few: Few | None = None,
) -> Answered:  # fmt: skip
    """Everything that was asked of a tracklet."""
    notices = [*notices, *_beyond(tracklet, asked)]
    say("laying the grid, flying the drawn orbits")
    found = alert(tracklet, asked.question, who, asked.after_s, few)
    moments = list(history(tracklet, asked.question, say, MOST_MOMENTS)) if asked.history else []
    told = found.headline.bound
    if asked.decide and told:
        notices.append(f"--decide: {NOTHING_TO_SETTLE}")
    decisions: list[Decision] = []
    if asked.decide and not told:
        lost = [one for one in found.fields if one.possible.visible is False]
        left_out = {(one.telescope, one.epoch.iso("utc", 0)) for one in lost}
        decisions = decide(found, who, asked.after_s, say, left_out=left_out)
        notices += _left_out(lost)
    summary = summarise(
        found, notices=notices, rejected=rejected, stations=stations, history=moments, decisions=decisions, truth=truth
    )
    return Answered(alert=found, summary=summary)


def _left_out(fields: Sequence[Field]) -> list[str]:
    """Which observations are not asked about, as nobody can make them."""
    told = [
        f"{one.telescope} {one.epoch.iso('utc', 0)[:16].replace('T', ' ')} ({', '.join(one.possible.reasons)})"
        for one in fields[:MOST_TOLD]
    ] + ([f"and {len(fields) - MOST_TOLD} more"] if len(fields) > MOST_TOLD else [])
    return [f"--decide: left out, as it cannot be observed then: {'; '.join(told)}"] if told else []


def _beyond(tracklet: Tracklet, asked: Asked) -> list[str]:
    """What is said of hours at which nobody looks, for they are after the time in which an impact counts."""
    end_s = asked.question.within_d * DAY_S - float(tracklet.exposures.t_s.max())
    late = [f"{after / 3600.0:g}" for after in asked.after_s.tolist() if after >= end_s]
    if not late:
        return []
    span_said = span(asked.question.within_d)
    return [f"--hours {','.join(late)}: left out, after the {span_said} in which an impact counts (--within)"]
