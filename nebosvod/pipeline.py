"""The main job: mission -> scene -> simulated measurements -> estimates -> predictions -> result."""

import platform
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod import __version__
from nebosvod.engine.assembly import View, computed_psi, linear_problem, nominal_point, view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.montecarlo import Sample, consistency, consistency_block, repeat_all
from nebosvod.engine.truth import draw
from nebosvod.estimation import Status
from nebosvod.findings.assessment import assess
from nebosvod.findings.distance import unknown_distance
from nebosvod.findings.foretold import foretell
from nebosvod.mission import Mission
from nebosvod.mission.reading.reader import require_mission
from nebosvod.results.result import Result
from nebosvod.results.run_summary import summarise
from nebosvod.results.run_tables import all_arrays, all_tables
from nebosvod.scene.prior import PriorTable, prior_table
from nebosvod.scene.scene import Scene, build_scene

Array = npt.NDArray[np.float64]
LIBRARIES = ("numpy", "scipy", "astropy", "jplephem", "numba", "pyerfa", "matplotlib")


def run(mission: Mission, seed: int = 0, progress: Callable[[str], None] | None = None) -> Result:
    """Run a mission: simulate its measurements, estimate, predict, and say which source is to blame for how much.

    Parameters
    ----------
    seed : of the simulated truth and noise; the same seed gives the same result.
    progress : called with one line of text at each stage.

    Raises
    ------
    InputError, CoverageError, DataError, GeometryError, EventError
        As the stages raise them; a lack of convergence or observability is a status of the result.
    """
    require_mission(mission, "run")
    say = progress or (lambda message: None)
    started = time.time()
    say("reading the ephemeris, propagating the reference orbit")
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    say("simulating the measurements")
    truth = draw(scene, priors, np.random.default_rng(np.random.SeedSequence(seed)))
    nominal = view(scene, nominal_point(scene))
    fits = []
    for estimator in mission.estimators:
        say(f"estimating: {estimator.name}")
        fits.append(judged(scene, fit(scene, estimator, nominal, truth.psi, priors)))
    say("predicting")
    foretold = {one.estimator.name: foretell(scene, one) for one in fits}
    samples = _samples(scene, nominal, priors, fits, seed, say)
    say("taking the accuracy apart")
    base = linear_problem(scene, mission.estimators[0], nominal, computed_psi(nominal), priors, about=nominal.point)
    findings = assess(scene, fits, foretold, samples, seed, (base, nominal))
    trials = [{"estimator": name, **consistency(sample)} for name, sample in samples.items()]
    return Result(
        summary=summarise(scene, priors, fits, findings) | consistency_block(trials),
        manifest=manifest(scene, seed, started, fits),
        arrays=all_arrays(scene, nominal, fits, truth.psi) | findings.arrays,
        tables=all_tables(scene, nominal, fits, truth.psi, findings),
    )


def judged(scene: Scene, found: Fit) -> Fit:
    """The fit, called not observable where its sigmas say that nobody knows how far the object is."""
    far = unknown_distance(scene, found)
    if not far or found.status is Status.NOT_OBSERVABLE:
        return found
    words = f"{Status.NOT_OBSERVABLE.sentence} They do not tell how far the object is: {far}."
    return replace(found, status=Status.NOT_OBSERVABLE, message=words)


def manifest(scene: Scene, seed: int, started: float, fits: list[Fit]) -> dict[str, Any]:
    """Where a result came from; only `times` differ between two runs with one seed."""
    mission = scene.mission
    first, last = scene.ephemeris.span
    return {
        "schema_version": 1,
        "versions": {
            "nebosvod": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        "mission": {"name": mission.name, "sha256": mission.sha256, "text": mission.text},
        "ephemeris": {
            "source": scene.ephemeris.source,
            "sha256": dict(scene.ephemeris.sha256),
            "span": f"{first.iso(digits=0)} to {last.iso(digits=0)}",
        },
        "seed": seed,
        "status": {one.estimator.name: str(one.status) for one in fits},
        "leap_seconds": "erfa's table; TAI - UTC stays at its last value, 37 s, after it; UT1 = UTC",
        "times": {
            "started_utc": datetime.fromtimestamp(started, UTC).isoformat(timespec="seconds"),
            "elapsed_s": round(time.time() - started, 3),
        },
    }


def _samples(
    scene: Scene, nominal: View, priors: PriorTable, fits: list[Fit], seed: int, say: Callable[[str], None]
) -> dict[str, Sample]:
    """Errors of repeated estimation by estimator, as many runs as the mission asks for; empty if it asks for none."""
    plan = scene.mission.monte_carlo
    if plan is None:
        return {}
    estimators = [one.estimator for one in fits if one.estimate.solution is not None]
    found = repeat_all(scene, estimators, nominal, priors, plan.runs, seed, say)
    return {estimator.name: sample for estimator, sample in zip(estimators, found)}
