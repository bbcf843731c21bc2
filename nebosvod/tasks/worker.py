"""What a worker does: it opens a job once, and makes a value of each number it is given.

A job is named by a function and what it is called with, so that a worker on another machine finds it in its own
installation. A task is a pure function of the job and its number; which worker does it cannot change its value.
"""

import importlib
import json
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nebosvod import errors
from nebosvod.errors import NebosvodError, WorkerError
from nebosvod.version import __version__

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker opens.

    Attributes
    ----------
    opener : "module:function"; called with the argument, returns a function of a task number.
    argument : as JSON.
    version : of the program that asks.
    """

    opener: str
    argument: str
    version: str = __version__

    @classmethod
    def of(cls, opener: str, argument: Mapping[str, Any]) -> "Job":
        """A job from what can be written as JSON."""
        return cls(opener, json.dumps(dict(argument)))


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of one task: a value, or the class, message and traceback of an exception."""

    value: Any = None
    kind: str = ""
    message: str = ""
    trace: str = ""

    def taken(self) -> Any:
        """The value.

        Raises
        ------
        NebosvodError
            As the task raised it; RuntimeError with the worker's traceback for any other exception.
        """
        if not self.kind:
            return self.value
        kind = getattr(errors, self.kind, None)
        if isinstance(kind, type) and issubclass(kind, NebosvodError):
            raise kind(self.message)
        raise RuntimeError(f"in a worker:\n{self.trace}")


_opened: dict[Job, Callable[[int], Any]] = {}  # the job at hand
_one_at_a_time = (
    threading.Lock()
)  # a worker of a cluster may have several threads; the program has one for each process


def perform(job: Job, task: int) -> Answer:
    """Do one task; whatever goes wrong is an answer, too."""
    with _one_at_a_time:
        try:
            if job not in _opened:
                _require_same(job.version)
                _opened.clear()
                module, _, name = job.opener.partition(":")
                _opened[job] = getattr(importlib.import_module(module), name)(json.loads(job.argument))
            return Answer(_opened[job](task))
        except Exception as error:  # noqa: BLE001 - whatever it is, who asked must hear of it
            return Answer(None, type(error).__name__, str(error), traceback.format_exc())


def _require_same(version: str) -> None:
    if version != __version__:
        raise WorkerError(
            f"a worker has nebosvod {__version__}, and this is {version}: their numbers may differ; install one "
            "version on all machines"
        )
