"""Epochs: text in and out, leap seconds, precision."""

import warnings

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from nebosvod.errors import InputError
from nebosvod.timescale import SECONDS_PER_DAY, Epoch, utc_jd


@pytest.mark.smoke
def test_julian_and_calendar_forms_of_one_moment_agree() -> None:
    forms = ["2021-01-01T00:00:00 TDB", "2021-01-01 TDB", "2459215.5 JD TDB", "59215.0 MJD TDB", "2021-01-01 00:00 TDB"]
    assert {Epoch.parse(form) for form in forms} == {Epoch(2459215.5, 0.0)}


def test_utc_is_37_leap_seconds_and_32_184_s_behind_tt() -> None:
    offset = Epoch.parse("2021-07-01T00:00:00 TT") - Epoch.parse("2021-07-01T00:00:00 UTC")
    assert offset == pytest.approx(-69.184, abs=1e-6)


def test_tdb_differs_from_tt_by_the_annual_term_of_1_66_ms() -> None:
    # TDB - TT = 1.657 ms sin(g) + 0.022 ms sin(...) to 50 us, g = 357.53 deg + 0.98560028 deg (JD - 2451545)
    for day in range(0, 365, 30):
        tt = Epoch.from_jd(2459215.5, float(day), "tt")
        tdb = Epoch.from_jd(2459215.5, float(day), "tdb")
        g = np.radians(357.53 + 0.98560028 * (2459215.5 + day - 2451545.0))
        assert tt - tdb == pytest.approx(0.001657 * np.sin(g), abs=5e-5)


def test_seconds_offsets_keep_nanoseconds_over_a_century() -> None:
    start = Epoch.parse("1990-01-01 TDB")
    assert (start + 3.0e9) - start == pytest.approx(3.0e9, abs=1e-5)
    assert (start + 1.25) - start == 1.25


@given(st.floats(2_450_000.0, 2_480_000.0), st.floats(-1.0, 1.0))
@example(2_450_000.5, -1e-97)
def test_epoch_is_independent_of_how_the_parts_are_split(jd1: float, jd2: float) -> None:
    epoch = Epoch.from_jd(jd1, jd2)
    assert 0.0 <= epoch.fraction < 1.0
    assert epoch.day % 1.0 == 0.5
    assert abs((epoch.day - jd1) + epoch.fraction - jd2) < 1e-9


@given(st.integers(0, 40 * 365 * 86400))
def test_text_of_an_epoch_reads_back_in_each_scale(seconds: int) -> None:
    epoch = Epoch(2447892.5, 0.0) + float(seconds)  # from 1990
    for scale in ("tdb", "tt", "utc"):
        assert abs(Epoch.parse(epoch.iso(scale, digits=9)) - epoch) < 1e-5


def test_a_true_leap_second_is_accepted_and_written_back() -> None:
    epoch = Epoch.parse("2016-12-31T23:59:60 UTC")
    assert epoch.iso("utc") == "2016-12-31T23:59:60.000 UTC"
    assert Epoch.parse("2017-01-01T00:00:00 UTC") - epoch == pytest.approx(1.0, abs=1e-6)


def test_dates_after_the_leap_second_table_raise_no_warning_and_keep_37_s() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        epoch = Epoch.parse("2055-01-01T00:00:00 UTC")
    assert epoch - Epoch.parse("2055-01-01T00:00:00 TT") == pytest.approx(69.184, abs=1e-6)


def test_utc_arrays_agree_with_single_epochs() -> None:
    epoch = Epoch.parse("2028-11-15T00:00:00 UTC")
    day, fraction = utc_jd(epoch, np.array([0.0, SECONDS_PER_DAY]))
    assert (day - 2462090.5) + fraction == pytest.approx([0.0, 1.0], abs=5e-10)  # TDB - TT drifts by up to 29 us a day


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("2028-11-15T00:00:00", "no time scale"),
        ("2459215.5", "no time scale"),
        ("2028-11-15 GPS", "no time scale"),
        ("2026-02-29 UTC", "no such date"),
        ("2026-13-01 TDB", "no such date"),
        ("2026-01-01T24:00:00 TDB", "no such time"),
        ("2015-12-31T23:59:60 UTC", "no leap second"),
        ("yesterday TDB", "neither"),
        ("99999999999 JD TDB", "out of any calendar"),
        ("nan JD TDB", "neither"),
        ("", "no time scale"),
    ],
)
def test_wrong_epochs_say_what_is_wrong(text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        Epoch.parse(text)
