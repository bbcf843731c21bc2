"""What is asked of a plan, and how the command line says it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from nebosvod.errors import InputError
from nebosvod.mission import Mission
from nebosvod.timescale import Epoch
from nebosvod.units import DURATION
from nebosvod.units import quantity as to_internal

Criterion = Literal["a", "d", "minimax", "guaranteed"]
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What is asked of a plan; times in s after the reference epoch, None = the mission's own.

    Attributes
    ----------
    visit_s : telescope time that a visit takes, by telescope; the others take `visit_default_s`.
    exposures, spacing_s : of a visit, and from one exposure to the next.
    """

    prediction: str
    visits: int = 5
    estimator: str | None = None
    criterion: Criterion = "a"
    start_s: float | None = None
    end_s: float | None = None
    step_s: float | None = None
    visit_s: Mapping[str, float] | None = None
    visit_default_s: float = HOUR_S
    exposures: int = 1
    spacing_s: float = 0.0


def read_wish(
    mission: Mission,
    prediction: str | None,
    visits: int,
    estimator: str | None,
    criterion: Criterion,
    window: tuple[str | None, str | None, str | None],
    visit_time: Sequence[str],
    exposures: int = 1,
    spacing: str | None = None,
) -> Wish:
    """Read what the command line says: first and last epoch, step, times and exposures of visits, with their units.

    Raises
    ------
    InputError
        If an epoch, a duration or the criterion cannot be read, or no prediction is named and
        there is none; names the option.
    """
    if criterion not in get_args(Criterion):
        raise InputError(f"--criterion: {criterion!r} (allowed: {', '.join(get_args(Criterion))})")
    start, end, step = window
    times: dict[str, float] = {}
    default = HOUR_S
    for said in visit_time:
        name, equals, text = said.rpartition("=")
        if equals:
            times[name] = _duration("--visit-time", text)
        else:
            default = _duration("--visit-time", text)
    return Wish(
        prediction=prediction or _usual_prediction(mission),
        visits=visits,
        estimator=estimator,
        criterion=criterion,
        start_s=None if start is None else _epoch("--from", start) - mission.reference_epoch,
        end_s=None if end is None else _epoch("--to", end) - mission.reference_epoch,
        step_s=None if step is None else _duration("--step", step),
        visit_s=times,
        visit_default_s=default,
        exposures=exposures,
        spacing_s=_duration("--spacing", spacing) if spacing is not None else 0.0,
    )


def _usual_prediction(mission: Mission) -> str:
    """The prediction to improve when none is named: the first at an encounter, else the first."""
    if not mission.predictions:
        raise InputError(f"{mission.path or mission.name}: predictions: there is none, so nothing to plan for; add one")
    encounters = [one.name for one in mission.predictions if hasattr(one, "near")]
    return [*encounters, mission.predictions[0].name][0]


def _epoch(option: str, text: str) -> Epoch:
    try:
        return Epoch.parse(text)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


def _duration(option: str, text: str) -> float:
    try:
        seconds = to_internal(text, DURATION)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None
    if not seconds > 0.0:
        raise InputError(f"{option}: must be more than 0 (got {text})")
    return seconds
