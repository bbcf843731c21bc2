"""Sentences of the first hour, from the stored answer."""

from collections.abc import Mapping
from typing import Any

from nebosvod.errors import counted
from nebosvod.impacts.chance import interval_words

APART = 0.2  # a difference between probabilities of two priors that is told
APART_FACTOR = 3.0  # a ratio that is
NOTED = 1e-3  # below it a ratio is not
Row = Mapping[str, Any]


def headline(summary: Mapping[str, Any]) -> str:
    """The answer in a line."""
    days = f"within {span(summary['within_d'])}"
    if summary["bound"]:
        return f"Probability to hit the Earth {days}: below {summary['high']:.2g} (95 %); {hits_words(summary['hits'])}"
    told = interval_words(*(summary[name] for name in ("probability", "low", "high")))
    return f"Probability to hit the Earth {days}: {told}"


def hits_words(hits: int) -> str:
    """Why a probability is a bound."""
    if not hits:
        return "no drawn orbit hits"
    return f"{counted(hits, 'drawn orbit')} {'hits, and weighs' if hits == 1 else 'hit, and weigh'} next to nothing"


def prior_decides(by_prior: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether probabilities by prior differ by 0.2, or by a factor of 3 where one is above 0.001.

    Of a bound it is known that it is below: it differs from what is that much above it.
    """
    known = [row["probability"] for row in by_prior.values() if not row["bound"]]
    high = max(known, default=0.0)
    low = min((top_of(row) for row in by_prior.values()), default=0.0)
    return bool(high - low > APART or (high > NOTED and high > APART_FACTOR * low))


def top_of(row: Mapping[str, Any]) -> float:
    """A probability, or the bound that it is below."""
    return float(row["high"] if row["bound"] else row["probability"])


def span(days: float) -> str:
    """In which time an impact counts."""
    return f"{days:g} days" if days >= 2.0 else f"{24.0 * days:.3g} h"


def arc(hours: float) -> str:
    """Length of the observed arc."""
    if hours < 2.0:
        return f"{60.0 * hours:.0f} min" if hours >= 0.05 else f"{3600.0 * hours:.2g} s"
    return f"{hours:.1f} h" if hours < 48.0 else f"{hours / 24.0:.1f} d"


def duration(seconds: float) -> str:
    """A length of time in the unit that suits it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 0.995 * length:
            return f"{_two(seconds / length)} {unit}"
    return f"{_two(seconds)} s"


def angle(arcsec: float, degrees: str = " deg") -> str:
    """A spread on the sky in the unit that suits it."""
    if arcsec < 99.5:
        return f"{_two(arcsec)} arcsec"
    return f"{_two(arcsec / 60.0)} arcmin" if arcsec < 3570.0 else f"{_two(arcsec / 3600.0)}{degrees}"


def sight(row: Row) -> str:
    """Whether a field can be seen, in a word or two; empty of a folder that does not say."""
    if row.get("visible", True) is False:
        return f"not possible: {row['not_seen']}"
    if row.get("altitude_deg") is not None:
        return f"{row['altitude_deg']:.0f} deg high"
    return f"{row['elongation_deg']:.0f} deg from the Sun" if "elongation_deg" in row else ""


def first_visible(summary: Row) -> Row | None:
    """The first of the fields that can be seen."""
    return next((row for row in summary["fields"] if row.get("visible", True) is not False), None)


def none_visible(summary: Row) -> str:
    """That none of the fields can be seen, and who can look next."""
    fields, then = summary["fields"], summary.get("next_visible")
    why = ", ".join(dict.fromkeys(word for row in fields for word in row["not_seen"].split(", ")))
    later = (
        f"the first chance is {then['telescope']} from about {then['epoch_utc'][:16].replace('T', ' ')} UTC on" if then
        else f"nor within {span(min(3.0, summary['within_d']))} after the last observation"
    )  # fmt: skip
    return f"at none of the times asked for can it be observed ({why}); {later}"


def _two(value: float) -> str:
    """Two digits, or three where the number has as many before its point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
