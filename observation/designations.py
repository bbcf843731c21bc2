"""Designations of small bodies: packed and unpacked, numbers, provisional ones, observers' own names."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from mpc_designation import MPCDesignationError, unpack

NUMBER = re.compile(r"0*([1-9]\d{0,8})", re.ASCII)
NUMBERED_COMET = re.compile(r"0*([1-9]\d{0,3}[PDI](?:-[A-Z]{1,2})?)", re.ASCII)
PROVISIONAL = re.compile(
    r"(?:\d{4}|A[89]\d{2}) [A-HJ-Y][A-HJ-Z]\d*|\d{4} (?:P-L|T-[123])|[ACDIPX]/\d{4} [A-Z]{1,2}\d*(?:-[A-Z]{1,2})?",
    re.ASCII,
)
RUN_TOGETHER = re.compile(r"(\d{4}|[aA][89]\d{2})[ _-]?([A-Za-z]{2}\d*)", re.ASCII)
OWN_NAME = re.compile(r"[-?+@./()\\A-Za-z0-9_ ]{1,25}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Designation:
    """What a record calls its object: permanent number, provisional designation, the observer's own name."""

    number: str = ""
    provisional: str = ""
    own: str = ""

    @property
    def name(self) -> str:
        """The most lasting of the three."""
        return self.number or self.provisional or self.own


def kind(text: str) -> str:
    """`number`, `provisional`, or "" for text that is neither, unpacked."""
    if NUMBER.fullmatch(text) or NUMBERED_COMET.fullmatch(text):
        return "number"
    return "provisional" if PROVISIONAL.fullmatch(text) else ""


def canonical_number(text: str) -> str:
    """A number without leading zeros."""
    return text.lstrip("0") or text


def unpacked(packed: str) -> str:
    """The readable form of a packed designation, "" if there is none."""
    if not packed:
        return ""
    try:
        return str(unpack(packed))
    except (MPCDesignationError, ValueError, IndexError, KeyError):
        return ""


def from_columns(columns: str) -> Designation | None:
    """The designation in columns 1-12 of an 80-column record; None if they hold nothing that can be one.

    Columns 1-5 hold a packed number, 6-12 a packed provisional designation or the observer's own name; for a comet
    column 5 holds the letter of its orbit. Unpacked designations written into the twelve columns are read as well.
    """
    whole = columns.strip()
    if kind(whole) == "number" and not columns[5:].strip():
        return Designation(number=canonical_number(whole))
    if kind(whole) == "provisional":
        return Designation(provisional=whole)
    head, tail = columns[:5].strip(), columns[5:].strip()
    if len(head) == 1 and columns[4] == head and tail:
        comet = unpacked(head + tail)
        return Designation(provisional=comet) if kind(comet) == "provisional" else None
    number = unpacked(head)
    if head and kind(number) != "number":
        return None
    provisional = unpacked(tail)
    if not tail and not head:
        return None
    if kind(provisional) == "provisional":
        return Designation(number=number, provisional=provisional)
    return Designation(number=number, own=tail) if OWN_NAME.fullmatch(tail) or not tail else None


def numbers_of(found: Iterable[Designation]) -> dict[str, str]:
    """The number of each provisional designation that stands beside one."""
    return {one.provisional: one.number for one in found if one.number and one.provisional}


def other_names(found: Iterable[Designation]) -> dict[str, tuple[str, ...]]:
    """What else the objects of some records are called: of each such name the designations it stands for.

    An observer's own name may have been given to several objects.
    """
    several = tuple(found)
    numbers = numbers_of(several)
    called: dict[str, dict[str, None]] = {}
    for one in several:
        name = one.number or numbers.get(one.provisional, "") or one.name
        for other in (one.provisional, one.own):
            if other and other != name:
                called.setdefault(other, {})[name] = None
    return {other: tuple(names) for other, names in called.items()}


def merged(parts: Iterable[Mapping[str, tuple[str, ...]]]) -> dict[str, tuple[str, ...]]:
    """`other_names` of several tables together; what is a number in one of them is so for all."""
    called: dict[str, dict[str, None]] = {}
    for part in parts:
        for other, names in part.items():
            called.setdefault(other, {}).update(dict.fromkeys(names))
    lasting = {name: numbered(name, called) for names in called.values() for name in names}
    return {other: tuple(dict.fromkeys(lasting[name] for name in names)) for other, names in called.items()}


def numbered(name: str, called: Mapping[str, Iterable[str]]) -> str:
    """The number that a provisional designation alone stands for, else the name itself."""
    found = tuple(called.get(name, ())) if kind(name) == "provisional" else ()
    return found[0] if len(found) == 1 else name


def readings(text: str) -> Iterator[str]:
    """What somebody may mean by a designation, likeliest first: as written, unpacked, with its blank."""
    plain = text.strip().strip("()")
    yield text.strip()
    if kind(plain) == "number":
        yield canonical_number(plain)
    if kind(whole := unpacked(plain)):
        yield whole
    if len(plain) == 12 and (columns := from_columns(plain)) is not None:
        yield columns.name
    if match := RUN_TOGETHER.fullmatch(plain):
        yield f"{match[1]} {match[2]}".upper()
