"""The main job: mission -> scene -> measurements, drawn or recorded -> estimates -> predictions -> result."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.montecarlo import Sample, repeat_all, state_nees
from nebosvod.engine.truth import draw, undrawn
from nebosvod.errors import InputError, NebosvodError, noting
from nebosvod.estimation import Status
from nebosvod.findings.assessment import assess
from nebosvod.findings.distance import unknown_distance
from nebosvod.findings.foretold import foretell
from nebosvod.fits.answer import Answer, answer
from nebosvod.fits.engine import fit_object
from nebosvod.mission import FitMission, Mission
from nebosvod.mission.fields import line_of_text
from nebosvod.mission.fit import FitPlan
from nebosvod.mission.reading.places import asking
from nebosvod.mission.reading.reader import require_mission
from nebosvod.mission.slugs import slug
from nebosvod.observation.formats.records import Astrometry
from nebosvod.results import fit_summary, fit_tables, run_summary, run_tables
from nebosvod.results.fit_export import exports
from nebosvod.results.manifest import manifest
from nebosvod.results.ownership import sha256_of
from nebosvod.results.result import Result
from nebosvod.scene.material import gather, one_object
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable, prior_table
from nebosvod.scene.scene import PlannedScene, build_scene

Array = npt.NDArray[np.float64]
Say = Callable[[str], None]
SPLIT_HINT = (
    "name it with --object, or fit each by itself with --split; "
    "where they are one object, give --object once for each of its names"
)


def run(
    mission: Mission, seed: int = 0, progress: Callable[[str], None] | None = None, *, nominal: bool = False
) -> Result:
    """Run a mission: simulate its measurements, estimate, predict, and say which source is to blame for how much.

    Parameters
    ----------
    seed : of the simulated truth and noise; the same seed gives the same result.
    nominal : whether no error is drawn: the accuracy is then that about the reference orbit itself, and two missions
        differ by what was changed in them alone.
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
    seen = nominal_view(scene)
    if nominal:
        truth = undrawn(seen, priors)
    else:
        truth = draw(scene, priors, np.random.default_rng(np.random.SeedSequence(seed)), seen.point)
    fits = []
    for estimator in mission.estimators:
        say(f"estimating: {estimator.name}")
        fits.append(judged(scene, fit(scene, estimator, seen, truth.psi, truth.priors)))
    say("predicting")
    foretold = {one.estimator.name: foretell(scene, one) for one in fits}
    samples = _samples(scene, seen, priors, fits, seed, say)
    say("taking the accuracy apart")
    base = linear_problem(scene, mission.estimators[0], seen, computed_psi(seen), priors, about=seen.point)
    findings = assess(scene, fits, foretold, samples, seed, (base, seen))
    trials = {name: state_nees(sample) for name, sample in samples.items()}
    return Result(
        summary=run_summary.summarise(scene, priors, fits, findings, trials, drawn=not nominal),
        manifest=manifest(scene, seed, started, fits) | ({"drawn": False} if nominal else {}),
        arrays=run_tables.all_arrays(scene, seen, fits, truth.psi) | dict(findings.arrays),
        tables=run_tables.all_tables(scene, seen, fits, truth.psi, findings),
    )


def judged(scene: PlannedScene, found: Fit) -> Fit:
    """The fit, called not observable where its sigmas say that nobody knows how far the object is."""
    far = unknown_distance(scene, found)
    if not far or found.status is Status.NOT_OBSERVABLE:
        return found
    words = f"{Status.NOT_OBSERVABLE.sentence} They do not tell how far the object is: {far}."
    return replace(found, status=Status.NOT_OBSERVABLE, message=words)


def _samples(
    scene: PlannedScene, nominal: View, priors: PriorTable, fits: list[Fit], seed: int, say: Callable[[str], None]
) -> dict[str, Sample]:
    """Errors of repeated estimation by estimator, as many runs as the mission asks for; empty if it asks for none."""
    plan = scene.mission.monte_carlo
    if plan is None:
        return {}
    estimators = [one.estimator for one in fits if one.estimate.solution is not None]
    found = repeat_all(scene, estimators, nominal, priors, plan.runs, seed, say)
    return {estimator.name: sample for estimator, sample in zip(estimators, found)}


def named(designations: Sequence[str]) -> tuple[str, ...]:
    """Designations as somebody typed them, without blanks around them.

    Raises
    ------
    InputError
        If one is empty, long, or cannot be shown.
    """
    try:
        return tuple(line_of_text(word) for word in designations)
    except InputError as error:
        raise InputError(f"--object: {error}; name a designation as the records have it") from None


def mission_of(files: Sequence[str], designations: Sequence[str] = ()) -> FitMission:
    """The fit of plain files: everything else as by default.

    Raises
    ------
    InputError
        If there is no file.
    """
    designations = named(designations)
    if not files:
        raise InputError("no observations: name their files, or one settings file (.yaml) with a fit block")
    stem = slug(Path(files[0]).name.partition(".")[0], "observations")
    if not all(str(file) for file in files):
        raise InputError('"": no such file (got an empty name); name a file of observations')
    # names of the system, which may be longer than the lines of a settings file
    chosen = {"observations": tuple(str(file) for file in files)}
    plan = FitPlan(observations=("-",)).model_copy(
        update=chosen | ({"designation": tuple(designations)} if designations else {})
    )
    return FitMission(schema_version=1, name=designations[0] if designations else stem, fit=plan)


def objects(mission: FitMission, split: bool) -> Iterator[Astrometry]:
    """The records of each object to fit: the one named, the only one, or with `split` every one.

    Raises
    ------
    InputError
        If there are several and none is chosen.
    """
    records = gather(mission)
    designations = mission.fit.designation
    if split and not designations:
        for name in records.objects:
            yield records.of(name)
        return
    place = asking(mission, "fit", "designation") if mission.was_read else nullcontext()
    with noting(records.notices), place:
        mine = one_object(records, designations, SPLIT_HINT)
    yield mine


def fitted(
    mission: FitMission, records: Astrometry, ephemeris: Ephemeris, say: Say, *, export: bool = False
) -> tuple[Result, Answer]:
    """Fit one object and make its result; with `export`, the orbit for other programs too."""
    started = time.time()
    with noting(records.notices):
        fit = fit_object(records, mission, ephemeris, say)
    with noting(fit.material.notices):
        found = answer(fit)
    result = Result(
        summary=fit_summary.summarise(found),
        manifest=_fit_manifest(mission, found, started),
        arrays=fit_tables.all_arrays(found),
        tables=fit_tables.all_tables(found),
        files=exports(found) if export else {},
    )
    return result, found


def every(
    mission: FitMission, ephemeris: Ephemeris, say: Say, *, export: bool = False
) -> Iterator[tuple[str, Result | NebosvodError]]:
    """Fit every object of the files, one after the other; trouble with one does not stop the others."""
    parts = list(objects(mission, split=True))
    for number, records in enumerate(parts, start=1):
        name = records.objects[0]
        say(f"{number} of {len(parts)}: {name}")
        try:
            yield name, fitted(mission, records, ephemeris, lambda message: None, export=export)[0]
        except NebosvodError as error:
            yield name, error


def _fit_manifest(mission: FitMission, found: Answer, started: float) -> dict[str, Any]:
    """Where the result came from, with the sha256 of every file read."""
    general = found.fit.general
    paths = [Path(name) for name in mission.fit.observations]
    if mission.path is not None:
        paths = [path for path in mission.input_files if path.is_file()]
    return manifest(general.scene, 0, started, [general.fit]) | {
        "inputs_sha256": {str(path): sha256_of(path) for path in paths},
        "status": {"fit": str(found.fit.verdict.status)},
    }
