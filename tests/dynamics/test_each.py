"""Orbits to their fates on steps of their own: closed forms of two bodies, and orbits flown one by one."""

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, find_encounters, propagate
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.each import fates_of_each, states_of_each
from nebosvod.dynamics.fates import Fates
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import ImpactError
from nebosvod.timescale import Epoch

Array = np.ndarray
EPOCH = Epoch.parse("2030-05-01T00:00:00 TDB")
ANYWHERE_KM = 1e9


def about_the_earth(forces: ForceModel, rows: list[Array]) -> Array:
    """Heliocentric states of states (6,) from the Earth's centre."""
    earth, sun = (forces.ephemeris.state_km_km_s(body, EPOCH, 0.0)[0] for body in ("earth", "sun"))
    found: Array = np.array(rows) + earth - sun
    return found


def fates(forces: ForceModel, rows: list[Array], days: float) -> Fates:
    return fates_of_each(about_the_earth(forces, rows), EPOCH, days * DAY_S, forces, "earth", ANYWHERE_KM)


def test_hyperbolas_fall_or_pass_where_two_bodies_say(full_forces: ForceModel) -> None:
    """Pericentre and its time, and the time at the ground; J2, Moon and Sun move them by km and s."""
    gm, lead_s = full_forces.ephemeris.gm_km3_s2["earth"], 7200.0
    lowest = [1.0, 3000.0, 6300.0, 6420.0, 20000.0, 60000.0]
    rows = [kepler([0.0, q, 0.0, np.sqrt(25.0 + 2.0 * gm / q), 0.0, 0.0], [-lead_s], gm)[0] for q in lowest]
    found = fates(full_forces, rows, 5.0)
    assert found.impact.tolist() == [True, True, True, False, False, False]
    assert set(found.body.tolist()) == {"earth"}
    for k, q in enumerate(lowest):
        if found.impact[k]:
            a, e = gm / 25.0, 1.0 + q * 25.0 / gm
            F = np.arccosh((6367.0 / a + 1.0) / e)
            before = (e * np.sinh(F) - F) * np.sqrt(a**3 / gm)
            assert 6356.7 < found.distance_km[k] < 6378.2
            assert found.t_s[k] == pytest.approx(lead_s - before, abs=15.0 if q > 6000.0 else 5.0)
        else:
            assert found.distance_km[k] == pytest.approx(q, abs=20.0)
            assert found.t_s[k] == pytest.approx(lead_s, abs=5.0)


def test_satellites_fall_at_their_first_perigee_or_circle_for_months(full_forces: ForceModel) -> None:
    """Half a period from apogee to perigee; 64 records are not room enough for those that go on."""
    gm = full_forces.ephemeris.gm_km3_s2["earth"]
    high, lowest = 60000.0, [2000.0, 6000.0, 7000.0, 20000.0]
    rows = []
    for q in lowest:
        speed = np.sqrt(gm * (2.0 / high - 2.0 / (high + q)))
        rows.append(np.array([high, 0.0, 0.0, 0.0, speed * np.cos(0.4), speed * np.sin(0.4)]))
    found = fates(full_forces, rows, 100.0)
    assert found.impact.tolist() == [True, True, False, False]
    for k in (0, 1):
        a = 0.5 * (high + lowest[k])
        e = 1.0 - lowest[k] / a
        E = 2.0 * np.pi - np.arccos((1.0 - 6370.0 / a) / e)
        since_apogee = (E - e * np.sin(E) - np.pi) * np.sqrt(a**3 / gm)
        assert found.t_s[k] == pytest.approx(since_apogee, abs=40.0)  # the Moon's pull on a way of some hours
    # the Moon and the Sun move perigees by 1 % in a hundred days
    assert found.distance_km[2:] == pytest.approx(lowest[2:], rel=0.05)
    one = propagate(about_the_earth(full_forces, rows)[3], EPOCH, [100.0 * DAY_S], full_forces, False)
    lowest_of_all = min(event.distance_km for event in find_encounters(one, "earth", 1e6))
    assert found.distance_km[3] == pytest.approx(lowest_of_all, abs=1e-3)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_orbits_torn_apart_have_the_fates_of_orbits_flown_one_by_one(full_forces: ForceModel, sign: float) -> None:
    forces = ForceModel(ephemeris=full_forces.ephemeris, asteroids=False)
    rng = np.random.default_rng(1)
    line = rng.standard_normal((30, 3))
    line *= (np.exp(rng.uniform(np.log(7e3), np.log(6e5), 30)) / np.linalg.norm(line, axis=1))[:, None]
    rows = list(np.hstack([line, 3.0 * rng.standard_normal((30, 3))]))
    end_s = sign * 2.0 * DAY_S
    found = fates(forces, rows, sign * 2.0)
    for k, start in enumerate(about_the_earth(forces, rows)):
        if found.impact[k]:
            with pytest.raises(ImpactError) as caught:
                propagate(start, EPOCH, [end_s], forces, False, tolerance=1e-12, margin_s=0.0)
            assert found.t_s[k] == pytest.approx(caught.value.t_s, abs=0.01)
            continue
        one = propagate(start, EPOCH, [end_s], forces, False, tolerance=1e-12, margin_s=0.0)
        events = find_encounters(one, "earth", ANYWHERE_KM)
        assert (found.body[k] == "earth") == bool(events)
        if events:
            assert found.distance_km[k] == pytest.approx(min(event.distance_km for event in events), abs=1e-3)
    assert 3 < found.impact.sum() < 27


HOURS_S = 3600.0 * np.array([0.2, 1.0, 1.5, 1.9])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_states_of_what_passes_low_and_at_twenty_thousand_km_s_are_those_flown_one_by_one(
    full_forces: ForceModel, sign: float
) -> None:
    """A pass 60 km above the ground an hour on, a satellite that stays low, and a speed that no orbit has."""
    gm, t_s = full_forces.ephemeris.gm_km3_s2["earth"], sign * HOURS_S
    low = kepler([0.0, 6440.0, 0.0, np.sqrt(25.0 + 2.0 * gm / 6440.0), 0.0, 0.0], [-sign * 3600.0], gm)[0]
    circling = np.array([6500.0, 0.0, 0.0, 0.0, np.sqrt(gm / 6500.0), 0.0])
    fast = np.array([-sign * 2.0e7, 9000.0, 0.0, 20000.0, 0.0, 0.0])
    states = about_the_earth(full_forces, [low, circling, fast])
    found = states_of_each(states, EPOCH, t_s, full_forces)
    for k, state in enumerate(states):
        alone = propagate(state, EPOCH, t_s, full_forces, False, tolerance=1e-13).state
        assert np.abs(found[k, :, :3] - alone[:, :3]).max() < 1e-3
        assert np.abs(found[k, :, 3:] - alone[:, 3:]).max() < 1e-6


def test_who_comes_down_or_begins_below_the_ground_has_no_states(full_forces: ForceModel) -> None:
    """A hyperbola with its pericentre at 3000 km, 3 h before it; one that falls after the last of the times is up.

    The third begins at 6365 km over the pole, 8 km above the ellipsoid; the last at 6370 km over the equator, below it.
    """
    gm = full_forces.ephemeris.gm_km3_s2["earth"]
    falls = kepler([0.0, 3e3, 0.0, np.sqrt(25.0 + 2.0 * gm / 3e3), 0.0, 0.0], [-10800.0], gm)[0]
    over = np.array([0.0, 0.0, 6365.0, 0.0, 0.0, 15.0])
    under = np.array([6370.0, 0.0, 0.0, 15.0, 0.0, 0.0])
    states = about_the_earth(full_forces, [falls, over, under])
    up = np.isfinite(states_of_each(states, EPOCH, HOURS_S + 3600.0, full_forces)).all(axis=(1, 2))
    assert up.tolist() == [False, True, False]
    sooner = states_of_each(states[:1], EPOCH, HOURS_S, full_forces)[0]
    earth = full_forces.ephemeris.position_km("earth", EPOCH, HOURS_S)
    sun = full_forces.ephemeris.position_km("sun", EPOCH, HOURS_S)
    two_bodies = kepler(falls, HOURS_S, gm)[:, :3]  # Moon and Sun move it by a few km in hours
    assert np.abs(sooner[:, :3] + sun - earth - two_bodies).max() < 30.0
