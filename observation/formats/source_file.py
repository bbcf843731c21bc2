"""The bytes of an observation file, checked before anything is read from them, and what is wrong in them by line."""

import gzip
import os
import re
import stat
import zlib
from pathlib import Path
from typing import NamedTuple

from nebosvod.errors import DataError, InputError, listed
from nebosvod.errors import printable as escaped

LARGEST_BYTES = 32_000_000  # unpacked; the longest list of one object has 3
MOST_LINES = 250_000
MOST_CELLS = 3_000_000  # of separators or tags: each becomes a text of its own in memory
MOST_COLUMNS = 400
LONGEST_LINE = 20_000
TOO_LONG = re.compile(rb"[^\n]{%d}" % (LONGEST_LINE + 1))
HEAD_BYTES, HEAD_LINES = 10_000_000, 1000  # where the names of columns are looked for
LINES_OF_XML = 20  # of one record
MOST_PROBLEMS = 20
VALUES = re.compile(r'"[^"]*"|\d+(?:\.\d+)?')  # what differs between things that are wrong in one way


class Problem(NamedTuple):
    """The first of things that are wrong in one way, and the lines of all."""

    text: str
    lines: list[int]

    @property
    def again(self) -> str:
        """Where else, for the end of a sentence."""
        others = [str(line) for line in dict.fromkeys(self.lines[1:]) if line != self.lines[0]]
        return f"; so too line{'s' * (len(others) > 1)} {listed(others)}" if others else ""


class SourceFile:
    """A text file as bytes with plain line ends, and a list of the problems found in it.

    Parameters
    ----------
    name : what to call it in messages.
    data : its contents; a UTF-8 byte order mark is taken off, CRLF and CR become LF.

    Raises
    ------
    InputError
        If the contents are UTF-16, hold NUL, or are not UTF-8; with line and value of the byte.
    """

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        self.problems: dict[str, Problem] = {}
        self.noted = self.unsaid = 0
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise InputError(f"{name}:1: UTF-16 byte order mark (byte 0x{data[0]:02X}); save the file as UTF-8")
        self.data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self._refuse_too_much()
        self._refuse_strange_bytes()

    def _refuse_too_much(self) -> None:
        """Count before anything is taken apart: a list of texts takes twenty times the bytes of the file."""
        xml = self.data[:4096].lstrip().startswith(b"<")
        lines, tags = self.data.count(b"\n"), self.data.count(b"<")
        most = MOST_LINES * (LINES_OF_XML if xml else 1)
        cells = max(self.data.count(b"|"), self.data.count(b","), tags)
        for found, allowed, what in ((lines, most, "lines"), (cells, MOST_CELLS, "cells")):
            if found > allowed:
                raise InputError(
                    f"{self.name}: more than {allowed:,} {what} ({found:,}); split it by objects or by time"
                )
        for number, line in enumerate(self.data[:HEAD_BYTES].split(b"\n")[:HEAD_LINES], start=1):
            columns = max(line.count(b"|"), line.count(b",")) + 1
            if columns > MOST_COLUMNS and not line.lstrip().startswith((b"#", b"!", b"<")):
                raise InputError(f"{self.name}:{number}: more than {MOST_COLUMNS} columns ({columns:,})")
        if not xml and (long := TOO_LONG.search(self.data)):
            number = self.data.count(b"\n", 0, long.start()) + 1
            raise InputError(f"{self.name}:{number}: a line of more than {LONGEST_LINE:,} bytes, no observation")

    def _refuse_strange_bytes(self) -> None:
        if (place := self.data.find(b"\0")) < 0:
            try:
                self.data.decode("utf-8")
            except UnicodeDecodeError as error:
                place = error.start
            else:
                return
        line = self.data.count(b"\n", 0, place) + 1
        raise InputError(f"{self.name}:{line}: byte 0x{self.data[place]:02X} is not text in UTF-8; save it as UTF-8")

    @property
    def text(self) -> str:
        """The contents as text."""
        return self.data.decode("utf-8")

    @property
    def full(self) -> bool:
        """Whether so much was noted that hints, which take their time, are for nobody any more."""
        return self.noted >= MOST_PROBLEMS

    def problem(self, line: int, text: str) -> None:
        """Note one thing that is wrong; of things of one kind, and beyond the first twenty kinds, lines are counted."""
        self.noted += 1
        kind = VALUES.sub("#", text)
        if kind in self.problems:
            self.problems[kind].lines.append(line)
        elif len(self.problems) < MOST_PROBLEMS:
            self.problems[kind] = Problem(escaped(text), [line])
        else:
            self.unsaid += 1

    def error(self, line: int, text: str) -> InputError:
        """The exception of one thing after which there is no reading on; those noted before come with it."""
        self.problem(line, text)
        return self._all()

    def refuse_problems(self) -> None:
        """Raise everything noted so far.

        Raises
        ------
        InputError
            If anything was noted: one line for each kind, causes before what follows from them.
        """
        if self.problems:
            raise self._all()

    def _all(self) -> InputError:
        said = [f"{self.name}:{one.lines[0]}: {one.text}{one.again}" for one in self.problems.values()]
        more = [f"{self.name}: and {self.unsaid} more"] if self.unsaid else []
        return InputError("\n".join([*said, *more]))


def read_source(path: str | Path) -> SourceFile:
    """Read an observation file, unpacked if its name ends in `.gz`.

    Raises
    ------
    InputError
        If it is no regular file, too large (unpacked), has too many lines or columns, is damaged gzip, or not UTF-8.
    DataError
        If the system refuses to read it.
    """
    name = printable(str(path))
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InputError(f"{name}: is a directory, a pipe or a device, not a file of observations")
        with open(path, "rb") as stream:
            if str(path).endswith(".gz"):
                with gzip.GzipFile(fileobj=stream) as unpacked:
                    data = unpacked.read(LARGEST_BYTES + 1)
            else:
                data = stream.read(LARGEST_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{name}: no such file") from None
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise InputError(f"{name}: is not a whole gzip file ({error}); copy it again") from None
    except OSError as error:
        raise DataError(f"{name}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(f"{name}: is not a usable file name ({error})") from None
    if len(data) > LARGEST_BYTES:
        raise InputError(f"{name}: larger than {LARGEST_BYTES:,} bytes (unpacked); split it by objects or by time")
    return SourceFile(name, data)


def printable(text: str, limit: int = 120) -> str:
    """Text made safe for a terminal: control characters escaped, long text cut."""
    return escaped(text if len(text) <= limit else text[:limit] + "...")
