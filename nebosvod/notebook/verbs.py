"""A function for each command, with its options and defaults; a quantity or a moment of astropy may stand for its text.

They print nothing and, unless an `output` is named, write nothing; `study` and `validate` keep what they compute in a
folder, as their commands do, since they can be continued. What a command ends with exit code 1 for is `answer.failed`;
what it refuses raises `nebosvod.errors.InputError`, which names the parameter.
"""

import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from nebosvod import pipeline
from nebosvod.commands import alert_made, alert_work, fit_work, orbit_work, plan_decide
from nebosvod.commands.orbit_work import Coordinates
from nebosvod.commands.plan import planned
from nebosvod.commands.workers import workers_from
from nebosvod.errors import InputError, NebosvodError
from nebosvod.mission import FitMission, Mission
from nebosvod.mission.slugs import slug
from nebosvod.notebook.answer import Alert, Approaches, Fit, FolderAnswer, Result, Risk, Sky, answer_of
from nebosvod.notebook.campaigns import Comparison, Decision, Kept, Plan, Study, Validation
from nebosvod.notebook.given import (
    Orbit,
    Say,
    joined,
    kept_in,
    mission_of,
    opened,
    path_of,
    paths_of,
    quiet,
    seed_of,
    several,
    spoken,
    text_of,
)
from nebosvod.report.study_page import make_study_page
from nebosvod.report.validation_page import write_validation_report
from nebosvod.results.alert_folder import alert_result
from nebosvod.results.compare import compare as compare_runs
from nebosvod.results.compare_orbits import compare_orbits, kind_of_folders
from nebosvod.scene.scene import load_ephemeris
from nebosvod.studies.comparison import all_studies, compare_studies
from nebosvod.studies.question import Study as StudyQuestion
from nebosvod.studies.reading import load_study
from nebosvod.studies.study import run_study
from nebosvod.studies.validation import validate as run_validation


@spoken
def run(
    mission: Mission | str | Path,
    seed: int = 0,
    progress: Say | None = None,
    *,
    nominal: bool = False,
    output: str | Path | None = None,
    overwrite: bool = False,
) -> Result:
    """Run a mission: simulate its measurements, estimate, predict, and say which source is to blame for how much.

    Parameters
    ----------
    mission : a mission, its file, or the name of a built-in one.
    seed : of the simulated truth and noise; the same seed gives the same result.
    progress : called with one line of text at each stage.
    nominal : draw no error: the accuracy about the reference orbit itself.
    output : also write the run to this folder; overwrite : replace an earlier run there.

    Raises
    ------
    InputError, CoverageError, DataError, GeometryError, EventError
        As the stages raise them; a lack of convergence or observability is a status of the result.

    Examples
    --------
    >>> import nebosvod
    >>> result = nebosvod.run("minimal")
    >>> result.typed.estimates[0]
    <OrbitEstimate batch: converged, position to 16.89 km>
    """
    found = Result(pipeline.run(mission_of(mission), seed=seed_of(seed), progress=progress, nominal=nominal))
    return kept_in(found, output, overwrite)


@spoken
def fit(
    files: str | Path | FitMission | Sequence[str | Path],
    designations: str | Sequence[str] = (),
    since: Any = None,
    until: Any = None,
    *,
    export: bool = False,
    output: str | Path | None = None,
    overwrite: bool = False,
    progress: Say | None = None,
) -> Fit | Alert:
    """Fit an orbit to real astrometry.

    Parameters
    ----------
    files : of observations (ADES or MPC 80-column), or one settings file with a fit block.
    designations : of the one object to fit, where files hold several; several names are joined.
    since, until : leave out observations before, and at and after these moments (text is UTC).
    export : make the orbit for other programs too, as files of the saved folder.
    output : also write the answer to this folder; overwrite : replace an earlier one there.
    progress : called with one line of text at each stage.

    Returns
    -------
    Fit
        Or `Alert` where the observations are too few for any orbit: what is known in their first hour.

    Raises
    ------
    InputError
        If there are several objects and none is chosen, or something cannot be read.
    GeometryError, EventError
        If there is no orbit, and the first hour has no answer either.
    """
    started, say = time.time(), progress or quiet
    mission = files if isinstance(files, FitMission) else _to_fit(files, designations, since, until)
    (records,) = pipeline.objects(mission, split=False)
    made = fit_work.answered(records, mission, load_ephemeris(mission), say, export=export, started=started)
    found = answer_of(made.result)
    return kept_in(found if isinstance(found, Alert) else Fit(made.result), output, overwrite)


@spoken
def fit_every(
    files: str | Path | Sequence[str | Path],
    since: Any = None,
    until: Any = None,
    *,
    export: bool = False,
) -> dict[str, Fit | NebosvodError]:
    """Fit every object of some files by itself, as `nebosvod fit --split`; trouble with one does not stop the others.

    Parameters
    ----------
    files, since, until, export : as of `fit`.

    Returns
    -------
    dict
        The fit of each object by its name, or the error that there was.
    """
    mission = _to_fit(files, (), since, until)
    found = pipeline.every(mission, load_ephemeris(mission), quiet, export=export)
    return {name: one if isinstance(one, NebosvodError) else Fit(one) for name, one in found}


def _to_fit(files: Any, designations: str | Sequence[str], since: Any, until: Any) -> FitMission:
    """The fit that the parameters say."""
    named = paths_of(files)
    return fit_work.resolved(named, several(designations), text_of(since), text_of(until))


@spoken
def validate(
    mission: Mission | str | Path,
    runs: int = 2000,
    *,
    output: str | Path | None = None,
    workers: int | None = None,
    scheduler: str = "",
    cluster: Literal["slurm"] | None = None,
    seed: int = 0,
    full: bool = False,
    overwrite: bool = False,
    progress: Callable[[int, int], None] = lambda done, runs: None,
) -> Validation:
    """Simulate a mission many times: do the errors look as the sigmas say?

    Parameters
    ----------
    mission : a mission, its file, or the name of a built-in one.
    runs : simulated truths; more add to those that the folder has.
    output : folder that keeps the campaign; `./NAME-validation` by default.
    workers : processes, or jobs of a cluster; one for each processor by default.
    scheduler, cluster : a dask scheduler that runs, "tcp://HOST:8786"; or "slurm", to start workers as its jobs.
    seed : of the simulated truths; full : iterate every estimate: slower, tests linearity.
    overwrite : replace another campaign in the folder.
    progress : called with the runs that are done and all runs.

    Raises
    ------
    InputError, GeometryError, OutputError
        If there are too few runs, nothing can be observed, or the folder holds another campaign.
    """
    loaded = mission_of(mission)
    folder = Path(output) if output is not None else Path(f"{loaded.slug}-validation")
    found = run_validation(
        loaded, folder, runs=runs, seed=seed_of(seed), workers=workers_from(workers, scheduler, cluster), full=full,
        overwrite=overwrite, progress=progress,
    )  # fmt: skip
    write_validation_report(folder, found)
    return Validation(found, folder)


@spoken
def plan(
    mission: Any,
    prediction: str | None = None,
    visits: int = 5,
    *,
    estimator: str | None = None,
    criterion: str = "a",
    start: Any = None,
    end: Any = None,
    step: Any = None,
    exposures: int = 1,
    spacing: Any = None,
    visit_time: str | Sequence[str] = (),
    decide: bool = False,
    until: Any = None,
    bodies: str | Sequence[str] = "earth,moon",
    telescope: str | Sequence[str] = (),
    sigma: Any = None,
    draws: int = 20_000,
    truths: int = 2000,
    seed: int = 1,
    below: float | None = None,
    above: float | None = None,
) -> Plan | Decision:
    """Find the measurements that would make a prediction better; with `decide`, what they may say of an impact.

    Parameters
    ----------
    mission : a mission, its file or name; with `decide` an orbit, as for `risk`.
    prediction : its name; the first encounter, or first, by default.
    visits : how many to schedule; exposures : of each; spacing : from one of them to the next.
    estimator : its name; the first by default.
    criterion : "a" (root trace), "d" (area, volume), "minimax" (worst correlation of errors) or "guaranteed" (each
        error within 3 sigma).
    start, end, step : candidate epochs; those of the mission's schedule by default.
    visit_time : that a visit takes, "2 h" or 'TELESCOPE="30 min"'; 1 h by default.
    decide : foresee the probability that the orbit hits after each candidate visit; what follows belongs to it.
    until : last date of an impact; bodies : what may be hit.
    telescope : who may observe: codes, MISSION.yaml:NAME, a spacecraft's file; sigma : of one no mission describes.
    draws : orbits of the cloud; truths : simulated of each visit; seed : of both.
    below, above : probabilities that would clear it (a tenth of now by default) and confirm it (midway from now to 1).

    Raises
    ------
    InputError
        If a parameter cannot be used, or belongs to the other question; names it.
    """
    said = {
        "prediction": prediction, "visits": visits, "estimator": estimator, "criterion": criterion,
        "start": text_of(start), "end": text_of(end), "step": text_of(step), "exposures": exposures,
        "spacing": text_of(spacing), "visit_time": several(visit_time), "until": text_of(until),
        "bodies": joined(bodies),
        "telescope": several(telescope), "sigma": text_of(sigma),
        "draws": draws, "truths": truths, "seed": seed_of(seed), "below": below, "above": above,
    }  # fmt: skip
    if not decide:
        return Plan(planned(mission_of(mission), said))
    with path_of(mission) as path:
        return Decision(plan_decide.decided(path, said))


@spoken
def compare(*answers: FolderAnswer | Kept | str | Path) -> Comparison:
    """Set several answers side by side: runs and fits, ephemerides, approaches, risks, or studies.

    Parameters
    ----------
    answers : results, or their folders.

    Raises
    ------
    InputError
        If there are fewer than two, or they cannot be compared.
    """
    with ExitStack() as held:
        folders = []
        for number, one in enumerate(answers, start=1):
            if isinstance(one, FolderAnswer):
                parent = Path(held.enter_context(tempfile.TemporaryDirectory()))
                folders.append(one.lent(parent, str(number)))
            elif not isinstance(one, Kept | str | Path):
                raise InputError(f"compare: takes results and their folders (got {type(one).__name__})")
            else:
                folders.append(one.folder if isinstance(one, Kept) else Path(one))
        if all_studies(folders):
            return Comparison(compare_studies(folders))
        kind = kind_of_folders(folders)
        return Comparison(compare_runs(folders) if kind is None else compare_orbits(folders, kind))


@spoken
def study(
    file: str | Path | StudyQuestion,
    *,
    output: str | Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str = "",
    cluster: Literal["slurm"] | None = None,
    overwrite: bool = False,
    parquet: bool = False,
    progress: Callable[[int, int], None] = lambda done, points: None,
) -> Study:
    """Vary a mission as the file of a study says; one table, one answer.

    Parameters
    ----------
    file : of the study, or one that is read.
    output : folder that keeps the study; `./NAME-study` by default. An interrupted study goes on there.
    resume : refuse to begin a new one; overwrite : replace another study in the folder.
    workers, scheduler, cluster : who computes, as of `validate`.
    parquet : write the table as Parquet, not ECSV.
    progress : called with the rows that are done and all rows.

    Raises
    ------
    InputError, OutputError
        If the file is wrong, there are too many points, or the folder holds something else.
    """
    asked = file if isinstance(file, StudyQuestion) else load_study(file)
    folder = Path(output) if output is not None else Path(f"{slug(asked.name, 'study')}-study")
    found = run_study(
        asked, folder, workers=workers_from(workers, scheduler, cluster), resume=resume, overwrite=overwrite,
        parquet=parquet, page=lambda result, table: make_study_page(result, table.columns), progress=progress,
    )  # fmt: skip
    return Study(found, folder)


@spoken
def risk(
    orbit: Orbit,
    until: Any,
    bodies: str | Sequence[str] = "earth,moon",
    on: Any = None,
    draws: int = 10_000,
    coordinates: Coordinates = "cartesian",
    diameter: Any = None,
    density: float | None = None,
    seed: int = 1,
    *,
    history: bool = False,
    output: str | Path | None = None,
    overwrite: bool = False,
    progress: Say | None = None,
) -> Risk:
    """How probable it is that an orbit hits, by several ways, for each virtual impactor.

    Parameters
    ----------
    orbit : with a covariance: a fit or a run, its folder, an orbit file of others, a mission with a prior orbit.
    until : last moment (text is UTC).
    bodies : what may be hit: planets and moon.
    on : from when the years of the Palermo scale count; the last observation by default.
    draws : orbits of the plain sampling; seed : of them.
    coordinates : in which the uncertainty is an ellipsoid.
    diameter : of the object, from H by default; density : kg/m3, 2600 by default.
    history : also how it came, of the folder of a fit.
    output : also write the answer to this folder; overwrite : replace an earlier one there.
    progress : called with one line of text at each stage.

    Raises
    ------
    InputError
        If a parameter cannot be used; names it.
    """
    with opened(orbit, history) as given:
        made = orbit_work.risk_of(
            given, text_of(until), joined(bodies), text_of(on), draws, coordinates, text_of(diameter), density,
            seed_of(seed), history, progress or quiet,
        )  # fmt: skip
    return kept_in(Risk(made.result), output, overwrite)


@spoken
def alert(
    files: str | Path | Sequence[str | Path],
    designations: str | Sequence[str] = (),
    since: Any = None,
    until: Any = None,
    *,
    within: Any = "100 d",
    unbound: bool = False,
    smallest: Any = "0.3 m",
    sites: str | Sequence[str] = (),
    by: str | Sequence[str] = (),
    hours: str | Sequence[float] = "1,3,6,12,24",
    history: bool = False,
    decide: bool = False,
    seed: int = 1,
    output: str | Path | None = None,
    overwrite: bool = False,
    progress: Say | None = None,
) -> Alert:
    """Probability of impact from observations too few for an orbit, with what to do next.

    Parameters
    ----------
    files : of observations, one settings file with a fit block, or a mission whose measurements are simulated.
    designations, since, until : which observations, as of `fit`.
    within : in which time an impact counts; smallest : diameter of the smallest object that counts.
    unbound : count orbits that are not bound to the Sun as well.
    sites : where to look next from; who observed last by default. hours : after the last observation.
    by : of a mission: count the measurements of these telescopes alone.
    history : also after each observation; decide : also which of the next ones would settle it.
    seed : of the random draws.
    output : also write the answer to this folder; overwrite : replace an earlier one there.
    progress : called with one line of text at each stage.

    Raises
    ------
    InputError, GeometryError
        If a parameter cannot be used, or nothing can be said.
    """
    started, named = time.time(), paths_of(files)
    asked = alert_made.Asked.of(
        within=text_of(within), bound=not unbound, smallest=text_of(smallest), sites=several(sites), by=several(by),
        hours=joined(hours), seed=seed_of(seed), history=history, decide=decide,
    )  # fmt: skip
    found = alert_work.found_for(named, several(designations), text_of(since), text_of(until), asked, progress or quiet)
    bodies = found.alert.tracklet.forces.ephemeris
    return kept_in(Alert(alert_result(found.summary, found.alert, bodies, named[0], started)), output, overwrite)


@spoken
def ephemeris(
    orbit: Orbit,
    since: Any,
    until: Any,
    step: Any = "1 d",
    site: str = "500",
    *,
    output: str | Path | None = None,
    overwrite: bool = False,
) -> Sky:
    """Where an orbit is seen, with its ellipse: directions, rates, distances, brightness, twilight.

    Parameters
    ----------
    orbit : with a covariance, as for `risk`.
    since, until : first and last time of reception (text is UTC); step : from one to the next.
    site : who looks: an observatory code (500: geocentre), MISSION.yaml:TELESCOPE, or a spacecraft's .oem or .bsp.
    output : also write the answer to this folder; overwrite : replace an earlier one there.

    Raises
    ------
    InputError
        If a parameter cannot be used; names it.

    Examples
    --------
    >>> import nebosvod
    >>> sky = nebosvod.ephemeris(nebosvod.run("minimal"), "2028-04-20", "2028-04-21")
    >>> sky.tables["ephemeris"]["distance_au"]
    <Quantity [...] AU>
    """
    with opened(orbit) as given:
        made = orbit_work.ephemeris_of(given, text_of(since), text_of(until), text_of(step), site)
    return kept_in(Sky(made.result), output, overwrite)


@spoken
def approaches(
    orbit: Orbit,
    since: Any,
    until: Any,
    within: Any = "0.1 au",
    *,
    output: str | Path | None = None,
    overwrite: bool = False,
    progress: Say | None = None,
) -> Approaches:
    """Every approach of an orbit to planets and the Moon: when, how near, with sigmas, b-plane and chance of impact.

    Parameters
    ----------
    orbit : with a covariance, as for `risk`.
    since, until : first and last moment (text is UTC); within : only nearer than this.
    output : also write the answer to this folder; overwrite : replace an earlier one there.
    progress : called with one line of text at each stage.

    Raises
    ------
    InputError
        If a parameter cannot be used; names it.
    """
    with opened(orbit) as given:
        made = orbit_work.approaches_of(given, text_of(since), text_of(until), text_of(within), progress or quiet)
    return kept_in(Approaches(made.result), output, overwrite)
