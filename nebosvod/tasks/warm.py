"""Processes that stay warm for somebody who waits: a request, then messages; a stale one is ended by force.

What such a process has imported, compiled and computed serves its next request. A request that nobody waits for any
more may end by itself for a moment; after that its process is killed and another takes its place, so that no
computation, however long, stands in the way of the next, and none that kills its process takes more with it.
"""

import asyncio
import importlib
import json
import multiprocessing
import threading
import traceback
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from nebosvod.errors import WorkerError
from nebosvod.tasks.local import begin, launching

GRACE_S = 0.7  # for a request that nobody waits for
COLD_S = 30.0  # the same for the first of a process, which loads what all others need
WARM = {"verb": "warm"}  # a request that asks for nothing else
Message = dict[str, Any]
Serve = Callable[[Mapping[str, Any]], Iterator[Message]]


def _serve(opener: str, pipe: Connection) -> None:
    """The life of a process: whatever goes wrong with a request is a message, too."""
    begin()
    module, _, name = opener.partition(":")
    serve: Serve = getattr(importlib.import_module(module), name)()
    while True:
        try:
            request = json.loads(pipe.recv_bytes())
        except (EOFError, OSError):
            return
        try:
            for message in serve(request):
                pipe.send_bytes(json.dumps(message).encode())
        except Exception as error:  # noqa: BLE001 - whatever it is, who asked must hear of it
            broken = {"step": "broken", "text": f"{type(error).__name__}: {error}", "trace": traceback.format_exc()}
            pipe.send_bytes(json.dumps(broken).encode())
        pipe.send_bytes(b"")


class _Process:
    """One of them, and a thread that listens to it.

    Attributes
    ----------
    warm : it has done something before.
    """

    def __init__(self, opener: str, loop: asyncio.AbstractEventLoop) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._said: asyncio.Queue[bytes | None] = asyncio.Queue()
        self._loop, self.warm = loop, False
        with launching():
            self._process = context.Process(target=_serve, args=(opener, theirs), daemon=True)
            self._process.start()
        theirs.close()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        said: bytes | None = b""
        while said is not None:
            try:
                said = self._pipe.recv_bytes()
            except (EOFError, OSError):
                self._process.join(2.0)  # it closes its end before it has ended, and its exit code is to be told
                said = None
            with suppress(RuntimeError):  # the loop is closed: nobody waits for anything any more
                self._loop.call_soon_threadsafe(self._said.put_nowait, said)

    async def messages(self, request: Mapping[str, Any]) -> AsyncGenerator[bytes, None]:
        """What it says to a request, as JSON.

        Raises
        ------
        WorkerError
            If it ends before it is done.
        """
        with suppress(OSError):  # it ended: the thread has heard so
            self._pipe.send_bytes(json.dumps(dict(request)).encode())
        async for said in self.rest():
            yield said

    async def rest(self) -> AsyncGenerator[bytes, None]:
        """What it still says."""
        while (said := await self._said.get()) != b"":
            if said is None:
                self._said.put_nowait(None)  # whoever asks again is told again
                raise WorkerError(
                    f"the process that computes ended (exit code {self._process.exitcode}: killed, or out of memory, "
                    "perhaps); the next change is computed by another one"
                )
            yield said

    def end(self) -> None:
        """Kill it."""
        self._process.kill()
        self._process.join(5.0)
        self._pipe.close()


class WarmProcesses:
    """Some of them, all alike.

    Parameters
    ----------
    opener : "module:function"; called once in each process, gives what answers a request by messages.
    count : how many; with two, one is ready while another is busy with something stale.
    """

    def __init__(self, opener: str, count: int = 2) -> None:
        self._opener, self._count = opener, count
        self._idle: asyncio.Queue[_Process] = asyncio.Queue()
        self._all: set[_Process] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def _begin(self) -> _Process:
        one = _Process(self._opener, asyncio.get_running_loop())
        self._all.add(one)
        return one

    def end(self) -> None:
        """Kill them all."""
        for one in self._all:
            one.end()
        self._all.clear()
        self._count = 0

    async def messages(self, request: Mapping[str, Any]) -> AsyncGenerator[bytes, None]:
        """What one of them says to a request, each message as JSON; to be closed when nobody waits any more.

        Raises
        ------
        WorkerError
            If the process ends before it is done.
        """
        if self._idle.empty() and len(self._all) < self._count:
            self._idle.put_nowait(self._begin())
        one = await self._idle.get()
        finished = False
        try:
            async for said in one.messages(request):
                yield said
            finished = True
        finally:
            if finished:
                self._back(one)
            else:
                self._later(self._leave(one))

    def _back(self, one: _Process) -> None:
        """It is done: warm, and ready for the next; the first time, another is made that will be."""
        one.warm = True
        self._idle.put_nowait(one)
        if len(self._all) < self._count:
            self._later(self._leave(self._begin(), WARM))

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _leave(self, one: _Process, request: Mapping[str, Any] | None = None) -> None:
        """Let it finish what nobody waits for, within a moment; else another takes its place."""
        try:
            async with asyncio.timeout(GRACE_S if one.warm else COLD_S):
                async for _ in one.rest() if request is None else one.messages(request):
                    pass
        except (TimeoutError, WorkerError):
            if one in self._all:
                self._all.discard(one)
                one.end()
                if request is None:  # one that cannot even begin is tried again when somebody waits
                    await self._leave(self._begin(), WARM)
        else:
            self._back(one)
