"""Counting behind the table of realism: right where the errors are as assumed, too few inside where they are not."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / 648000.0
DAY_S = 86400.0
EPOCH = Epoch.parse("2010-01-01T00:00:00 TDB")
STATE = np.array([3.9e8, 5e7, 2e7, -2.5, 16.5, 4.0])  # the main belt
NOISE, BIAS = 0.3 * ARCSEC, 0.3 * ARCSEC
STATIONS = np.array(["703", "G96", "F51", "704"])


@pytest.fixture(scope="module")
def realism() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "realism.py"
    spec = importlib.util.spec_from_file_location("realism", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["realism"] = module  # its dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def distances(realism: ModuleType, bias_rad: float, assumed_rad: float, seeds: int = 40) -> list[float]:
    """Made-up arcs of six apparitions, their first three fitted, the others predicted."""
    ephemeris = Ephemeris.load()
    forces = ForceModel(ephemeris=ephemeris)
    found: list[float] = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        t_s = np.sort(np.concatenate([450.0 * k + rng.uniform(0.0, 80.0, 40) for k in range(6)])) * DAY_S
        apparition = realism.apparitions(t_s)
        station = rng.choice(STATIONS, t_s.size)
        observer = ephemeris.state_km_km_s("earth", EPOCH, t_s)
        R = np.tile(NOISE**2 * np.eye(2), (t_s.size, 1, 1))
        empty = Sky.of(EPOCH, t_s, np.zeros((t_s.size, 2)), R, observer, ephemeris)
        truth = compute(propagate(STATE, EPOCH, empty.span_s, forces), empty.exposures).psi
        drawn = {(code, k): bias_rad * rng.standard_normal(2) for code in STATIONS for k in range(6)}
        error = np.array([drawn[key] for key in zip(station.tolist(), apparition.tolist())])
        observed = offset(truth, error + NOISE * rng.standard_normal((t_s.size, 2)))
        sky = Sky.of(EPOCH, t_s, observed, R, observer, ephemeris)
        arc = realism.Arc(sky=sky, station=station, apparition=apparition, state=STATE, forces=forces)
        found += [one.distance for one in realism.predictions(arc, sky, assumed_rad)]
    return found


@pytest.mark.parametrize("bias_rad", [0.0, BIAS])
def test_ellipses_hold_what_they_say_where_the_errors_are_as_assumed(realism: ModuleType, bias_rad: float) -> None:
    """Three predictions from each of forty fits; they hang together, so the bounds are those of forty: 2.6 sigma."""
    shares = realism.shares(distances(realism, bias_rad, bias_rad))
    for share, level in zip(shares, realism.LEVELS):
        assert abs(share - level) < max(2.6 * np.sqrt(level * (1.0 - level) / 40.0), 0.05)


def test_ellipses_that_ignore_the_biases_hold_too_little(realism: ModuleType) -> None:
    half, ninety, most = realism.shares(distances(realism, BIAS, 0.0))
    assert half < 0.25
    assert ninety < 0.6
    assert most < 0.85


def test_a_gap_of_sixty_days_begins_an_apparition(realism: ModuleType) -> None:
    days = np.array([0.0, 10.0, 69.0, 130.0, 131.0, 400.0])
    assert realism.apparitions(days * DAY_S).tolist() == [0, 0, 0, 1, 1, 2]


def test_a_constant_bias_of_all_stations_is_its_share_of_the_mean(realism: ModuleType) -> None:
    """Stations of equal numbers: the mean of their biases has sigma bias / sqrt(stations)."""
    n = 80
    rng = np.random.default_rng(3)
    t_s = np.sort(rng.uniform(0.0, 50.0, n)) * DAY_S
    ephemeris = Ephemeris.load()
    forces = ForceModel(ephemeris=ephemeris)
    R = np.tile(NOISE**2 * np.eye(2), (n, 1, 1))
    sky = Sky.of(EPOCH, t_s, np.zeros((n, 2)), R, ephemeris.state_km_km_s("earth", EPOCH, t_s), ephemeris)
    seen = compute(propagate(STATE, EPOCH, sky.span_s, forces), sky.exposures)
    arc = realism.Arc(
        sky=sky, station=np.tile(STATIONS, 20), apparition=np.zeros(n, dtype=int), state=STATE, forces=forces
    )
    one = realism.against(arc, sky, seen, np.zeros((6, 6)), np.arange(n), BIAS, 0.0)
    np.testing.assert_allclose(one.covariance, (NOISE**2 / n + BIAS**2 / 4) * np.eye(2), rtol=1e-12, atol=1e-24)
