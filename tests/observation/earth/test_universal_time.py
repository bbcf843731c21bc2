"""Calendar dates to TDB: against erfa one by one, leap seconds, and universal time before 1960."""

import erfa
import numpy as np
import pytest

from nebosvod.observation.earth.universal_time import delta_t_s, iso, month_days, tdb_times, ut1_jd
from nebosvod.timescale import Epoch

# TT - UT1 of the Astronomical Almanac, section K (annual means at the beginning of the year), seconds
ALMANAC = {1890: -5.87, 1900: -2.72, 1910: 10.46, 1920: 21.16, 1930: 24.02, 1940: 24.33, 1950: 29.15, 1959: 32.68}


def times(*rows: tuple[int, int, int, float]) -> tuple[Epoch, np.ndarray, np.ndarray]:
    year, month, day, second = (np.array(column) for column in zip(*rows))
    return tdb_times(year, month, day, second.astype(float))


@pytest.mark.parametrize("text", [
    "1960-01-01T00:00:00", "1965-07-01T12:34:56.789", "1972-06-30T23:59:60", "2005-10-09T04:49:02.208",
    "2016-12-31T23:59:59.999", "2016-12-31T23:59:60.5", "2017-01-01T00:00:00", "2026-11-22T20:00:00",
])  # fmt: skip
def test_utc_agrees_with_the_epochs_of_missions(text: str) -> None:
    day, clock = text.split("T")
    hour, minute, second = clock.split(":")
    row = (*map(int, day.split("-")), int(hour) * 3600 + int(minute) * 60 + float(second))
    epoch, t_s, exists = times(row)
    assert exists.all()
    assert abs((epoch - Epoch.parse(f"{text} UTC")) + t_s[0]) < 1e-6
    assert epoch.fraction == 0.0
    assert 0.0 <= t_s[0] < 86400.0 + 70.0


def test_a_second_after_the_end_of_its_day_exists_on_days_with_a_leap_second_only() -> None:
    rows = [(2016, 12, 31, 86400.0), (2016, 12, 31, 86401.0), (2016, 12, 30, 86400.0), (1955, 6, 30, 86400.0)]
    assert times(*rows)[2].tolist() == [True, False, False, False]


@pytest.mark.parametrize("year", ALMANAC)
def test_universal_time_before_1960_is_delta_t_behind(year: int) -> None:
    epoch, t_s, _ = times((year, 1, 1, 43200.0))
    # the polynomials stay within 1 s of the almanac before 1900 and 0.3 s after; TDB - TT is below 2 ms
    assert abs(t_s[0] - 43200.0 - ALMANAC[year]) < (1.0 if year < 1900 else 0.3)
    assert epoch.day == sum(erfa.cal2jd(year, 1, 1))


def test_the_polynomials_join() -> None:
    for year in (1860.0, 1900.0, 1920.0, 1941.0):
        before, after = delta_t_s(np.array([year - 1e-9, year]))
        assert abs(before - after) < 0.3, year


def test_universal_time_comes_back_from_tt() -> None:
    day, fraction = np.array([2429231.5, 2411670.5]), np.array([0.3, 0.9])
    tt = fraction + delta_t_s(2000.0 + (day - 2451544.5) / 365.25) / 86400.0
    back = sum(ut1_jd(day, tt)) - day
    # the year moves by less than a day between the two: 3 ms of delta T
    np.testing.assert_allclose(back, fraction, atol=3e-3 / 86400.0, rtol=0)


def test_the_epoch_is_the_zero_hour_before_the_first_of_all() -> None:
    epoch, t_s, _ = times((2020, 1, 1, 100.0), (1938, 11, 28, 3600.0), (2020, 1, 2, 0.0))
    assert str(epoch) == "1938-11-28T00:00:00.000 TDB"
    assert int(np.argmin(t_s)) == 1


def test_months_have_their_days() -> None:
    years = np.array([2023, 2024, 1900, 2000, 2023, 2023, 2023])
    months = np.array([2, 2, 2, 2, 12, 13, 0])
    assert month_days(years, months).tolist() == [28, 29, 28, 29, 31, 0, 0]


def test_text_of_times_has_four_decimals() -> None:
    part = np.array([864_000_000 - 1, 0, 1])
    same = np.array([1, 1, 1])
    assert iso(same + 1892, same + 9, same + 28, part).tolist() == [
        "1893-10-29T23:59:59.9999Z", "1893-10-29T00:00:00.0000Z", "1893-10-29T00:00:00.0001Z",
    ]  # fmt: skip
