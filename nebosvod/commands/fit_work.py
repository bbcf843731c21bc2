"""What `nebosvod fit` does: files in, run folders and a few lines on the terminal out."""

from collections.abc import Callable, Sequence
from pathlib import Path

import click

from nebosvod.commands.fit_answer import print_fit, print_line
from nebosvod.errors import InputError, NebosvodError, notes_of
from nebosvod.fits.suggestion import writable, write_suggestion
from nebosvod.mission import FitMission, load_fit
from nebosvod.mission.slugs import slug
from nebosvod.pipeline import every, fitted, mission_of, named, objects
from nebosvod.report.pages import report_text
from nebosvod.results.result import OwnedFolder, json_text
from nebosvod.scene.dates import chosen_dates
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
    if suggest is not None:
        writable(suggest, overwrite)
    with OwnedFolder(folder, report_text, overwrite=overwrite) as target:
        say("reading the observations")
        (records,) = objects(mission, split=False)
        result, found = fitted(mission, records, load_ephemeris(mission), say, export=export)
        target.publish(result)
    if suggest is not None:
        written = write_suggestion(suggest, mission, found.fit.found, found.fit.epoch, overwrite)
        if not written:
            text = "the tests found no shared error and no missing force, so there is nothing to suggest"
            click.echo(f"notice: {text}: {suggest} is not written", err=True)
        for copy in written[1:]:
            click.echo(f"notice: {copy}: copied there, for settings name files below their own folder", err=True)
    if as_json:
        click.echo(result.summary_text(), nl=False)
    else:
        print_fit(result.summary, folder)
    return result.failed


def fit_every(
    mission: FitMission, folder: Path, overwrite: bool, as_json: bool, export: bool, say: Callable[[str], None]
) -> bool:
    """Fit every object by itself, a folder for each below `folder`; returns whether any failed."""
    ephemeris = load_ephemeris(mission)
    failed, summaries = False, []
    for name, found in every(mission, ephemeris, say, export=export):
        if isinstance(found, NebosvodError):
            failed = True
            said = str(found) if str(found).startswith(f"{name}: ") else f"{name}: {found}"
            click.echo("\n".join((said, *(f"notice: {note}" for note in notes_of(found)))), err=True)
            continue
        own = folder / slug(name, "object")
        with OwnedFolder(own, report_text, overwrite=overwrite) as target:
            target.publish(found)
        failed = failed or found.failed
        summaries.append(dict(found.summary))
        if not as_json:
            print_line(found.summary, own)
    if as_json:
        click.echo(json_text({"objects": summaries}), nl=False)
    return failed
