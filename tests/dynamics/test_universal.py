"""Two-body motion of many orbits at once, against the one-orbit solution of the dynamics stage."""

import numpy as np
import pytest

from nebosvod.dynamics.twobody import kepler
from nebosvod.dynamics.twobody_many import fly, lagrange_coefficients, stumpff

GM = 0.01720209895**2  # au^3/d^2


@pytest.fixture(scope="module")
def orbits():
    """300 states, au and au/d, 40 % of them hyperbolic, and times up to a thousand days."""
    rng = np.random.default_rng(0)
    states = np.concatenate([rng.normal(size=(300, 3)), 0.012 * rng.normal(size=(300, 3))], axis=1)
    return states, 300.0 * rng.normal(size=300)


def test_it_is_the_motion_of_the_other_solver(orbits) -> None:
    states, t = orbits
    ours = fly(states, t, GM)
    theirs = np.array([kepler(state, [time], GM)[0] for state, time in zip(states, t)])
    error = np.max(np.abs(ours - theirs), axis=1) / np.max(np.abs(theirs), axis=1)
    # both lose some digits over many revolutions of small orbits
    assert np.max(error) < 1e-12
    assert np.median(error) < 1e-15


def test_a_parabola_is_no_special_case() -> None:
    r = np.array([1.0, 0.2, -0.1])
    speed = np.sqrt(2.0 * GM / np.linalg.norm(r))
    for excess in (-1e-12, 0.0, 1e-12):
        v = np.array([-0.3, 0.9, 0.2])
        v *= speed * (1.0 + excess) / np.linalg.norm(v)
        state = np.concatenate([r, v])
        there = fly(state[None], np.array([120.0]), GM)
        np.testing.assert_allclose(there[0], kepler(state, [120.0], GM)[0], rtol=1e-13)


def test_flying_there_and_back_ends_where_it_began(orbits) -> None:
    states, t = orbits
    back = fly(fly(states, t, GM), -t, GM)
    np.testing.assert_allclose(back, states, rtol=0.0, atol=1e-9)


def test_many_orbits_at_many_times_broadcast(orbits) -> None:
    states, t = orbits
    table = fly(states[:7, None], t[:11], GM)
    assert table.shape == (7, 11, 6)
    # the last iteration is shared: an ulp or two
    np.testing.assert_allclose(table[3, 5], fly(states[3:4], t[5:6], GM)[0], rtol=1e-12)


def test_lagrange_coefficients_have_unit_wronskian(orbits) -> None:
    states, t = orbits
    f, g, f_dot, g_dot = lagrange_coefficients(states, t, GM)
    scale = np.abs(f * g_dot) + np.abs(g * f_dot)
    np.testing.assert_allclose((f * g_dot - g * f_dot - 1.0) / scale, 0.0, atol=1e-13)


def test_stumpff_functions_join_where_the_series_ends() -> None:
    for z in (0.5, -0.5):
        inside, outside = stumpff(np.array([z])), stumpff(np.array([z * (1.0 + 1e-12)]))
        np.testing.assert_allclose(inside, outside, rtol=2e-12)
    c2, c3 = stumpff(np.array([0.0, 4.0, -4.0]))
    np.testing.assert_allclose(c2, [0.5, (1.0 - np.cos(2.0)) / 4.0, (np.cosh(2.0) - 1.0) / 4.0], rtol=1e-14)
    np.testing.assert_allclose(c3, [1 / 6, (2.0 - np.sin(2.0)) / 8.0, (np.sinh(2.0) - 2.0) / 8.0], rtol=1e-14)


def test_absurd_orbits_give_nan_and_no_warning() -> None:
    states = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, np.nan, 0.0, 0.0], [1.0, 0, 0, 0, 0.017, 0]])
    there = fly(states, np.full(3, 10.0), GM)
    assert np.isnan(there[:2]).any(axis=1).all()
    assert np.isfinite(there[2]).all()
