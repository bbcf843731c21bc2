"""How a probability is told: the digits it needs, near one as many as what is missing to it, and no hit as a bound."""

import math
from collections.abc import Mapping
from typing import Any

LEAST = 1e-12  # of a formula; below it nobody knows
CERTAIN = 1.0 - 1e-9


def digits(low: float) -> int:
    """How many digits of a probability and its interval: near 1 so many that two tell what is missing at its low end.

    With three 0.9987 to 0.9994 would be told as 0.999 to 0.999.
    """
    return max(3, min(9, 1 + math.ceil(-math.log10(1.0 - low)))) if low < 1.0 else 3


def chance_words(value: float) -> str:
    """The probability of a formula: `0.187`, `0.99996`, `< 1e-12`."""
    if value < LEAST:
        return f"< {LEAST:g}"
    return "1" if value > CERTAIN else f"{value:.{digits(value)}g}"


def bound_words(high: float) -> str:
    """What is known where nothing hit."""
    return f"< {high:.2g} (95 %)"


def interval_words(value: float, low: float, high: float) -> str:
    """`0.187 (0.181 to 0.192)`; without an interval that of a formula."""
    if low == high:
        return chance_words(value)
    n = digits(low)
    low = low if low >= LEAST else 0.0
    return f"{value:.{n}g} ({low:.{n}g} to {high:.{n}g})"


def short_words(row: Mapping[str, Any]) -> str:
    """The same without its interval: `0.187`, `< 0.0006`."""
    return f"< {row['high']:.2g}" if row["bound"] else chance_words(row["probability"])


def row_words(row: Mapping[str, Any]) -> str:
    """An answer of a summary, with `probability`, `low`, `high` and `bound`."""
    if row["bound"]:
        return bound_words(row["high"]) if row["high"] < 1.0 else "-"
    return interval_words(row["probability"], row["low"], row["high"])
