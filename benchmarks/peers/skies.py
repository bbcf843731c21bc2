"""Made-up observations of the orbits of cases.py, and starts for fitting them."""

import numpy as np
from peers.cases import EPOCH, Array

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.constants import AU_KM
from nebosvod.observation import GroundSite, Telescope, observe
from nebosvod.observation.measurement.astrometry import merge
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.timescale import SECONDS_PER_DAY

SIGMA_RAD = np.radians(0.2 / 3600.0)
OFF_AU = 1e-4


def sky_of(state: Array, forces: ForceModel, n: int, days: float, rng: np.random.Generator) -> Sky:
    """n directions with noise of 0.2 arcsec over `days` about EPOCH, from two places on the ground by turns."""
    t_s = np.sort(rng.uniform(-days / 2.0, days / 2.0, n)) * SECONDS_PER_DAY
    trajectory = propagate(state, EPOCH, t_s, forces)
    places = [GroundSite.from_parallax(1.0, 0.8, 0.55), GroundSite.from_parallax(-2.0, 0.9, -0.4)]
    seen = merge(
        [
            observe(trajectory, Telescope(name=f"T{k}", spacecraft=place, sigma_rad=1e-6), t_s[k::2], forces.ephemeris)
            for k, place in enumerate(places)
        ]
    )
    R = np.tile(SIGMA_RAD**2 * np.eye(2), (n, 1, 1))
    observed = offset(seen.psi, SIGMA_RAD * rng.standard_normal((n, 2)))
    return Sky.of(EPOCH, seen.t_s, observed, R, seen.telescope_state, forces.ephemeris)


def off(state: Array, rng: np.random.Generator) -> Array:
    """The state moved by 1e-4 au in a random direction, and by as large a part of its velocity."""
    direction = rng.standard_normal((2, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    speed, distance = np.linalg.norm(state[3:]), np.linalg.norm(state[:3])
    moved: Array = state + OFF_AU * np.concatenate([AU_KM * direction[0], AU_KM / distance * speed * direction[1]])
    return moved
