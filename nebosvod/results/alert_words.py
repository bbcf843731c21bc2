"""Sentences of the first hour, from the stored answer."""

from collections.abc import Mapping
from typing import Any

from nebosvod.impacts.chance import interval_words


def headline(summary: Mapping[str, Any]) -> str:
    """The answer in a line."""
    days = f"within {span(summary['within_d'])}"
    if summary["bound"]:
        hits = summary["hits"]
        said = f"{hits} drawn orbits hit, and weigh next to nothing" if hits else "no drawn orbit hits"
        return f"Probability to hit the Earth {days}: below {summary['high']:.2g} (95 %); {said}"
    told = interval_words(*(summary[name] for name in ("probability", "low", "high")))
    return f"Probability to hit the Earth {days}: {told}"


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


def _two(value: float) -> str:
    """Two digits, or three where the number has as many before its point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
