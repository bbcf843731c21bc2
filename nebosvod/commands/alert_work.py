"""What `nebosvod alert` does: files or a mission in, answers on the terminal and in folders out."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import click

from nebosvod.commands.alert_answer import line_of, print_alert
from nebosvod.commands.alert_made import Answered, Asked, of_mission, of_records
from nebosvod.commands.fit_work import SETTINGS, resolved
from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError, NebosvodError, OutputError, counted, notes_of
from nebosvod.mission import FitMission, load_any
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.mission.slugs import slug
from nebosvod.pipeline import objects
from nebosvod.results.alert_folder import alert_result
from nebosvod.results.result import OwnedFolder, json_text
from nebosvod.scene.scene import load_ephemeris

Say = Callable[[str], None]


def answer_one(
    files: Sequence[str], designations: Sequence[str], since: str | None, until: str | None, asked: Asked, say: Say
) -> bool:
    """Answer for one object; returns whether too little is known for an answer."""
    started = time.time()
    with _folder(asked.output, asked.overwrite) as target:  # refused before anything is computed
        found = found_for(files, designations, since, until, asked, say)
        if target is not None:
            _publish(found, target, str(files[0]), started)
    if asked.as_json:
        click.echo(json_text(found.summary), nl=False)
    else:
        print_alert(found.summary, asked.output)
    return not found.alert.enough


def found_for(
    files: Sequence[str], designations: Sequence[str], since: str | None, until: str | None, asked: Asked, say: Say
) -> Answered:
    """The answer for one object, or for a mission whose measurements are simulated."""
    if not _is_mission(files):
        _require_no_telescopes(asked)
        mission = resolved(files, designations, since, until)
        (records,) = objects(mission, split=False)
        return of_records(records, mission, load_ephemeris(mission), asked, say)
    if designations or since or until:
        raise InputError("--object, --from, --to: choose observations, and a mission simulates its own; remove them")
    return of_mission(files[0], asked, say)


def _require_no_telescopes(asked: Asked) -> None:
    """Raise InputError where telescopes are chosen of records, which name stations."""
    if asked.by:
        raise InputError(f"--by {asked.by[0]}: chooses telescopes of a mission, and these are observations; remove it")


def _is_mission(files: Sequence[str]) -> bool:
    """Whether the one file is a mission that is simulated."""
    if len(files) != 1:
        return False
    if files[0] in builtin_names() and not Path(files[0]).exists():
        return True
    return Path(files[0]).suffix in SETTINGS and not isinstance(load_any(files[0]), FitMission)


def answer_every(
    files: Sequence[str], designations: Sequence[str], since: str | None, until: str | None, asked: Asked, say: Say
) -> bool:
    """A line for every object of the files; returns whether any has no answer."""
    if _is_mission(files):
        raise InputError(f"--split: {files[0]} is a mission, which has one object; remove --split")
    _require_no_telescopes(asked)
    mission = resolved(files, designations, since, until)
    ephemeris, parts = load_ephemeris(mission), list(objects(mission, split=True))
    failed, summaries, noticed, refused = False, [], set[str](), list[OutputError]()
    for number, records in enumerate(parts, start=1):
        name, started = records.objects[0], time.time()
        say(f"{number} of {len(parts)}: {name}")
        try:
            found = of_records(records, mission, ephemeris, asked, lambda line: None)
        except NebosvodError as error:
            failed = True
            said = str(error) if str(error).startswith(f"{name}: ") else f"{name}: {error}"
            click.echo("\n".join((said, *(f"notice: {note}" for note in notes_of(error)))), err=True)
            continue
        failed = failed or not found.alert.enough
        summaries.append(found.summary)
        for text in found.summary["warnings"]:
            if text not in noticed:  # what is said of many objects alike is said once
                click.echo(f"notice: {name}: {text}", err=True)
            noticed.add(text)
        if not asked.as_json:
            click.echo(line_of(found.summary))
        try:
            with _folder(
                None if asked.output is None else asked.output / slug(name, "object"), asked.overwrite
            ) as target:
                if target is not None:
                    _publish(found, target, str(files[0]), started)
        except OutputError as error:  # the others are not to wait for it
            refused.append(error)
    if asked.as_json:
        click.echo(json_text({"objects": summaries}), nl=False)
    if refused:
        what = f"{len(refused)} of {counted(len(summaries), 'folder')} could not be written, the first for this reason"
        raise OutputError(f"{what}: {refused[0]}")
    return failed


def _folder(folder: Path | None, overwrite: bool) -> AbstractContextManager[OwnedFolder | None]:
    """The folder of an answer, which is ours while it is open; None where none is wanted."""
    from nebosvod.report.pages import report_text

    return nullcontext() if folder is None else OwnedFolder(folder, report_text, overwrite=overwrite)


def _publish(found: Answered, target: OwnedFolder, source: str, started: float) -> None:
    """Write an answer into its folder."""
    ephemeris: Ephemeris = found.alert.tracklet.forces.ephemeris
    target.publish(alert_result(found.summary, found.alert, ephemeris, source, started))
