"""Times as CCSDS messages write them: ASCII time codes A and B (CCSDS 301.0-B)."""

import re
from datetime import date, timedelta

from nebosvod.errors import InputError
from nebosvod.timescale import Epoch, Scale

# calendar date (code A) or day of the year (code B), a time that may be cut short, and the terminator Z
_CODE = re.compile(r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))(?:T(\d{2}:\d{2}(?::\d{2})?)(?:[.,](\d*))?)?(Z)?", re.ASCII)
# seconds to add to a clock reading to have TT; the others are scales of `Epoch`
ATOMIC = {"TAI": 32.184, "GPS": 51.184}
SCALES: dict[str, Scale] = {"UTC": "utc", "TDB": "tdb", "TT": "tt"}
SYSTEMS = (*SCALES, *ATOMIC)


def read_time(text: str, system: str) -> Epoch:
    """The moment a time code names by the clock of a TIME_SYSTEM (one of `SYSTEMS`).

    Parameters
    ----------
    text : `2024-02-28T12:00:00.5` (code A) or `2024-059T12:00:00.5` (code B), with or without the terminator Z.

    Raises
    ------
    InputError
        If the form is neither, the date or time does not exist, or Z (UTC) contradicts the time system.

    References
    ----------
    CCSDS 301.0-B, Time Code Formats; CCSDS 502.0-B, Orbit Data Messages.
    """
    match = _CODE.fullmatch(text)
    if match is None or (match[6] is not None and match[5].count(":") < 2):
        raise InputError(f'time "{text}": allowed 2024-02-28T12:00:00.5 or 2024-059T12:00:00.5, with or without Z')
    if match[7] and system != "UTC":
        raise InputError(f'time "{text}": its Z says UTC, but TIME_SYSTEM says {system}; make them agree')
    day = f"{match[1]}-{match[2]}-{match[3]}" if match[4] is None else _day_of_year(text, int(match[1]), int(match[4]))
    clock = (match[5] or "00:00:00") + (f".{match[6]}" if match[6] else "")
    return Epoch.parse(f"{day}T{clock} {SCALES.get(system, 'tt').upper()}") + ATOMIC.get(system, 0.0)


def _day_of_year(text: str, year: int, number: int) -> str:
    """The calendar date of a day of the year, 001 to 366."""
    found = date(year, 1, 1) + timedelta(days=number - 1) if 1 <= year < 9999 and number else None
    if found is None or found.year != year:
        raise InputError(f'time "{text}": {year} has no day {number:03d}')
    return found.isoformat()
