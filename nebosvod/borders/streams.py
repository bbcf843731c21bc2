"""The standard streams: closed ones lead nowhere, and a reader that leaves early ends no work.

A command that lost its reader goes on silently: its files are written, and its exit code is that of its work.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast


class PatientStream:
    """A text stream whose reader may leave: what is written after that goes nowhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._left = False

    def write(self, text: str) -> int:
        """Write, or pretend to."""
        if not self._left:
            try:
                return self._stream.write(text)
            except BrokenPipeError:
                self._leave()
        return len(text)

    def flush(self) -> None:
        """Flush, or pretend to."""
        if not self._left:
            try:
                self._stream.flush()
            except BrokenPipeError:
                self._leave()

    def _leave(self) -> None:
        """Send what is still in the buffer, and all that comes, nowhere."""
        self._left = True
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def patient_streams() -> Iterator[None]:
    """Give this process three open descriptors and patient standard streams; the streams come back at the end."""
    before = sys.stdout, sys.stderr
    _open_descriptors()
    try:
        sys.stdout, sys.stderr = (cast(TextIO, PatientStream(_there(stream))) for stream in before)
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, PatientStream):
                stream.flush()
        sys.stdout, sys.stderr = before


def _open_descriptors() -> None:
    """A file opened by the work must never get the number of a closed standard stream: libraries print there."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free


def _there(stream: TextIO | None) -> TextIO:
    """The stream; one that leads nowhere where Python found it closed, or it was closed since."""
    if stream is None or stream.closed:
        return open(os.devnull, "w", encoding="utf-8")
    return stream
