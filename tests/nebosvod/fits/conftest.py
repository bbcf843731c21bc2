"""A made-up sky: two stations, an orbit near the Earth, noise of 0.2 arcsec."""

from types import SimpleNamespace

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.observation import GroundSite, Telescope, observe
from nebosvod.observation.measurement.astrometry import merge
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.timescale import Epoch

ARCSEC = np.pi / 648000.0
STATE = np.array([1.5e8, 3e7, 1e7, -5.0, 28.0, 3.0])
EPOCH = Epoch.parse("2023-03-01T00:00:00 TDB")


@pytest.fixture(scope="session")
def ephemeris():
    return Ephemeris.load()


@pytest.fixture(scope="session")
def made_sky(ephemeris):
    """A function that makes the sky of an orbit: n observations over `days`, noise `sigma_arcsec`."""

    def make(n=120, days=60.0, sigma_arcsec=0.2, seed=1, forces=None, state=STATE):
        rng = np.random.default_rng(seed)
        forces = forces or ForceModel(ephemeris=ephemeris)
        t_s = np.sort(rng.uniform(-days / 2, days / 2, n)) * 86400.0
        trajectory = propagate(state, EPOCH, t_s, forces)
        sites = [GroundSite.from_parallax(1.0, 0.8, 0.55), GroundSite.from_parallax(-2.0, 0.9, -0.4)]
        seen = merge(
            [
                observe(trajectory, Telescope(name=f"T{k}", spacecraft=site, sigma_rad=1e-6), t_s[k::2], ephemeris)
                for k, site in enumerate(sites)
            ]
        )
        sigma = sigma_arcsec * ARCSEC
        R = np.tile(sigma**2 * np.eye(2), (n, 1, 1))
        observed = offset(seen.psi, sigma * rng.standard_normal((n, 2)))
        sky = Sky.of(EPOCH, seen.t_s, observed, R, seen.telescope_state, ephemeris)
        return SimpleNamespace(sky=sky, seen=seen, forces=forces, trajectory=trajectory, state=state, sigma=sigma)

    return make
