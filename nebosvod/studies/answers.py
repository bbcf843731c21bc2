"""What a study asks of each point: a path such as `predictions.encounter.semi_axes_km.0`, and the number it means.

Numbers have the names and units of summary.json of a run; those that cost orbits of their own (curvature, Monte Carlo)
or many solves (remedies) are not among them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from nebosvod.errors import InputError
from nebosvod.findings.prediction import Answered
from nebosvod.mission import Mission
from nebosvod.mission.request import Prediction, ValuePrediction
from nebosvod.mission.vocabulary import PLANES
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.studies.point import Point
from nebosvod.studies.sampled import corridor_km, impact_probability

Shares = dict[str, float]  # by source
ENCOUNTER = ("b_plane", "mtp", "perigee_distance", "entry")
# of predictions that are not a number with a unit of its own
UNITS = {"sky": "arcsec", "rtn_velocity": "m_s"} | dict.fromkeys((*ENCOUNTER, "distance", "position", "rtn"), "km")
SHOWN = {"m_s": "m/s", "km_s": "km/s", "km2_s2": "km^2/s^2", "deg_d": "deg/d", "1": ""}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Asked:
    """One answer that is asked for.

    Attributes
    ----------
    name : of the column; of : its path.
    unit : of the number; empty for a share or a count.
    shares : whether it is the shares of all sources.
    take : the number, or the shares, of a point; None where the point does not have it.
    title : the name in the file, which several times share; the name where empty.
    before_s : with what is measured until so long before the epoch of the orbit; 0 for all that is.
    """

    name: str
    of: str
    unit: str
    shares: bool
    take: Callable[[Point], float | Shares | None]
    title: str = ""
    before_s: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)

    def before(self, duration_s: float, text: str) -> "Asked":
        """The same, as it was known so long before the epoch of the orbit."""

        def take(point: Point) -> float | Shares | None:
            then = point.earlier(duration_s)
            return None if then is None else self.take(then)

        return replace(self, name=f"{self.name} {text}", take=take, title=self.name, before_s=duration_s)


def read_answer(name: str, of: str, mission: Mission) -> Asked:
    """What a path means for a mission.

    Raises
    ------
    InputError
        If it leads nowhere; says what is allowed, and what is near.
    """
    head, _, rest = of.partition(".")
    makers: Mapping[str, Callable[[str, str, str, Mission], Asked]] = {
        "predictions": _of_prediction, "state": _of_state, "parameters": _of_parameter, "visible": _of_visible,
    }  # fmt: skip
    if head in makers:
        return makers[head](name, of, rest, mission)
    if of in COUNTS:
        return Asked(name=name, of=of, unit=COUNTS[of][0], shares=False, take=COUNTS[of][1])
    raise _unknown(of, of, [*makers, *COUNTS])


COUNTS: Mapping[str, tuple[str, Callable[[Point], float | None]]] = {
    "n_observations": ("", lambda point: float(point.times_s.size)),
    "first_seen_d": ("d", lambda point: float(point.times_s[0]) / 86400.0),
    "last_seen_d": ("d", lambda point: float(point.times_s[-1]) / 86400.0),
    "condition_number": ("", lambda point: point.estimate.condition_number),
    "warning_time_d": ("d", lambda point: point.warning_s() / 86400.0),
}


def _of_prediction(name: str, of: str, rest: str, mission: Mission) -> Asked:
    names = [one.name for one in mission.predictions]
    mine = max((one for one in names if rest == one or rest.startswith(f"{one}.")), key=len, default=None)
    if mine is None:
        raise _unknown(of, rest.partition(".")[0], names, "prediction of the mission")
    request = next(one for one in mission.predictions if one.name == mine)
    key = rest[len(mine) + 1 :]
    if key == "budget":
        return Asked(name=name, of=of, unit="", shares=True, take=lambda point: point.shares(mine))
    if key.startswith("budget."):
        source = key.removeprefix("budget.")
        return Asked(name=name, of=of, unit="", shares=False, take=lambda point: (point.shares(mine) or {}).get(source))
    flown = _flown(request, mine)
    if key in flown:
        unit, number_of = flown[key]
        return Asked(name=name, of=of, unit=unit, shares=False, take=number_of)
    known = _numbers(request)
    if key not in known:
        vectors = sorted({one.rpartition(".")[0] for one in known if one.rpartition(".")[2].isdigit()})
        if key in vectors:
            size = len([one for one in known if one.startswith(f"{key}.")])
            raise InputError(f"{of}: has {size} components; say which, {of}.0 to {of}.{size - 1}")
        raise _unknown(of, key, [*known, *flown, "budget", "budget.SOURCE"], f'number of the prediction "{mine}"')
    unit, take = known[key]

    def number(point: Point) -> float | None:
        found = point.prediction(mine)
        return None if found is None else take(found)

    return Asked(name=name, of=of, unit=unit, shares=False, take=number)


def _numbers(request: Prediction) -> dict[str, tuple[str, Callable[[Answered], float | None]]]:
    """The numbers of a prediction: unit, and how they are taken."""
    unit = request.in_unit if isinstance(request, ValuePrediction) else UNITS[request.plane]
    word = SHOWN.get(unit, unit)
    size = len(PLANES[request.plane].components)
    found: dict[str, tuple[str, Callable[[Answered], float | None]]] = {}
    for key, attribute in VECTORS.items():
        for k in range(size):
            found[f"{key}_{unit}.{k}"] = word, _component(attribute, k)
    found[f"sigma_total_{unit}"] = word, lambda one: float(np.sqrt(np.sum(one.sigma**2)))
    if size == 2:
        found["angle_deg"] = "deg", lambda one: one.angle_deg
    if request.plane in ENCOUNTER or isinstance(request, ValuePrediction):
        for k in range(size):
            found[f"mean_{unit}.{k}"] = word, _value(k)
    if request.plane in ENCOUNTER:
        found["sigma_time_s"] = "s", lambda one: one.sigma_time_s
        found["closest_distance_km"] = "km", lambda one: _fact(one, "distance_km")
        found["speed_km_s"] = "km/s", lambda one: _fact(one, "speed_km_s")
    if request.plane == "entry":
        found["sigma_longitude_deg"] = "deg", lambda one: one.sigma_longitude_deg
        found["sigma_latitude_deg"] = "deg", lambda one: one.sigma_latitude_deg
    return found


def _flown(request: Prediction, name: str) -> dict[str, tuple[str, Callable[[Point], float | None]]]:
    """What an encounter says of an impact, of one too whose ellipse is no answer."""
    found: dict[str, tuple[str, Callable[[Point], float | None]]] = {}
    if request.plane in ENCOUNTER:
        found["impact_probability_linear"] = "", lambda point: point.chance(name)
        found["impact_probability"] = "", lambda point: impact_probability(point, name)
    if request.plane == "entry":
        found["corridor_km"] = "km", lambda point: corridor_km(point, name)
    return found


VECTORS = {
    "semi_axes": "semi_axes", "sigma": "sigma", "sigma_formal": "sigma_formal", "mean_error": "mean_error",
}  # fmt: skip


def _component(attribute: str, k: int) -> Callable[[Answered], float]:
    return lambda one: float(getattr(one, attribute)[k])


def _value(k: int) -> Callable[[Answered], float | None]:
    return lambda one: None if one.quantity.value is None else float(one.quantity.value[k])


def _fact(one: Answered, name: str) -> float | None:
    encounter = one.quantity.encounter
    return None if encounter is None else float(getattr(encounter, name))


def _of_state(name: str, of: str, rest: str, mission: Mission) -> Asked:
    if rest == "budget":
        return Asked(name=name, of=of, unit="", shares=True, take=lambda point: point.state_shares())
    known: Mapping[str, tuple[str, Callable[[Point], float]]] = {
        "sigma_position_km": ("km", lambda point: point.state_sigma(0, formal=False)),
        "sigma_velocity_m_s": ("m/s", lambda point: point.state_sigma(1, formal=False)),
        "sigma_formal_position_km": ("km", lambda point: point.state_sigma(0, formal=True)),
        "sigma_formal_velocity_m_s": ("m/s", lambda point: point.state_sigma(1, formal=True)),
    }
    if rest not in known:
        raise _unknown(of, rest, [*known, "budget"], "number of the state")
    unit, take = known[rest]
    return Asked(name=name, of=of, unit=unit, shares=False, take=take)


def _of_parameter(name: str, of: str, rest: str, mission: Mission) -> Asked:
    parameter, _, key = rest.rpartition(".")
    if key != "sigma" or not parameter:
        raise InputError(f"{of}: of a parameter there is its sigma, such as parameters.radius_m.sigma")
    return Asked(name=name, of=of, unit="", shares=False, take=lambda point: point.parameter_sigma(parameter))


def _of_visible(name: str, of: str, rest: str, mission: Mission) -> Asked:
    names = [telescope.name for telescope in mission.telescopes]
    if rest not in names:
        raise _unknown(of, rest, names, "telescope of the mission")
    return Asked(name=name, of=of, unit="", shares=False, take=lambda point: float(point.visible(rest)))


def _unknown(of: str, word: str, known: Sequence[str], what: str = "answer") -> InputError:
    near = get_close_matches(word, known, 1)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    return InputError(
        f'{shown(of, 80)}: "{shown(word, 60)}" is no {what} (allowed: {", ".join(known[:25]) or "none"}){hint}'
    )
