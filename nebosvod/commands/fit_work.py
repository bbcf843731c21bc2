"""What `nebosvod fit` does: files in, run folders and a few lines on the terminal out."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from nebosvod.commands.alert_answer import line_of
from nebosvod.commands.alert_made import Answered
from nebosvod.commands.fit_answer import print_fit, print_line
from nebosvod.commands.short_arc import first_hour, in_place_of, is_short, say_instead, with_first_hour
from nebosvod.dynamics import Ephemeris
from nebosvod.errors import EventError, GeometryError, InputError, NebosvodError, notes_of
from nebosvod.fits.answer import Answer
from nebosvod.fits.suggestion import writable, write_suggestion
from nebosvod.mission import FitMission, load_fit
from nebosvod.mission.slugs import slug
from nebosvod.observation.formats.records import Astrometry
from nebosvod.pipeline import every, fitted, mission_of, named, objects
from nebosvod.report.pages import report_text
from nebosvod.results.result import OwnedFolder, Result, json_text
from nebosvod.scene.dates import chosen_dates
from nebosvod.scene.material import gather
from nebosvod.scene.scene import load_ephemeris

Say = Callable[[str], None]
SETTINGS = (".yaml", ".yml")


def resolved(
    files: Sequence[str], designations: Sequence[str] = (), since: str | None = None, until: str | None = None
) -> FitMission:
    """The fit of a settings file, or of plain files of observations; what the command line says comes first.

    Parameters
    ----------
    designations : of the one object to fit.
    since, until : dates of the first observation used, and of the first one after those.

    Raises
    ------
    InputError
        If a settings file stands beside others, or is wrong; or a date is.
    """
    settings = [file for file in files if Path(file).suffix in SETTINGS]
    if settings and len(files) > 1:
        raise InputError(f"{settings[0]}: is a settings file and names its observations itself; give it alone")
    mission = load_fit(settings[0]) if settings else mission_of(files, designations)
    said = dict(chosen_dates(mission, since, until))
    if designations:
        said["designation"] = named(designations)
    if not said:
        return mission
    return mission.model_copy(update={"fit": mission.fit.model_copy(update=said)})


def fit_one(
    mission: FitMission,
    folder: Path,
    overwrite: bool,
    as_json: bool,
    export: bool,
    say: Callable[[str], None],
    suggest: Path | None = None,
) -> bool:
    """Fit one object, write its folder, print the answer, write suggested settings; returns whether it failed."""
    started = time.time()
    if suggest is not None:
        writable(suggest, overwrite)
    with OwnedFolder(folder, report_text, overwrite=overwrite) as target:
        say("reading the observations")
        (records,) = objects(mission, split=False)
        made = answered(records, mission, load_ephemeris(mission), say, export=export, started=started)
        target.publish(made.result)
    if made.answer is None and made.first_hour is not None:
        click.echo(made.result.summary_text(), nl=False) if as_json else say_instead(made.first_hour, folder)
        return False
    if suggest is not None and made.answer is not None:
        written = write_suggestion(suggest, mission, made.answer.fit.found, made.answer.fit.epoch, overwrite)
        if not written:
            text = "the tests found no shared error and no missing force, so there is nothing to suggest"
            click.echo(f"notice: {text}: {suggest} is not written", err=True)
        for copy in written[1:]:
            click.echo(f"notice: {copy}: copied there, for settings name files below their own folder", err=True)
    if as_json:
        click.echo(made.result.summary_text(), nl=False)
    else:
        print_fit(made.result.summary, folder)
        if made.first_hour is not None:
            say_instead(made.first_hour, None)
    return made.result.failed and made.first_hour is None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """What came of the records of one object: the result, the fit if there is an orbit, the first hour if too short."""

    result: Result
    answer: Answer | None
    first_hour: Answered | None


def answered(
    records: Astrometry, mission: FitMission, ephemeris: Ephemeris, say: Say, *, export: bool, started: float
) -> Made:
    """Fit one object; where its observations are too few for an orbit, say what is known in their first hour.

    Raises
    ------
    GeometryError, EventError
        If there is no orbit, and the first hour has no answer either.
    """
    try:
        result, found = fitted(mission, records, ephemeris, say, export=export)
    except (GeometryError, EventError) as error:
        instead = first_hour(records, mission, ephemeris, say)
        if instead is None:
            raise
        result = in_place_of(error, instead, ephemeris, str(mission.fit.observations[0]), started)
        return Made(result=result, answer=None, first_hour=instead)
    known = first_hour(records, mission, ephemeris, say) if is_short(result) else None
    return Made(result=result if known is None else with_first_hour(result, known), answer=found, first_hour=known)


def fit_every(
    mission: FitMission, folder: Path, overwrite: bool, as_json: bool, export: bool, say: Callable[[str], None]
) -> bool:
    """Fit every object by itself, a folder for each below `folder`; returns whether any failed."""
    ephemeris = load_ephemeris(mission)
    failed, summaries = False, []
    for name, found in every(mission, ephemeris, say, export=export):
        instead = None
        if isinstance(found, GeometryError | EventError):
            instead = first_hour(gather(mission).of(name), mission, ephemeris, lambda message: None)
        if instead is not None and isinstance(found, NebosvodError):
            source = str(mission.fit.observations[0])
            own = folder / slug(name, "object")
            with OwnedFolder(own, report_text, overwrite=overwrite) as target:
                target.publish(in_place_of(found, instead, ephemeris, source, time.time()))
            summaries.append(instead.summary)
            click.echo(f"notice: {name}: {instead.summary['warnings'][0]}", err=True)
            if not as_json:
                click.echo(f"{line_of(instead.summary)}; {own}")
            continue
        if isinstance(found, NebosvodError):
            failed = True
            said = str(found) if str(found).startswith(f"{name}: ") else f"{name}: {found}"
            click.echo("\n".join((said, *(f"notice: {note}" for note in notes_of(found)))), err=True)
            continue
        own = folder / slug(name, "object")
        known = None
        if is_short(found):
            known = first_hour(gather(mission).of(name), mission, ephemeris, lambda message: None)
            found = found if known is None else with_first_hour(found, known)
        with OwnedFolder(own, report_text, overwrite=overwrite) as target:
            target.publish(found)
        failed = failed or (found.failed and known is None)
        summaries.append(dict(found.summary))
        if not as_json:
            print_line(found.summary, own)
            if known is not None:
                click.echo(f"  {line_of(known.summary)}")
    if as_json:
        click.echo(json_text({"objects": summaries}), nl=False)
    return failed
