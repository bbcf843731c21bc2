"""What the residuals say of the model, in a few lines of a terminal."""

from collections.abc import Iterator, Mapping
from typing import Any

FINDINGS_SHOWN = 4


def diagnosis_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """The findings of the tests of residuals; nothing where chance would bring as much."""
    found = (summary.get("diagnosis") or {}).get("findings", [])
    for text in found[:FINDINGS_SHOWN]:
        yield f"residuals: {text}"
    if len(found) > FINDINGS_SHOWN:
        yield f"  and {len(found) - FINDINGS_SHOWN} more (all in the report)"
