"""Errors of low orbits: the flattened Earth turns the orbit, and an error still grows with time, not exponentially."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nebosvod.observation import GeocentricOrbit, Geostationary, sun_synchronous
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs
from nebosvod.observation.uncertainty.orbit_transition import transitions

DAY = 86400.0
J2, RADIUS = 1.0826359e-3, 6378.1366


def flattened(gm, pole, j2):
    """The acceleration of a flattened Earth, km/s^2; written anew, from the textbook (Vallado 2013, eq. 8-30)."""

    def rate(t, y):
        r, d = y[:3], np.linalg.norm(y[:3])
        z = r @ pole
        a = -gm * r / d**3 - 1.5 * j2 * gm * RADIUS**2 / d**5 * ((1 - 5 * z**2 / d**2) * r + 2 * z * pole)
        return np.concatenate([y[3:], a])

    return rate


def flown(gm, pole, y, t_s, flat=True):
    found = solve_ivp(
        flattened(gm, pole, J2 * flat), (0.0, t_s[-1]), y, t_eval=t_s, rtol=1e-12, atol=1e-9, method="DOP853"
    )
    return found.y.T


@pytest.mark.parametrize("orbit", ["sun-synchronous", "inclined", "eccentric", "no J2"])
def test_an_error_of_a_low_orbit_drifts_as_between_two_orbits_of_a_flattened_earth(orbit, ephemeris, epoch):
    """Two states integrated apart by 100 m or 10 cm/s, by scipy; sizes over the last revolution after five days."""
    made = {
        "sun-synchronous": sun_synchronous(elements_epoch=epoch, altitude_km=700.0, local_time_h=6.0),
        "inclined": GeocentricOrbit(elements_epoch=epoch, a_km=7500.0, i_rad=0.9, node_rad=1.0, mean_anomaly_rad=2.0),
        "eccentric": GeocentricOrbit(elements_epoch=epoch, a_km=12000.0, e=0.3, i_rad=0.6, node_rad=1.0, peri_rad=2.0),
        "no J2": GeocentricOrbit(elements_epoch=epoch, a_km=12000.0, e=0.3, i_rad=0.6, peri_rad=2.0, j2=False),
    }[orbit]
    gm = ephemeris.gm_km3_s2["earth"]
    period = 2.0 * np.pi * np.sqrt(made.a_km**3 / gm)
    t_s = np.concatenate([[0.0], 5.0 * DAY + np.linspace(0.0, period, 60)])
    start = (made.state_km_km_s(ephemeris, epoch, t_s[:1]) - ephemeris.state_km_km_s("earth", epoch, t_s[:1]))[0]
    Phi = transitions(made, ephemeris, epoch, np.zeros(t_s.size), t_s)
    np.testing.assert_allclose(Phi[0], np.eye(6), atol=1e-6)
    pole = R_icrf_from_cirs(epoch, np.zeros(1))[0, :, 2]
    for column in range(6):
        moved = np.zeros(6)
        moved[column] = 0.1 if column < 3 else 1e-4
        apart = flown(gm, pole, start + moved, t_s, made.j2) - flown(gm, pole, start - moved, t_s, made.j2)
        expected = np.sqrt(np.mean(np.sum((apart[1:, :3] / 2.0) ** 2, axis=1)))
        found = np.sqrt(np.mean(np.sum((Phi[1:, :3] @ moved) ** 2, axis=1)))
        assert found == pytest.approx(expected, rel=0.15 if made.j2 else 1e-3, abs=0.02)


def test_along_a_track_flown_over_a_flattened_earth_the_partials_are_those_of_displaced_orbits(ephemeris, epoch):
    """A table or a file of a low orbit: a day, by differences of orbits integrated by scipy."""
    gm = ephemeris.gm_km3_s2["earth"]
    pole = R_icrf_from_cirs(epoch, np.zeros(1))[0, :, 2]
    start = np.array([7000.0, 0.0, 0.0, 0.0, -1.0, 7.5])
    dense = solve_ivp(
        flattened(gm, pole, J2), (0.0, DAY), start, rtol=1e-12, atol=1e-9, method="DOP853", dense_output=True
    )

    class Track:
        def state_km_km_s(self, ephemeris, epoch, t_s):
            return dense.sol(t_s).T + ephemeris.state_km_km_s("earth", epoch, t_s)

    t_s = np.array([0.1, 0.5, 1.0]) * DAY
    Phi = transitions(Track(), ephemeris, epoch, np.zeros(3), t_s)
    for column in range(6):
        moved = np.zeros(6)
        moved[column] = 0.01 if column < 3 else 1e-5
        apart = (flown(gm, pole, start + moved, t_s) - flown(gm, pole, start - moved, t_s)) / 2.0
        error = np.linalg.norm((Phi @ moved - apart)[:, :3], axis=1) / np.linalg.norm(apart[:, :3], axis=1).max()
        assert error.max() < 5e-3


def test_back_and_forth_is_the_identity_and_a_circle_on_the_equator_is_the_geostationary_one(ephemeris, epoch):
    circle = GeocentricOrbit(elements_epoch=epoch, a_km=42164.17, j2=False)
    there, back = np.array([3.0 * DAY]), np.zeros(1)
    product = (
        transitions(circle, ephemeris, epoch, there, back)[0] @ transitions(circle, ephemeris, epoch, back, there)[0]
    )
    scale = np.array([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    np.testing.assert_allclose(product * scale / scale[:, None], np.eye(6), atol=1e-5)
    near = transitions(Geostationary(longitude_rad=0.0), ephemeris, epoch, back, there)[0]
    ours = transitions(circle, ephemeris, epoch, back, there)[0]
    assert np.linalg.norm(ours[:3, :3]) == pytest.approx(np.linalg.norm(near[:3, :3]), rel=0.3)
