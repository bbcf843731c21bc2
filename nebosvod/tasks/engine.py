"""Where tasks are done: one call, whatever does them."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nebosvod.errors import InputError
from nebosvod.tasks.local import run_local
from nebosvod.tasks.worker import Job

MOST_WORKERS = 256  # processes of one machine
CLUSTERS = ("slurm",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Workers:
    """Who does the tasks: processes of this machine unless a scheduler or a cluster is named.

    Attributes
    ----------
    count : processes; of a cluster, jobs that are asked for.
    scheduler : address of a dask scheduler that runs, such as tcp://10.0.0.1:8786.
    cluster : what to start workers with.
    """

    count: int = 1
    scheduler: str = ""
    cluster: Literal["", "slurm"] = ""

    def __post_init__(self) -> None:
        if self.scheduler and self.cluster:
            raise InputError("--scheduler and --cluster: one of them says where to compute, not both")
        if not 1 <= self.count <= MOST_WORKERS and not self.cluster:
            raise InputError(f"--workers: is out of range (got {self.count}; allowed 1 to {MOST_WORKERS})")


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


def run_tasks(
    opener: str,
    argument: Mapping[str, Any],
    tasks: Iterable[int],
    workers: Workers,
    done: Callable[[int, Any], None] = lambda task, value: None,
) -> None:
    """Do all tasks; each is done once, in no particular order.

    Parameters
    ----------
    opener : "module:function"; called once in each worker with `argument`, returns a function of a task number.
    argument : what can be written as JSON.
    done : called in this process after each task with its number and its value.

    Raises
    ------
    NebosvodError
        As the first task that failed raised it; RuntimeError with the worker's traceback for any other.
    WorkerError
        If workers die again and again, or a scheduler does not answer.
    """
    job = Job.of(opener, argument)
    if workers.scheduler or workers.cluster:
        from nebosvod.tasks.cluster import run_on_cluster

        run_on_cluster(job, tasks, workers.scheduler, workers.count, done)
    else:
        run_local(job, tasks, workers.count, done)
