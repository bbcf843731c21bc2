"""What a telescope sees, and the reason for every epoch it loses."""

import numpy as np
import pytest

from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.observation import Geostationary, Telescope, visibility

DEG = np.pi / 180.0
T_S = np.array([0.0])


@pytest.fixture
def scene(ephemeris, epoch, support):
    """See a target that lies `angle` off a body's centre, as seen by a telescope that stands off that body."""

    def look(body, angle_deg, telescope_off_km, distance_km, magnitude=None, **limits):
        centre = ephemeris.position_km(body, epoch, T_S)[0]
        away = np.array([0.6, 0.64, 0.48])
        aside = np.cross(away, [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        place = telescope_off_km * away
        direction = -np.cos(angle_deg * DEG) * away + np.sin(angle_deg * DEG) * aside
        target = centre + place + distance_km * direction - ephemeris.position_km("sun", epoch, T_S)[0]
        telescope = Telescope(name="A", spacecraft=support.Shifted(body=body, by_km=place), sigma_rad=1e-6, **limits)
        return visibility(telescope, support.Still(epoch=epoch, position=target), T_S, ephemeris, magnitude)

    return look


@pytest.mark.parametrize(("angle", "seen"), [(44.9, False), (45.1, True)])
def test_sun_exclusion_counts_from_the_suns_centre(scene, angle, seen):
    # the Sun drifts 15 m/s during 33 s of light time: nothing at 1e7 km
    result = scene("sun", angle, 1.5e8, 1e7, exclusion_sun_rad=45 * DEG)
    assert result.visible[0] == seen
    assert result.reason[0] == ("" if seen else "sun")
    assert result.sun_angle_rad[0] == pytest.approx(angle * DEG, abs=1e-6)


@pytest.mark.parametrize(("body", "off_km"), [("earth", 42164.0), ("moon", 10000.0)])
@pytest.mark.parametrize(("beyond_limb", "seen"), [(9.5, False), (10.5, True)])
def test_earth_and_moon_exclusion_count_from_the_limb(scene, body, off_km, beyond_limb, seen):
    limb = np.degrees(np.arcsin(RADIUS_KM[body] / off_km))
    result = scene(body, limb + beyond_limb, off_km, 1e5, **{f"exclusion_{body}_rad": 10 * DEG})
    assert result.visible[0] == seen
    assert result.reason[0] == ("" if seen else body)
    # the Earth moves 10 km during the light time of 0.3 s
    assert getattr(result, f"{body}_limb_rad")[0] == pytest.approx(beyond_limb * DEG, abs=3e-4)


def test_without_exclusion_a_body_hides_only_what_is_behind_its_disc(scene):
    behind = scene("earth", 5.0, 42164.0, 1e6)
    assert behind.reason[0] == "earth"
    assert behind.earth_limb_rad[0] < 0.0
    in_front = scene("earth", 5.0, 42164.0, 3e4)
    assert in_front.visible[0]


def test_faint_targets_are_lost_to_the_magnitude_limit(scene):
    bright = scene("earth", 170.0, 42164.0, 1e7, magnitude=(19.0, 0.15), limiting_magnitude=22.0)
    V = bright.apparent_magnitude[0]
    assert bright.visible[0]
    faint = scene("earth", 170.0, 42164.0, 1e7, magnitude=(19.0, 0.15), limiting_magnitude=V - 0.01)
    assert faint.reason[0] == "magnitude"


def test_without_H_and_G_brightness_limits_nothing(scene):
    result = scene("earth", 170.0, 42164.0, 1e9, limiting_magnitude=1.0)
    assert result.visible[0]
    assert np.isnan(result.apparent_magnitude[0])


def test_every_limit_is_counted_and_the_first_is_the_reason(scene):
    result = scene("sun", 10.0, 1.5e8, 1e7, exclusion_sun_rad=45 * DEG, magnitude=(25.0, 0.15), limiting_magnitude=20.0)
    assert result.counts == {"duty": 0, "sun": 1, "earth": 0, "moon": 0, "magnitude": 1}
    assert result.reason[0] == "sun"
    assert result.explain() == "0 of 1 epochs visible; removed by sun 1, magnitude 1"


def test_visible_is_exactly_where_there_is_no_reason(two_body, ephemeris):
    telescope = Telescope(
        name="A",
        spacecraft=Geostationary(longitude_rad=0.0),
        sigma_rad=1e-6,
        exclusion_sun_rad=60 * DEG,
        exclusion_earth_rad=20 * DEG,
        exclusion_moon_rad=20 * DEG,
        limiting_magnitude=21.0,
    )
    t_s = np.arange(0.0, 100.0, 0.1) * 86400.0
    result = visibility(telescope, two_body, t_s, ephemeris, magnitude=(19.1, 0.24))
    np.testing.assert_array_equal(result.visible, result.reason == "")
    assert all(0 < count < t_s.size for limit, count in result.counts.items() if limit != "duty")
    lost = np.any(list(result.removed.values()), axis=0)
    np.testing.assert_array_equal(result.visible, ~lost)


@pytest.mark.parametrize(("angle", "seen"), [(84.0, False), (86.0, True), (134.0, True), (136.0, False)])
def test_a_field_of_regard_is_a_ring_about_the_sun(scene, angle, seen):
    result = scene("sun", angle, 1.5e8, 1e7, exclusion_sun_rad=85 * DEG, largest_sun_rad=135 * DEG)
    assert result.visible[0] == seen
    assert result.reason[0] == ("" if seen else "sun")


def test_outside_its_duty_windows_a_telescope_sees_nothing(two_body, ephemeris, epoch):
    windows = ((epoch + 86400.0, epoch + 2 * 86400.0), (epoch + 5 * 86400.0, epoch + 6 * 86400.0))
    telescope = Telescope(name="A", spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6, duty=windows)
    t_s = np.array([0.0, 0.999, 1.0, 1.5, 2.0, 2.001, 5.5, 7.0]) * 86400.0
    result = visibility(telescope, two_body, t_s, ephemeris)
    np.testing.assert_array_equal(result.removed["duty"], [True, True, False, False, False, True, False, True])
    assert result.reason[0] == "duty"


def test_a_trailing_target_is_fainter_for_the_limit_but_not_in_the_sky(two_body, ephemeris):
    t_s = np.arange(0.0, 20.0, 0.5) * 86400.0
    fixed = {"name": "A", "spacecraft": Geostationary(longitude_rad=0.0), "sigma_rad": 1e-6}
    short = visibility(Telescope(**fixed, limiting_magnitude=21.3), two_body, t_s, ephemeris, (19.1, 0.24))
    trails = Telescope(**fixed, limiting_magnitude=21.3, exposure_s=600.0, fwhm_rad=1.0 * DEG / 3600.0)
    long = visibility(trails, two_body, t_s, ephemeris, (19.1, 0.24))
    np.testing.assert_array_equal(short.apparent_magnitude, long.apparent_magnitude)
    lost = short.visible & ~long.visible
    assert np.any(lost)
    assert np.all(long.reason[lost] == "magnitude")
