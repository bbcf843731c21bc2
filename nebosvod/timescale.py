"""Epochs: two-part TDB Julian dates, read from and written to text, and UTC by the leap-second table.

Inside nebosvod a time is float64 TDB seconds after an `Epoch`; this module is the only place where
other scales exist. UTC uses erfa's leap-second table; after its last entry TAI - UTC stays as it is
(37 s), and erfa's "dubious year" warning about that is silenced here and nowhere else. TDB - TT is
erfa's `dtdb` at the geocentre (Fairhead and Bretagnon 1990, good to 10 us).
"""

import math
import re
import warnings
from dataclasses import dataclass, field, replace
from datetime import timedelta
from functools import lru_cache
from typing import Any, Literal

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError

SECONDS_PER_DAY = 86400.0
KEPT_EPOCHS = 20_000
Integers = npt.NDArray[np.int64]
Scale = Literal["tdb", "tt", "utc"]
SCALES: tuple[Scale, ...] = ("tdb", "tt", "utc")
HINT = 'say the scale, for example "2028-11-15T00:00:00 TDB", "2028-11-15 UTC" or "2459215.5 JD TDB"'

_CALENDAR = re.compile(r"(\d{4})-(\d{2})-(\d{2})(?:[T ](\d{2}):(\d{2})(?::(\d{2}(?:\.\d+)?))?)?")
_JULIAN = re.compile(r"(\d+)(\.\d*)? (JD|MJD)")


@dataclass(frozen=True, slots=True, order=True)
class Epoch:
    """A moment as a two-part TDB Julian date: day number (ends in .5) and fraction of the day in [0, 1).

    `scale` is the one it was written in, for the answer to be in the same; it does not tell moments apart.
    """

    day: float
    fraction: float
    scale: Scale = field(default="tdb", compare=False, repr=False)

    @classmethod
    def from_jd(cls, jd1: float, jd2: float = 0.0, scale: Scale = "tdb") -> "Epoch":
        """Make an epoch from a two-part Julian date in `scale`; the parts may be split anyhow."""
        if not (math.isfinite(jd1) and math.isfinite(jd2)):
            raise InputError(f"epoch: Julian date {jd1} + {jd2} is not finite")
        if scale != "tdb":
            jd1, jd2 = (float(part) for part in to_tdb(jd1, jd2, scale))
        day = math.floor(jd1 - 0.5) + 0.5
        fraction = (jd1 - day) + jd2
        whole = math.floor(fraction)
        fraction -= whole
        if fraction == 1.0:  # just before midnight: the nearest number is midnight
            whole, fraction = whole + 1, 0.0
        return cls(day + whole, fraction)

    @classmethod
    def parse(cls, text: str) -> "Epoch":
        """Read `2028-11-15T00:00:00 TDB`, `2028-11-15 UTC`, `2459215.5 JD TDB` or `59215.0 MJD TT`.

        Raises
        ------
        InputError
            If the scale is missing, the form is not one of these, or the date does not exist.
        """
        body, _, last = text.strip().rpartition(" ")
        scale = last.lower()
        if scale not in SCALES or not body:
            raise InputError(f'epoch "{text}" has no time scale (allowed: TDB, TT, UTC); {HINT}')
        julian = _JULIAN.fullmatch(body)
        if julian:
            whole, part, kind = julian.groups()
            if len(whole) > 9:
                raise InputError(f'epoch "{text}" is out of any calendar; {HINT}')
            start = float(whole) + (2400000.5 if kind == "MJD" else 0.0)
            return replace(cls.from_jd(start, float("0" + (part or ".0")), scale), scale=scale)
        calendar = _CALENDAR.fullmatch(body)
        if not calendar:
            raise InputError(f'epoch "{text}" is neither a calendar date nor a Julian date; {HINT}')
        return cls._from_calendar(text, calendar, scale)

    @classmethod
    def _from_calendar(cls, text: str, match: re.Match[str], scale: Scale) -> "Epoch":
        """Build the epoch from the groups of a calendar date, checking that the date exists."""
        year, month, day = (int(match[i]) for i in (1, 2, 3))
        hour, minute, second = int(match[4] or 0), int(match[5] or 0), float(match[6] or 0.0)
        if hour > 23 or minute > 59 or second >= 61.0:
            raise InputError(f'epoch "{text}": no such time of day')
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            try:
                jd1, jd2 = erfa.dtf2d(scale.upper(), year, month, day, hour, minute, second)
                leap = second < 60.0 or int(erfa.d2dtf(scale.upper(), 3, jd1, jd2)[3]["s"]) == 60
            except erfa.ErfaError as error:
                raise InputError(f'epoch "{text}": no such date ({error})') from None
        if not leap:
            raise InputError(f'epoch "{text}": there was no leap second at this time')
        return replace(cls.from_jd(float(jd1), float(jd2), scale), scale=scale)

    def __add__(self, seconds: float) -> "Epoch":
        """The epoch `seconds` of TDB later; a timedelta, or a Quantity or TimeDelta of astropy, is converted."""
        return Epoch.from_jd(self.day, self.fraction + _plain_seconds(seconds) / SECONDS_PER_DAY)

    def __sub__(self, other: "Epoch") -> float:
        """TDB seconds from `other` to this epoch."""
        return ((self.day - other.day) + (self.fraction - other.fraction)) * SECONDS_PER_DAY

    @property
    def jd_tdb(self) -> float:
        """Julian date TDB in one float64 (40 us coarse): for display and coarse comparison only."""
        return self.day + self.fraction

    def iso(self, scale: Scale = "tdb", digits: int = 3) -> str:
        """Calendar text such as `2028-11-15T00:00:00.000 TDB`, rounded to `digits` decimals of a second."""
        jd1, jd2 = (self.day, self.fraction) if scale == "tdb" else _from_tdb(self.day, self.fraction, scale)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            year, month, day, time = erfa.d2dtf(scale.upper(), digits, jd1, jd2)
        hour, minute, second, fraction = (int(time[key]) for key in ("h", "m", "s", "f"))
        tail = f".{fraction:0{digits}d}" if digits > 0 else ""
        stamp = f"{int(year):04d}-{int(month):02d}-{int(day):02d}T{hour:02d}:{minute:02d}:{second:02d}{tail}"
        return f"{stamp} {scale.upper()}"

    def __str__(self) -> str:
        return self.iso()


def _plain_seconds(value: Any) -> float:
    """Seconds of a number, a timedelta, or what astropy converts to seconds."""
    if isinstance(value, timedelta):
        return value.total_seconds()
    if not hasattr(value, "to_value"):
        return value  # type: ignore[no-any-return]
    try:
        return float(value.to_value("s"))
    except (TypeError, ValueError):
        raise InputError(f"epoch: only a time can be added to it, got {value}") from None


def utc_jd(epoch: Epoch, t_s: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Two-part UTC Julian dates (erfa's quasi-JD) of times `t_s` (n,) in TDB seconds after `epoch`."""
    t = np.asarray(t_s, dtype=np.float64)
    return _from_tdb(np.full(t.shape, epoch.day), epoch.fraction + t / SECONDS_PER_DAY, "utc")


def tdb_from_utc(
    year: Integers, month: Integers, day: Integers, second: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Two-part TDB Julian dates of UTC calendar dates (n,) that exist and seconds of the day (n,), from 1960 on.

    The third array says where the second is one of its day: below 86400, or below 86401 on a day with a leap second.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        late = np.maximum(second - 86340.0, 0.0)  # seconds of the last minute, which alone may have sixty-one
        hour, minute = np.divmod(np.minimum(second, 86340.0), 3600.0)
        minute, rest = np.divmod(minute, 60.0)
        jd1, jd2 = erfa.dtf2d("UTC", year, month, day, hour.astype(int), minute.astype(int), rest + late)
        noon = erfa.dat(year, month, day, 0.5)
        following = erfa.jd2cal(jd1, 1.0)
        steps = erfa.dat(*following[:3], 0.0) - noon
    day_length = 86400.0 + np.where(steps > 0.5, 1.0, 0.0)
    day1, day2 = to_tdb(jd1, jd2, "utc")
    return day1, day2, second < day_length


def _tdb_minus_tt(jd1: npt.ArrayLike, jd2: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """TDB - TT in seconds at the geocentre; the argument may be in either scale.

    The series has 800 terms, and a fit asks for the same epochs at each iteration: the last few answers are kept.
    """
    if np.ndim(jd1) != 1 or np.shape(jd1) != np.shape(jd2) or np.size(jd1) > KEPT_EPOCHS:
        offset: npt.NDArray[np.float64] = erfa.dtdb(jd1, jd2, 0.0, 0.0, 0.0, 0.0)
        return offset
    days = (np.ascontiguousarray(jd, dtype=np.float64).tobytes() for jd in (jd1, jd2))
    return _kept_tdb_minus_tt(*days)


@lru_cache(maxsize=16)
def _kept_tdb_minus_tt(jd1: bytes, jd2: bytes) -> npt.NDArray[np.float64]:
    """TDB - TT of arrays given by their bytes; the answer is shared, so it cannot be written to."""
    offset: npt.NDArray[np.float64] = erfa.dtdb(np.frombuffer(jd1), np.frombuffer(jd2), 0.0, 0.0, 0.0, 0.0)
    offset.setflags(write=False)
    return offset


def to_tdb(
    jd1: npt.ArrayLike, jd2: npt.ArrayLike, scale: Scale
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Two-part date in `scale` -> TDB, of any shape."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        if scale == "utc":
            jd1, jd2 = erfa.taitt(*erfa.utctai(jd1, jd2))
        tdb: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]] = erfa.tttdb(jd1, jd2, _tdb_minus_tt(jd1, jd2))
    return tdb


def _from_tdb(
    jd1: npt.ArrayLike, jd2: npt.ArrayLike, scale: Scale
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Two-part TDB date -> `scale`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        date: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
        date = erfa.tdbtt(jd1, jd2, _tdb_minus_tt(jd1, jd2))
        if scale == "utc":
            date = erfa.taiutc(*erfa.tttai(*date))
    return date
