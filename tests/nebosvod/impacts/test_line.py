"""The line of variations leads to each virtual impactor along what moves the orbit in its own target plane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nebosvod import read_orbit
from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.impact import follow
from nebosvod.impacts.cloud import Passage, draw
from nebosvod.impacts.flight import Course
from nebosvod.impacts.hitting import hitting_orbit
from nebosvod.impacts.line import line_of_variations, lowest_points
from nebosvod.impacts.risk import risk
from nebosvod.orbits.conversion import balanced_factor
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

IMPACT = Epoch.parse("2036-05-01T00:00:00 TDB")
UNTIL = IMPACT + 3.0 * SECONDS_PER_DAY
DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")
PLAIN = 4.96e-4  # of a million plain draws, 496 hit (the long test below)


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


def turned() -> UncertainOrbit:
    """Four years before an impact, a month before a passage at 0.04 au, uncertain along its track in place and speed.

    What moves it along the track at that passage is not what moves it in 2036: the two are 22 degrees apart, and a
    sigma is 2 million km long then, which bends.
    """
    state = np.array([
        -104213294.98932408, -102169854.83912374, -45769001.80023171,
        15.607058624576934, -15.808958661957927, -9.167988352524523,
    ])  # fmt: skip
    along = state[3:] / np.linalg.norm(state[3:])
    place, speed = np.zeros(6), np.zeros(6)
    place[:3], speed[3:] = 6e5 * along, 6e-3 * along
    wide = np.hstack([place[:, None], speed[:, None], np.diag([1.0] * 3 + [1e-9] * 3)])
    return UncertainOrbit(
        name="turned", epoch=IMPACT + -4.0 * 365.25 * SECONDS_PER_DAY, state=state - 1.5 * place - 0.7 * speed,
        factor=balanced_factor(wide),
    )  # fmt: skip


def test_the_line_has_the_chance_of_drawn_orbits_where_an_earlier_passage_points_elsewhere(bodies: Ephemeris) -> None:
    """Along the track of the passage in 2032 it had 1.8e-4."""
    orbit = turned()
    course = Course(orbit=orbit, ephemeris=bodies, last=UNTIL, bodies=("earth",))
    nominal = follow(orbit.state, orbit.epoch, (0.0, UNTIL - orbit.epoch), 0.0, orbit.forces(bodies), True)
    line = line_of_variations(course, nominal, Epoch.parse("2032-05-28T02:00:00 TDB") - orbit.epoch)
    least = min((one for one in line.minima if abs(one.epoch - IMPACT) < 2e6), key=lambda one: one.distance_km)
    hits = hitting_orbit(course, "earth", least.epoch, least.sigma * line.string.direction)
    assert hits is not None
    direction = line.toward(hits).direction
    assert float(direction @ line.string.direction) == pytest.approx(0.924, abs=0.002)
    assert np.linalg.norm(hits.J @ direction) == pytest.approx(np.linalg.norm(hits.J, 2), rel=1e-9)
    assert line.probability(hits, "earth") == pytest.approx(PLAIN, rel=0.1)


def test_a_target_midway_between_two_orbits_of_the_line_is_looked_at() -> None:
    """Four orbits on a straight line past the Earth at 1000 km, the target amid two, 300 radii from each."""
    sigmas, zeta = np.array([-1.5, -0.5, 0.5, 1.5]), np.array([-6e6, -2e6 + 1.0, 2e6, 6e6])
    passage = Passage(
        body="earth", epoch=IMPACT, t_s=np.zeros(4), distance_km=np.abs(zeta),
        xi_zeta_km=np.stack([np.full(4, 1000.0), zeta], axis=1), axes=np.eye(3), hits=np.zeros(4, dtype=np.bool_),
        v_infinity_km_s=30.0, capture_radius_km=6800.0,
    )  # fmt: skip
    ((least, sigma, spacing, at),) = lowest_points(sigmas, passage)
    assert least == pytest.approx(1000.0, abs=1.0)
    assert (sigma, spacing) == (-0.5, 1.0)
    assert at is passage
    away = replace(passage, xi_zeta_km=passage.xi_zeta_km + np.array([1e6, 0.0]))
    assert lowest_points(sigmas, away) == []


@needs_data
@pytest.mark.long
def test_the_line_of_a_lost_asteroid_is_fine_enough_for_an_impact_three_sigmas_off(bodies: Ephemeris) -> None:
    """2001 VB, seen for six days, 13 au long after 22 years: 401 orbits step over the impact of 2023-07-23.

    The line and draws about the hitting orbit agree on a few 1e-9.
    """
    orbit, until = read_orbit(DATA / "sbdb" / "2001VB.json"), Epoch.parse("2024-06-01 UTC")
    found = risk(orbit, until, bodies, bodies=("earth",), draws=500)
    assert found.line is not None
    assert len(found.line.sigmas) > 2000
    assert not found.line.coarse
    (one,) = found.impactors
    assert one.epoch.iso("utc", 0).startswith("2023-07-23")
    chance = {way.name: way.probability for way in one.ways}
    assert chance["line_of_variations"] == pytest.approx(chance["importance_sampling"], rel=0.15)
    assert one.sigmas_line == pytest.approx(-3.5, abs=0.02)


@pytest.mark.long
def test_every_way_has_the_chance_of_a_million_plain_draws(bodies: Ephemeris) -> None:
    orbit = turned()
    course, rng = Course(orbit=orbit, ephemeris=bodies, last=UNTIL, bodies=("earth",)), np.random.default_rng(5)
    count, arrival = 0, IMPACT - orbit.epoch - 30.0 * SECONDS_PER_DAY
    for _ in range(20):  # some hit at the passages before
        cloud = course.fly(draw(orbit, 50_000, rng))
        count += int(np.count_nonzero(cloud.hit & (cloud.t_s > arrival)))
    assert count / 1e6 == pytest.approx(PLAIN, abs=3.0 * PLAIN / np.sqrt(count))
    (one,) = risk(orbit, UNTIL, bodies, bodies=("earth",), draws=2000).impactors
    chance = {way.name: way.probability for way in one.ways}
    for name in ("line_of_variations", "importance_sampling"):
        assert chance[name] == pytest.approx(count / 1e6, rel=0.15), name
    assert one.sigmas_line == pytest.approx(float(np.linalg.norm(one.orbits[0].u)), abs=0.02)
    assert one.stretching_km == pytest.approx(float(np.linalg.norm(one.orbits[0].J, 2)), rel=1e-6)
