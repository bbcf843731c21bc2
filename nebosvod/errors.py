"""Every exception nebosvod raises, the exit code a program should end with, and how messages count.

A message says where, what was found, what is allowed and what to do next. Wrong input raises; a
numerical failure inside a run is a status of the result, not an exception.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

# what a program ends with: finished, but not to be relied on; wrong input; the machine; a fault of the program
EXIT_QUALITY, EXIT_INPUT, EXIT_ENVIRONMENT, EXIT_INTERNAL = 1, 2, 3, 4


def counted(number: int, noun: str) -> str:
    """`1 record`, `2 records`, for a message."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def listed(names: Sequence[str], most: int = 6) -> str:
    """`NEB-1, NEB-2`; of many the first few: `W84, F51, M22 and 57 others`."""
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[: most // 2])} and {len(names) - most // 2} others"


def printable(text: str) -> str:
    """Text on one line that cannot disturb a terminal: what cannot be shown is escaped."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


class NebosvodError(Exception):
    """Base of all errors of this package.

    Attributes
    ----------
    place : what in a file asked for this, as the message begins; empty where nobody said.
    """

    exit_code = 4
    place = ""

    def say_place(self, place: str) -> None:
        """Put in front of the message what in a file asked for this; the first place that is said stays."""
        if place and not self.place:
            self.place = place
            self.args = (f"{place}: {self}",)


class NebosvodNotice(UserWarning):
    """What a user should know although the work goes on; the program shows it as one line, `notice: ...`."""


@contextmanager
def noting(notices: Sequence[str]) -> Iterator[None]:
    """Give an error on its way out what a user should know of the files, whatever the outcome (PEP 678 notes)."""
    try:
        yield
    except NebosvodError as error:
        for notice in notices:
            if notice not in getattr(error, "__notes__", ()):
                error.add_note(notice)
        raise


def notes_of(error: BaseException) -> tuple[str, ...]:
    """What `noting` gave to an error."""
    return tuple(getattr(error, "__notes__", ()))


class InputError(NebosvodError, ValueError):
    """Something the user wrote cannot be used; the message names file, line and field."""

    exit_code = 2


class CoverageError(InputError):
    """An epoch lies outside what a table or an ephemeris covers; the message gives the span."""


class GeometryError(NebosvodError):
    """The measurements do not determine what was asked for.

    Parameters
    ----------
    message : the sentence for the user.
    rank : numerical rank of the whitened problem, if known.
    weak_direction : parameter names with their weights in the worst determined combination.
    """

    exit_code = 1

    def __init__(
        self, message: str, *, rank: int | None = None, weak_direction: dict[str, float] | None = None
    ) -> None:
        super().__init__(message)
        self.rank = rank
        self.weak_direction = dict(weak_direction or {})


class UnseenError(GeometryError):
    """Nothing of a schedule can be seen."""


class EventError(NebosvodError):
    """The physics ended the run early: an impact, or a start below a body's surface."""

    exit_code = 1


class ImpactError(EventError):
    """An orbit runs into a body.

    Parameters
    ----------
    message : the sentence for the user.
    body, t_s : what it hits, and when it comes to the surface, TDB s after the orbit's epoch.
    """

    def __init__(self, message: str, *, body: str = "", t_s: float = float("nan")) -> None:
        super().__init__(message)
        self.body = body
        self.t_s = t_s


class StepLimitError(EventError):
    """An orbit takes more steps of the integration than it may.

    Parameters
    ----------
    message : the sentence for the user.
    t_s : how far it came, TDB s after the orbit's epoch.
    """

    def __init__(self, message: str, *, t_s: float = float("nan")) -> None:
        super().__init__(message)
        self.t_s = t_s


class NoAnswerError(NebosvodError):
    """A prediction does not exist for this orbit.

    Parameters
    ----------
    reason : the sentence for the user.
    status : one word for the summary.
    """

    exit_code = 1

    def __init__(self, reason: str, *, status: str = "no_answer") -> None:
        super().__init__(reason)
        self.status = status


class DataError(NebosvodError):
    """Data the program needs is missing or damaged; the message names the file, body and span."""

    exit_code = 3


class OutputError(NebosvodError):
    """A result cannot be written: disk, permission, or a run folder that is in use or exists."""

    exit_code = 3


class WorkerError(NebosvodError):
    """A process that computes for this one, or a cluster of them, does not answer; what is finished is kept."""

    exit_code = 3
