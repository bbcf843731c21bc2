"""Kepler motion in universal variables."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nebosvod.dynamics.twobody import kepler, stumpff
from nebosvod.errors import InputError

GM = 132712440041.27942
AU_KM = 149597870.7
STATE = np.array([0.9 * AU_KM, 0.2 * AU_KM, -0.1 * AU_KM, -3.0, 27.0, 4.0])


@pytest.mark.parametrize("z", [-50.0, -1.5, -1.0, -0.3, 0.0, 1e-9, 0.99, 1.0, 7.0, 39.4, 400.0])
def test_stumpff_functions_follow_their_series(z: float) -> None:
    """4e-14: from z > 0 on, c_3 is a difference of numbers of order one."""
    with mp.workdps(60):
        for k, value in enumerate(stumpff(z)):
            wanted = mp.nsum(lambda j, k=k: (-mp.mpf(z)) ** j / mp.factorial(k + 2 * j), [0, 120])
            assert value == pytest.approx(float(wanted), rel=4e-14, abs=4e-16)


@settings(max_examples=100, deadline=None)
@given(speed=st.floats(5.0, 80.0), days=st.floats(-3000.0, 3000.0), angle=st.floats(0.1, 3.0))
def test_energy_and_momentum_stay_and_the_way_back_ends_where_it_began(speed: float, days: float, angle: float) -> None:
    """1e-10: a near miss of the Sun (speed 5 km/s) amplifies rounding by the ratio of distances squared."""
    start = np.array([AU_KM, 0.0, 0.0, speed * np.cos(angle), speed * np.sin(angle), 0.3])
    there = kepler(start, [days * 86400.0], GM)[0]
    energy = [0.5 * x[3:] @ x[3:] - GM / np.linalg.norm(x[:3]) for x in (start, there)]
    momentum = [np.cross(x[:3], x[3:]) for x in (start, there)]
    assert energy[1] == pytest.approx(energy[0], abs=float(1e-10 * GM / np.linalg.norm(there[:3])))
    assert np.linalg.norm(momentum[1] - momentum[0]) < 1e-10 * np.linalg.norm(momentum[0])
    back = kepler(there, [-days * 86400.0], GM)[0]
    assert np.linalg.norm(back[:3] - start[:3]) < 1e-6 * AU_KM


def test_velocity_is_the_derivative_of_position() -> None:
    around = kepler(STATE, [1e6 - 50.0, 1e6, 1e6 + 50.0], GM)
    assert (around[2, :3] - around[0, :3]) / 100.0 == pytest.approx(around[1, 3:], abs=1e-8)


def test_a_period_later_the_state_is_the_same() -> None:
    a = 1.0 / (2.0 / np.linalg.norm(STATE[:3]) - STATE[3:] @ STATE[3:] / GM)
    period = 2 * np.pi * np.sqrt(a**3 / GM)
    assert kepler(STATE, [period], GM)[0] == pytest.approx(STATE, rel=1e-12)


def test_state_at_the_centre_is_refused() -> None:
    with pytest.raises(InputError, match="off the centre"):
        kepler([0, 0, 0, 1, 0, 0], [1.0], GM)


@pytest.mark.parametrize("speed", [1e-3, 10.0, 29.0, np.sqrt(2.0 * GM / AU_KM), 43.0, 200.0])
@pytest.mark.parametrize("days", [-4000.0, -0.01, 60.0, 3e5])
def test_motion_follows_the_equation_of_kepler_in_forty_digits(speed: float, days: float) -> None:
    """1e-14 of position and velocity, times the revolutions and the stretching of a near miss of the Sun.

    From an apse at 1 au: r = r0 + (GM - r0 beta) U2 for any energy, U2 by its hypergeometric series in 40 digits.
    """
    start = np.array([AU_KM, 0.0, 0.0, 0.0, speed, 0.0])
    there = kepler(start, [days * 86400.0], GM)[0]
    with mp.workdps(60):
        r0, v, gm, t = mp.mpf(AU_KM), mp.mpf(float(speed)), mp.mpf(GM), mp.mpf(days * 86400.0)
        beta = 2 * gm / r0 - v * v
        turns = 0.0
        if beta > 0:
            period = 2 * mp.pi * gm / beta**1.5
            turns = float(mp.nint(t / period))
            t -= period * mp.nint(t / period)

        def U(k: int, s: mp.mpf) -> mp.mpf:
            return s**k / mp.factorial(k) * mp.hyp1f2(1, mp.mpf(k + 1) / 2, mp.mpf(k + 2) / 2, -beta * s * s / 4)

        low, high = mp.mpf(0), mp.sign(t) * mp.mpf(1e-9)
        while abs(r0 * U(1, high) + gm * U(3, high)) < abs(t):
            low, high = high, 2 * high
        s = mp.findroot(lambda x: r0 * U(1, x) + gm * U(3, x) - t, (low, high), solver="anderson", tol=1e-40)
        r = r0 * U(0, s) + gm * U(2, s)
        wanted = [
            r0 - gm * U(2, s),
            (r0 * U(1, s)) * v,
            0,
            -gm * U(1, s) * r0 / (r * r0),
            v * (1 - gm * U(2, s) / r),
            0,
        ]
        wanted_state = np.array([float(w) for w in wanted])
        stretch = 1.0 + float(mp.sqrt(2 * gm / r) * abs(t) / r) + 2 * np.pi * abs(turns)
    for part in (slice(0, 3), slice(3, 6)):
        error = np.linalg.norm(there[part] - wanted_state[part]) / np.linalg.norm(wanted_state[part])
        assert error < 1e-14 * stretch
