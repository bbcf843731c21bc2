"""Sentences of the first hour, from the stored answer."""

from collections.abc import Mapping
from typing import Any

from nebosvod.impacts.chance import interval_words


def headline(summary: Mapping[str, Any]) -> str:
    """The answer in a line."""
    days = f"within {summary['within_d']:g} days"
    if summary["bound"]:
        hits = summary["hits"]
        said = f"{hits} drawn orbits hit, and weigh next to nothing" if hits else "no drawn orbit hits"
        return f"Probability to hit the Earth {days}: below {summary['high']:.2g} (95 %); {said}"
    told = interval_words(*(summary[name] for name in ("probability", "low", "high")))
    return f"Probability to hit the Earth {days}: {told}"
