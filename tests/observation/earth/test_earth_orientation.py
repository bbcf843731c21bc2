"""The Earth's orientation on any date."""

import numpy as np
import pytest
from astropy.time import Time
from astropy.utils import iers

from nebosvod.observation.earth.earth_orientation import orientation


def ut1_minus_tai(first_mjd: float, last_mjd: float, table, number: int = 400):
    """Ours and astropy's UT1 - TAI, s, and the poles, at times strewn over a span."""
    mjd = np.random.default_rng(7).uniform(first_mjd, last_mjd, number)
    utc = Time(mjd, format="mjd", scale="utc")
    ours = orientation(utc.tt.jd1, utc.tt.jd2)
    tai_s = ((ours.ut1_jd[0] - utc.tai.jd1) + (ours.ut1_jd[1] - utc.tai.jd2)) * 86400.0
    utc_minus_tai = utc.unix - utc.unix_tai
    theirs = table.ut1_utc(utc.jd1, utc.jd2).to_value("s") + utc_minus_tai
    x, y = table.pm_xy(utc.jd1, utc.jd2)
    return ours, tai_s - theirs, (ours.x_pole_rad - x.to_value("rad"), ours.y_pole_rad - y.to_value("rad"))


def test_from_1973_on_it_is_astropys_bulletin_a() -> None:
    table = iers.IERS_A.open(iers.IERS_A_FILE)
    ours, difference_s, pole = ut1_minus_tai(41685.0, 61000.0, table)
    # a day that ends with a leap second is stretched, and astropy's table with it
    leap = np.abs(difference_s) > 1e-3
    assert leap.sum() <= 4
    np.testing.assert_allclose(difference_s[~leap], 0.0, atol=1e-7)
    np.testing.assert_allclose(pole, 0.0, atol=1e-15)
    assert ours.notices() == ()


def test_from_1962_to_1972_it_is_the_c04_series() -> None:
    table = iers.IERS_B.open(iers.IERS_B_FILE)
    mjd = np.random.default_rng(7).uniform(37665.0, 41683.0, 300)
    utc = Time(mjd, format="mjd", scale="utc")
    ours = orientation(utc.tt.jd1, utc.tt.jd2)
    theirs = table.ut1_utc(utc.jd1, utc.jd2).to_value("s")
    difference_s = ((ours.ut1_jd[0] - utc.jd1) + (ours.ut1_jd[1] - utc.jd2)) * 86400.0 - theirs
    # UTC of those years drifts against TAI within a day: up to 2.6 ms, and its steps of 0.1 s stretch a day
    assert np.median(np.abs(difference_s)) < 1e-6
    assert np.max(np.abs(difference_s)) < 0.11
    assert not ours.before.any()


@pytest.mark.parametrize("year", [1900.0, 1938.0, 1955.0])
def test_before_1960_ut1_is_what_the_clock_showed(year: float) -> None:
    """TT minus UT1 of the Nautical Almanac's history: -2.7 s in 1900, 23.9 s in 1938, 31.1 s in 1955."""
    known = {1900.0: -2.72, 1938.0: 23.9, 1955.0: 31.1}[year]
    tt = np.array([2451545.0 + (year - 2000.0) * 365.25])
    ours = orientation(tt, np.zeros(1))
    assert -ours.ut1_jd[1][0] * 86400.0 == pytest.approx(known, abs=0.2)
    assert ours.x_pole_rad[0] == 0.0
    assert "1 time before 1962" in ours.notices()[0]


def test_universal_time_does_not_jump_where_one_source_gives_way_to_the_next() -> None:
    # 1960.0: polynomial to clock (good to 0.5 s); 1962.0: clock to C04 (0.1 s); 1973.0: C04 to Bulletin A (1 ms)
    for mjd, jump_s in ((36934.0, 0.5), (37665.0, 0.1), (41684.0, 1e-3)):
        tt = orientation(np.full(2, 2400000.5), np.array([mjd - 0.05, mjd + 0.05]))
        assert abs(np.diff(tt.ut1_jd[1])[0] - 0.1) * 86400.0 < jump_s


def test_after_the_table_its_last_value_is_kept_and_the_error_is_said() -> None:
    last = orientation(np.array([2461000.5]), np.array([0.0]))
    far = orientation(np.array([2461000.5, 2466154.5]), np.zeros(2))
    held = (far.ut1_jd[1][1] - last.ut1_jd[1][0]) * 86400.0
    assert abs(held) < 1.0
    assert list(far.after) == [False, True]
    assert far.beyond_days > 3000.0
    assert "last values are kept (sites good to about" in far.notices()[0]
