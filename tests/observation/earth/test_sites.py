"""Observatories on the ground."""

from typing import ClassVar

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import EarthLocation
from astropy.time import Time
from astropy.utils import iers

from nebosvod.errors import CoverageError, InputError
from nebosvod.observation import GroundSite
from nebosvod.observation.earth.sites import ground_states
from nebosvod.timescale import Epoch, utc_jd

EPOCH = Epoch.parse("2020-01-01T00:00:00 TDB")
T_S = np.linspace(0.0, 5.0, 83) * 365.25 * 86400.0
# adam_core da2cf35 (MIT), I41_ssb.parquet, six of its 366 epochs
I41_MJD = [56293.0, 56893.0, 57503.0, 58293.0, 59193.0, 59943.0]
I41_SSB = [
    [-0.1812733393317034, 0.9642194480171509, -4.301181686897163e-05],
    [0.8828976178443274, -0.4983082331252832, -7.708263415762239e-05],
    [-0.820341754559472, -0.5747462017705164, -0.0001331379897497315],
    [0.03984264823313095, -1.008694898470972, -3.72992639405209e-05],
    [0.1966554024711697, 0.969741025115319, 8.282089787373613e-05],
    [-0.1447365551147406, 0.9740936922607825, 0.0001878262587161316],
]
PARANAL = np.array([1946.404, -5467.644, -2642.728])


RNG = np.random.default_rng(11)
NIGHTS_S = np.floor(RNG.uniform(-26.9, 27.0, 60) * 365.25) * 86400.0
# how close times lie decides how precession and nutation are evaluated: between nodes, one by one, by quarters of a day
TIMES_S = {
    "dense": (np.linspace(0.0, 300.0, 900) * 86400.0, 1e-7),
    "strewn": (RNG.uniform(-26.9, 27.0, 300) * 365.25 * 86400.0, 1e-7),
    "in nights": ((NIGHTS_S[:, None] + RNG.uniform(0.0, 0.24, (60, 6)) * 86400.0).ravel(), 4e-6),
}


def astropys(epoch: Epoch, t_s: np.ndarray, table: iers.IERS) -> np.ndarray:
    """Geocentric states (n, 6) of Paranal by astropy with a table."""
    with iers.earth_orientation_table.set(table):
        time = Time(*utc_jd(epoch, t_s), format="jd", scale="utc")
        position, velocity = EarthLocation.from_geocentric(*PARANAL, unit=units.km).get_gcrs_posvel(time)
    return np.concatenate([position.xyz.to_value("km"), velocity.xyz.to_value("km/s")]).T


@pytest.mark.parametrize("times", TIMES_S)
def test_a_site_is_where_astropy_has_it_since_1973(times, monkeypatch):
    """0.1 mm: node-interpolated nutation 0.03 mm, UT1 and TT 1e-9 s; 4 mm where nights share a nutation (1.8 found)."""
    monkeypatch.setattr(iers.conf, "auto_download", False)
    epoch, (t_s, allowed_km) = Epoch.parse("2000-01-01T00:00:00 TDB"), TIMES_S[times]
    ours, earth = ground_states(PARANAL, epoch, t_s)
    theirs = astropys(epoch, t_s, iers.IERS_A.open(iers.IERS_A_FILE))
    # astropy stretches the day that ends with a leap second: another UT1 there, by up to a second
    usual = np.linalg.norm(ours[:, :3] - theirs[:, :3], axis=1) < 1e-4
    assert np.count_nonzero(~usual) <= 1
    np.testing.assert_allclose(ours[usual, :3], theirs[usual, :3], rtol=0.0, atol=allowed_km)
    np.testing.assert_allclose(ours[:, 3:], theirs[:, 3:], rtol=0.0, atol=1e-7)
    assert earth.notices() == ()


def test_a_site_is_where_astropy_has_it_from_1962_to_1972(monkeypatch):
    """By EOP C04. astropy keeps TAI - UTC of 0h all day; it drifted by up to 2.6 ms a day: 1.2 m before midnight."""
    monkeypatch.setattr(iers.conf, "auto_download", False)
    table = iers.IERS_B.open(iers.IERS_B_FILE)
    for hour, allowed_m in ((0.001, 2e-4), (23.9, 1.2)):
        utc = Time(np.arange(37666.0, 41680.0, 40.0), hour / 24.0, format="mjd", scale="utc")
        epoch = Epoch.from_jd(2400000.5, 37665.0)
        t_s = (utc.tdb.jd1 - epoch.day + utc.tdb.jd2) * 86400.0
        ours, earth = ground_states(PARANAL, epoch, t_s)
        error_m = 1e3 * np.linalg.norm((ours - astropys(epoch, t_s, table))[:, :3], axis=1)
        assert np.max(error_m) < allowed_m
        assert not earth.before.any()


def test_a_site_counts_from_the_barycentre(ephemeris):
    state = GroundSite(itrf_km=PARANAL).state_km_km_s(ephemeris, EPOCH, T_S)
    geocentric, _ = ground_states(PARANAL, EPOCH, T_S)
    np.testing.assert_array_equal(state, ephemeris.state_km_km_s("earth", EPOCH, T_S) + geocentric)


def test_places_of_one_pass_are_those_of_single_sites():
    places = PARANAL * np.array([[1.0], [0.5], [-0.5]])
    together, _ = ground_states(places, EPOCH, T_S[:3])
    alone = [ground_states(place, EPOCH, T_S[:3])[0][i] for i, place in enumerate(places)]
    np.testing.assert_array_equal(together, alone)


def test_parallax_constants_place_a_site_at_its_distance_and_longitude():
    # X05: longitude, rho cos phi', rho sin phi' of the MPC
    site = GroundSite.from_parallax(np.radians(289.25058), 0.864981, -0.500958)
    assert np.linalg.norm(site.itrf_km) == pytest.approx(6375.5, abs=0.1)
    assert np.degrees(np.arctan2(site.itrf_km[1], site.itrf_km[0])) == pytest.approx(289.25058 - 360.0, abs=1e-9)


def test_earth_rotation_at_the_sites_of_another_code(ephemeris):
    """Palomar (I41), barycentric, from an independent code: its site is 7 m from the MPC's constants, fixed to the
    ground, so the difference keeps its length while the Earth turns. Ecliptic J2000, au, at MJD TDB 56293 and 59943."""
    site = GroundSite.from_parallax(np.radians(243.14022), 0.836322, 0.546875)
    epoch = Epoch.from_jd(2400000.5, 56293.0)
    theirs = np.array(I41_SSB) * 149597870.7
    cos, sin = np.cos(np.radians(84381.448 / 3600)), np.sin(np.radians(84381.448 / 3600))
    theirs = theirs @ np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
    ours = site.state_km_km_s(ephemeris, epoch, (np.array(I41_MJD) - 56293.0) * 86400.0)[:, :3]
    difference_m = np.linalg.norm(ours - theirs, axis=1) * 1e3
    assert np.all(difference_m < 8.0)
    # au to 17 digits and DE440 rounding: 3 cm
    assert np.ptp(difference_m) < 0.15


def test_after_the_table_a_site_is_refused_or_extrapolated_as_told(ephemeris):
    future = Epoch.parse("2045-01-01T00:00:00 TDB")
    with pytest.raises(CoverageError, match=r"covers 1962-01-01 to 20\d\d-\d\d-\d\d, asked for 2045-01-01"):
        GroundSite(itrf_km=PARANAL).state_km_km_s(ephemeris, future, np.zeros(1))
    state = GroundSite(itrf_km=PARANAL, extrapolate=True).state_km_km_s(ephemeris, future, np.zeros(1))
    height = np.linalg.norm(state[0, :3] - ephemeris.position_km("earth", future, np.zeros(1))[0])
    assert height == pytest.approx(np.linalg.norm(PARANAL), abs=1e-6)


def test_before_the_tables_a_site_is_refused_or_placed_by_the_clocks_as_told():
    """An ephemeris of its own: the one that is shipped begins in 1990."""

    class Still:
        gm_km3_s2: ClassVar[dict[str, float]] = {}

        def state_km_km_s(self, body, epoch, t_s):
            return np.zeros((t_s.size, 6))

    t_s = np.array([0.0, 400.0 * 86400.0])
    past = Epoch.parse("1961-06-01T00:00:00 TDB")
    with pytest.raises(CoverageError, match=r"covers 1962-01-01 to .* asked for 1961-06-01"):
        GroundSite(itrf_km=PARANAL).state_km_km_s(Still(), past, t_s)
    covered = GroundSite(itrf_km=PARANAL).state_km_km_s(Still(), past, t_s[1:])
    placed = GroundSite(itrf_km=PARANAL, extrapolate=True).state_km_km_s(Still(), past, t_s)
    # one time alone, or two of them: nutation by the same series
    np.testing.assert_allclose(placed[1:], covered, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(placed[:, :3], axis=1), np.linalg.norm(PARANAL), rtol=1e-12)


def test_a_position_that_is_none_is_refused():
    with pytest.raises(InputError, match="three finite"):
        GroundSite(itrf_km=np.array([1.0, np.nan, 0.0]))
