"""The numbers behind a figure or a table as a CSV file inside the page: a `data:` link that works without a script."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

DIGITS = 7  # significant; the exact values are in the files of the folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Download:
    """A file name, the text of the file, and how many rows it has below its head."""

    name: str
    text: str
    rows: int

    @property
    def href(self) -> str:
        """The whole file as an address."""
        return "data:text/csv;charset=utf-8," + quote(self.text, safe="/,:;=+*()'!~@$?|")


def csv(name: str, columns: Mapping[str, Any]) -> Download:
    """A CSV file from columns of equal length, named with their units; what is not a finite number stays empty."""
    lines = [",".join(_cell(head) for head in columns)]
    lines += [",".join(_cell(cell) for cell in row) for row in zip(*columns.values(), strict=True)]
    return Download(name=f"{name}.csv", text="\n".join(lines) + "\n", rows=len(lines) - 1)


def _cell(value: Any) -> str:
    """One cell: text quoted where it must be, numbers with `DIGITS` digits, nothing for nothing."""
    if isinstance(value, str):
        return '"' + value.replace('"', '""') + '"' if any(c in value for c in ',"\n') else value
    if value is None or isinstance(value, bool):
        return "" if value is None else str(value).lower()
    return f"{value:.{DIGITS}g}" if math.isfinite(value) else ""
