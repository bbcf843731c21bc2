"""The command line: arguments -> functions -> exit code.

No numerics here, and heavy modules load only in the commands that need them.

Exit codes: 0 done; 1 finished, but a quality gate failed (no convergence, not observable, nothing visible, a
prediction without an answer);
2 wrong input; 3 environment (missing data, disk, permission, folder in use); 4 internal error (a crash
file is written); 130 interrupted.
"""

import json
import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import click

from nebosvod.borders.interrupts import EXIT_INTERRUPTED, end, interruptible
from nebosvod.errors import InputError, NebosvodError, NebosvodNotice, notes_of
from nebosvod.version import __version__

EXIT_QUALITY, EXIT_INPUT, EXIT_ENVIRONMENT, EXIT_INTERNAL = 1, 2, 3, 4
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(context_settings=CONTEXT)
@click.version_option(__version__, prog_name="nebosvod")
@click.option("--debug", is_flag=True, expose_value=False, help="Show a Python traceback when something fails.")
def app() -> None:
    """Orbit determination of asteroids watched by space telescopes.

    Write one YAML mission; get how well the orbit and its predictions are known, and which uncertainty is
    to blame for how much. A first run:

    \b
        nebosvod missions                 what comes built in
        nebosvod run apophis-2029         run one; prints the answer and where the report is
        nebosvod init my.yaml             a commented mission to start your own from
        nebosvod check my.yaml            is it right, and what will it cost? (runs nothing)
        nebosvod validate my.yaml         can its sigmas be believed?
        nebosvod plan my.yaml -p NAME     what to measure next
        nebosvod compare DIR DIR          runs side by side
        nebosvod fit FILE...              an orbit from real observations

    Exit codes: 0 done, 1 finished but not trustworthy (not observable, not converged, nothing visible),
    2 wrong input, 3 missing data, disk or permission, 4 internal error, 130 interrupted.
    """


@app.command(short_help="Run a mission; write its folder and report.")
@click.argument("mission")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder [default: ./<mission name>-run].")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of the simulation.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier run in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json, and nothing else, on stdout.")
def run(mission: str, output: Path | None, seed: int, overwrite: bool, as_json: bool) -> int:
    """Run MISSION (a file or a built-in name) and write its run folder and report.

    \b
    Example:  nebosvod run apophis-2029 -o apophis --seed 1
    """
    from nebosvod.commands.progress import stages
    from nebosvod.mission import load_mission
    from nebosvod.report.pages import report_text
    from nebosvod.results.result import OwnedFolder, default_folder

    loaded = load_mission(mission)
    folder = output if output is not None else default_folder(loaded.slug)
    with stages() as progress, OwnedFolder(folder, report_text, overwrite=overwrite) as target:
        from nebosvod.pipeline import run as run_mission

        result = run_mission(loaded, seed=seed, progress=progress)
        progress("writing the run folder and its report")
        target.publish(result)
    if as_json:
        click.echo(result.summary_text(), nl=False)
    else:
        from nebosvod.commands.run_answer import print_answer

        print_answer(result.summary, folder)
    return EXIT_QUALITY if result.failed else 0


@app.command(short_help="Validate a mission and show what it means; run nothing.")
@click.argument("mission")
def check(mission: str) -> int:
    """Validate MISSION, print what it resolves to and what it will cost; run nothing."""
    from nebosvod.commands.resolved import describe
    from nebosvod.mission import FitMission, load_any

    loaded = load_any(mission)
    if isinstance(loaded, FitMission):
        from nebosvod.commands.fit_resolved import describe_fit

        click.echo(describe_fit(loaded))
    else:
        click.echo(describe(loaded))
    return 0


@app.command(short_help="Write a commented mission to start from.")
@click.argument("path", type=click.Path(path_type=Path))
def init(path: Path) -> int:
    """Write a commented mission to PATH (a new .yaml file) to start from."""
    from nebosvod.borders.wholefile import write_new_text
    from nebosvod.mission import template_text

    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a mission file ends in .yaml; try: nebosvod init {path}.yaml")
    write_new_text(path, template_text(path.stem))
    click.echo(f"wrote {path}\nnext: edit it, then  nebosvod check {path}  and  nebosvod run {path}")
    return 0


@app.command()
def missions() -> int:
    """List the built-in missions."""
    from nebosvod.mission import list_missions

    rows = list_missions()
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:<{width}}  {title}")
    return 0


@app.command(short_help="Simulate many times: can the sigmas be believed?")
@click.argument("mission")
@click.option("--runs", "-n", type=int, default=2000, show_default=True, help="Simulated truths.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder [default: ./<mission name>-validation].")
@click.option("--workers", type=click.IntRange(1, 256), help="Processes [default: one for each processor].")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of the simulation.")
@click.option("--full", is_flag=True, help="Propagate every truth and iterate every estimate: slower, tests linearity.")
@click.option("--overwrite", is_flag=True, help="Replace another campaign, or a larger one, in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print validation.json, and nothing else, on stdout.")
def validate(
    mission: str,
    runs: int,
    output: Path | None,
    workers: int | None,
    seed: int,
    full: bool,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Simulate MISSION many times: do the errors look as the sigmas say?

    Every uncertainty is drawn anew in every run; all estimators of the mission see the same runs. An interrupted
    campaign continues with the same command; more --runs add to those that are there. Exit code 1 when an estimator
    is found wrong about its own accuracy.

    \b
    Example:  nebosvod validate minimal --runs 2000
    """
    from nebosvod.commands.progress import counting
    from nebosvod.commands.validate_answer import print_validation
    from nebosvod.mission import load_mission
    from nebosvod.report.validation_page import write_validation_report
    from nebosvod.results.result import json_text

    loaded = load_mission(mission)
    folder = output if output is not None else Path(f"{loaded.slug}-validation")
    with counting("runs") as progress:
        from nebosvod.studies.validation import validate as validate_mission

        found = validate_mission(
            loaded,
            folder,
            runs=runs,
            seed=seed,
            workers=workers or len(os.sched_getaffinity(0)),
            full=full,
            overwrite=overwrite,
            progress=progress,
            say=lambda sentence: click.echo(f"notice: {sentence}", err=True),
        )
    page = write_validation_report(folder, found)
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        print_validation(found, folder)
        click.echo(f"report: {page}")
    return 0 if found["passed"] else EXIT_QUALITY


@app.command(short_help="Find what to measure next for a prediction.")
@click.argument("mission")
@click.option(
    "--prediction", "-p", help="Name of a prediction of the mission [default: its first encounter, or first]."
)
@click.option("--visits", "-k", type=int, default=5, show_default=True, help="How many visits to schedule.")
@click.option("--estimator", help="Name of an estimator [default: the first].")
@click.option(
    "--criterion", type=click.Choice(["a", "d"]), default="a", show_default=True, help="a: root trace; d: area, volume."
)
@click.option("--from", "start", help="First candidate epoch, as in a mission file [default: the mission's schedule].")
@click.option("--to", "end", help="Last candidate epoch.")
@click.option("--step", help='From one candidate epoch to the next, as "6 h".')
@click.option("--exposures", type=int, default=1, show_default=True, help="Exposures of a visit.")
@click.option("--spacing", help='From one exposure of a visit to the next, as "1 min".')
@click.option("--visit-time", multiple=True, help='Time of a visit, "2 h" or TELESCOPE="30 min" [default: 1 h].')
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Also write the result to this new .json file.")
@click.option("--page", type=click.Path(path_type=Path), help="Also write figures and tables to this new .html file.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else, on stdout.")
def plan(
    mission: str,
    prediction: str | None,
    visits: int,
    estimator: str | None,
    criterion: str,
    start: str | None,
    end: str | None,
    step: str | None,
    exposures: int,
    spacing: str | None,
    visit_time: tuple[str, ...],
    output: Path | None,
    page: Path | None,
    as_json: bool,
) -> int:
    """Find the measurements that would make a PREDICTION of MISSION better, and by how much.

    \b
    Example:  nebosvod plan apophis-2029 --prediction encounter --visits 5
    """
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.plan_answer import print_plan
    from nebosvod.commands.progress import stages
    from nebosvod.mission import load_mission
    from nebosvod.planning.planner import plan as plan_mission
    from nebosvod.planning.planner import read_wish
    from nebosvod.results.result import json_text

    require_places(output, page)
    loaded = load_mission(mission)
    window = (start, end, step)
    wish = read_wish(loaded, prediction, visits, estimator, criterion, window, visit_time, exposures, spacing)
    with stages() as progress:
        found = plan_mission(loaded, wish, progress)
    if output is not None:
        write_new_text(output, json_text(found))
    if page is not None:
        from nebosvod.report.plan_page import make_plan_page

        write_new_text(page, make_plan_page(found))
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        print_plan(found)
    return 0


@app.command(short_help="Show several runs side by side.")
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path), metavar="DIR DIR ...")
@click.option(
    "--page", type=click.Path(path_type=Path), help="Also write tables and overlaid ellipses to this new .html."
)
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as JSON, and nothing else, on stdout.")
def compare(folders: tuple[Path, ...], page: Path | None, as_json: bool) -> int:
    """Show the runs in several folders side by side, and warn where they do not compare.

    \b
    Example:  nebosvod compare apophis-2029-run apophis-heliocentric-run
    """
    from nebosvod.borders.stored import held_together
    from nebosvod.borders.wholefile import require_places, write_new_text
    from nebosvod.commands.compare_answer import print_comparison
    from nebosvod.results.compare import compare as compare_runs
    from nebosvod.results.ownership import changed_said
    from nebosvod.results.result import json_text

    require_places(page)
    found = compare_runs(folders)
    for sentence in (sentence for folder in folders for sentence in changed_said(folder)):
        click.echo(f"notice: {sentence}", err=True)
    if page is not None:
        from nebosvod.report.comparison_page import make_comparison_page

        with held_together("compare"):
            text = make_comparison_page(found)
        write_new_text(page, text)
    if as_json:
        click.echo(json_text(found), nl=False)
    else:
        with held_together("compare"):
            print_comparison(found)
    return 0


@app.command(short_help="Make the report of a run again.")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--pdf", is_flag=True, help="Also print it to report.pdf, by a Chromium of this machine.")
def report(folder: Path, pdf: bool) -> int:
    """(Re)make report.html of the run in FOLDER, from the files of the run alone."""
    from nebosvod.borders.wholefile import refuse_link
    from nebosvod.report.kit.pdf import print_pdf
    from nebosvod.report.pages import report_text
    from nebosvod.results.result import rewrite_report

    if folder.is_symlink():
        refuse_link(folder, folder.lstat().st_mode)
    made = rewrite_report(
        folder,
        report_text,
        printer=print_pdf if pdf else None,
        say=lambda sentence: click.echo(f"notice: {sentence}", err=True),
    )
    click.echo(f"report: {made}")
    if pdf:
        click.echo(f"pdf: {folder / 'report.pdf'}")
    return 0


@app.command()
@click.option("--fit", "of_fit", is_flag=True, help="Of a file for nebosvod fit.")
def schema(of_fit: bool) -> int:
    """Print the JSON Schema of the mission file."""
    from nebosvod.mission.reading.schema import fit_schema, mission_schema

    click.echo(json.dumps(fit_schema() if of_fit else mission_schema(), indent=2, ensure_ascii=False))
    return 0


@app.command(short_help="Fit an orbit to real observations.")
@click.argument("files", nargs=-1, metavar="FILE...")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder [default: ./<name>-fit].")
@click.option(
    "--object",
    "designations",
    multiple=True,
    help="Any designation of the object to fit, where files hold several; again for each name that is to be joined.",
)
@click.option("--from", "since", help="Leave out earlier observations: a date, UTC.")
@click.option("--to", "until", help="Leave out observations at this date, UTC, and later.")
@click.option("--split", is_flag=True, help="Fit every object of the files by itself, a folder for each.")
@click.option(
    "--export", is_flag=True, help="Also write the orbit as orbit.oem (CCSDS, with covariance) and orbit.bsp."
)
@click.option(
    "--suggest",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the settings that would mend what the tests found.",
)
@click.option("--overwrite", is_flag=True, help="Replace an earlier fit in the same folder.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json, and nothing else, on stdout.")
def fit(
    files: tuple[str, ...],
    output: Path | None,
    designations: tuple[str, ...],
    since: str | None,
    until: str | None,
    split: bool,
    export: bool,
    suggest: Path | None,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Fit an orbit to real astrometry: FILE... are observations (ADES or MPC 80-column), or one .yaml with a fit block.

    Exit code 1 when the observations do not give an orbit that can be relied on: not observable, not converged.

    \b
    Example:  nebosvod fit 2023DW.obs80
              nebosvod fit mission.yaml -o dw --overwrite
    """
    from nebosvod.commands.fit_command import fit_every, fit_one, resolved
    from nebosvod.commands.progress import stages

    mission = resolved(files, designations, since, until)
    folder = output if output is not None else Path(f"{mission.slug}-fit")
    if split and suggest is not None:
        raise InputError("--suggest: writes the settings of one object; choose it by --object instead of --split")
    with stages() as progress:
        if split:
            failed = fit_every(mission, folder, overwrite, as_json, export, progress)
        else:
            failed = fit_one(mission, folder, overwrite, as_json, export, progress, suggest)
    return EXIT_QUALITY if failed else 0


def _crash_file(argv: Sequence[str]) -> Path | None:
    """Write the traceback of the current exception to a new file; None if even that fails."""
    try:
        handle, name = tempfile.mkstemp(prefix="nebosvod-crash-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"nebosvod {__version__}\nargv: {list(argv)}\nPython {sys.version}\n\n{traceback.format_exc()}")
    except OSError:
        return None
    return Path(name)


def _invoke(argv: Sequence[str]) -> int:
    """Run click without its own exits; the command's return value is the exit code."""
    code: Any = app.main(args=list(argv), prog_name="nebosvod", standalone_mode=False)
    return code if isinstance(code, int) else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program on `argv` (default: the command line) and return its exit code."""
    from nebosvod.borders.streams import patient_streams

    argv = sys.argv[1:] if argv is None else argv
    # matrices of a mission are small: threads of the linear algebra cost more than they bring, up to ten times where
    # something else runs. It is read when numpy loads; who sets it keeps it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    debug = "--debug" in argv
    argv = [word for word in argv if word != "--debug"]  # so that it may stand anywhere
    with interruptible(), patient_streams(), warnings.catch_warnings():
        show = warnings.showwarning
        warnings.showwarning = lambda message, kind, *place: _show_warning(show, message, kind, *place)
        return _answered(argv, debug)


def entry() -> NoReturn:
    """The program: `main`, and the end of the process with its exit code."""
    end(main())


def _show_warning(show: Callable[..., None], message: Warning | str, kind: type[Warning], *place: Any) -> None:
    """A notice of this program is a line on stderr; any other warning is shown as Python does."""
    if issubclass(kind, NebosvodNotice):
        click.echo(f"notice: {message}", err=True)
    else:
        show(message, kind, *place)


def _answered(argv: Sequence[str], debug: bool) -> int:
    """Run a command; whatever goes wrong becomes a sentence and an exit code."""
    try:
        return _invoke(argv)
    except NebosvodError as error:
        if debug:
            raise
        for line in str(error).splitlines():  # of several things that are wrong each has a line
            click.echo(f"error: {line}", err=True)
        for note in notes_of(error):
            click.echo(f"notice: {note}", err=True)
        return error.exit_code
    except click.ClickException as error:
        error.show()
        return EXIT_INPUT
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; nothing half-written is left", err=True)
        return EXIT_INTERRUPTED
    except OSError as error:  # what no stage turned into a sentence of its own: disk, permission, memory of the system
        if debug:
            raise
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        click.echo(f"error: the system refused: {what}; check disk space and permissions", err=True)
        return EXIT_ENVIRONMENT
    except MemoryError as error:
        if debug:
            raise
        click.echo(f"error: not enough memory{f': {error}' if str(error) else ''}; ask for less at a time", err=True)
        return EXIT_ENVIRONMENT
    except Exception:  # the last resort: a file instead of a traceback
        if debug:
            raise
        path = _crash_file(argv)
        click.echo(f"internal error in nebosvod {__version__}; details: {path}; please report it", err=True)
        return EXIT_INTERNAL
