"""Designations of small bodies, packed and unpacked: what a text or the first twelve columns of a record name.

Which names are of one object is for `object_names`.
"""

import re
from dataclasses import dataclass

from mpc_designation import MPCDesignationError, unpack

NUMBER = re.compile(r"0*([1-9]\d{0,8})", re.ASCII)
# "6743P-L" is of the Palomar-Leiden survey, without its blank
NUMBERED_COMET = re.compile(r"(?!\d{4}P-L)0*([1-9]\d{0,3}[PDI](?:-[A-Z]{1,2})?)", re.ASCII)
COMET_HEAD = re.compile(r"0*([1-9]\d{0,3})([PDI])", re.ASCII)
# number and what follows its stroke: "1I/2017 U1", "73P/Schwassmann-Wachmann 3-B"
LONG_COMET = re.compile(r"0*([1-9]\d{0,3})([PDI])/(.{2,60}?)(?:-([A-Z]{1,2}))?", re.ASCII)
MINOR_PLANET = r"(?:\d{4}|A[89]\d{2}) [A-HJ-Y][A-HJ-Z]\d*|\d{4} (?:P-L|T-[123])"
# a comet whose orbit letter is not written has half-month and number: "2019 Y4"
COMET = r"\d{4} [A-HJ-Y][1-9]\d*(?:-[A-Z]{1,2})?|[ACDIPX]/(?:-?\d{1,4}|A[89]\d{2}) [A-Z]{1,2}\d*(?:-[A-Z]{1,2})?"
PROVISIONAL = re.compile(f"{MINOR_PLANET}|{COMET}", re.ASCII)
# three letters are in no designation of the IAU: objects of exercises, such as "2026 PDC27", "2022 TTX", "2013 PDC-E"
EXERCISE = re.compile(r"\d{4} [A-Z]{3}\d{0,3}(?:-[A-Z])?", re.ASCII)
OWN_NAME = re.compile(r"[-?+@./()\\A-Za-z0-9_ ]{1,25}")
ORBIT_LETTER = re.compile(r"[ACDIPX]/")
FRAGMENT = re.compile(r"[A-Za-z]{1,2}", re.ASCII)
PLANETS = "Mercury|Venus|Earth|Mars|Jupiter|Saturn|Uranus|Neptune|Pluto"
SATELLITE = re.compile(
    # a packed number in 1-5; a packed provisional designation in 5-12; and as one writes them
    r"[MVEJSUNP]\d{3}S(?: .*|[A-Z]\d{2}[A-Z]\w{3})?|S[I-L]\d{2}[MVEJSUNP][0-9A-Za-z]\d\d"
    rf"|S/\d{{4}} (?:[A-Z]|\(\d+\)) \d+|(?i:{PLANETS}) (?:\d+|[IVXLC]+)|[MJSUNP] [IVXLC]+",
    re.ASCII,
)
NO_SATELLITES = "is a natural satellite; orbits about planets are not fitted, only those about the Sun"


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

    @property
    def stem(self) -> str:
        """What the provisional designation is without its orbit letter; see `stem_of`."""
        return stem_of(self.provisional)


def kind(text: str) -> str:
    """`number`, `provisional` (also of an exercise), or "" for text that is neither, unpacked."""
    if NUMBER.fullmatch(text) or NUMBERED_COMET.fullmatch(text):
        return "number"
    return "provisional" if PROVISIONAL.fullmatch(text) or EXERCISE.fullmatch(text) else ""


def stem_of(provisional: str) -> str:
    """A provisional designation without its orbit letter, which changes: A/2017 U1 became C/ and I/2017 U1."""
    return ORBIT_LETTER.sub("", provisional, count=1)


def is_satellite(text: str) -> bool:
    """Whether a text, or twelve columns, name a natural satellite."""
    return bool(SATELLITE.fullmatch(text.rstrip())) or (text[:4] == "    " and is_satellite(text.strip()))


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


def from_text(text: str) -> Designation | None:
    """The designation that a text by itself is, readable or packed; None if it is none."""
    for form in (text, unpacked(text)):
        if kind(form) == "number":
            return Designation(number=canonical_number(form))
        if kind(form) == "provisional":
            return Designation(provisional=form)
    if match := LONG_COMET.fullmatch(text):
        number, letter, rest, fragment = match.groups()
        provisional = f"{letter}/{rest}{f'-{fragment}' if fragment else ''}"
        return Designation(
            number=_with_fragment(number + letter, fragment or ""),
            provisional=provisional if kind(provisional) == "provisional" else "",
        )
    return None


def combined(parts: list[Designation]) -> Designation | None:
    """What several texts of one record say together; None if they name two numbers.

    A fragment that one of them names is that of all.
    """
    if len({one.number.partition("-")[0] for one in parts if one.number}) > 1:
        return None
    provisional = next((one.provisional for one in parts if one.provisional), "")
    number = max((one.number for one in parts), key=len, default="")
    if number and COMET_HEAD.fullmatch(number):
        number = _with_fragment(number, fragment_of(provisional))
    return Designation(number=number, provisional=provisional, own=next((one.own for one in parts if one.own), ""))


def fragment_of(designation: str) -> str:
    """The letters of the fragment at the end of a comet's designation, "" if there are none."""
    head, dash, letters = designation.rpartition("-")
    comet = NUMBERED_COMET.fullmatch(designation) or re.search(r"[A-Z]\d+$", head)
    return letters if dash and comet and FRAGMENT.fullmatch(letters) else ""


def _with_fragment(number: str, letters: str) -> str:
    """The number of a comet with the letters of its fragment, if it has some."""
    return f"{number}-{letters.upper()}" if letters else number


def from_columns(columns: str, last_year: int = 9999) -> Designation | None:
    """The designation in columns 1-12 of an 80-column record; None if they hold nothing that can be one.

    Columns 1-5 hold a packed number, 6-12 a packed provisional designation or the observer's own name; for a comet
    column 5 holds the letter of its orbit and 11-12 the letters of a fragment. Unpacked designations written into the
    twelve columns are read as well. Beside a number, a provisional designation of a year after `last_year` is none.
    """
    whole, head, tail = columns.strip(), columns[:5].strip(), columns[5:].strip()
    if not whole or is_satellite(columns):
        return None
    # digits across the border of the two fields are one number that was not packed
    across = NUMBER.fullmatch(whole) and columns[4:6].strip().isdigit() and len(columns[4:6].strip()) == 2
    comet = head and (NUMBERED_COMET.fullmatch(whole) or LONG_COMET.fullmatch(whole))
    if kind(whole) == "provisional" or across or comet or (kind(whole) == "number" and not tail):
        return from_text(whole)
    if len(head) == 1 and columns[4] == head and tail:
        written = from_text(head + tail)
        return written if written and ORBIT_LETTER.match(written.provisional) else None
    if match := COMET_HEAD.fullmatch(head):
        return _of_comet(match[1], match[2], tail, last_year)
    number = unpacked(head)
    if head and kind(number) != "number":
        return None
    provisional = unpacked(tail)
    # packed comets have their letter in column 5: without it, "A10Rq2c" is an observer's own name
    if re.fullmatch(MINOR_PLANET, provisional, re.ASCII):
        possible = not number or year_of(provisional) <= last_year
        return Designation(number=number, provisional=provisional if possible else "")
    return Designation(number=number, own=tail) if OWN_NAME.fullmatch(tail) or not tail else None


def _of_comet(digits: str, letter: str, tail: str, last_year: int) -> Designation | None:
    """A numbered comet with what stands in columns 6-12: a fragment, a packed provisional designation, a name."""
    if not tail or FRAGMENT.fullmatch(tail):
        return Designation(number=_with_fragment(digits + letter, tail))
    provisional = unpacked(letter + tail)
    if kind(provisional) == "provisional":
        number = _with_fragment(digits + letter, fragment_of(provisional))
        return Designation(number=number, provisional=provisional if year_of(provisional) <= last_year else "")
    return Designation(number=digits + letter, own=tail) if OWN_NAME.fullmatch(tail) else None


def year_of(provisional: str) -> int:
    """The year in a provisional designation, 0 where it has none (surveys)."""
    year = re.match(r"(\d{4}) [A-Z]{1,2}\d*(?:-|$)", stem_of(provisional))
    return int(year[1]) if year else 0
