"""Apparent places."""

import numpy as np
import pytest

from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.observation import Geostationary, apparent_place, sight
from nebosvod.observation.measurement.direction import angle_between, unit_vector

T_S = np.linspace(0.0, 300.0, 61) * 86400.0
MAS = np.pi / 180.0 / 3.6e6


@pytest.fixture
def line(two_body, ephemeris):
    return sight(two_body, Geostationary(longitude_rad=0.0), T_S, ephemeris)


def test_aberration_turns_towards_the_velocity_by_v_over_c(line, epoch, ephemeris):
    apparent = unit_vector(apparent_place(line, epoch, ephemeris))
    v = line.telescope_state[:, 3:] / SPEED_OF_LIGHT_KM_S
    across = v - line.u * np.sum(v * line.u, axis=1, keepdims=True)
    shift = apparent - line.u
    shift -= line.u * np.sum(shift * line.u, axis=1, keepdims=True)
    # classical to first order; second order (v/c)^2 = 1e-8 rad = 2 mas, deflection up to tens of mas near the Sun
    assert np.max(np.linalg.norm(shift - across, axis=1)) < 60.0 * MAS
    assert np.max(np.linalg.norm(shift, axis=1)) > 15.0e3 * MAS


def test_gravity_bends_away_from_the_sun_by_the_law_of_einstein(epoch, ephemeris, support):
    """A very distant target at 90 deg from the Sun, seen at 1 au: 4.07 mas."""
    sun = ephemeris.state_km_km_s("sun", epoch, np.zeros(1))[0]
    earth = ephemeris.position_km("earth", epoch, np.zeros(1))[0]
    to_sun = (sun[:3] - earth) / np.linalg.norm(sun[:3] - earth)
    aside = np.cross(to_sun, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    place = earth - sun[:3] + 1e13 * aside

    class Resting(support.Shifted):  # type: ignore[name-defined]
        def state_km_km_s(self, ephemeris, epoch, t_s):
            state = ephemeris.state_km_km_s("earth", epoch, t_s)
            state[:, 3:] = 0.0
            return state

    line = sight(support.Still(epoch=epoch, position=place), Resting(by_km=np.zeros(3)), np.zeros(1), far(ephemeris))
    apparent = unit_vector(apparent_place(line, epoch, ephemeris))
    away = angle_between(apparent, to_sun[None]) - angle_between(line.u, to_sun[None])
    assert away[0] / MAS == pytest.approx(4.07, abs=0.1)


def far(ephemeris):
    """An ephemeris whose Sun rests: the light of a target at 1e13 km left it a year ago."""

    class Resting:
        gm_km3_s2 = ephemeris.gm_km3_s2

        def position_km(self, body, epoch, t_s):
            return ephemeris.position_km(body, epoch, np.zeros(t_s.size))

        def state_km_km_s(self, body, epoch, t_s):
            state = ephemeris.state_km_km_s(body, epoch, np.zeros(t_s.size))
            state[:, 3:] = 0.0
            return state

    return Resting()
