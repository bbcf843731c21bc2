"""Tasks in processes of this machine: the standard library's pool, started so that nothing of the user's gets in.

A worker is a fresh interpreter (`spawn`) that imports neither from the working directory nor the user's main module,
computes on one thread, so that a value does not depend on how many there are, and ends when its parent does, however
that ends: a pool of the standard library alone would leave workers behind that wait for ever.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any

from nebosvod.errors import WorkerError
from nebosvod.tasks.worker import ONE_THREAD, Answer, Job, perform

NAME_FILES = ("NEBOSVOD_EPHEMERIS", "NUMBA_CACHE_DIR")
ENDED_BY_POOL = (0, None, -int(signal.SIGTERM))  # exit codes of workers that did not end by themselves
PATIENCE = 2  # pools that break one after the other without a single task done
Done = Callable[[int, Any], None]


def run_local(job: Job, tasks: Iterable[int], workers: int, done: Done) -> None:
    """Do all tasks in processes; where a worker dies its task is given to another one.

    Raises
    ------
    WorkerError
        If workers die again and again.
    """
    waiting, broken = deque(tasks), 0
    while waiting:
        pool, before = _Pool(job, min(workers, len(waiting))), len(waiting)
        for task, answer in pool.answers(waiting):
            done(task, answer.taken())
        broken = 0 if len(waiting) < before else broken + 1
        if waiting and broken >= PATIENCE:
            raise WorkerError(
                f"a worker ended before its task was done (exit code {pool.exit_code}: killed, or out of memory, "
                "perhaps), and so did those that took its place; what is finished is kept; fewer --workers need less "
                "memory"
            )


class _Pool:
    """Some workers until the tasks are done or one of them dies.

    Attributes
    ----------
    exit_code : of the worker that died; None where the system does not say.
    """

    def __init__(self, job: Job, workers: int) -> None:
        self.exit_code: int | None = None
        self._job, self._workers = job, workers
        self._given: dict[Future[Answer], int] = {}
        self._broke = False

    def answers(self, waiting: deque[int]) -> Iterator[tuple[int, Answer]]:
        """Each task with its answer, as they come; where a worker dies it ends, and what was given out waits again."""
        strangers = {child.pid for child in multiprocessing.active_children()}
        with launching():
            pool = ProcessPoolExecutor(self._workers, multiprocessing.get_context("spawn"), begin)
        children: list[BaseProcess] = []
        try:
            while waiting or self._given:
                self._give(pool, waiting)
                children = [one for one in multiprocessing.active_children() if one.pid not in strangers] or children
                for future in wait(self._given, return_when=FIRST_COMPLETED).done:
                    task = self._given.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        self._broke = True
                        waiting.appendleft(task)
                    else:
                        yield task, future.result()
                if self._broke and not self._given:
                    return
        finally:
            self._end(pool, children)

    def _give(self, pool: ProcessPoolExecutor, waiting: deque[int]) -> None:
        """Keep each worker busy and one task waiting for it."""
        while waiting and not self._broke and len(self._given) < 2 * self._workers:
            try:
                with launching():
                    self._given[pool.submit(perform, self._job, waiting[0])] = waiting[0]
                waiting.popleft()
            except BrokenProcessPool:
                self._broke = True

    def _end(self, pool: ProcessPoolExecutor, children: Sequence[BaseProcess]) -> None:
        """End the workers: idle ones by themselves, all others by force."""
        if self._broke:
            for child in children:
                child.join(1.0)
            until = (
                time.monotonic() + 1.0
            )  # the pool's own thread waits for them too, and may be about to write it down
            while any(one.exitcode is None for one in children) and time.monotonic() < until:
                time.sleep(0.01)
            self.exit_code = next((one.exitcode for one in children if one.exitcode not in ENDED_BY_POOL), None)
        if self._broke or self._given:
            for child in children:
                child.kill()
        pool.shutdown(wait=True, cancel_futures=True)


def begin() -> None:
    """Prepare a worker: Ctrl-C is for its parent, nobody reads what it says, and without a parent it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


_launch = threading.Lock()


@contextmanager
def launching() -> Iterator[None]:
    """What a process started here inherits: environment, module path, no main module, and a blocked Ctrl-C.

    multiprocessing hands the path and the main module of the parent over; a script without a guard would run again in
    each worker, and the path may hold the working directory. The place of this package comes last, for a checkout that
    is not installed.
    """
    with _launch:
        kept, path, main = dict(os.environ), sys.path[:], sys.modules.get("__main__")
        signals = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            os.environ.update(dict.fromkeys(ONE_THREAD, "1"), PYTHONSAFEPATH="1")
            os.environ.update({name: os.path.abspath(kept[name]) for name in NAME_FILES if kept.get(name)})
            here = os.path.realpath(os.curdir)
            sys.path[:] = [one for one in path if one and os.path.realpath(one) != here]
            sys.path.append(str(Path(__file__).resolve().parents[2]))
            sys.modules["__main__"] = ModuleType("__main__")
            yield
        finally:
            sys.path[:] = path
            if main is not None:
                sys.modules["__main__"] = main
            for name in (*ONE_THREAD, *NAME_FILES, "PYTHONSAFEPATH"):
                if name in kept:
                    os.environ[name] = kept[name]
                else:
                    os.environ.pop(name, None)
            signal.pthread_sigmask(signal.SIG_SETMASK, signals)
