"""Axes: limits, round ticks and how they are written, for linear, logarithmic and calendar axes."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np
import numpy.typing as npt

from nebosvod.report.kit.wording import SUPERSCRIPT, number
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
TICK_CHARACTER = 6.1  # mean width of a character of a tick text, px
FEW_DECADES = 1.7  # a logarithmic axis shorter than this names 1, 2 and 5, a longer one its decades


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scale:
    """One axis: kind ("linear", "log", "time" in days after `origin`), limits, label with unit, ticks.

    A silent one writes no text.
    """

    kind: str
    low: float
    high: float
    label: str
    ticks: tuple[tuple[float, str], ...]
    origin: str = ""
    silent: bool = False

    def silenced(self) -> "Scale":
        """The same axis without texts, for a panel beside or above one that has them."""
        return replace(self, ticks=tuple((value, "") for value, _ in self.ticks), silent=True)

    def within(self, wide: float, before: float, behind: float) -> "Scale":
        """The same axis without the tick texts that would stick out of a panel, `wide` px, by more than so many px.

        One that would then have none keeps all.
        """

        def fits(value: float, text: str) -> bool:
            place, half = wide * float(self.part(np.array(value))), 0.5 * TICK_CHARACTER * len(text)
            return place - half >= -before and place + half <= wide + behind

        kept = tuple((value, text) for value, text in self.ticks if fits(value, text))
        return replace(self, ticks=kept or self.ticks)

    def reversed(self) -> "Scale":
        """The same axis from high to low."""
        return replace(self, low=self.high, high=self.low)

    def part(self, values: Array) -> Array:
        """Where values lie on the axis, 0 at its low end and 1 at its high end."""
        if self.kind == "log":
            return np.asarray(np.log(values / self.low) / math.log(self.high / self.low))
        return np.asarray((values - self.low) / (self.high - self.low))

    @property
    def width(self) -> int:
        """Characters of the longest tick text."""
        return max((len(text) for _, text in self.ticks), default=0)


def linear(values: Iterable[float], label: str, *, pad: float = 0.05, most: int = 6) -> Scale:
    """A linear axis over the finite values, with at most about `most` round ticks; `pad` parts of it stay free."""
    low, high = _limits(values)
    if high <= low:
        low, high = low - (abs(low) or 1.0), high + (abs(high) or 1.0)
    room = pad * (high - low)
    low, high = (low if low == 0.0 else low - room), (high if high == 0.0 else high + room)
    step = round_step((high - low) / most)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    ticks = [(k * step, tick_text(k * step, step)) for k in range(first, last + 1)]
    return Scale(kind="linear", low=low, high=high, label=label, ticks=tuple(ticks))


def logarithmic(values: Iterable[float], label: str, *, pad: float = 0.04, most: int = 6) -> Scale:
    """A logarithmic axis over the positive finite values."""
    low, high = _limits(v for v in values if v > 0.0)
    if not low < high:
        low, high = (0.5 * low, 2.0 * high) if low > 0.0 else (0.1, 10.0)
    grow = (high / low) ** pad
    low, high = low / grow, high * grow
    ends = math.floor(math.log10(low)), math.ceil(math.log10(high))
    if math.log10(high / low) < FEW_DECADES:
        every = _minor(low, high, ends)
    else:
        stride = -(-(ends[1] - ends[0]) // most)
        every = [10.0**k for k in range(ends[0], ends[1] + 1) if k % stride == 0]
    ticks = tuple((v, power_text(v)) for v in every if low <= v * (1 + 1e-9) and v <= high * (1 + 1e-9))
    return Scale(kind="log", low=low, high=high, label=label, ticks=ticks)


def calendar(epoch: Epoch, t_s: Array, *, most: float = 5.5, pad: float = 0.02) -> Scale:
    """Days after `epoch`, labelled with calendar dates (TDB); none at the very end, where it would be cut."""
    low, high = float(np.min(t_s)) / SECONDS_PER_DAY, float(np.max(t_s)) / SECONDS_PER_DAY
    room = pad * (high - low) or 0.5
    low, high = low - room, high + room
    text = epoch.iso(digits=0).removesuffix(" TDB")
    origin = datetime.fromisoformat(text)
    marks, pattern = _dates(origin + timedelta(days=low), origin + timedelta(days=high), most)
    places = [((m - origin).total_seconds() / SECONDS_PER_DAY, m.strftime(pattern)) for m in marks]
    ticks = tuple((x, name) for x, name in places if x < high - 0.03 * (high - low))
    return Scale(kind="time", low=low, high=high, label="date, TDB", ticks=ticks, origin=text)


def named(names: list[str], label: str = "") -> Scale:
    """A row for each name, the first on top."""
    ticks = tuple((-float(i), name) for i, name in enumerate(names))
    return Scale(kind="linear", low=-len(names) + 0.5, high=0.5, label=label, ticks=ticks)


def round_step(rough: float) -> float:
    """The next step of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough * (1 - 1e-9)))


def tick_text(value: float, step: float) -> str:
    """A tick of a linear axis with the decimals of its step."""
    if abs(value) < 1e-9 * step:
        return "0"
    if step >= 1e5 or step < 1e-4:
        return number(value, 2)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    text = f"{abs(value):,.{digits}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return ("\N{MINUS SIGN}" if value < 0 else "") + text


def power_text(value: float) -> str:
    """A tick of a logarithmic axis: 0.01, 0.5, 1, 1000, 10⁴."""
    exponent = math.floor(math.log10(value) + 1e-9)
    if -3 <= exponent <= 3:
        return f"{value:.6g}"
    lead = round(value / 10.0**exponent, 3)
    raised = f"10{str(exponent).translate(SUPERSCRIPT)}"
    return raised if lead == 1.0 else f"{lead:g}·{raised}"


def _limits(values: Iterable[float]) -> tuple[float, float]:
    """Smallest and largest finite value; 0 and 0 where there is none."""
    found = [float(v) for v in values if math.isfinite(v)]
    return (min(found), max(found)) if found else (0.0, 0.0)


def _minor(low: float, high: float, ends: tuple[int, int]) -> list[float]:
    """Round values inside a short logarithmic axis, more of them the shorter it is."""
    for leads in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)):
        found = [lead * 10.0**k for k in range(ends[0], ends[1] + 1) for lead in leads]
        found = [v for v in found if low <= v <= high]
        if len(found) >= 3:
            return found
    step = round_step((high - low) / 4)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _dates(start: datetime, end: datetime, most: float) -> tuple[list[datetime], str]:
    """At most about `most` round dates between two moments, and how to write them."""
    days = (end - start).total_seconds() / SECONDS_PER_DAY
    if days > 75:
        steps = (1, 2, 3, 6, 12, 24, 60, 120, 240, 600, 1200)
        step = next((s for s in steps if days / 30.44 / s <= most + 0.5), steps[-1])
        months = [m for m in range(start.year * 12 + start.month, end.year * 12 + end.month) if m % step == 0]
        return [datetime(m // 12, m % 12 + 1, 1) for m in months], "%Y-%m" if step < 12 else "%Y"
    hours = next(h for h in (1, 3, 6, 12, 24, 48, 120, 240, 360, 720, 1440) if days * 24 / h <= most)
    origin = datetime(start.year, 1, 1)
    k = math.ceil((start - origin).total_seconds() / 3600 / hours)
    marks = []
    while origin + timedelta(hours=k * hours) <= end:
        marks.append(origin + timedelta(hours=k * hours))
        k += 1
    return marks, "%Y-%m-%d" if hours >= 24 else "%m-%d %H:%M"
