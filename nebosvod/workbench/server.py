"""The server of the page: addresses, what each answers, and how it is started and ended."""

import json
import logging
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from nebosvod.errors import InputError, NebosvodError, OutputError, WorkerError
from nebosvod.mission.reading.schema import fit_schema, mission_schema
from nebosvod.results.result import default_folder
from nebosvod.tasks.warm import WarmProcesses
from nebosvod.workbench.desk import ChangedError, Desk
from nebosvod.workbench.guard import Guard
from nebosvod.workbench.job import Job

HERE = Path(__file__).parent
LOOK = "nebosvod.workbench.look:opened"
LARGEST_POST = 8_000_000  # bytes: a text of the largest size a mission may have, every letter escaped
FILES = {
    "/style.css": ("../report/style.css", "text/css"),
    "/": ("page.html", "text/html"),
    "/page.js": ("page.js", "text/javascript"),
    "/form.js": ("form.js", "text/javascript"),
    "/page.css": ("page.css", "text/css"),
}
# a report is shown as from nowhere: it may run its own script and offer files, and reach nothing of this server
REPORT_POLICY = "sandbox allow-scripts allow-downloads allow-popups allow-modals"
BACKLOG = 64


class Workbench:
    """What the addresses of one page answer.

    Parameters
    ----------
    desk : the mission.
    output : run folder; by default that of `nebosvod run`, by the name the mission has when it runs.
    """

    def __init__(self, desk: Desk, output: Path | None) -> None:
        self._desk, self._output, self._job = desk, output, Job()
        self._warm = WarmProcesses(LOOK)

    def app(self) -> Starlette:
        """As an ASGI application."""
        files = [Route(path, _file(*what), methods=["GET"]) for path, what in FILES.items()]
        posts = {"look": self._look, "edit": self._edit, "save": self._save, "run": self._run, "stop": self._stop}
        return Starlette(
            routes=[
                *files,
                Route("/start", self._start, methods=["GET"]),
                Route("/report", self._report, methods=["GET"]),
                *(Route(f"/{name}", answer, methods=["POST"]) for name, answer in posts.items()),
            ],
            lifespan=self._lifespan,
            exception_handlers={NebosvodError: _said},
        )

    @asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            self._warm.end()
            await self._job.stop()

    async def _start(self, request: Request) -> Response:
        """The file as it is on disk now, and the schemas of the form."""
        text, mark = self._desk.read()
        return JSONResponse(
            {
                "text": text, "mark": mark, "name": self._desk.name, "path": str(self._desk.path),
                "saved": self._desk.saved, "output": None if self._output is None else str(self._output),
                "schemas": _schemas(), "running": self._job.busy,
            }
        )  # fmt: skip

    async def _look(self, request: Request) -> Response:
        """Messages on a text, one a line."""
        posted = await _posted(request, text=str)
        told = {"verb": "look", "text": posted["text"], "name": self._desk.name, "folder": str(self._desk.folder)}
        return _lines(self._told(told))

    async def _edit(self, request: Request) -> Response:
        """The text with one place changed."""
        posted = await _posted(request, text=str, path=list)
        keys = ("text", "path", "value", "written")
        told = {"verb": "edit", "name": self._desk.name, **{key: posted.get(key) for key in keys}}
        return _lines(self._told(told))

    async def _told(self, request: dict[str, Any]) -> AsyncIterator[bytes]:
        messages = self._warm.messages(request)
        try:
            async for said in messages:
                yield said + b"\n"
        except WorkerError as error:
            yield _line({"step": "broken", "text": str(error)})
        finally:
            await messages.aclose()

    async def _save(self, request: Request) -> Response:
        """Write the file, if it is as the page read it."""
        posted = await _posted(request, text=str, mark=str)
        try:
            mark = self._desk.save(posted["text"], posted["mark"])
        except ChangedError as error:
            return JSONResponse({"text": str(error), "mark": self._desk.mark()}, status_code=409)
        return JSONResponse({"mark": mark, "path": str(self._desk.path)})

    async def _run(self, request: Request) -> Response:
        """Run the file as it is on disk, if the page has the same text."""
        posted = await _posted(request, verb=str, slug=str, mark=str, overwrite=bool)
        if posted["verb"] not in ("run", "fit"):
            raise InputError("a page may ask for run or fit")
        mark = self._desk.mark()
        if mark != posted["mark"]:
            what = "has changed on disk since it was read here" if mark else "is gone from disk; Save writes it again"
            raise OutputError(f"{self._desk.name}: {what}; nothing was run")
        folder = self._folder(posted["verb"], posted["slug"])
        return _lines(_as_lines(self._job.run(posted["verb"], self._desk.argument, folder, posted["overwrite"])))

    def _folder(self, verb: str, slug: str) -> Path:
        """Where a run is written, as the command would."""
        if self._output is not None:
            return self._output
        if not slug or slug != Path(slug).name or slug.startswith("."):
            raise InputError("a run folder needs the name of a mission")
        return default_folder(slug) if verb == "run" else Path(f"{slug}-fit")

    async def _stop(self, request: Request) -> Response:
        await _posted(request)
        await self._job.stop()
        return JSONResponse({})

    async def _report(self, request: Request) -> Response:
        """The page of the last run."""
        if self._job.report is None or not self._job.report.is_file():
            raise InputError("no run of this page has written a report yet")
        return FileResponse(
            self._job.report, media_type="text/html", headers={"content-security-policy": REPORT_POLICY}
        )


def serve(desk: Desk, output: Path | None, port: int, say: Callable[[str], None]) -> None:
    """Serve a page until a signal ends it.

    Parameters
    ----------
    port : 0 for a free one.
    say : called with the address, once it answers.

    Raises
    ------
    OutputError
        If the port cannot be had.
    KeyboardInterrupt
        When Ctrl-C or SIGTERM has ended it.
    """
    with _listening(port) as listening:
        number, token = listening.getsockname()[1], secrets.token_urlsafe(24)
        app = Guard(Workbench(desk, output).app(), token, number)
        config = uvicorn.Config(
            app, log_config=None, access_log=False, server_header=False, ws="none", lifespan="on",
            timeout_graceful_shutdown=1, timeout_keep_alive=30, h11_max_incomplete_event_size=32_768,
        )  # fmt: skip
        logging.getLogger("uvicorn").addHandler(logging.NullHandler())  # what it says of requests that were cut off
        server = _Server(config)
        server.begun = lambda: say(f"http://127.0.0.1:{number}/{token}/")
        server.run(sockets=[listening])
    raise KeyboardInterrupt  # where the signal that ended it is one this process was started without


class _Server(uvicorn.Server):
    """Tells when it answers."""

    begun: Callable[[], None]

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self.begun()


def _listening(port: int) -> socket.socket:
    """A socket of this machine alone."""
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(("127.0.0.1", port))
        made.listen(BACKLOG)
    except OSError as error:
        made.close()
        raise OutputError(f"port {port}: {error.strerror}; give another --port, or none for a free one") from None
    return made


def _file(name: str, kind: str) -> Callable[[Request], Response]:
    """What answers with a file of the page."""

    def answer(request: Request) -> Response:
        return Response((HERE / name).read_bytes(), media_type=kind)

    return answer


@cache
def _schemas() -> dict[str, Any]:
    return {"mission": mission_schema(), "fit": fit_schema()}


async def _posted(request: Request, **wanted: type) -> dict[str, Any]:
    """What a page has sent.

    Raises
    ------
    InputError
        If it is too large, or not what this address takes.
    """
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        raise InputError("this address takes JSON")
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > LARGEST_POST:
            raise InputError(f"the text is larger than {LARGEST_POST} bytes; a mission is a few kilobytes")
        parts.append(part)
    try:
        found = json.loads(b"".join(parts) or b"{}")
    except (ValueError, RecursionError):
        raise InputError("this address takes JSON") from None
    if not isinstance(found, dict) or any(type(found.get(key)) is not kind for key, kind in wanted.items()):
        raise InputError(f"this address takes {', '.join(wanted)}")
    return found


def _lines(messages: AsyncIterator[bytes]) -> Response:
    return StreamingResponse(messages, media_type="application/x-ndjson")


def _line(message: dict[str, Any]) -> bytes:
    return json.dumps(message).encode() + b"\n"


async def _as_lines(messages: AsyncIterator[dict[str, Any]]) -> AsyncIterator[bytes]:
    try:
        async for message in messages:
            yield _line(message)
    except NebosvodError as error:
        yield _line({"step": "refused", "text": str(error)})


def _said(request: Request, error: Exception) -> Response:
    """A refusal in a sentence."""
    return JSONResponse({"text": str(error)}, status_code=400)
