"""Sentences of the first hour, from the stored answer."""

import math
from collections.abc import Mapping
from typing import Any


def headline(summary: Mapping[str, Any]) -> str:
    """The answer in a line."""
    days = f"within {summary['within_d']:g} days"
    if summary["bound"]:
        hits = summary["hits"]
        said = f"{hits} drawn orbits hit, and weigh next to nothing" if hits else "no drawn orbit hits"
        return f"Probability to hit the Earth {days}: below {summary['high']:.2g} (95 %); {said}"
    p, low, high = (summary[name] for name in ("probability", "low", "high"))
    n = digits(low)
    return f"Probability to hit the Earth {days}: {p:.{n}g} ({low:.{n}g} to {high:.{n}g})"


def digits(low: float) -> int:
    """How many digits of a probability and its interval: near 1 so many that two tell what is missing at its low end.

    With three 0.9987 to 0.9994 would be told as 0.999 to 0.999.
    """
    return max(3, min(9, 1 + math.ceil(-math.log10(1.0 - low)))) if low < 1.0 else 3
