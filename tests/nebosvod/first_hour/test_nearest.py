"""How near the Earth orbits come by the Sun alone: against two-body states of every four hours."""

import sys
from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.twobody import kepler
from nebosvod.first_hour.nearest import nearest_by_the_sun
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.exposures import Exposures

sys.path.insert(0, str(Path(__file__).resolve().parent))
from kinds import AU, EPOCH, SITE  # type: ignore[import-not-found]


def test_the_least_distance_is_that_of_two_body_states() -> None:
    """Ellipses of some months, whose revolutions are taken off, an orbit like the Earth's, and a hyperbola."""
    ephemeris, within_d = Ephemeris.load(), 150.0
    site = Telescope(name="F51", spacecraft=SITE, sigma_rad=1e-6)
    exposures = Exposures.of(EPOCH, [(site, np.array([0.0, 60.0]))], ephemeris)
    tracklet = Tracklet.of(
        "made up", exposures, np.zeros((2, 2)), ForceModel(ephemeris=ephemeris), Columns.none(2), None
    )
    t_s = np.append(np.arange(0.0, within_d * 86400.0, 14400.0), within_d * 86400.0)
    earth, sun = (ephemeris.state_km_km_s(body, tracklet.epoch, t_s) for body in ("earth", "sun"))
    rng = np.random.default_rng(2)
    moved = np.hstack([0.02 * AU * rng.standard_normal((6, 3)), 4.0 * rng.standard_normal((6, 3))])
    states = (earth - sun)[0] + moved
    states[0, 3:] *= 0.5
    states[1, 3:] *= 2.0
    states[2] = (earth - sun)[0] + np.array([2e6, 0.0, 0.0, 0.0, 0.0, 0.01])
    gm = ephemeris.gm_km3_s2["sun"]
    for state, found in zip(states, nearest_by_the_sun(tracklet, states, within_d), strict=True):
        away = np.asarray(kepler(state, t_s, gm)) - (earth - sun)
        at = np.linalg.norm(away[:, :3], axis=1)
        k = int(at.argmin())
        r, v = away[k, :3], away[k, 3:]
        step = np.clip(-(r @ v) / (v @ v), -14400.0, 14400.0)
        assert found == pytest.approx(np.linalg.norm(r + step * v), rel=3e-3, abs=500.0)
