"""What a study varies: values with their units, as a list or as a range, and the numbers a table has of them.

A value goes into the mission as the file says it ("0.02 arcsec"); the table has it as a number in the unit of the
first value. What is no number (a word, a date, a block) is told apart by its text.
"""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.mission.yaml.yamlfile import Tree, shown
from nebosvod.units import DIMENSIONS, NUMBER, Dimension

MOST_VALUES = 100_000  # on one axis
_WITH_UNIT = re.compile(rf"({NUMBER})\s*([A-Za-z][\w/^*]*)?")
_RANGE = re.compile(r"(.+?)\s*\.\.\s*(.+)")
RANGE_HINT = 'such as "0.02 arcsec .. 1 arcsec" with log: 7 or linear: 7, or a list of values'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """One thing that is varied.

    Attributes
    ----------
    name : of the column; paths : of the mission, all of which take the value.
    values : as the mission's file would say them, for a list or a grid.
    numbers : of the same in `unit`; None where they are no numbers.
    low, high : ends of a range, in `unit`; nan for a list.
    log : whether a range is even in its logarithm; whole : whether it has whole numbers only.
    steps : how many values the range has in a grid; 0 where the file does not say.
    texts : what the table has of values that are no numbers; their own text where absent.
    """

    name: str
    paths: tuple[str, ...]
    unit: str = ""
    values: Sequence[Tree] = ()
    numbers: tuple[float, ...] | None = None
    low: float = math.nan
    high: float = math.nan
    log: bool = False
    whole: bool = False
    steps: int = 0
    texts: tuple[str, ...] = ()

    def changes(self, value: Tree) -> dict[str, Tree]:
        """What a value changes in a mission, by path: itself at every path; without paths it says so itself."""
        if self.paths:
            return dict.fromkeys(self.paths, value)
        return dict(value) if isinstance(value, dict) else {}

    @property
    def is_range(self) -> bool:
        """Whether it has every value between two ends."""
        return math.isfinite(self.low)

    @property
    def count(self) -> int:
        """Values in a grid."""
        return self.steps if self.is_range else len(self.values)

    def at_step(self, step: int) -> tuple[Tree, float | str]:
        """The value of a grid by its number: for the mission, and for the table."""
        if not self.is_range:
            value = self.values[step]
            if self.numbers is not None:
                return value, self.numbers[step]
            return value, self.texts[step] if self.texts else _text(value)
        return self._said(float(self.grid()[step]))

    def shown(self, step: int) -> float | str:
        """What the table has of a value of a grid."""
        return self.texts[step] if self.texts else self.at_step(step)[1]

    def grid(self) -> npt.NDArray[np.float64]:
        """The numbers of a range in a grid, its ends exact."""
        fraction = np.linspace(0.0, 1.0, self.steps)
        found = self._between(fraction)
        found[0], found[-1] = self.low, self.high
        return found

    def at_fraction(self, fraction: float) -> tuple[Tree, float | str]:
        """The value of a sample, by a number from 0 to below 1: of a list each value has one equal part."""
        if not self.is_range:
            return self.at_step(min(int(fraction * len(self.values)), len(self.values) - 1))
        return self._said(float(self._between(np.array([fraction]))[0]))

    def _between(self, fraction: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.log:
            found = self.low * (self.high / self.low) ** fraction
        else:
            found = self.low + (self.high - self.low) * fraction
        return np.round(found) if self.whole else found

    def _said(self, number: float) -> tuple[Tree, float | str]:
        if not self.unit:
            return (round(number) if self.whole else number), number
        return f"{number!r} {self.unit}", number


class _Read(NamedTuple):
    """A number with its unit, as text has it."""

    number: float
    unit: str


def read_axis(name: str, paths: Sequence[str], values: Any, log: int | bool | None, linear: int | bool | None) -> Axis:
    """Read what a study says of one axis.

    Raises
    ------
    InputError
        If it is none; says what is wrong and what is allowed.
    """
    if isinstance(values, list):
        if log is not None or linear is not None:
            raise InputError("log and linear are for a range; a list has its own values")
        return _listed(name, tuple(paths), values)
    match = _RANGE.fullmatch(values.strip()) if isinstance(values, str) else None
    if match is None:
        got = shown(str(values), 60)
        raise InputError(f'is neither a range nor a list of values (got "{got}"; {RANGE_HINT})')
    if log is not None and linear is not None:
        raise InputError("a range is even in its values (linear) or in their logarithms (log), not in both")
    return _range(name, tuple(paths), match[1], match[2], log, linear)


def _range(name: str, paths: tuple[str, ...], low: str, high: str, log: Any, linear: Any) -> Axis:
    ends = [_number(text) for text in (low, high)]
    for end, text in zip(ends, (low, high)):
        if end is None:
            raise InputError(f'"{shown(text, 40)}" is no number with a unit; a range is {RANGE_HINT}')
    first, last = ends[0], ends[1]
    if first is None or last is None:
        raise InputError(f"is no range; {RANGE_HINT}")
    stop = last.number * _factor(last.unit, first.unit)
    if not first.number < stop:
        raise InputError(f'runs downwards or has no length (got "{shown(low, 40)} .. {shown(high, 40)}")')
    if log not in (None, False) and first.number <= 0.0:
        raise InputError(f'log: a range from "{shown(low, 40)}" has no logarithms; it must begin above 0')
    said = next((one for one in (log, linear) if one not in (None, False)), None)
    steps = said if isinstance(said, int) and not isinstance(said, bool) else 0
    whole = not first.unit and all(re.fullmatch(r"[-+]?\d+", text.strip()) for text in (low, high))
    whole = whole and (steps == 0 or log in (None, False)) and (steps == 0 or _even(first.number, stop, steps))
    return Axis(
        name=name, paths=paths, unit=first.unit, low=first.number, high=stop, log=log not in (None, False),
        whole=whole, steps=steps,
    )  # fmt: skip


def _even(low: float, high: float, steps: int) -> bool:
    return steps > 1 and (high - low) % (steps - 1) == 0.0


def _listed(name: str, paths: tuple[str, ...], values: Sequence[Tree]) -> Axis:
    if not 1 <= len(values) <= MOST_VALUES:
        raise InputError(f"has {len(values)} values (allowed 1 to {MOST_VALUES})")
    texts = [_text(value) for value in values]
    if len(set(texts)) < len(texts):
        twice = next(text for text in texts if texts.count(text) > 1)
        raise InputError(f'has "{shown(twice, 40)}" twice')
    read = [_number(value) for value in values]
    known = [one for one in read if one is not None]
    if len(known) < len(values):
        return Axis(name=name, paths=paths, values=tuple(values))
    unit = known[0].unit
    numbers = tuple(one.number * _factor(one.unit, unit) for one in known)
    return Axis(name=name, paths=paths, unit=unit, values=tuple(values), numbers=numbers)


def _number(value: Any) -> _Read | None:
    """A number with or without a unit; None for anything else."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return _Read(float(value), "") if math.isfinite(value) else None
    match = _WITH_UNIT.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        return None
    unit = match[2] or ""
    return _Read(float(match[1]), unit) if not unit or _dimensions(unit) else None


def in_unit(text: str, unit: str) -> float:
    """A number with its unit, in another one.

    Raises
    ------
    InputError
        If it is none, has no unit where one is needed, or one of another kind.
    """
    found = _number(text)
    if found is None or (unit and not found.unit):
        hint = f' with its unit, such as "1 {unit}"' if unit else ""
        raise InputError(f'needs a number{hint} (got "{shown(text, 40)}")')
    return found.number * _factor(found.unit, unit)


def _dimensions(unit: str) -> list[Dimension]:
    return [one for one in DIMENSIONS if unit in one.factors or unit in one.aliases]


def _factor(unit: str, wanted: str) -> float:
    """How many of one unit another is."""
    if unit == wanted:
        return 1.0
    for one in DIMENSIONS:
        own, other = one.aliases.get(unit, unit), one.aliases.get(wanted, wanted)
        if own in one.factors and other in one.factors:
            return float(f"{one.factors[own] / one.factors[other]:.15g}")  # 1 arcsec is 1000 mas
    raise InputError(f'has values of different kinds (got "{unit or "no unit"}" beside "{wanted or "no unit"}")')


def _text(value: Tree) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True)
