"""Where telescopes are."""

import erfa
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import EarthLocation
from astropy.time import Time
from astropy.utils import iers

from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, HeliocentricCompanion
from nebosvod.observation.earth import earth_rotation
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs, earth_rotation_angle
from nebosvod.observation.spacecraft.kinds import rtn_axes, turn_about_ecliptic_pole
from nebosvod.timescale import Epoch, utc_jd

EPOCH = Epoch.parse("2024-03-01T00:00:00 TDB")
T_S = np.linspace(0.0, 40.0, 57) * 86400.0


def geocentric(spacecraft, ephemeris, epoch, t_s):
    return spacecraft.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s("earth", epoch, t_s)


@pytest.fixture
def no_download(monkeypatch):
    monkeypatch.setattr(iers.conf, "auto_download", False)


def astropy_gcrs(fixed_km, epoch, t_s, polar_motion):
    """Position and velocity by astropy, UT1 = UTC; its own polar motion table can be switched off."""
    time = Time(*utc_jd(epoch, t_s), format="jd", scale="utc")
    time.delta_ut1_utc = 0.0
    if not polar_motion:
        table = iers.IERS_B.open().copy()
        for column in ("PM_x", "PM_y"):
            table[column][:] = 0.0
        with iers.earth_orientation_table.set(table):
            return _gcrs(fixed_km, time)
    return _gcrs(fixed_km, time)


def _gcrs(fixed_km, time):
    position, velocity = EarthLocation.from_geocentric(*fixed_km, unit=units.km).get_gcrs_posvel(time)
    return position.xyz.to_value(units.km).T, velocity.xyz.to_value(units.km / units.s).T


def ring_point(ephemeris, longitude_rad):
    radius = (ephemeris.gm_km3_s2["earth"] / 7.292115146706979e-5**2) ** (1 / 3)
    return radius * np.array([np.cos(longitude_rad), np.sin(longitude_rad), 0.0])


def test_geostationary_is_astropys_fixed_point_to_three_millimetres_without_polar_motion(ephemeris, no_download):
    ours = geocentric(Geostationary(longitude_rad=2.0), ephemeris, EPOCH, T_S)
    position, velocity = astropy_gcrs(ring_point(ephemeris, 2.0), EPOCH, T_S, polar_motion=False)
    # the TIO locator s' = -47 uas per century, which we leave out, is 2.3 mm here; interpolated nutation 0.2 mm
    assert np.max(np.linalg.norm(ours[:, :3] - position, axis=1)) < 3e-6
    # astropy differentiates the same rotation; precession is 1e-7 of the velocity
    assert np.max(np.linalg.norm(ours[:, 3:] - velocity, axis=1)) < 1e-6


def test_polar_motion_left_out_costs_a_geostationary_telescope_under_120_metres(ephemeris, no_download):
    ours = geocentric(Geostationary(longitude_rad=2.0), ephemeris, EPOCH, T_S)
    position, _ = astropy_gcrs(ring_point(ephemeris, 2.0), EPOCH, T_S, polar_motion=True)
    error_km = np.linalg.norm(ours[:, :3] - position, axis=1)
    assert 0.01 < error_km.max() < 0.12


def test_geostationary_ring_turns_with_the_earth_at_42164_km(ephemeris, epoch):
    t_s = np.array([0.0, 43082.0, 86164.0905])
    relative = geocentric(Geostationary(longitude_rad=0.7), ephemeris, epoch, t_s)
    radius = np.linalg.norm(relative[:, :3], axis=1)
    np.testing.assert_allclose(radius, 42164.17, atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(relative[:, 3:], axis=1), 3.07466, atol=1e-5)
    # after half a sidereal day opposite, after a whole one back (precession in a day: 0.1" = 30 m)
    np.testing.assert_allclose(relative[1, :3], -relative[0, :3], atol=0.3)
    np.testing.assert_allclose(relative[2, :3], relative[0, :3], atol=0.1)


def test_velocities_are_the_derivatives_of_positions(ephemeris, epoch, support):
    for spacecraft in (Geostationary(longitude_rad=-1.0), HeliocentricCompanion(lead_rad=0.5)):
        state = spacecraft.state_km_km_s(ephemeris, epoch, T_S + 1e5)
        numeric = support.derivative(
            lambda h, s=spacecraft: s.state_km_km_s(ephemeris, epoch, T_S + 1e5 + h)[:, :3], 100.0
        )
        # positions of 1.5e8 km carry 3e-8 km: 1e-9 km/s over 100 s; precession of the ring 4e-7 km/s; truncation 1e-10
        np.testing.assert_allclose(state[:, 3:], numeric, rtol=0.0, atol=6e-7)


def test_telescopes_180_degrees_apart_are_on_opposite_sides_of_the_earth(ephemeris, epoch):
    here = geocentric(Geostationary(longitude_rad=0.0), ephemeris, epoch, T_S)
    there = geocentric(Geostationary(longitude_rad=np.pi), ephemeris, epoch, T_S)
    np.testing.assert_allclose(here, -there, rtol=0.0, atol=2e-7)


@pytest.mark.parametrize("lead_deg", [10.0, -10.0, 60.0])
def test_a_companion_keeps_its_angle_from_the_earth_and_its_distance_from_the_sun(ephemeris, epoch, lead_deg):
    sun = ephemeris.state_km_km_s("sun", epoch, T_S)
    earth = ephemeris.state_km_km_s("earth", epoch, T_S) - sun
    relative = HeliocentricCompanion(lead_rad=np.radians(lead_deg)).state_km_km_s(ephemeris, epoch, T_S) - sun
    np.testing.assert_allclose(
        np.linalg.norm(relative[:, :3], axis=1), np.linalg.norm(earth[:, :3], axis=1), rtol=1e-14
    )
    cosine = np.sum(relative[:, :3] * earth[:, :3], axis=1) / np.sum(earth[:, :3] ** 2, axis=1)
    # the Earth strays up to 1" and, by 2029, 14" from the J2000 ecliptic: 2.4e-9 of the cosine
    np.testing.assert_allclose(cosine, np.cos(np.radians(lead_deg)), atol=5e-9)
    # ahead is where the Earth is going
    ahead = np.sum(relative[:, :3] * earth[:, 3:], axis=1) / np.sum(earth[:, 3:] ** 2, axis=1)
    assert np.all(np.sign(ahead) == np.sign(lead_deg))


def test_the_ecliptic_turn_is_a_rotation_that_leaves_the_pole(ephemeris):
    turn = turn_about_ecliptic_pole(0.3)
    obliquity = np.radians(84381.448 / 3600.0)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    pole = np.array([0.0, -np.sin(obliquity), np.cos(obliquity)])
    np.testing.assert_allclose(turn @ pole, pole, atol=1e-15)
    assert np.trace(turn) == pytest.approx(1.0 + 2.0 * np.cos(0.3))
    assert turn[1, 0] > 0.0  # counter-clockwise seen from the north


def test_interpolated_precession_nutation_equals_erfa_to_a_microarcsecond():
    t_s = np.sort(np.random.default_rng(5).uniform(-30.0, 400.0, 3000)) * 86400.0
    ours = R_icrf_from_cirs(EPOCH, t_s)
    some = slice(None, None, 50)
    exact = np.swapaxes(erfa.c2i06a(EPOCH.day, EPOCH.fraction + t_s[some] / 86400.0), 1, 2)
    assert np.max(np.abs(ours[some] - exact)) < 5e-12  # 1e-6 arcsec
    np.testing.assert_allclose(R_icrf_from_cirs(EPOCH, t_s[some][:10]), exact[:10], rtol=0.0, atol=1e-15)


def test_the_turn_of_a_night_does_not_depend_on_what_was_asked_before(monkeypatch):
    """What is kept of a night is that night's own, to the last bit, whatever epoch it is counted from."""
    night = 86400.0 * (np.repeat([3.1, 800.3, 2100.6], 4) + 0.02 * np.tile(np.arange(4), 3))
    other = Epoch.parse("2019-03-05T00:00:00 TDB")

    def asked(order):
        for kept in (earth_rotation._slow, earth_rotation._tt_minus_tdb):
            monkeypatch.setattr(kept, "known", {})
        for start in order:
            gap = EPOCH - start
            found = R_icrf_from_cirs(start, night + gap), earth_rotation.tt_days(start, night + gap)
        return found

    first, second = asked([EPOCH]), asked([other, EPOCH])
    for one, again in zip(first, second):
        assert one.tobytes() == again.tobytes()
    exact = np.swapaxes(erfa.c2i06a(EPOCH.day, EPOCH.fraction + night / 86400.0), 1, 2)
    np.testing.assert_allclose(first[0], exact, rtol=0.0, atol=1.5e-10)  # 0.03 mas
    shift = erfa.dtdb(EPOCH.day, EPOCH.fraction + night / 86400.0, 0.0, 0.0, 0.0, 0.0) / 86400.0
    np.testing.assert_allclose(first[1], EPOCH.fraction + night / 86400.0 - shift, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("start", ["2016-12-20T00:00:00 TDB", "2028-03-01T06:00:00 TDB"])
def test_the_interpolated_earth_rotation_angle_equals_the_direct_one_also_across_a_leap_second(start):
    epoch = Epoch.parse(start)
    t_s = np.linspace(-0.3, 21.7, 4001) * 86400.0
    day, fraction = utc_jd(epoch, t_s)
    turn = earth_rotation_angle(epoch, t_s) - erfa.era00(day, fraction)
    turn = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
    # 1e-13 d of a two-part date in one number near its half: 1e-8 s; 7e-13 rad = 0.03 mm on the geostationary ring
    assert np.max(np.abs(turn)) < 2e-12


def test_rtn_axes_are_right_handed_and_follow_the_motion():
    state = np.array([[7000.0, 0.0, 0.0, 1.0, 7.5, 0.0], [0.0, 3.0, 0.0, -1.0, 0.0, 1.0]])
    axes = rtn_axes(state)
    np.testing.assert_allclose(axes[0], np.eye(3), atol=1e-15)
    for R in axes:
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.all(np.einsum("ni,ni->n", axes[:, :, 1], state[:, 3:]) > 0.0)


def test_angles_must_be_finite():
    with pytest.raises(InputError, match="longitude"):
        Geostationary(longitude_rad=np.nan)
    with pytest.raises(InputError, match="lead"):
        HeliocentricCompanion(lead_rad=np.inf)
