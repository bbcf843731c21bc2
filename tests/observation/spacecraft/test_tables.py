"""Spacecraft from tables: the interpolation, its ends, and what is refused."""

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator, KroghInterpolator

from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.observation import table
from nebosvod.observation.spacecraft.tabulated import Segment

DAY = 86400.0


def kepler(t):
    one = np.ones(t.size)
    return kepler_state(398600.4, 42164.0, 0.1, 0.3, 0.2 * one, 0.7 * one, t * np.sqrt(398600.4 / 42164.0**3))


def segment_of(polynomials, method, window, nodes):
    """A table of six polynomials, or of three and their derivatives."""
    both = [*polynomials, *(p.deriv() for p in polynomials)][:6]
    states = np.stack([p(nodes) for p in both], axis=1)
    return both, Segment(t_s=nodes, states=states, start_s=nodes[0], end_s=nodes[-1], method=method, window=window)


@pytest.mark.parametrize(
    ("method", "window", "degree", "count"), [("hermite", 4, 7, 3), ("hermite", 3, 5, 3), ("lagrange", 5, 4, 6)]
)
def test_interpolation_reproduces_polynomials_of_its_degree_and_no_higher(method, window, degree, count):
    rng = np.random.default_rng(1)
    nodes = 0.25 * np.arange(12) + rng.uniform(0.0, 0.15, 12)
    where = rng.uniform(nodes[0], nodes[-1], 60)  # windows in disorder
    for more, exact in ((0, True), (1, False)):
        polynomials = [np.polynomial.Polynomial(c) for c in rng.normal(size=(count, degree + 1 + more))]
        expected, segment = segment_of(polynomials, method, window, nodes)
        error = np.abs(segment.evaluate(where) - np.stack([p(where) for p in expected], axis=1))
        # values up to 3^7: round-off 5e-13, times the growth of differences over close points
        assert bool(error.max() < 1e-9) is exact


@pytest.mark.parametrize("method", ["hermite", "lagrange"])
def test_interpolation_is_that_of_scipy_in_a_window_about_each_time(method):
    nodes = np.sort(np.random.default_rng(2).uniform(0.0, 2.0, 30)) * DAY
    states = kepler(nodes)
    segment = Segment(t_s=nodes, states=states, start_s=nodes[0], end_s=nodes[-1], method=method, window=6)
    for where in np.linspace(nodes[0], nodes[-1], 47)[1:-1]:
        first = int(np.clip(np.searchsorted(nodes, where) - 3, 0, 24))
        mine = slice(first, first + 6)
        found = segment.evaluate(np.array([where]))[0]
        if method == "lagrange":
            expected = BarycentricInterpolator(nodes[mine], states[mine])(where)
        else:
            points = np.repeat(nodes[mine], 2)
            values = np.stack([states[mine, :3], states[mine, 3:] * DAY], axis=1).reshape(-1, 3)
            curve = KroghInterpolator((points - where) / DAY, values)
            expected = np.concatenate([curve(0.0), curve.derivative(0.0) / DAY])
        np.testing.assert_allclose(found[:3], expected[:3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found[3:], expected[3:], rtol=0.0, atol=1e-10)


def test_a_table_gives_its_points_and_the_orbit_between_them(ephemeris, epoch):
    nodes = np.arange(0.0, 2.0, 0.02) * DAY
    orbit = table(epoch, nodes, kepler(nodes), "earth")
    between = np.linspace(0.0, nodes[-1], 777)
    state = orbit.state_km_km_s(ephemeris, epoch, between) - ephemeris.state_km_km_s("earth", epoch, between)
    # sixteenth-order interpolation of a step of 1/50 revolution: round-off of 1.5e8 km remains
    np.testing.assert_allclose(state[:, :3], kepler(between)[:, :3], rtol=0.0, atol=2e-7)
    np.testing.assert_allclose(state[:, 3:], kepler(between)[:, 3:], rtol=0.0, atol=1e-9)


def test_a_table_refuses_times_outside_with_its_span(ephemeris, epoch):
    nodes = np.arange(5) * 3600.0
    orbit = table(epoch, nodes, kepler(nodes), "earth", source="mine.ecsv")
    with pytest.raises(CoverageError, match=r"mine.ecsv: no state at 2028-11-16.*2028-11-15T00:00:00 TDB to 2028-11"):
        orbit.state_km_km_s(ephemeris, epoch, np.array([0.0, DAY]))


@pytest.mark.parametrize(
    ("t_s", "states", "words"),
    [
        ([0.0, 0.0, 1.0], np.zeros((3, 6)), "ascend"),
        ([0.0, 1.0, 2.0], np.zeros((3, 5)), r"states \(k, 6\)"),
        ([0.0, 1.0, 2.0], np.full((3, 6), np.nan), "not finite"),
        ([0.0], np.zeros((1, 6)), "at least two"),
    ],
)
def test_broken_tables_are_refused(epoch, t_s, states, words):
    with pytest.raises(InputError, match=words):
        table(epoch, t_s, states, "earth")


@pytest.mark.parametrize("far_km", [1e11, 1e12, 9e12])
def test_a_state_no_telescope_has_is_refused_with_the_file(ephemeris, epoch, far_km):
    """It used to end as a light time that leads out of the integrated span, without the file."""
    nodes = np.linspace(0.0, DAY, 20)
    states = kepler(nodes)
    states[10, 0] = far_km
    orbit = table(epoch, nodes, states, "earth", source="craft.oem")
    assert orbit.state_km_km_s(ephemeris, epoch, nodes[:2]).shape == (2, 6)
    with pytest.raises(DataError, match=r"^craft\.oem: a state of .* which no telescope has .* damaged, copy it again"):
        orbit.state_km_km_s(ephemeris, epoch, nodes[9:12])
