"""Monte Carlo re-estimations a second: one factorisation for all runs against solving each anew, and the whole command.

Both ways draw the same truths and estimate them with the same method in one process; the command runs every estimator
of the mission in two worker processes, from nothing to validation.json.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from nebosvod.engine.assembly import computed_psi, nominal_view
from nebosvod.engine.trial import Setting, generator, measured_truth
from nebosvod.mission import load_mission
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene
from nebosvod.studies.validation import validate


def main() -> None:
    """Print one line for each mission."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("missions", nargs="*", default=["minimal", "apophis-2029", "apophis-heliocentric"])
    parser.add_argument("--runs", type=int, default=1000)
    options = parser.parse_args()
    for name in options.missions:
        print(f"{name}: {measured(name, options.runs)}")


def measured(name: str, runs: int) -> str:
    """Runs a second of both ways, their ratio, and the wall time of the command."""
    mission = load_mission(name)
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    nominal = nominal_view(scene)
    computed = computed_psi(nominal)
    started = time.perf_counter()
    setting = Setting.at(scene, nominal, priors, mission.estimators[:1])
    (estimating,) = setting.estimating
    ready = time.perf_counter() - started
    started = time.perf_counter()
    residuals = np.array([measured_truth(setting, computed, generator(0, i))[0] for i in range(100)])
    drawing = (time.perf_counter() - started) / 100
    started = time.perf_counter()
    means = estimating.means(residuals)
    fast = (time.perf_counter() - started) / 100
    started = time.perf_counter()
    anew = np.array([estimating.solved_anew(one) for one in residuals])
    slow = (time.perf_counter() - started) / 100
    sigma = np.linalg.norm(estimating.reference.S_formal, axis=1)
    difference = np.abs((anew - means) / sigma).max()
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        validate(mission, Path(folder) / "v", runs=runs, workers=2)
        command = time.perf_counter() - started
    return (
        f"{len(computed)} measurements; set-up {1e3 * ready:.0f} ms; a run: truth {1e3 * drawing:.2f} ms, estimate "
        f"{1e3 * fast:.3f} ms against {1e3 * slow:.1f} ms anew; {1.0 / (drawing + fast):.0f} runs/s against "
        f"{1.0 / (drawing + slow):.0f}, ratio {(drawing + slow) / (drawing + fast):.1f} "
        f"(estimate alone {slow / fast:.0f}); largest difference {difference:.1e} sigma; "
        f"validate, {runs} runs of {len(mission.estimators)} estimators, 2 workers: {command:.1f} s"
    )


if __name__ == "__main__":
    main()
