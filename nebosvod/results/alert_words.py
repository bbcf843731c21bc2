"""Sentences of the first hour, from the stored answer."""

from collections.abc import Mapping
from typing import Any


def headline(summary: Mapping[str, Any]) -> str:
    """The answer in a line."""
    days = f"within {summary['within_d']:g} days"
    if summary["bound"]:
        return f"Probability to hit the Earth {days}: below {summary['high']:.2g} (95 %); no drawn orbit hits"
    p, low, high = (summary[name] for name in ("probability", "low", "high"))
    return f"Probability to hit the Earth {days}: {p:.3g} ({low:.3g} to {high:.3g})"
