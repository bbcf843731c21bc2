"""The lines of a file of text, one at a time: a list of them takes thirty times the bytes of a hostile file."""

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from nebosvod.errors import DataError

LARGEST_BYTES = 100_000_000
MOST_LINES = 1_000_000
LONGEST_LINE = 20_000


@contextmanager
def text_lines(path: Path) -> Iterator[Iterator[tuple[int, str]]]:
    """The lines of a file in UTF-8, with their numbers.

    Raises
    ------
    DataError
        If it is no regular file, cannot be read, is not UTF-8, or is too large; then also while it is read.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise DataError(f"{path}: is no regular file")
        if status.st_size > LARGEST_BYTES:
            raise DataError(f"{path}: larger than {LARGEST_BYTES:,} bytes")
        with path.open(encoding="utf-8") as file:
            yield _numbered(path, file)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None


def _numbered(path: Path, file: TextIO) -> Iterator[tuple[int, str]]:
    number = 0
    try:
        while line := file.readline(LONGEST_LINE + 1):
            number += 1
            if number > MOST_LINES:
                raise DataError(f"{path.name}: more than {MOST_LINES:,} lines; thin it out, or cut it into several")
            if len(line) > LONGEST_LINE:
                raise DataError(f"{path.name}:{number}: a line of more than {LONGEST_LINE:,} characters")
            yield number, line
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        where = f"after line {number}" if number else "in its first line"
        text = f"{path.name}: byte 0x{byte:02X} {where} is not text in UTF-8; get the file again, or save it as UTF-8"
        raise DataError(text) from None
