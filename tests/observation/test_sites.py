"""Observatories on the ground."""

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import EarthLocation
from astropy.time import Time
from astropy.utils import iers

from nebosvod.errors import CoverageError, InputError
from nebosvod.observation import GroundSite
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


def test_a_site_is_where_astropy_has_it_to_a_tenth_of_a_millimetre(ephemeris, monkeypatch):
    monkeypatch.setattr(iers.conf, "auto_download", False)
    ours = GroundSite(itrf_km=PARANAL).state_km_km_s(ephemeris, EPOCH, T_S)
    ours = ours - ephemeris.state_km_km_s("earth", EPOCH, T_S)
    with iers.earth_orientation_table.set(iers.IERS_A.open(iers.IERS_A_FILE)):
        time = Time(*utc_jd(EPOCH, T_S), format="jd", scale="utc")
        position, velocity = EarthLocation.from_geocentric(*PARANAL, unit=units.km).get_gcrs_posvel(time)
    # interpolated nutation 0.03 mm; two barycentric positions of 1.5e8 km subtracted: 0.04 mm
    np.testing.assert_allclose(ours[:, :3], position.xyz.to_value("km").T, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(ours[:, 3:], velocity.xyz.to_value("km/s").T, rtol=0.0, atol=1e-7)


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
    with pytest.raises(CoverageError, match=r"Earth-rotation table covers UTC MJD 41684 to \d+, asked for 6798\d"):
        GroundSite(itrf_km=PARANAL).state_km_km_s(ephemeris, future, np.zeros(1))
    state = GroundSite(itrf_km=PARANAL, extrapolate=True).state_km_km_s(ephemeris, future, np.zeros(1))
    height = np.linalg.norm(state[0, :3] - ephemeris.position_km("earth", future, np.zeros(1))[0])
    assert height == pytest.approx(np.linalg.norm(PARANAL), abs=1e-6)


def test_before_the_table_a_site_is_refused_in_any_case(ephemeris):
    past = Epoch.parse("1971-01-01T00:00:00 TDB")
    with pytest.raises(CoverageError, match="41684"):
        GroundSite(itrf_km=PARANAL, extrapolate=True).state_km_km_s(ephemeris, past, np.zeros(1))


def test_a_position_that_is_none_is_refused():
    with pytest.raises(InputError, match="three finite"):
        GroundSite(itrf_km=np.array([1.0, np.nan, 0.0]))
