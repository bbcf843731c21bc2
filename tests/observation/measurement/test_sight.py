"""Light time and the line of sight."""

import numpy as np
import pytest
from scipy.optimize import brentq

from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, HeliocentricCompanion, sight

T_S = np.linspace(0.0, 100.0, 12) * 86400.0


@pytest.mark.parametrize("spacecraft", [Geostationary(longitude_rad=0.3), HeliocentricCompanion(lead_rad=0.2)])
def test_light_time_solves_the_equation_found_by_bracketing(spacecraft, two_body, ephemeris, epoch):
    line = sight(two_body, spacecraft, T_S, ephemeris)
    telescope = spacecraft.state_km_km_s(ephemeris, epoch, T_S)[:, :3]

    def excess(tau, k):
        t = np.array([T_S[k] - tau])
        target = two_body.at(t).state[0, :3] + ephemeris.position_km("sun", epoch, t)[0]
        return np.linalg.norm(target - telescope[k]) / SPEED_OF_LIGHT_KM_S - tau

    brute = [brentq(excess, 0.0, 5000.0, args=(k,), xtol=1e-12, rtol=1e-15) for k in range(T_S.size)]
    # the equation is solved to 1e-9 s; times of 1e7 s carry 2e-9 s, which times V/c = 1e-4 is nothing
    np.testing.assert_allclose(line.light_time_s, brute, rtol=0.0, atol=1e-9)


def test_direction_distance_and_light_time_belong_together(two_body, ephemeris):
    line = sight(two_body, Geostationary(longitude_rad=0.0), T_S, ephemeris)
    rho = line.target_state[:, :3] - line.telescope_state[:, :3]
    np.testing.assert_allclose(line.u * line.distance_km[:, None], rho, rtol=1e-15, atol=1e-7)
    np.testing.assert_allclose(line.light_time_s * SPEED_OF_LIGHT_KM_S, line.distance_km, rtol=1e-15)


def test_vectors_are_barycentric_not_heliocentric(two_body, ephemeris, epoch):
    """A heliocentric difference forgets that the Sun moves during the light time: up to 9 mas."""
    spacecraft = HeliocentricCompanion(lead_rad=-1.0)
    line = sight(two_body, spacecraft, T_S, ephemeris)
    heliocentric = spacecraft.state_km_km_s(ephemeris, epoch, T_S) - ephemeris.state_km_km_s("sun", epoch, T_S)
    wrong = two_body.at(T_S - line.light_time_s).state[:, :3] - heliocentric[:, :3]
    wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
    mas = np.linalg.norm(wrong - line.u, axis=1) * 180.0 / np.pi * 3.6e6
    assert 2.0 < mas.max() < 20.0


def test_sky_partials_follow_the_line_of_sight_through_the_light_time(two_body, ephemeris, support):
    """D L: how the line of sight moves with the telescope, seen along the axes of the tangent plane."""
    spacecraft = Geostationary(longitude_rad=0.0)
    line = sight(two_body, spacecraft, T_S, ephemeris)
    DL = line.sky_partials()
    D = tangent_axes(line.psi) / line.distance_km[:, None, None]
    for j, axis in enumerate(np.eye(3)):

        def rho(h, axis=axis):
            moved = sight(two_body, support.Shifted(spacecraft=spacecraft, by_km=h * axis), T_S, ephemeris)
            return moved.u * moved.distance_km[:, None]

        # positions of 1e8 km carry 3e-8 km of round-off, over a base of 1e5 km
        seen = np.einsum("nai,ni->na", D, support.derivative(rho, 1e5))
        np.testing.assert_allclose(seen, -DL[:, :, j], rtol=0.0, atol=1e-11 / line.distance_km.min())


def tangent_axes(psi):
    """East and north (n, 2, 3) by the sines and cosines of the angles."""
    sin_ra, cos_ra, sin_dec, cos_dec = np.sin(psi[:, 0]), np.cos(psi[:, 0]), np.sin(psi[:, 1]), np.cos(psi[:, 1])
    east = np.stack([-sin_ra, cos_ra, np.zeros_like(sin_ra)], axis=1)
    return np.stack([east, np.stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec], axis=1)], axis=1)


def test_times_must_be_a_vector_of_finite_numbers(two_body, ephemeris):
    for bad in (np.array([]), np.array([0.0, np.nan]), np.zeros((2, 2))):
        with pytest.raises(InputError, match="reception times"):
            sight(two_body, Geostationary(longitude_rad=0.0), bad, ephemeris)


def test_a_target_about_as_fast_as_light_is_refused(two_body, ephemeris, support):
    class Racing(support.TwoBody):  # type: ignore[name-defined]
        @property
        def state(self):
            still = 0.0 * self.t_s
            x, vx = 1e8 + 4e5 * np.sin(self.t_s), 4e5 * np.cos(self.t_s)
            return np.stack([x, still, still, vx, still, still], axis=1)

    racing = Racing(epoch=two_body.epoch, start=two_body.start)
    with pytest.raises(InputError, match=r"km and km/s"):
        sight(racing, Geostationary(longitude_rad=0.0), T_S, ephemeris)
