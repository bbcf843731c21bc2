"""The command line: arguments -> functions -> exit code.

No numerics here, and heavy modules load only in the commands that need them.

Exit codes: 0 done; 1 finished, but a quality gate failed (no convergence, not observable, nothing visible, a
prediction without an answer);
2 wrong input; 3 environment (missing data, disk, permission, folder in use); 4 internal error (a crash
file is written); 130 interrupted.
"""

import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click

from nebosvod.borders.interrupts import EXIT_INTERRUPTED, end, interruptible
from nebosvod.errors import (
    EXIT_ENVIRONMENT,
    EXIT_INPUT,
    EXIT_INTERNAL,
    NebosvodError,
    NebosvodNotice,
    notes_of,
    printable,
)
from nebosvod.version import __version__

VERBS = {
    "alert": "What is known in the first hour: impact, orbit, where to look.",
    "approaches": "What an orbit comes near to, and how near.",
    "check": "Validate a mission and show what it means; run nothing.",
    "compare": "Show several runs side by side.",
    "elements": "Orbital elements at a date, with sigmas.",
    "ephemeris": "Where an orbit is seen, with its ellipse.",
    "fit": "Fit an orbit to real observations.",
    "init": "Write a commented mission to start from.",
    "missions": "List the built-in missions.",
    "open": "Edit a mission in a local page, with its answer as one types.",
    "plan": "Find what to measure next for a prediction.",
    "report": "Make the report of a run again.",
    "risk": "How probable it is that an orbit hits.",
    "run": "Run a mission; write its folder and report.",
    "schema": "Print the JSON Schema of the mission file.",
    "study": "Vary a mission over many points; one table, one answer.",
    "validate": "Simulate many times: can the sigmas be believed?",
}
TOGETHER = {"init": "start", "missions": "start", "schema": "start"}  # verbs that share a file
LONGEST_WORD = 400  # letters of the command line that a message repeats whole
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class Verbs(click.Group):
    """The verbs of `VERBS`, each loaded from its file in commands/ when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every verb."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a verb; None for another word."""
        if cmd_name not in VERBS:
            return None
        found = getattr(import_module(f"nebosvod.commands.{TOGETHER.get(cmd_name, cmd_name)}"), cmd_name)
        return found if isinstance(found, click.Command) else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of `--help`, without loading any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


@click.group(cls=Verbs, context_settings=CONTEXT)
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
        nebosvod study STUDY.yaml         thousands of missions, one answer
        nebosvod alert FILE...            how likely an impact is, when an orbit cannot be told yet
        nebosvod fit FILE...              an orbit from real observations
        nebosvod ephemeris ORBIT ...      where it is seen, and how well that is known
        nebosvod elements ORBIT           its elements at a date, with sigmas
        nebosvod approaches ORBIT ...     what it comes near to, and how near
        nebosvod risk ORBIT --until DATE  how probable it is that it hits

    Exit codes: 0 done, 1 finished but not trustworthy (not observable, not converged, nothing visible),
    2 wrong input, 3 missing data, disk or permission, 4 internal error, 130 interrupted.
    """


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
    with interruptible() as lost, patient_streams(), warnings.catch_warnings():
        show = warnings.showwarning
        warnings.showwarning = lambda message, kind, *place: _show_warning(show, message, kind, *place)
        try:
            return _answered(argv, debug, lost.is_set)
        except KeyboardInterrupt:  # while a failure was told
            return _interrupted()


def entry() -> NoReturn:
    """The program: `main`, and the end of the process with its exit code."""
    end(main())


def _show_warning(show: Callable[..., None], message: Warning | str, kind: type[Warning], *place: Any) -> None:
    """A notice of this program is a line on stderr; any other warning is shown as Python does."""
    if issubclass(kind, NebosvodNotice):
        click.echo(f"notice: {printable(str(message))}", err=True)
    else:
        show(message, kind, *place)


def _lines(message: str, argv: Sequence[str]) -> list[str]:
    """The lines of a message; a long word of the command line is cut, one with line breaks stays on its line."""
    for word in argv:
        if not word.isprintable() or len(word) > LONGEST_WORD:
            cut = f"{word[: LONGEST_WORD // 2]}..." if len(word) > LONGEST_WORD else word
            message = message.replace(word, printable(cut))
    return [printable(line) for line in message.split("\n")]


def _interrupted() -> int:
    """Say so."""
    click.echo("interrupted; nothing half-written is left", err=True)
    return EXIT_INTERRUPTED


def _answered(argv: Sequence[str], debug: bool, broken_into: Callable[[], bool]) -> int:
    """Run a command; whatever goes wrong becomes a sentence and an exit code.

    Where an interrupt was swallowed (`broken_into`), as in a compiler's callback, what fails after it is its doing.
    """
    try:
        return _invoke(argv)
    except NebosvodError as error:
        if debug:
            raise
        for line in _lines(str(error), argv):  # of several things that are wrong each has a line
            click.echo(f"error: {line}", err=True)
        for note in notes_of(error):
            click.echo(f"notice: {printable(note)}", err=True)
        return error.exit_code
    except click.ClickException as error:
        error.show()
        return EXIT_INPUT
    except (KeyboardInterrupt, click.Abort):
        return _interrupted()
    except OSError as error:  # what no stage turned into a sentence of its own: disk, permission, memory of the system
        if debug:
            raise
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        click.echo(f"error: the system refused: {_lines(what, argv)[0]}; check disk space and permissions", err=True)
        return EXIT_ENVIRONMENT
    except MemoryError as error:
        if debug:
            raise
        click.echo(f"error: not enough memory{f': {error}' if str(error) else ''}; ask for less at a time", err=True)
        return EXIT_ENVIRONMENT
    except Exception:  # the last resort: a file instead of a traceback
        if debug:
            raise
        if broken_into():
            return _interrupted()
        path = _crash_file(argv)
        click.echo(f"internal error in nebosvod {__version__}; details: {path}; please report it", err=True)
        return EXIT_INTERNAL
