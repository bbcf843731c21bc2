"""From the file of a fit, or names on a command line, to results ready for their run folders."""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError, NebosvodError, noting
from nebosvod.fits.answer import Answer, answer
from nebosvod.fits.engine import fit_object
from nebosvod.mission import FitMission
from nebosvod.mission.fields import slug
from nebosvod.mission.fit import FitPlan
from nebosvod.observation.formats.records import Astrometry
from nebosvod.pipeline import manifest
from nebosvod.results.fit_export import exports
from nebosvod.results.fit_summary import summarise
from nebosvod.results.fit_tables import all_arrays, all_tables
from nebosvod.results.ownership import sha256_of
from nebosvod.results.result import Result
from nebosvod.scene.material import gather, one_object

Say = Callable[[str], None]
SPLIT_HINT = (
    "name it with --object, or fit each by itself with --split; "
    "where they are one object, give --object once for each of its names"
)


def mission_of(files: Sequence[str], designations: Sequence[str] = ()) -> FitMission:
    """The fit of plain files: everything else as by default.

    Raises
    ------
    InputError
        If there is no file.
    """
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
    with noting(records.notices):
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
        summary=summarise(found),
        manifest=_manifest(mission, found, started),
        arrays=all_arrays(found),
        tables=all_tables(found),
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


def _manifest(mission: FitMission, found: Answer, started: float) -> dict[str, Any]:
    """Where the result came from, with the sha256 of every file read."""
    general = found.fit.general
    paths = [Path(name) for name in mission.fit.observations]
    if mission.path is not None:
        paths = [path for path in mission.input_files if path.is_file()]
    return manifest(general.scene, 0, started, [general.fit]) | {
        "inputs_sha256": {str(path): sha256_of(path) for path in paths},
        "status": {"fit": str(found.fit.verdict.status)},
    }
