"""Which names are of one object: numbers and provisional designations that stand together, changed orbit letters."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from nebosvod.observation.formats.designations import (
    EXERCISE,
    Designation,
    canonical_number,
    from_columns,
    from_text,
    kind,
    stem_of,
    unpacked,
)

RUN_TOGETHER = re.compile(
    r"(\d{4}|[aA][89]\d{2})[ _-]?([A-Za-z]{2}\d*|[A-Za-z]{3}\d{1,3}|[Pp]-[Ll]|[Tt]-[123])", re.ASCII
)
WITH_NAME = re.compile(r"\((\d+)\)\s+\S.*", re.ASCII)


def numbers_of(found: Iterable[Designation]) -> dict[str, str]:
    """The number of each provisional designation that stands beside one, by its stem."""
    return {one.stem: one.number for one in found if one.number and one.provisional}


def names_of(found: Sequence[Designation]) -> list[str]:
    """What each of them is called: by the number, if any record knows it; one name for changed orbit letters."""
    numbers, letters = numbers_of(found), one_letter(one.provisional for one in found)
    return [one.number or numbers.get(one.stem) or letters.get(one.stem) or one.name for one in found]


def one_letter(names: Iterable[str]) -> dict[str, str]:
    """Of each stem of provisional designations the form it is called by: with the letter that stands last."""
    found: dict[str, str] = {}
    for name in names:
        if kind(name) == "provisional":
            found[stem_of(name)] = max(found.get(stem_of(name), ""), name)
    return found


def other_names(found: Iterable[Designation]) -> dict[str, tuple[str, ...]]:
    """What else the objects of some records are called: of each such name the designations it stands for.

    An observer's own name may have been given to several objects.
    """
    several = tuple(found)
    called: dict[str, dict[str, None]] = {}
    for one, name in zip(several, names_of(several)):
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


def exercises(file: str, found: Iterable[Designation]) -> list[str]:
    """A notice for each name in a file that looks like a designation and is none of the IAU."""
    names = dict.fromkeys(one.provisional for one in found if EXERCISE.fullmatch(one.provisional))
    return [f"{file}: {name} is no designation of the IAU; taken as the name of an exercise" for name in names]


def numbered(name: str, called: Mapping[str, Iterable[str]]) -> str:
    """The number that a provisional designation alone stands for, else the name itself."""
    if kind(name) != "provisional":
        return name
    stem = stem_of(name)
    forms = [other for other in called if kind(other) == "provisional" and stem_of(other) == stem]
    found = dict.fromkeys(one for form in forms for one in called[form])
    return next(iter(found)) if len(found) == 1 else name


def united(names: Sequence[str], called: Mapping[str, Iterable[str]]) -> list[str]:
    """What the objects of several tables are called together: see `numbered` and `one_letter`."""
    known = [numbered(name, called) for name in names]
    letters = one_letter(known)
    return [letters.get(stem_of(name), name) if kind(name) == "provisional" else name for name in known]


def readings(text: str) -> list[str]:
    """What somebody may mean by a designation, likeliest first: as written, unpacked, with its blank."""
    return list(dict.fromkeys(_readings(text)))


def _readings(text: str) -> Iterator[str]:
    """The same, some of them twice."""
    plain = text.strip().strip("()")
    yield text.strip()
    if kind(plain) == "number":
        yield canonical_number(plain)
    if kind(whole := unpacked(plain)):
        yield whole
    if len(plain) == 12 and (columns := from_columns(plain)) is not None:
        yield columns.name
    if (written := from_text(plain)) is not None:
        yield from (name for name in (written.number, written.provisional) if name)
    if match := RUN_TOGETHER.fullmatch(plain):
        yield f"{match[1]} {match[2]}".upper()
    if match := WITH_NAME.fullmatch(text.strip()):
        yield canonical_number(match[1])
    if kind(plain.upper()):
        yield plain.upper()
