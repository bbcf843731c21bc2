"""Which lines of an 80-column file are records, which belong together, and which are left out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nebosvod.observation.contracts import Flags, Rows
from nebosvod.observation.formats import mpc80_codes
from nebosvod.observation.formats.mpc80_columns import BLANK, WIDTH, Columns, lines_of
from nebosvod.observation.formats.source_file import SourceFile

CODE = np.frombuffer(b"COD ", dtype=np.uint8)  # the header line that names the observatory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordLines:
    """The lines of a file that are records: first lines, and for each the row of its second line or -1."""

    source: SourceFile
    rows: Columns
    line: Rows
    first: Rows
    second: Rows
    left_out: dict[str, int]
    header_station: list[str]  # of each first line, by the header above it; "" where none names one

    @property
    def head(self) -> Columns:
        return self.rows[self.first]

    def wrong(self, which: Flags, text: Callable[[str], str]) -> None:
        """Note a problem for each first line of `which`; `text` makes the sentence from the line."""
        for i in np.flatnonzero(which).tolist():
            row = self.rows[self.first[i]]
            self.source.problem(int(self.line[self.first[i]]), text(bytes(row).decode("ascii", "replace")))


def record_lines(source: SourceFile) -> RecordLines:
    """Sort out blank, header, deleted and radar lines, and find the second line of every two-line record."""
    rows, lengths, raw = lines_of(source.data)
    if (raw > 126).any() or ((raw < BLANK) & (raw != 10)).any():
        strange = int(np.flatnonzero((raw > 126) | ((raw < BLANK) & (raw != 10)))[0])
        raise source.error(
            int(np.count_nonzero(raw[:strange] == 10)) + 1,
            f"byte 0x{raw[strange]:02X} has no place in 80-column records, which are plain ASCII",
        )
    line: Rows = np.arange(1, lengths.size + 1)
    keep = lengths > 0
    for keyword in mpc80_codes.HEADERS:
        start = np.frombuffer(keyword.ljust(4 if len(keyword) > 1 else 1).encode(), dtype=np.uint8)
        keep &= ~(rows[:, : start.size] == start).all(axis=1)
    for number in line[keep & (lengths != WIDTH)].tolist():
        source.problem(
            int(number),
            f"the record has {lengths[number - 1]} columns, not {WIDTH}; the observatory code must stand in 78-80 "
            "(was the line cut or shifted?)",
        )
    source.refuse_problems()
    named = np.flatnonzero(~keep & (rows[:, :4] == CODE).all(axis=1))
    codes = ["", *(bytes(row[4:]).decode("ascii").strip()[:4] for row in rows[named])]
    rows, line = rows[keep], line[keep]
    first, second, left_out = _pairs(source, rows, line)
    above = np.searchsorted(named, line[first] - 1)
    return RecordLines(
        source=source,
        rows=rows,
        line=line,
        first=first,
        second=second,
        left_out=left_out,
        header_station=[codes[k] for k in above],
    )


def _pairs(source: SourceFile, rows: Columns, line: Rows) -> tuple[Rows, Rows, dict[str, int]]:
    """Which rows are first lines to be read, the row of the second line of each, and what is left out."""
    code = rows[:, 14]
    n = code.size
    follower = np.zeros(n, dtype=bool)  # second lines
    has_second = np.zeros(n, dtype=bool)
    left_out = {"deleted": 0, "radar": 0, "offset": 0}
    deleted = np.isin(code, [ord(letter) for letter in mpc80_codes.DELETED])
    same = np.zeros(n, dtype=bool)  # whether the next row is of the same object, time and observatory
    agree = rows[:-1] == rows[1:]
    same[:-1] = agree[:, :12].all(axis=1) & agree[:, 15:32].all(axis=1) & agree[:, 77:80].all(axis=1)
    following = np.append(code[1:], 0)
    for big, small in mpc80_codes.SECOND_LINES.items():
        firsts, seconds = code == ord(big), code == ord(small)
        followed = following == ord(small)
        for i in np.flatnonzero(firsts & ~followed).tolist():
            source.problem(int(line[i]), _orphan_first(big, small))
        for i in np.flatnonzero(firsts & followed & ~same).tolist():
            source.problem(
                int(line[i + 1]),
                f'line "{small}" is not of the same object, time and observatory as line {line[i]} before it '
                "(columns 1-12, 16-32 and 78-80 must agree)",
            )
        owned = np.zeros(n, dtype=bool)
        # the second line of a deleted record goes with it
        owned[1:] = ((firsts & followed) | (deleted & followed & same))[:-1]
        for i in np.flatnonzero(seconds & ~owned).tolist():
            source.problem(int(line[i]), f'line "{small}" stands alone: it must follow its line "{big}"')
        follower |= seconds
        has_second |= firsts & followed
    source.refuse_problems()
    radar = np.isin(code, [ord(letter) for letter in mpc80_codes.RADAR]) & ~follower
    offset = code == ord(mpc80_codes.OFFSET)
    left_out.update(deleted=int(deleted.sum()), radar=int(radar.sum()), offset=int(offset.sum()))
    first = np.flatnonzero(~(follower | deleted | radar | offset))
    return first, np.where(has_second[first], first + 1, -1), left_out


def _orphan_first(big: str, small: str) -> str:
    what = {"S": "where the spacecraft was", "V": "where the observer stood", "R": "its uncertainties"}[big]
    return f'line "{big}" is not followed by its line "{small}", which tells {what}; without it the record has no use'
