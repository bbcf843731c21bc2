"""What the classes of summaries have in common: they show themselves in a line, and in a notebook as a table."""

import warnings
from collections.abc import Mapping
from dataclasses import fields
from html import escape
from typing import Any, ClassVar

import numpy as np
from astropy.time import Time
from astropy.units import Quantity

MOST, LONGEST = 6, 60  # numbers of an array, letters of a text, that a line shows


class Typed:
    """A block of a summary; `SCHEMA` is the file, under nebosvod/, of one that is whole."""

    __slots__ = ()
    SCHEMA: ClassVar[str] = ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(f'{name} {value}' for name, value in self._shown())}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><th scope="row" style="text-align:left;font-weight:normal">{escape(name)}</th>'
            f'<td style="text-align:left">{escape(value)}</td></tr>'
            for name, value in self._shown()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"

    def _shown(self) -> list[tuple[str, str]]:
        """Name and value of each field that has one."""
        named = ((one.name, getattr(self, one.name)) for one in fields(self))  # type: ignore[arg-type]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # erfa calls every UTC date to come dubious
            shown = [(name, told(value)) for name, value in named if value is not None]
        return [(name, words) for name, words in shown if words]


def told(value: Any) -> str:
    """A value in few words."""
    if isinstance(value, Time):
        return f"{value.isot} {value.scale.upper()}" if value.isscalar else f"{value.size} moments"
    if isinstance(value, Quantity):
        few = value.size <= MOST and value.ndim < 2
        unit = f" {value.unit}" if few or value.unit.to_string() else ""
        return f"{_numbers(value.value) if few else f'array {value.shape}'}{unit}".rstrip()
    if isinstance(value, np.ndarray):
        return _numbers(value) if value.size <= MOST and value.ndim < 2 else f"array {value.shape}"
    if isinstance(value, Typed):
        return type(value).__name__
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return f"{{{', '.join(map(str, value))}}}"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) if all(isinstance(one, str) for one in value) else f"{len(value)} rows"
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def _numbers(values: Any) -> str:
    """One number, or some in brackets."""
    if np.ndim(values) == 0:
        return f"{float(values):.6g}"
    return f"[{' '.join(f'{one:.6g}' for one in np.asarray(values).tolist())}]"
