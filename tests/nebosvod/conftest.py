"""Runs shared by the tests of the program: each mission is run once."""

from collections.abc import Callable
from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.engine.assembly import nominal_view
from nebosvod.mission import Mission, load_mission
from nebosvod.pipeline import run
from nebosvod.results.result import Result
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable, prior_table
from nebosvod.scene.scene import Scene, build_scene

Setting = tuple[Scene, PriorTable, View]
# Apophis before 2029 by two geostationary telescopes, the problem of the source
NEB = """schema_version: 1
name: neb
reference_epoch: 2028-11-15T00:00:00 TDB
object:
  name: (99942) Apophis
  orbit: {kind: cometary, frame: ecliptic_j2000, epoch: 2459215.5 JD TDB, e: 0.1915216893501022, q: 0.7458270478466523 au,
          tp: 2459101.039422462638 JD TDB, node: 204.0389272089208 deg, peri: 126.6520518368553 deg, i: 3.336751320066756 deg}
  radius: {value: 170 m, sigma: 20 m, treatment: estimated}
  mass: {value: 6.1e10 kg, sigma: 1.5e10 kg, treatment: estimated}
  albedo: {value: 0.159, sigma: 0.05, treatment: estimated}
telescopes:
  - name: NEB-1
    orbit: {kind: geostationary, longitude: 0 deg}
    noise: {sigma: 0.1 arcsec}
    bias: {sigma: 0.05 arcsec, treatment: estimated}
    position: {sigma: 3 km, correlation: white, treatment: estimated}
  - {name: NEB-2, like: NEB-1, orbit: {longitude: 180 deg}}
schedule: [{telescopes: all, start: 2028-11-15T00:00:00 TDB, end: 2029-04-08T00:00:00 TDB, cadence: 6 d}]
predictions:
  - {name: where, plane: position, at: 2029-04-06T00:00:00 TDB}
  - {name: enc, plane: b_plane, body: earth, near: 2029-04-13T21:46:00 TDB}
"""  # noqa: E501


def setting_of(mission: Mission) -> Setting:
    """Scene, priors and the nominal point of a mission."""
    scene = build_scene(mission)
    return scene, prior_table(mission, scene.forces, scene.state), nominal_view(scene)


@pytest.fixture(scope="session")
def make_setting() -> Callable[[Mission], Setting]:
    return setting_of


@pytest.fixture(scope="session")
def minimal() -> Mission:
    return load_mission("minimal")


@pytest.fixture(scope="session")
def minimal_setting(minimal: Mission) -> Setting:
    return setting_of(minimal)


@pytest.fixture(scope="session")
def apophis() -> Mission:
    return load_mission("apophis-2029")


@pytest.fixture(scope="session")
def apophis_result(apophis: Mission) -> Result:
    return run(apophis, seed=0)


@pytest.fixture(scope="session")
def minimal_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of `nebosvod run minimal --seed 3`."""
    folder = tmp_path_factory.mktemp("runs") / "minimal"
    assert main(["run", "minimal", "-o", str(folder), "--seed", "3"]) == 0
    return folder


@pytest.fixture(scope="session")
def minimal_text(minimal: Mission) -> str:
    """The text of the smallest mission, to be changed by a test."""
    return minimal.text


@pytest.fixture(scope="session")
def neb_text() -> str:
    """The text of the problem of Guo and Ivashkin 2018, without a prior."""
    return NEB
