"""Tasks shared out to worker processes: results as they come, nothing left behind when anything dies.

A worker is a Python that runs this module: it reads one line that says what to open, then one task number a line, and
answers each with a line. When the parent dies, however it dies, the pipe closes and the worker ends after its task.
Workers compute on one thread each, so that a result does not depend on how many there are.
"""

import importlib
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, Any

from nebosvod import errors
from nebosvod.errors import NebosvodError

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
NAME_FILES = ("NEBOSVOD_EPHEMERIS", "NUMBA_CACHE_DIR")
BEGIN = (
    "import runpy, sys; sys.path.append(sys.argv[1]); "
    "runpy.run_module('nebosvod.studies.executor', run_name='__main__')"
)
Reply = tuple[int, Any] | Exception | None


def run_tasks(
    opener: str,
    argument: Mapping[str, Any],
    tasks: Iterable[int],
    workers: int,
    done: Callable[[int, Any], None] = lambda task, answer: None,
) -> None:
    """Do all tasks in worker processes; each task is done by one of them, in no particular order.

    Parameters
    ----------
    opener : "module:function"; called once in each worker with `argument`, returns a function of a task number
        whose value, if any, can be written as JSON.
    done : called in this process after each task with its number and the answer.

    Raises
    ------
    NebosvodError
        As the first task that failed raised it; RuntimeError with the worker's traceback for any other.
    """
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    count = 0
    for count, task in enumerate(tasks, start=1):  # noqa: B007
        waiting.put(task)
    replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()
    first_line = json.dumps({"opener": opener, "argument": dict(argument)}) + "\n"
    own = tempfile.TemporaryDirectory(prefix="nebosvod-workers-", ignore_cleanup_errors=True)
    processes = [_start(own.name) for _ in range(min(workers, count))]
    threads = [
        threading.Thread(target=_feed, args=(process, first_line, waiting, replies), daemon=True)
        for process in processes
    ]
    try:
        for thread in threads:
            thread.start()
        for _ in range(count):
            reply = replies.get()
            if isinstance(reply, Exception):
                raise reply
            if reply is not None:
                done(*reply)
    finally:
        for process in processes:
            process.kill()
        for process, thread in zip(processes, threads):
            process.wait()
            if thread.ident is not None:
                thread.join()
            _close(process)
        own.cleanup()


def _start(folder: str) -> "subprocess.Popen[str]":
    """A worker in a session of its own: Ctrl-C reaches the parent alone, which then ends its workers.

    It starts in an empty folder and with `-P`: no file of the user's working directory can pass for a module. The
    place of this package comes last on its path, for a checkout that is not installed.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-c", BEGIN, str(Path(__file__).resolve().parents[2])],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
        env=os.environ | _absolute(os.environ) | dict.fromkeys(ONE_THREAD, "1"),
        start_new_session=True,
    )


def _absolute(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables that name files, as they are meant in the parent's folder."""
    return {name: os.path.abspath(environment[name]) for name in NAME_FILES if environment.get(name)}


def _close(process: "subprocess.Popen[str]") -> None:
    """Close both pipes; the worker may be gone."""
    for pipe in (process.stdin, process.stdout):
        try:
            if pipe is not None:
                pipe.close()
        except OSError:
            continue


def _feed(
    process: "subprocess.Popen[str]",
    first_line: str,
    waiting: "queue.SimpleQueue[int]",
    replies: "queue.SimpleQueue[Reply]",
) -> None:
    """Give one worker task after task; runs in a thread of the parent."""
    message = first_line
    while True:
        try:
            task = waiting.get_nowait()
        except queue.Empty:
            return
        answer = _ask(process, message + f"{task}\n")
        message = ""
        if isinstance(answer, Exception):
            replies.put(answer)
            return
        replies.put((task, answer))


def _ask(process: "subprocess.Popen[str]", message: str) -> Any:
    """Send a task, wait for the answer: its value, or the exception to raise."""
    if process.stdin is None or process.stdout is None:
        return RuntimeError("a worker has no pipes")
    try:
        process.stdin.write(message)
        process.stdin.flush()
        line = process.stdout.readline()
    except (OSError, ValueError):
        line = ""
    if not line:
        code = process.wait()
        return RuntimeError(f"a worker ended before its task was done (exit code {code}); out of memory, perhaps")
    try:
        answer = json.loads(line)
        return answer["value"] if "value" in answer else _exception(answer)
    except (ValueError, KeyError, TypeError) as error:  # an error in this thread would leave the parent waiting
        return RuntimeError(f"a worker answered {line[:200]!r}: {error!r}")


def _exception(answer: Mapping[str, str]) -> Exception:
    """The worker's exception in this process."""
    kind = getattr(errors, answer["kind"], None)
    if isinstance(kind, type) and issubclass(kind, NebosvodError):
        return kind(answer["message"])
    return RuntimeError(f"in a worker:\n{answer['traceback']}")


def serve(lines: IO[str], out: IO[str]) -> None:
    """Work for a parent: the first line says what to open, each further one is a task."""
    first = lines.readline()
    if not first:
        return
    try:
        asked = json.loads(first)
        module, _, name = asked["opener"].partition(":")
        work: Callable[[int], Any] | None = getattr(importlib.import_module(module), name)(asked["argument"])
        failure: dict[str, str] = {}
    except Exception as error:  # noqa: BLE001 - whatever it is, the parent must hear of it
        work, failure = None, _described(error)
    for line in lines:
        answer: dict[str, Any] = failure
        if work is not None:
            try:
                answer = {"value": work(int(line))}
            except Exception as error:  # noqa: BLE001
                answer = _described(error)
        out.write(json.dumps(answer) + "\n")
        out.flush()


def _described(error: Exception) -> dict[str, str]:
    return {"kind": type(error).__name__, "message": str(error), "traceback": traceback.format_exc()}


if __name__ == "__main__":
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing else may speak on the pipe
    serve(sys.stdin, answers)
