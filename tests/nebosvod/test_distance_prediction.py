"""The distance of the object from a telescope as a prediction: value and partials by light time solved with numpy."""

import numpy as np
import pytest

from nebosvod.dynamics import propagate
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.engine.evaluation import quantity
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.scene import PlannedScene, build_scene

ASKED = "  - {name: far, plane: distance, from: ahead, at: 2028-04-29T00:00:00 TDB}\n"


@pytest.fixture(scope="module")
def scene(minimal: Mission) -> PlannedScene:
    return build_scene(load_mission_text(minimal.text.replace("predictions:\n", "predictions:\n" + ASKED)))


def distance_km(scene: PlannedScene, state: np.ndarray, t: float) -> float:
    """By repeated substitution of c tau = |r(t - tau) - r_telescope(t)|, with the Sun where it was at emission."""
    orbit = propagate(state, scene.epoch, np.array([0.0, t]), scene.forces, sensitivities=False)
    here = scene.telescopes[0].spacecraft.state_km_km_s(scene.ephemeris, scene.epoch, np.array([t]))[0, :3]
    far = 0.0
    for _ in range(8):
        at = np.array([t - far / SPEED_OF_LIGHT_KM_S])
        sun = scene.ephemeris.position_km("sun", scene.epoch, at)[0]
        far = float(np.linalg.norm(orbit.state_at(at)[0, :3] + sun - here))
    return far


def test_the_distance_is_the_way_of_the_light_and_its_partials_are_difference_quotients(scene: PlannedScene) -> None:
    request = scene.mission.predictions[0]
    found = quantity(scene, scene.trajectory, request)
    t = request.when - scene.epoch
    assert found.value == pytest.approx([distance_km(scene, scene.state, t)], abs=1e-4)
    for column, step in enumerate((1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6)):
        moved = [scene.state + sign * step * np.eye(6)[column] for sign in (-1.0, 1.0)]
        before, after = (distance_km(scene, state, t) for state in moved)
        quotient = (after - before) / (2.0 * step)
        assert found.partials[0, column] == pytest.approx(quotient, rel=1e-5, abs=1e-7 / step), column
