"""The text of ADES records as columns, before it means anything, and its conversion to numbers with what is allowed."""

import re
from dataclasses import dataclass

import numpy as np

from nebosvod.observation.contracts import Array, Rows
from nebosvod.observation.formats.source_file import SourceFile, printable

DECIMAL = re.compile(r"[+-]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})", re.ASCII)
REAL = re.compile(DECIMAL.pattern + r"(?:[eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Records of one file as text.

    Attributes
    ----------
    source : the file, which takes note of problems.
    line : (n,) line on which each record stands or begins.
    columns : for each name that occurs the n texts, stripped, "" where a record has none.
    notices : what a user should know about the file.
    """

    source: SourceFile
    line: Rows
    columns: dict[str, list[str]]
    notices: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.line.size)

    def text(self, name: str) -> list[str]:
        """The n texts of a column, all "" if the file has none of this name."""
        return self.columns.get(name) or [""] * len(self)

    def wrong(self, row: int, name: str, why: str) -> None:
        """Note what is wrong with one cell."""
        self.source.problem(int(self.line[row]), f'{name} "{printable(self.text(name)[row], 60)}": {why}')

    def numbers(self, name: str, allowed: str, *, real: bool = False) -> Array:
        """A column of numbers (n,), nan where blank, noting what is not a number or outside of `allowed`.

        Parameters
        ----------
        allowed : an interval as one writes it, such as `[0, 360)`.
        real : whether an exponent may be written.
        """
        values = np.full(len(self), np.nan)
        if name not in self.columns:
            return values
        form = REAL if real else DECIMAL
        for row, text in enumerate(self.columns[name]):
            if not text:
                continue
            if form.fullmatch(text):
                values[row] = float(text)
            else:
                self.wrong(row, name, f"is not a decimal number; allowed {allowed}{_hint(name, text)}")
        low, high = (float(end) for end in allowed[1:-1].split(","))
        with np.errstate(invalid="ignore"):
            below = values < low if allowed[0] == "[" else values <= low
            above = values > high if allowed[-1] == "]" else values >= high
        for row in np.flatnonzero(below | above).tolist():
            self.wrong(row, name, f"is outside of what is allowed, {allowed}")
            values[row] = np.nan
        return values

    def keep(self, rows: list[int]) -> "Cells":
        """The same with these rows only."""
        columns = {name: [texts[row] for row in rows] for name, texts in self.columns.items()}
        line = self.line[np.array(rows, dtype=np.int64)]
        return Cells(source=self.source, line=line, columns=columns, notices=self.notices)


def _hint(name: str, text: str) -> str:
    """What the writer may have meant."""
    if re.fullmatch(r"[+-]?\d+[: hd]\s*\d+.*", text):
        return "; write degrees with decimals, not sexagesimal"
    if re.search("[OoIl]", text) and re.search(r"\d", text):
        return "; a letter stands where a digit belongs"
    return "; leave the cell empty if it is not known" if name not in ("ra", "dec") else ""
