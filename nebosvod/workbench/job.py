"""The run that a page has asked for: the program's own command in a process of its own, one at a time."""

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from nebosvod.errors import InputError
from nebosvod.tasks.worker import ONE_THREAD

BEAT_S = 1.0
PATIENCE_S = 10.0  # for a run that is stopped
LONGEST_SAID = 200_000  # letters of its answer that a page shows
Message = dict[str, Any]


class Job:
    """The run at hand, if any.

    Attributes
    ----------
    report : of the last run that wrote one.
    """

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self.report: Path | None = None

    @property
    def busy(self) -> bool:
        """Whether a run goes on."""
        return self._process is not None and self._process.returncode is None

    async def run(self, verb: str, mission: str, folder: Path, overwrite: bool) -> AsyncIterator[Message]:
        """Start `nebosvod run`, or `fit`; a message a second, then its exit code and words.

        It goes on to its end when nobody listens any more.

        Raises
        ------
        InputError
            If another run goes on.
        """
        if self.busy:
            raise InputError("another run goes on in this server; wait for it, or stop it")
        words = [verb, mission, "-o", str(folder), *(["--overwrite"] if overwrite else [])]
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-m", "nebosvod", *words,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONSAFEPATH": "1"},
        )  # fmt: skip
        started = time.monotonic()
        said = asyncio.ensure_future(process.communicate())
        said.add_done_callback(lambda done: self._ended(folder))
        while True:
            finished, _ = await asyncio.wait({said}, timeout=BEAT_S)
            if finished:
                break
            yield {"step": "running", "seconds": round(time.monotonic() - started, 1)}
        text = said.result()[0].decode("utf-8", "replace")[-LONGEST_SAID:]
        yield {"step": "ran", "code": process.returncode, "text": text, "report": self.report is not None}

    def _ended(self, folder: Path) -> None:
        """A run that ended by 0 or 1 has written its folder."""
        page = folder / "report.html"
        if self._process is not None and self._process.returncode in (0, 1) and page.is_file():
            self.report = page

    async def stop(self) -> None:
        """End the run at hand as Ctrl-C would: nothing half-written is left."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        try:
            await asyncio.wait_for(process.wait(), PATIENCE_S)
        except TimeoutError:
            with suppress(ProcessLookupError):
                process.kill()
