"""`nebosvod open`: a mission in a page of this machine, with its answer as one types."""

import os
import sys
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
            _show(address)

    serve(desk, output, port, tell)
    return 0


def _desktop() -> bool:
    """Whether a browser would open a window, and not take the terminal."""
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _show(address: str) -> None:
    """Open the page; whoever has no browser has the address."""
    import threading
    import webbrowser

    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
