"""Calendar dates of old and new observations to TDB: UTC from 1960 on, UT1 before, when there was no UTC.

TT - UT1 before 1960 is the polynomial of Espenak and Meeus (2006), Five Millennium Canon of Solar Eclipses, NASA
TP-2006-214141, section 2: within about 1 s from 1800 to 1900 and 0.2 s after; an asteroid of 20 km/s moves by as many
times 20 km. At 1960-01-01 it meets the leap-second table (UTC was then steered to UT2) within 0.5 s.
"""

import erfa
import numpy as np

from nebosvod.observation.contracts import Array, Flags, Rows, Texts
from nebosvod.timescale import SECONDS_PER_DAY, Epoch, tdb_from_utc

FIRST_YEAR, LAST_YEAR = 1800, 2199
FIRST_UTC_YEAR = 1960
# first year, year from which t counts, coefficients of t^0, t^1, ... in seconds
DELTA_T = (
    (
        1800,
        1800,
        (13.72, -0.332447, 0.0068612, 0.0041116, -0.00037436, 0.0000121272, -0.0000001699, 0.000000000875),
    ),
    (1860, 1860, (7.62, 0.5737, -0.251754, 0.01680668, -0.0004473624, 1.0 / 233174.0)),
    (1900, 1900, (-2.79, 1.494119, -0.0598939, 0.0061966, -0.000197)),
    (1920, 1920, (21.20, 0.84493, -0.076100, 0.0020936)),
    (1941, 1950, (29.07, 0.407, -1.0 / 233.0, 1.0 / 2547.0)),
)


def delta_t_s(year: Array) -> Array:
    """TT - UT1 in seconds for decimal years (n,) of 1800 to 1960.

    References
    ----------
    Espenak, Meeus 2006, NASA TP-2006-214141, section 2.
    """
    value = np.zeros_like(year)
    for first, origin, coefficients in DELTA_T:
        value = np.where(year >= first, np.polynomial.polynomial.polyval(year - origin, coefficients), value)
    return value


def ut1_jd(jd1_tt: Array, jd2_tt: Array) -> tuple[Array, Array]:
    """Two-part UT1 Julian dates of TT dates before 1960, by the same polynomial that reading used."""
    year = 2000.0 + (jd1_tt - 2451544.5 + jd2_tt) / 365.25
    return jd1_tt, jd2_tt - delta_t_s(year) / SECONDS_PER_DAY


def month_days(year: Rows, month: Rows) -> Rows:
    """Days of each month (n,); 0 where there is no such month."""
    lengths = np.array([0, 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])
    there = (month >= 1) & (month <= 12)
    leap = (year % 4 == 0) & ((year % 100 != 0) | (year % 400 == 0)) & (month == 2)
    days: Rows = np.where(there, lengths[np.where(there, month, 0)] + leap, 0)
    return days


def tdb_times(year: Rows, month: Rows, day: Rows, second: Array) -> tuple[Epoch, Array, Flags]:
    """The 0h TDB before the first of these times, TDB seconds after it (n,), and where there is such a second.

    Parameters
    ----------
    year, month, day : (n,) dates that exist, years `FIRST_YEAR` to `LAST_YEAR`; n at least 1.
    second : (n,) seconds of the day, universal time; 86400 and more on a day with a leap second only.
    """
    jd1, jd2, exists = np.empty(year.size), np.empty(year.size), second < SECONDS_PER_DAY
    new = year >= FIRST_UTC_YEAR
    if new.any():
        jd1[new], jd2[new], exists[new] = tdb_from_utc(year[new], month[new], day[new], second[new])
    old = ~new
    if old.any():
        zero, modified = erfa.cal2jd(year[old], month[old], day[old])
        jd1[old] = zero + modified
        decimal_year = 2000.0 + (jd1[old] - 2451544.5) / 365.25
        tt = second[old] / SECONDS_PER_DAY + delta_t_s(decimal_year) / SECONDS_PER_DAY
        jd2[old] = tt + erfa.dtdb(jd1[old], tt, 0.0, 0.0, 0.0, 0.0) / SECONDS_PER_DAY
    first = int(np.argmin(jd1 + jd2))
    epoch = Epoch(Epoch.from_jd(float(jd1[first]), float(jd2[first])).day, 0.0)
    return epoch, ((jd1 - epoch.day) + jd2) * SECONDS_PER_DAY, exists


def iso(year: Rows, month: Rows, day: Rows, ticks: Rows) -> Texts:
    """Text such as `2010-03-27T09:23:13.0464Z` of dates (n,) and 0.1 ms ticks of the day below 864,000,000."""
    digits = np.empty((year.size, 25), dtype=np.uint8)
    digits[:] = np.frombuffer(b"0000-00-00T00:00:00.0000Z", dtype=np.uint8)
    second, part = np.divmod(ticks, 10_000)
    minute, second = np.divmod(second, 60)
    hour, minute = np.divmod(minute, 60)
    for value, end, width in (
        (year, 4, 4), (month, 7, 2), (day, 10, 2), (hour, 13, 2), (minute, 16, 2), (second, 19, 2), (part, 24, 4)
    ):  # fmt: skip
        for place in range(width):
            digits[:, end - 1 - place] += (value // 10**place % 10).astype(np.uint8)
    text: Texts = digits.view("S25").ravel().astype("U25")
    return text
