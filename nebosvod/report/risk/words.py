"""A risk in words: how probable, when, whether the ways agree, what is to blame."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from nebosvod.impacts.chance import digits
from nebosvod.impacts.ways import WORDS, Way, agree
from nebosvod.report.kit import short, wording
from nebosvod.report.kit.wording import NBSP, join, number, percent
from nebosvod.results.ahead_words import CALLED

Item = Mapping[str, Any]
SHORT = {"linear": "linear", "sampling": "sampling"}  # in the headline
NUMERALS = {2: "two", 3: "three", 4: "four"}
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
        first, last = _pair(p, low, high)
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
    return f"{100.0 * p:.{_decimals(p, width)}f}{NBSP}%"


def _pair(p: float, low: float, high: float) -> tuple[str, str]:
    """The ends of an interval, in the form of the probability between them."""
    if high < RARE:
        return number(low, 2), number(high, 2)
    n = _decimals(p, high - low)
    return f"{100.0 * low:.{n}f}", f"{100.0 * high:.{n}f}"


def _decimals(p: float, width: float) -> int:
    """Decimals of a percentage with an interval of this width: half of it has then 2 to 20 units of the last one.

    Two digits of a probability are told in any case; of one without an interval as many as anywhere.
    """
    first = 1 + math.floor(math.log10(100.0 * p))  # digits before the point
    if width <= 0.0:
        return max(digits(p) - first, 0)
    return min(max(0, 2 - first, math.ceil(-math.log10(25.0 * width))), 4)


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


def belief_words(row: Item) -> list[str | Markup]:
    """Which way to go by, which others agree with it, and why that one."""
    agreeing, apart = agreement(row)
    best = way_name(row["recommended"])
    others = [one for one in agreeing if one not in (best, SHORT.get(row["recommended"], best))]
    head = "With caution" if apart else "Yes, as far as the covariance holds" if others else "By one way only"
    parts: list[str | Markup] = [Markup("<b>{}</b>: go by {}").format(head, best)]
    if others:
        parts.append(Markup("{} {} with it").format(join(others), "agrees" if len(others) == 1 else "agree"))
    parts += [Markup("{} says {} and misleads").format(way_name(way["way"]), chance(way, False)) for way in apart]
    told: list[str | Markup] = [short.as_many(parts[0], parts[1:]), f"{row['reason'][:1].upper()}{row['reason'][1:]}."]
    if any(way["draws"] == 0 for way in apart):
        told.append("What disagrees without drawing takes the region for straighter or smaller than it is.")
    return told


def nominal_words(row: Item) -> list[str | Markup]:
    """How near the estimate itself comes, with the ellipse about it; and where the hits lie in the uncertainty."""
    near = row.get("approach") or {}
    parts: list[str | Markup] = []
    axes = [near[key] for key in ("semi_major_km", "semi_minor_km") if near.get(key) is not None]
    if near.get("impact"):
        parts.append("the nominal orbit hits")
    elif near.get("distance_km") is not None:
        parts.append(
            Markup("the nominal orbit misses the centre by {}").format(wording.quantity(near["distance_km"], "km"))
        )
    if axes:
        parts.append(Markup("target plane {} (1σ)").format(wording.product(axes, "km")))
    parts.append(Markup("time ± {} (1σ)").format(wording.quantity(row["sigma_time_s"], "s")))
    text = Markup("; ").join(parts)
    told: list[str | Markup] = [text[:1].upper() + text[1:] + "."]
    if row.get("sigmas") is not None:
        told.append(
            Markup("The nearest hit lies {} sigmas along the line of variations.").format(number(abs(row["sigmas"])))
        )
    return told


def headline(summary: Item) -> Markup:
    """The answer in one sentence."""
    rows = summary["virtual_impactors"]
    if not rows:
        return Markup("No impact on {} found until {}: {}").format(
            join([body_name(body) for body in summary["bodies"]], "or"), summary["until_utc"][:10],
            chance(summary["sampling"]),
        )  # fmt: skip
    worst = leading(rows)[0]
    what = Markup("{} on {} to hit {}").format(
        chance(worst), wording.date(worst["epoch_utc"]), body_name(worst["body"])
    )
    blame, agreeing, brief = blame_words(worst), agreement_words(worst), brief_agreement(worst)
    whom = [] if blame is None else [blame]
    shorter = [one.replace(" of the spread that decides", "") for one in whom]
    said = [[what, agreeing, *whom], [what, brief, *whom], [what, brief, *shorter], [what, agreeing], [what, brief]]
    ways = (Markup("; ").join(one) for one in said)
    return short.first_that_fits(*ways, wide_px=short.HEADLINE_PX, look=short.HEADLINE)


def brief_agreement(row: Item) -> Markup:
    """`four ways agree`, `line of variations misleads`."""
    agreeing, apart = agreement(row)
    if apart:
        return Markup("{} {}").format(
            join(way_name(way["way"]) for way in apart), "misleads" if len(apart) == 1 else "mislead"
        )
    return (
        Markup("{} ways agree").format(NUMERALS[len(agreeing)]) if len(agreeing) in NUMERALS else agreement_words(row)
    )


def leading(rows: Sequence[Item]) -> list[Item]:
    """Virtual impactors, the most probable first; of those without a hit the one with the highest bound."""
    return sorted(rows, key=lambda row: (-(row["probability"] or 0.0), -row["high"]))


def impactor_name(row: Item) -> str:
    """`the Earth, 2038-07-10`."""
    return f"{body_name(row['body'])}, {row['epoch_utc'][:10]}"
