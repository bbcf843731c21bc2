"""Runs shared by the tests of the program: each mission is run once."""

from collections.abc import Callable
from pathlib import Path

import pytest

from nebosvod.assembly import View, nominal_point, view
from nebosvod.cli import main
from nebosvod.mission import Mission, load_mission
from nebosvod.pipeline import run
from nebosvod.prior import PriorTable, prior_table
from nebosvod.result import Result
from nebosvod.scene import Scene, build_scene

Setting = tuple[Scene, PriorTable, View]


def setting_of(mission: Mission) -> Setting:
    """Scene, priors and the nominal point of a mission."""
    scene = build_scene(mission)
    return scene, prior_table(mission, scene.forces, scene.state), view(scene, nominal_point(scene))


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
