"""What a page is made of, for who wants its figures and words without the page."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

from nebosvod.report.kit.plate import Plate


@dataclass(slots=True, eq=False)
class Gathered:
    """The figures of a page in the order they were drawn, and the words its template was given."""

    plates: list[Plate] = field(default_factory=list)
    words: dict[str, Any] = field(default_factory=dict)


_NOW: ContextVar[Gathered | None] = ContextVar("gathered", default=None)


@contextmanager
def gathering() -> Iterator[Gathered]:
    """Gather what the pages made inside are made of."""
    found = Gathered()
    token = _NOW.set(found)
    try:
        yield found
    finally:
        _NOW.reset(token)


def gather_plate(plate: Plate) -> Plate:
    """Keep a finished figure where somebody gathers."""
    found = _NOW.get()
    if found is not None:
        found.plates.append(plate)
    return plate


def gather_words(words: Mapping[str, Any]) -> None:
    """Keep the words of a template where somebody gathers."""
    found = _NOW.get()
    if found is not None:
        found.words.update(words)
