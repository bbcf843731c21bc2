"""Orbits on even steps that none leads: closed forms of two bodies, orbits flown alone, who is left to others."""

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.constants import AU_KM
from nebosvod.dynamics.even import EvenSteps
from nebosvod.dynamics.twobody import kepler
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
EPOCH = Epoch.parse("2030-05-01T00:00:00 TDB")
HOURS_S = 3600.0 * np.array([0.5, 2.0, 5.0, 6.0])


def about_the_earth(forces: ForceModel, rows: Array) -> Array:
    """Heliocentric states of states (m, 6) from the Earth's centre."""
    earth, sun = (forces.ephemeris.state_km_km_s(body, EPOCH, 0.0)[0] for body in ("earth", "sun"))
    return np.asarray(rows + earth - sun)


@pytest.fixture(scope="module")
def forces(full_forces: ForceModel) -> ForceModel:
    return ForceModel(ephemeris=full_forces.ephemeris, asteroids=False)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_orbits_from_the_moon_to_neptune_are_those_flown_one_by_one(forces: ForceModel, sign: float) -> None:
    rng = np.random.default_rng(3)
    line = rng.standard_normal((40, 3))
    away = np.exp(rng.uniform(np.log(5e4), np.log(30.0 * AU_KM), 40))
    line *= (away / np.linalg.norm(line, axis=1))[:, None]
    states = about_the_earth(forces, np.hstack([line, 8.0 * rng.standard_normal((40, 3))]))
    t_s = sign * HOURS_S
    found, known = EvenSteps(EPOCH, t_s, forces).fly(states)
    assert known.all()
    for k, state in enumerate(states):
        alone = propagate(state, EPOCH, t_s, forces, False, tolerance=1e-14).state
        assert np.abs(found[k, :, :3] - alone[:, :3]).max() < 1e-11 * max(float(away[k]), AU_KM)
        assert np.abs(found[k, :, 3:] - alone[:, 3:]).max() < 1e-9


def test_who_falls_has_states_as_long_as_two_bodies_say(forces: ForceModel) -> None:
    """Hyperbolas with pericentres below the surface, an hour before it: on the ground some minutes sooner."""
    gm = forces.ephemeris.gm_km3_s2["earth"]
    rows = [kepler([0.0, q, 0.0, np.sqrt(25.0 + 2.0 * gm / q), 0.0, 0.0], [-3600.0], gm)[0] for q in (3e3, 6e3, 2e4)]
    t_s = np.array([1200.0, 3000.0, 3590.0, 4800.0])
    found, known = EvenSteps(EPOCH, t_s, forces).fly(about_the_earth(forces, np.array(rows)))
    assert known.all()
    up = np.isfinite(found[:, :, 0])
    assert up.tolist() == [[True, True, False, False], [True, True, False, False], [True] * 4]
    earth = forces.ephemeris.position_km("earth", EPOCH, t_s) - forces.ephemeris.position_km("sun", EPOCH, t_s)
    for k, row in enumerate(rows):
        two_bodies = kepler(row, t_s, gm)[:, :3]  # Moon and Sun move it by a few km in hours
        assert np.abs(found[k, up[k], :3] - earth[up[k]] - two_bodies[up[k]]).max() < 30.0


def test_who_begins_below_the_ground_is_nowhere_and_who_is_low_at_a_time_is_left_to_others(forces: ForceModel) -> None:
    gm = forces.ephemeris.gm_km3_s2["earth"]
    below = np.array([5000.0, 0.0, 0.0, 0.0, 9.0, 0.0])
    low = np.array([6450.0, 0.0, 0.0, 0.0, np.sqrt(gm / 6450.0), 0.0])
    found, known = EvenSteps(EPOCH, HOURS_S, forces).fly(about_the_earth(forces, np.array([below, low])))
    assert known.tolist() == [True, False]
    assert np.isnan(found).all()
