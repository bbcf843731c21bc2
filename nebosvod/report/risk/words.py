"""A risk in words: how probable, when, whether the ways agree, what is to blame."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from nebosvod.impacts.ways import WORDS, Way, agree
from nebosvod.report.kit import wording
from nebosvod.report.kit.wording import NBSP, join, number, percent
from nebosvod.results.ahead_words import CALLED

Item = Mapping[str, Any]
SHORT = {"linear": "linear", "sampling": "sampling"}  # in the headline
RARE = 1e-3  # a probability below this is told as one in so many


def body_name(body: str) -> str:
    """A body as a sentence names it."""
    return CALLED.get(body, body.capitalize())


def way_name(way: str) -> str:
    """A way as a reader is told it."""
    return WORDS.get(way, way.replace("_", " "))


def chance(row: Item, interval: bool = True) -> Markup:
    """`18.4 % (18.1 to 18.7)`, `below 0.06 % (95 %)`, `1.2 × 10⁻⁶ (1 to 1.4 × 10⁻⁶), one in 830 000`."""
    low, high, p = row["low"], row["high"], row["probability"]
    if unanswered(row):
        return Markup("no answer")
    if row["bound"] or p is None:
        return Markup('below <data value="{}" data-unit="">{}</data> (95{}%)').format(repr(high), _plain(high), NBSP)
    spread = Markup("")
    if interval and high > low:
        first, last = _pair(low, high)
        spread = Markup(" ({} to {})").format(first, last)
    shown = Markup('<data value="{}" data-unit="">{}</data>').format(repr(p), _share(p, high - low))
    rare = f", one in {number(float(f'{1.0 / p:.1e}'), 2)}" if 0.0 < p < RARE else ""
    return Markup('<span class="nowrap">{}{}</span>{}').format(shown, spread, rare)


def unanswered(row: Item) -> bool:
    """Whether a way has nothing to say: it drew nothing, and has no number."""
    return bool(row["probability"] is None and row.get("draws") == 0)


def _share(p: float, width: float) -> str:
    """A probability with the decimals that its interval leaves."""
    if p == 0.0:
        return "next to nothing"  # of a formula: below the smallest number there is
    if p < RARE:
        return number(p, 2)
    return f"{100.0 * p:.{_decimals(width)}f}{NBSP}%"


def _pair(low: float, high: float) -> tuple[str, str]:
    """The ends of an interval, in the form of the probability between them."""
    if high < RARE:
        return number(low, 2), number(high, 2)
    digits = _decimals(high - low)
    return f"{100.0 * low:.{digits}f}", f"{100.0 * high:.{digits}f}"


def _decimals(width: float) -> int:
    """Decimals of a percentage with an interval of this width: half of it has then 2 to 20 units of the last one."""
    return 1 if width <= 0.0 else min(max(0, math.ceil(-math.log10(25.0 * width))), 4)


def _plain(value: float) -> str:
    return number(value, 2) if value < RARE else f"{number(100.0 * value, 2)}{NBSP}%"


def agreement(row: Item) -> tuple[list[str], list[Item]]:
    """Short names of the ways that agree with the recommended one, itself among them, and the ways that do not."""
    best = next((way for way in row["ways"] if way["way"] == row["recommended"]), row)
    agree, apart = [], []
    for way in row["ways"]:
        if unanswered(way):
            continue
        if way is best or consistent(best, way):
            agree.append(SHORT.get(way["way"], way_name(way["way"])))
        else:
            apart.append(way)
    return agree, apart


def consistent(one: Item, other: Item) -> bool:
    """Whether two answers, of ways or of folders, can both be right."""
    return agree(_way(other), _way(one))


def _way(row: Item) -> Way:
    """An answer as the way it came from; one with an interval was drawn."""
    drawn = int(row.get("draws") or row["high"] > row["low"])
    return Way(name=row.get("way", ""), probability=row["probability"], low=row["low"], high=row["high"], draws=drawn)


def agreement_words(row: Item) -> Markup:
    """`linear and sampling agree`, `linear says 88 % and misleads`."""
    agree, apart = agreement(row)
    said: list[str | Markup] = []
    if len(agree) > 1:
        said.append(Markup("{} agree").format(join(agree)))
    said += [Markup("{} says {} and misleads").format(way_name(way["way"]), chance(way, False)) for way in apart]
    return Markup("; ").join(said) if said else Markup("by {} alone").format(agree[0] if agree else row["recommended"])


def blame_words(row: Item) -> Markup | None:
    """The source that the probability hangs on most; None where there is no budget."""
    rows = (row.get("budget") or {}).get("rows") or []
    if not rows:
        return None
    worst = strongest(row)
    if worst["share"] is not None:
        return Markup("{} is to blame for {} of the spread that decides").format(
            worst["source"], percent(worst["share"] or 0.0)
        )
    return Markup("it hangs most on {}").format(worst["source"])


def strongest(row: Item) -> Item:
    """The source with the largest share of the line, or without one the largest elasticity."""
    rows: list[Item] = row["budget"]["rows"]
    if any(one["share"] is not None for one in rows):
        return max(rows, key=lambda one: one["share"] or 0.0)
    return max(rows, key=lambda one: abs(one["elasticity"]))


def halved_words(row: Item) -> Markup:
    """What would become of the probability if the strongest source were halved."""
    worst = strongest(row)
    p, error = worst["probability_if_halved"], worst["probability_if_halved_error"]
    told = {"probability": min(p, 1.0), "low": max(p - error, 0.0), "high": min(p + error, 1.0), "bound": False}
    return Markup("Were {} halved and the estimate the same, it would be {}, one standard error either way.").format(
        worst["source"], chance(told)
    )


def headline(summary: Item) -> Markup:
    """The answer in one sentence."""
    rows = summary["virtual_impactors"]
    if not rows:
        return Markup("No impact on {} found until {}: {}").format(
            join([body_name(body) for body in summary["bodies"]], "or"), summary["until_utc"][:10],
            chance(summary["sampling"]),
        )  # fmt: skip
    worst = leading(rows)[0]
    blame = blame_words(worst)
    parts = [
        Markup("{} on {} to hit {}").format(chance(worst), wording.date(worst["epoch_utc"]), body_name(worst["body"])),
        agreement_words(worst),
        *([] if blame is None else [blame]),
    ]
    return Markup("; ").join(parts)


def leading(rows: Sequence[Item]) -> list[Item]:
    """Virtual impactors, the most probable first; of those without a hit the one with the highest bound."""
    return sorted(rows, key=lambda row: (-(row["probability"] or 0.0), -row["high"]))


def impactor_name(row: Item) -> str:
    """`the Earth, 2038-07-10`."""
    return f"{body_name(row['body'])}, {row['epoch_utc'][:10]}"
