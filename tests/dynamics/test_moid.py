"""The smallest distance of two orbits: against JPL's and ESA's numbers, a grid, and its sigma by other means."""

import json
from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, propagate
from nebosvod.dynamics.moid import Conic, conic, earth_conic, earth_moid_km, moid_km
from nebosvod.orbits.reading import read_orbit_file
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")


def read(path: Path) -> UncertainOrbit:
    orbit = read_orbit_file(path)
    assert orbit is not None
    return orbit


@needs_data
@pytest.mark.parametrize(
    "name", ["101955", "162173", "2015AB", "2022OB5", "2023DZ2", "2024YR4", "433", "65803", "99942"]
)
@pytest.mark.parametrize("kind", ["ke0", "ke1"])
def test_it_is_what_esa_prints(name: str, kind: str) -> None:
    path = DATA / "neocc" / f"{name}.{kind}"
    (line,) = (line for line in path.read_text().splitlines() if "! MOID" in line)
    orbit, bodies = read(path), Ephemeris.load()
    found, _ = earth_moid_km(orbit.state, orbit.factor[:6], bodies, orbit.epoch)
    assert found / AU_KM == pytest.approx(float(line.split()[2]), abs=1e-8)


@needs_data
@pytest.mark.parametrize("name", ["101955", "2022AP7", "2024YR4", "25143", "99942"])
def test_it_is_what_jpl_prints_at_the_epoch_of_the_elements(name: str) -> None:
    path, bodies = DATA / "sbdb" / f"{name}_phys.json", Ephemeris.load()
    orbit, said = read(path), json.loads(path.read_text())["orbit"]
    at = Epoch.parse(f"{said['epoch']} JD TDB")
    along = propagate(orbit.state, orbit.epoch, [at - orbit.epoch], orbit.forces(bodies), sensitivities=False)
    found, _ = earth_moid_km(along.state[0], orbit.factor[:6], bodies, at)
    assert found / AU_KM == pytest.approx(float(said["moid"]), rel=6e-6)  # six digits are printed


def test_it_is_the_smallest_distance_of_a_dense_grid() -> None:
    rng, bodies = np.random.default_rng(2), Ephemeris.load()
    earth = earth_conic(bodies, Epoch.parse("2024-01-01 TDB"))
    grid = np.linspace(-np.pi, np.pi, 1201)
    there = earth.at(grid)
    for _ in range(12):
        first = rng.normal(size=3)
        first /= np.linalg.norm(first)
        second = np.cross(rng.normal(size=3), first)
        e = rng.uniform(0.0, 0.95)
        orbit = Conic(p_km=rng.uniform(0.3, 1.9) * AU_KM, e=e, axes=np.stack([first, second / np.linalg.norm(second)]))
        points = orbit.at(grid)
        gap = min(float(np.linalg.norm(there - point, axis=1).min()) for point in points)
        found, _ = moid_km(orbit, earth)
        spacing = 2.0 * np.pi / 1200.0 * 2.5 * AU_KM / (1.0 - e)
        assert found <= gap + 1.0
        assert gap - found < 2.0 * spacing


def test_the_sigma_is_the_scatter_of_drawn_orbits() -> None:
    bodies, at = Ephemeris.load(), Epoch.parse("2024-01-01 TDB")
    state = np.array([1.6e8, 2.0e7, 1.0e7, -4.0, 29.0, 12.0])
    lower = np.tril(np.random.default_rng(8).normal(size=(6, 6)))
    factor = np.array([30.0, 30.0, 30.0, 1e-5, 1e-5, 1e-5])[:, None] * lower
    nominal, sigma = earth_moid_km(state, factor, bodies, at)
    earth, gm = earth_conic(bodies, at), bodies.gm_km3_s2["sun"]
    rng = np.random.default_rng(1)
    drawn = [moid_km(conic(state + factor @ rng.standard_normal(6), gm), earth)[0] for _ in range(300)]
    assert np.std(drawn) == pytest.approx(sigma, rel=0.15)
    assert np.mean(drawn) == pytest.approx(nominal, abs=0.3 * sigma)


def test_a_hyperbola_has_one_too() -> None:
    bodies, at = Ephemeris.load(), Epoch.parse("2024-01-01 TDB")
    state = np.array([2.0e8, 0.0, 1.0e7, -20.0, 50.0, 5.0])
    found, sigma = earth_moid_km(state, np.diag([1.0] * 3 + [1e-6] * 3), bodies, at)
    assert 0.0 < found < 3.0 * AU_KM
    assert sigma > 0.0


def test_an_orbit_that_is_nowhere_near_is_nearest_at_its_perihelion(ephemeris: Ephemeris) -> None:
    """2,000 au away at 1,000 km/s, which three records may come to; the Earth's orbit is 1 au wide."""
    epoch = Epoch.parse("2024-02-15T00:00:00 TDB")
    state = np.array([2000.0 * AU_KM, 0.0, 0.0, 0.0, 1000.0, 0.0])
    least, sigma = earth_moid_km(state, np.zeros((6, 1)), ephemeris, epoch)
    assert least == pytest.approx(2000.0 * AU_KM, rel=1e-3)
    assert sigma == 0.0
