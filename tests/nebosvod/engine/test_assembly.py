"""Assembly: what reaches the estimators, and that a million epochs fit into memory."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nebosvod.engine.assembly import nominal_view, nuisance_treatment
from nebosvod.mission import Mission, load_mission_text
from nebosvod.observation import merge, observe
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

Setting = tuple[Scene, PriorTable, View]
ROOT = Path(__file__).resolve().parents[3]


def test_rows_are_those_of_the_telescopes_joined_by_time(minimal_setting: Setting) -> None:
    scene, _, nominal = minimal_setting
    at = scene.exposures
    seen = [(t, at.t_s[at.telescope_index == number]) for number, t in enumerate(at.telescopes)]
    each = [observe(scene.trajectory, telescope, t_s, scene.ephemeris) for telescope, t_s in seen]
    joined = merge(each)
    for name in ("t_s", "telescope_index", "psi", "H_x0", "H_c", "noise", "Phi_emission"):
        one, other = getattr(joined, name), getattr(nominal.observation, name)
        # To rounding: vectors may begin elsewhere in the rows of one telescope than in those of all
        assert np.abs(one - other).max() <= 1e-15 * np.abs(one).max(), name


def test_a_view_that_does_not_simulate_differs_in_nothing_an_estimator_sees(minimal_setting: Setting) -> None:
    scene, _, nominal = minimal_setting
    light = nominal_view(scene, simulates=False)
    assert light.observation.Phi_emission.shape[0] == 0
    for name in ("psi", "H_x0", "H_c", "H_z", "rate", "noise"):
        assert np.array_equal(getattr(light.observation, name), getattr(nominal.observation, name)), name


TREATMENTS = """
shared: [{name: catalogue, bias: {sigma: 0.02 arcsec, treatment: considered}}]
estimators:
  - {name: plain, method: batch_qr}
  - {name: group, method: batch_qr, treatment: {bias: ignored, position: fixed}}
  - {name: one, method: batch_qr, treatment: {bias: ignored, bias ahead: considered, catalogue: fixed}}
  - {name: by its name, method: batch_qr, treatment: {telescope position ahead: considered}}
"""


def test_overrides_reach_every_source_by_group_by_telescope_and_by_name(
    minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    scene = make_setting(load_mission_text(minimal.text + TREATMENTS))[0]
    said = {
        estimator.name: [nuisance_treatment(scene, estimator, nuisance.name) for nuisance in scene.nuisances]
        for estimator in scene.mission.estimators
    }
    names = ["bias ahead", "telescope position ahead", "bias behind", "telescope position behind", "catalogue"]
    assert [nuisance.name for nuisance in scene.nuisances] == names
    assert said["plain"] == ["estimated", "estimated", "estimated", "estimated", "considered"]
    assert said["group"] == ["ignored", "fixed", "ignored", "fixed", "ignored"]
    assert said["one"] == ["considered", "estimated", "ignored", "estimated", "fixed"]
    assert said["by its name"] == ["estimated", "considered", "estimated", "estimated", "considered"]


MILLION = """
import resource
from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.estimation.solvers import batch
from nebosvod.mission import load_mission, load_mission_text
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene

text = load_mission("apophis-2029").text.replace("cadence: 12 h", "cadence: 24.88325 s")
mission = load_mission_text(text.replace("limiting_magnitude: 22", "limiting_magnitude: 40"))
scene = build_scene(mission)
priors = prior_table(mission, scene.forces, scene.state)
seen = nominal_view(scene, simulates=False)
problem = linear_problem(scene, mission.estimators[0], seen, computed_psi(seen), priors, about=seen.point)
estimate = batch.solve(problem, way="qr")
print(seen.observation.t_s.size, str(estimate.status), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


@pytest.mark.long
def test_a_million_epochs_of_two_telescopes_assemble_and_solve_in_a_gigabyte_and_a_half() -> None:
    """Two geostationary telescopes with white position errors, biases (4) and radius, mass, albedo (3)."""
    done = subprocess.run([sys.executable, "-c", MILLION], capture_output=True, text=True, check=True, cwd=ROOT)
    count, status, peak = done.stdout.split()
    assert int(count) > 950_000
    assert status == "converged"
    assert int(peak) < 1.5e9  # bytes
