"""How good each thing must be for a wanted answer: one at a time, and all together at least cost.

Of each source of error: the largest value with which the answer is as wanted while the others stay as they are, what
would be left if it were perfect (the floor, below which nothing done to this source brings the answer), and what there
would be if it were a million times worse: where the two ends agree with what is now, it does not matter.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.expression import Expression
from nebosvod.errors import NebosvodError

Array = npt.NDArray[np.float64]
REACH = 1e6  # factors tried, down and up
REACH_SCHEDULE = 32.0  # of a cadence: more measurements than this many times would only cost time
HALVINGS = 40
SAME = 1e-9  # relative, between ends that do not differ
MOST_STEPS = 60
KNEE = 0.02  # relative, of where a thing stops to matter
NEAR = 1.05  # of an end, within which more, or less, of a thing makes no difference
SLACK = 1e-5  # relative, of the answer at the joint optimum
LOOKS = ((-5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0), (-0.5, 0.5), (-0.25, 0.25))  # powers of two


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Needed:
    """One thing that may be better or worse.

    Attributes
    ----------
    name : of it; paths : of the mission; unit : of its values; now : what the mission says at the first path.
    said : number and unit of what the mission says at each path, where these differ (position and velocity of a prior):
        all become better and worse together.
    """

    name: str
    paths: tuple[str, ...]
    unit: str
    now: float
    said: tuple[tuple[float, str], ...] = ()

    def changes(self, value: float) -> dict[str, Any]:
        """What a mission says with this value, by path."""
        if not self.said:
            return dict.fromkeys(self.paths, _text(value, self.unit))
        factor = value / self.now
        return {path: _text(factor * number, unit) for path, (number, unit) in zip(self.paths, self.said)}

    @property
    def reach(self) -> float:
        """Largest factor that is tried."""
        return REACH_SCHEDULE if self.stepped else REACH

    @property
    def stepped(self) -> bool:
        """Whether the answer goes in steps with it: of a schedule, the number of measurements is a whole one."""
        return any(path.startswith("schedule.") for path in self.paths)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Requirement:
    """What is wanted, and of what.

    Attributes
    ----------
    answer : name of the number; limit : what it may be at most, in its unit; text : the same as written.
    cost : a formula of the names; None for the sum of now / value, by which twice as good costs twice as much.
    """

    answer: str
    limit: float
    text: str
    each: tuple[Needed, ...]
    cost: Expression | None

    def cost_of(self, values: Mapping[str, float]) -> float:
        """What some values cost."""
        if self.cost is not None:
            return float(self.cost(values))
        return float(sum(one.now / values[one.name] for one in self.each))


Number = Callable[[Mapping[str, Any]], float]


def required(wanted: Requirement, number: Number) -> dict[str, Any]:
    """What is needed of each by itself, and of all together.

    Parameters
    ----------
    number : the answer of a mission with changes of some paths; raises where there is none.
    """
    tried: dict[tuple[float, ...], float] = {}

    def answer(values: Mapping[str, float]) -> float:
        key = tuple(values[one.name] for one in wanted.each)
        if key not in tried:
            changes: dict[str, Any] = {}
            for one in wanted.each:
                changes |= one.changes(values[one.name])
            try:
                tried[key] = number(changes)
            except NebosvodError:
                tried[key] = math.inf
        return tried[key]

    now = {one.name: one.now for one in wanted.each}
    together = _together(wanted, answer, now)
    return {
        "answer": wanted.answer,
        "wanted": wanted.text,
        "limit": wanted.limit,
        "now": _finite(answer(now)),
        "cost": wanted.cost.text if wanted.cost is not None else None,
        "each": [_alone(wanted, one, answer, now) for one in wanted.each],
        "together": together,
        "evaluations": len(tried),
    }


def _alone(
    wanted: Requirement, one: Needed, answer: Callable[[Mapping[str, float]], float], now: Mapping[str, float]
) -> dict[str, Any]:
    """What is needed of one thing, the others being as they are."""

    def at(factor: float) -> float:
        return answer({**now, one.name: one.now * factor})

    floor, without = at(1.0 / one.reach), at(one.reach)
    needed, said = None, ""
    if floor > wanted.limit:
        said = f"cannot do it alone: however good, {floor:.4g} remains"
    elif without <= wanted.limit:
        said = "does not matter: however bad, the answer is as wanted"
    else:
        needed = one.now * largest_factor(at, wanted.limit, 1.0 / one.reach, one.reach)
        said = "must be better" if needed < one.now else "may be worse"
    reach = one.reach
    better, worse = None, None
    if math.isfinite(floor) and without > NEAR**2 * floor:
        better = one.now * largest_factor(at, NEAR * floor, 1.0 / reach, reach, KNEE)
        if math.isfinite(without):
            worse = one.now * largest_factor(at, without / NEAR, 1.0 / reach, reach, KNEE)
    same = abs(without - floor) <= SAME * abs(floor) if math.isfinite(without) else False
    return {
        "name": one.name,
        "set": list(one.paths),
        "unit": one.unit,
        "now": one.now,
        "needed": needed,
        "floor": _finite(floor),
        "without": _finite(without),
        "no_better_below": better,
        "no_worse_above": worse,
        "matters": not same,
        "verdict": said,
    }


def largest_factor(at: Callable[[float], float], limit: float, low: float, high: float, near: float = 1e-6) -> float:
    """The largest factor with which a growing number is within a limit, by halving its logarithm; to a part of it."""
    a, b = math.log(low), math.log(high)
    for _ in range(HALVINGS):
        middle = 0.5 * (a + b)
        if at(math.exp(middle)) <= limit:
            a = middle
        else:
            b = middle
        if b - a < near:
            break
    return math.exp(a)


def _together(
    wanted: Requirement, answer: Callable[[Mapping[str, float]], float], now: Mapping[str, float]
) -> dict[str, Any] | None:
    """Values of all with which the answer is as wanted at the least cost; None where none are.

    Notes
    -----
    Sequential quadratic programming in the logarithms of values, answer and cost, from the values that are equally
    many times better or worse than now; partials are differences. What the answer goes in steps with has none: of a
    cadence that is a little longer, as many measurements span more time, and the answer is better, until one falls
    out. So cadences are tried, ever closer to the best one, and the rest is sought for each.
    """
    reach = min(one.reach for one in wanted.each)

    def scaled(factor: float) -> dict[str, float]:
        return {name: value * factor for name, value in now.items()}

    if len(wanted.each) < 2 or not answer(scaled(1.0 / reach)) <= wanted.limit:
        return None
    factor = largest_factor(lambda f: answer(scaled(f)), wanted.limit, 1.0 / reach, reach)
    equally = scaled(factor)
    unit = wanted.cost_of(equally)
    if not (math.isfinite(unit) and unit > 0.0):
        return None
    stepped = [one for one in wanted.each if one.stepped]
    best, converged = _smooth(wanted, answer, equally, unit, [one for one in wanted.each if not one.stepped])
    for powers in LOOKS:
        for one in stepped:
            middle = best[one.name] if len(powers) == 2 else one.now
            for power in powers:
                value = middle * 2.0**power
                if not one.now / one.reach <= value <= one.now * one.reach:
                    continue
                others = [other for other in wanted.each if not other.stepped]
                start = _started(wanted, answer, best | {one.name: value}, others)
                if start is None:
                    continue
                found, good = _smooth(wanted, answer, start, unit, others)
                if wanted.cost_of(found) < wanted.cost_of(best):
                    best, converged = found, good
    return {
        "values": best,
        "answer": _finite(answer(best)),
        "cost": wanted.cost_of(best),
        "cost_equally": unit,
        "converged": converged,
    }


def _started(
    wanted: Requirement,
    answer: Callable[[Mapping[str, float]], float],
    values: Mapping[str, float],
    others: Sequence[Needed],
) -> dict[str, float] | None:
    """Values with which the answer is as wanted, some of them being equally many times better or worse."""

    def scaled(factor: float) -> dict[str, float]:
        return {**values, **{one.name: values[one.name] * factor for one in others}}

    if not others:
        return dict(values) if answer(values) <= wanted.limit else None
    reach = min(one.reach for one in others)
    if not answer(scaled(1.0 / reach)) <= wanted.limit:
        return None
    return scaled(largest_factor(lambda f: answer(scaled(f)), wanted.limit, 1.0 / reach, reach, KNEE))


def _smooth(
    wanted: Requirement,
    answer: Callable[[Mapping[str, float]], float],
    first: Mapping[str, float],
    unit: float,
    others: Sequence[Needed],
) -> tuple[dict[str, float], bool]:
    """The least cost over some of the values, the rest being as at first; and whether it converged."""
    from scipy.optimize import minimize

    if not others:
        return dict(first), True
    start = np.log([first[one.name] for one in others])

    def values(x: Array) -> dict[str, float]:
        return {**first, **dict(zip([one.name for one in others], np.exp(x).tolist()))}

    def room(x: Array) -> float:
        found = answer(values(x))
        return math.log(wanted.limit / found) if math.isfinite(found) and found > 0.0 else -50.0

    found = minimize(
        lambda x: wanted.cost_of(values(x)) / unit,
        start,
        method="SLSQP",
        bounds=[(math.log(one.now / one.reach), math.log(one.now * one.reach)) for one in others],
        constraints=[{"type": "ineq", "fun": room}],
        options={"maxiter": MOST_STEPS, "ftol": 1e-7, "eps": 1e-4},
    )
    kept = room(found.x) > -SLACK and found.fun <= wanted.cost_of(first) / unit
    return values(found.x if kept else start), bool(found.success)


def _text(value: float, unit: str) -> Any:
    """As a mission says it."""
    return f"{value!r} {unit}" if unit else value


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def words(found: Mapping[str, Any], unit: str) -> Sequence[str]:
    """What is needed, a line for each."""
    lines = [f"wanted: {found['answer']} {found['wanted']} (now {_shown(found['now'])} {unit})".replace(" )", ")")]
    for one in found["each"]:
        needed = "" if one["needed"] is None else f": {one['needed']:.4g} {one['unit']}".rstrip()
        now = f"{one['now']:.4g} {one['unit']}".rstrip()
        lines.append(f"  {one['name']} (now {now}): {one['verdict']}{needed}{_knees(one)}")
    told = found.get("averaging")
    if told:
        lines += list(_averaging_words(told, unit))
    if found["together"]:
        units = {one["name"]: one["unit"] for one in found["each"]}
        values = [f"{name} {value:.4g} {units[name]}".rstrip() for name, value in found["together"]["values"].items()]
        lines.append(f"  together at least cost: {', '.join(values)}")
    return lines


def _knees(one: Mapping[str, Any]) -> str:
    """Between which values a thing matters."""
    unit, said = one["unit"], []
    if one["no_better_below"] is not None:
        said.append(f"better than {one['no_better_below']:.3g} {unit} helps no more".replace("  ", " "))
    if one["no_worse_above"] is not None:
        said.append(f"worse than {one['no_worse_above']:.3g} {unit} it might as well be unknown".replace("  ", " "))
    return f" ({', '.join(said)})" if said else ""


def _averaging_words(told: Mapping[str, Any], unit: str) -> Iterator[str]:
    """What averaging brings."""
    if told["n_needed"] is not None:
        yield f"  or {_count(told['n_needed'])} measurements as they are (now {told['n']})"
    if told["n_where_equal"] is not None:
        equal, floor = _count(told["n_where_equal"]), f"{told['floor']:.4g} {unit}".rstrip()
        yield f"  averaging brings most up to about {equal} measurements: however many, what they share leaves {floor}"


def _count(value: float) -> str:
    return f"{max(1, math.ceil(value - 1e-9)):,}"


def _shown(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"
