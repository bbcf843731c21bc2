"""Orbits that a mission states by elements: about the Earth, about the Sun, about L1 and L2."""

import numpy as np
import pytest

from nebosvod.dynamics.constants import AU_KM, RADIUS_KM
from nebosvod.dynamics.kepler import eccentric_anomaly, kepler_state
from nebosvod.errors import InputError
from nebosvod.observation import GeocentricOrbit, HeliocentricOrbit, LibrationOrbit, sun_synchronous
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs
from nebosvod.observation.spacecraft.geocentric import secular_rates
from nebosvod.observation.spacecraft.lagrange import linear_motion
from nebosvod.timescale import Epoch

DAY = 86400.0
ELEMENTS = {"a_km": 26000.0, "e": 0.6, "i_rad": 1.1, "node_rad": 0.4, "peri_rad": 4.5, "mean_anomaly_rad": 2.0}


def relative(spacecraft, body, ephemeris, epoch, t_s):
    return spacecraft.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s(body, epoch, t_s)


@pytest.mark.parametrize("e", [0.0, 0.01, 0.5, 0.9, 0.999])
def test_keplers_equation_is_solved_to_round_off(e):
    M = np.linspace(-10.0, 10.0, 2001)
    E = np.array([eccentric_anomaly(angle, e) for angle in M])
    left = np.mod(E - e * np.sin(E) - M + np.pi, 2.0 * np.pi) - np.pi
    assert np.max(np.abs(left)) < 5e-15


def test_a_kepler_orbit_keeps_energy_and_angular_momentum_and_obeys_gravity(support):
    t = np.linspace(0.0, 2e5, 50)
    gm, a, e = 398600.4, 26000.0, 0.6
    n = np.sqrt(gm / a**3)
    angle = np.full(50, 0.7)

    def state(h):
        return kepler_state(gm, a, e, 1.1, angle, 2.0 * angle, n * (t + h))

    r, v = state(0.0)[:, :3], state(0.0)[:, 3:]
    distance = np.linalg.norm(r, axis=1)
    np.testing.assert_allclose(np.sum(v * v, axis=1) / 2 - gm / distance, -gm / (2 * a), rtol=1e-12)
    momentum = np.cross(r, v)
    np.testing.assert_allclose(np.linalg.norm(momentum, axis=1), np.sqrt(gm * a * (1 - e * e)), rtol=1e-13)
    np.testing.assert_allclose(momentum[:, 2] / np.linalg.norm(momentum, axis=1), np.cos(1.1), rtol=1e-13)
    derivative = support.derivative(state, 5.0)
    np.testing.assert_allclose(derivative[:, :3], v, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(derivative[:, 3:], -gm * r / distance[:, None] ** 3, rtol=0.0, atol=1e-10)


def test_a_geocentric_orbit_without_j2_returns_after_a_period(ephemeris, epoch):
    orbit = GeocentricOrbit(elements_epoch=epoch, j2=False, **ELEMENTS)
    period = 2.0 * np.pi / np.sqrt(ephemeris.gm_km3_s2["earth"] / orbit.a_km**3)
    state = relative(orbit, "earth", ephemeris, epoch, np.array([0.0, period, 10.0 * period]))
    # the frame of date precesses by 1e-6 rad in the 5 days
    np.testing.assert_allclose(state[1:], np.broadcast_to(state[0], (2, 6)), rtol=0.0, atol=0.1)


def test_the_velocity_of_a_geocentric_orbit_is_the_derivative_of_its_position(ephemeris, epoch, support):
    orbit = GeocentricOrbit(elements_epoch=epoch + 1e6, **ELEMENTS)
    t_s = np.linspace(0.0, 5.0, 40) * DAY
    state = orbit.state_km_km_s(ephemeris, epoch, t_s)
    numeric = support.derivative(lambda h: orbit.state_km_km_s(ephemeris, epoch, t_s + h)[:, :3], 2.0)
    # 1.5e8 km carry 3e-8 km, over 2 s; precession left out of the velocity: 1e-7 of 4 km/s
    np.testing.assert_allclose(state[:, 3:], numeric, rtol=0.0, atol=5e-7)


def test_j2_turns_node_and_perigee_at_the_known_rates():
    # ISS-like 51.6 deg at 6778 km: node -5.0 deg/d, argument of perigee +3.7 deg/d (Vallado, Fundamentals, sec. 9.6)
    a = 6778.0
    n = np.sqrt(398600.4 / a**3)
    node, peri, _ = np.degrees(secular_rates(n, a, 0.0, np.radians(51.6))) * DAY
    assert node == pytest.approx(-5.0, abs=0.05)
    assert peri == pytest.approx(3.74, abs=0.05)
    # at the critical inclination the perigee rests, in polar orbit the node
    assert secular_rates(n, a, 0.0, np.arcsin(np.sqrt(0.8)))[1] == pytest.approx(0.0, abs=1e-19)
    assert secular_rates(n, a, 0.0, np.pi / 2)[0] == pytest.approx(0.0, abs=1e-19)


def test_a_sun_synchronous_orbit_has_the_known_inclination_and_keeps_its_local_time(ephemeris, epoch):
    orbit = sun_synchronous(elements_epoch=epoch, altitude_km=700.0, local_time_h=18.0)
    # 98.19 deg at 700 km (Vallado, fig. 11-13)
    assert np.degrees(orbit.i_rad) == pytest.approx(98.19, abs=0.02)
    t_s = np.arange(0.0, 366.0, 30.0) * DAY
    state = relative(orbit, "earth", ephemeris, epoch, t_s)
    sun = ephemeris.position_km("sun", epoch, t_s) - ephemeris.position_km("earth", epoch, t_s)
    back = np.swapaxes(R_icrf_from_cirs(epoch, t_s), 1, 2)
    normal = np.einsum("nij,nj->ni", back, np.cross(state[:, :3], state[:, 3:]))
    equatorial_sun = np.einsum("nij,nj->ni", back, sun)
    node = np.arctan2(normal[:, 0], -normal[:, 1])
    hours = 12.0 + (node - np.arctan2(equatorial_sun[:, 1], equatorial_sun[:, 0])) * 12.0 / np.pi
    # apparent less mean Sun, the equation of time: within 17 min
    deviation = np.mod(hours - 18.0 + 12.0, 24.0) - 12.0
    assert np.max(np.abs(deviation)) < 17.0 / 60.0
    assert np.ptp(deviation) > 0.3
    assert abs(deviation.mean()) < 2.0 / 60.0


def test_orbits_that_cannot_be_are_refused(epoch):
    with pytest.raises(InputError, match="inside the Earth"):
        GeocentricOrbit(elements_epoch=epoch, a_km=7000.0, e=0.1)
    with pytest.raises(InputError, match=r"e in \[0, 1\)"):
        GeocentricOrbit(elements_epoch=epoch, a_km=7000.0, e=1.0)
    with pytest.raises(InputError, match="none exists"):
        sun_synchronous(elements_epoch=epoch, altitude_km=6000.0, local_time_h=6.0)
    with pytest.raises(InputError, match="local time"):
        sun_synchronous(elements_epoch=epoch, altitude_km=600.0, local_time_h=24.0)
    with pytest.raises(InputError, match="a > 0"):
        HeliocentricOrbit(elements_epoch=epoch, a_km=-1.0)
    with pytest.raises(InputError, match='"L1" or "L2"'):
        LibrationOrbit(point="L4", elements_epoch=epoch)


def test_a_circular_heliocentric_orbit_stays_in_the_ecliptic_at_its_distance(ephemeris, epoch):
    orbit = HeliocentricOrbit(elements_epoch=epoch, a_km=0.7 * AU_KM, mean_anomaly_rad=1.0)
    t_s = np.linspace(0.0, 300.0, 31) * DAY
    state = relative(orbit, "sun", ephemeris, epoch, t_s)
    np.testing.assert_allclose(np.linalg.norm(state[:, :3], axis=1), 0.7 * AU_KM, rtol=1e-13)
    pole = np.array([0.0, -np.sin(np.radians(84381.448 / 3600)), np.cos(np.radians(84381.448 / 3600))])
    np.testing.assert_allclose(state[:, :3] @ pole, 0.0, atol=1e-6)
    assert np.cross(state[0, :3], state[0, 3:]) @ pole > 0.0
    # 0.7^1.5 years
    period = 365.2569 * DAY * 0.7**1.5
    again = relative(orbit, "sun", ephemeris, epoch, np.array([0.0, period]))
    np.testing.assert_allclose(again[1, :3], again[0, :3], rtol=0.0, atol=500.0)


class TestLibration:
    """L1 and L2."""

    def test_the_points_lie_at_their_known_distances(self):
        # Richardson 1980, table: gamma of L1 and L2 of the Sun and the Earth-Moon pair
        mu = 3.040423e-6
        assert linear_motion(mu, "L1")[0] == pytest.approx(1.001090e-2, abs=1e-7)
        assert linear_motion(mu, "L2")[0] == pytest.approx(1.007824e-2, abs=1e-7)
        # Richardson 1980: Sun-Earth L1, lambda = 2.08645, k = 3.2293
        _, frequency, kappa = linear_motion(3.04036e-6, "L1")
        assert frequency == pytest.approx(2.08645, abs=1e-4)
        assert kappa == pytest.approx(3.22927, abs=1e-4)

    @pytest.mark.parametrize(("point", "side"), [("L1", -1.0), ("L2", 1.0)])
    def test_without_amplitude_the_spacecraft_is_on_the_line(self, ephemeris, epoch, point, side):
        t_s = np.linspace(0.0, 365.0, 40) * DAY
        orbit = LibrationOrbit(point=point, elements_epoch=epoch)
        place = relative(orbit, "emb", ephemeris, epoch, t_s)[:, :3]
        line = ephemeris.position_km("emb", epoch, t_s) - ephemeris.position_km("sun", epoch, t_s)
        unit = line / np.linalg.norm(line, axis=1, keepdims=True)
        along = np.sum(place * unit, axis=1)
        np.testing.assert_allclose(along * side, 1.497e6, rtol=0.025)
        np.testing.assert_allclose(np.cross(place, unit), 0.0, atol=1e-3)

    def test_a_halo_has_its_amplitudes_and_half_a_year(self, ephemeris, epoch):
        t_s = np.linspace(0.0, 365.25, 400) * DAY
        orbit = LibrationOrbit(point="L2", elements_epoch=epoch, amplitude_km=6e5, amplitude_z_km=3e5)
        centre = LibrationOrbit(point="L2", elements_epoch=epoch)
        offset = orbit.state_km_km_s(ephemeris, epoch, t_s)[:, :3] - centre.state_km_km_s(ephemeris, epoch, t_s)[:, :3]
        line = ephemeris.position_km("emb", epoch, t_s) - ephemeris.position_km("sun", epoch, t_s)
        unit = line / np.linalg.norm(line, axis=1, keepdims=True)
        along = np.sum(offset * unit, axis=1)
        assert np.max(np.abs(along)) == pytest.approx(6e5 / 3.19, rel=0.02)
        assert np.max(np.linalg.norm(offset, axis=1)) == pytest.approx(6e5, rel=0.01)
        crossings = np.count_nonzero(np.diff(np.sign(along)))
        assert crossings == 4  # two revolutions a year

    @pytest.mark.parametrize("point", ["L1", "L2"])
    def test_its_velocity_is_the_derivative_of_its_position(self, ephemeris, epoch, support, point):
        size = {"amplitude_km": 6e5, "amplitude_z_km": 3e5, "phase_rad": 0.4, "phase_z_rad": 2.0}
        orbit = LibrationOrbit(point=point, elements_epoch=epoch, **size)
        t_s = np.linspace(0.0, 365.0, 200) * DAY
        state = orbit.state_km_km_s(ephemeris, epoch, t_s)
        numeric = support.derivative(lambda h: orbit.state_km_km_s(ephemeris, epoch, t_s + h)[:, :3], 3600.0)
        # 1.5e8 km carry 3e-8 km, over two hours: 1e-11; the planets tilt the orbit, worth 3e-7
        np.testing.assert_allclose(state[:, 3:], numeric, rtol=0.0, atol=5e-11)


def test_the_epoch_of_elements_and_the_epoch_of_times_are_independent(ephemeris, epoch):
    later = Epoch.from_jd(epoch.day + 10.0, epoch.fraction)
    for orbit in (
        GeocentricOrbit(elements_epoch=epoch, a_km=2.0 * RADIUS_KM["earth"], e=0.1),
        HeliocentricOrbit(elements_epoch=epoch, a_km=AU_KM, e=0.1),
        LibrationOrbit(point="L1", elements_epoch=epoch, amplitude_km=5e5),
    ):
        np.testing.assert_allclose(
            orbit.state_km_km_s(ephemeris, epoch, np.array([10.0 * DAY])),
            orbit.state_km_km_s(ephemeris, later, np.array([0.0])),
            rtol=0.0,
            atol=1e-5,
        )
