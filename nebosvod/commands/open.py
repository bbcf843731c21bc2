"""`nebosvod open`: a mission in a page of this machine, with its answer as one types."""

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import DataError

INSTALL = "pip install 'nebosvod[page]'"


@click.command()
@click.argument("mission", shell_complete=completion.missions)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder [default: ./<mission name>-run].")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of 127.0.0.1 [default: a free one].")
@click.option("--browser/--no-browser", default=True, help="Show the page in a browser, where there is a desktop.")
def open(mission: str, output: Path | None, port: int, browser: bool) -> int:
    """Edit MISSION (a file or a built-in name) in a local page: text and form, answer as you type; Ctrl-C ends it.

    \b
    Example:  nebosvod open my.yaml
    """
    try:
        from nebosvod.workbench.server import serve
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in ("starlette", "uvicorn"):
            raise
        raise DataError(f"nebosvod open needs {missing}, which comes with the extra page: {INSTALL}") from None
    from nebosvod.workbench.desk import Desk

    desk = Desk(mission)

    def tell(address: str) -> None:
        click.echo(f"{desk.name} is open at {address}\nCtrl-C ends it")
        sys.stdout.flush()
        if browser and _desktop():
            held.callback(_show(address))

    with ExitStack() as held:
        serve(desk, output, port, tell)
    return 0


def _desktop() -> bool:
    """Whether a browser would open a window, and not take the terminal."""
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _show(address: str) -> Callable[[], None]:
    """Open the page; whoever has no browser has the address. Returns what takes away the file it was opened by.

    The address holds the token, and every user of a machine may read the command lines of its processes: a browser is
    given a file that only its owner can read.
    """
    import tempfile
    import threading
    import webbrowser

    folder = tempfile.TemporaryDirectory(prefix="nebosvod-")  # of mode 700
    page = Path(folder.name) / "open.html"
    page.write_text(
        f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={address}"><a href="{address}">open</a>\n'
    )
    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
    return folder.cleanup
