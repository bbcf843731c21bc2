"""Tasks on a dask cluster: a scheduler that runs, or jobs of Slurm that are started for it.

dask is an extra (`nebosvod[cluster]`). Workers need the same version of this program and the input files at the same
paths; values come back to the process that asked, which alone writes. Nothing is kept that the local engine does not
keep: it is the same function of a number.
"""

import logging
import os
import queue
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from nebosvod.errors import DataError, InputError, WorkerError
from nebosvod.tasks.worker import ONE_THREAD, Answer, Job, perform

CONNECT_S = 15.0  # for a scheduler to answer
QUIET_S = 20.0  # without a connection, before it is given up
WORKERS_S = 30.0  # for the first worker of a scheduler that was named
LOOK_S = 2.0  # between looks at how many workers there are
AHEAD = 3  # tasks in the hands of the scheduler for each thread of a worker
INSTALL = "install it with: pip install 'nebosvod[cluster]'"
Done = Callable[[int, Any], None]


def run_on_cluster(job: Job, tasks: Iterable[int], scheduler: str, jobs: int, done: Done) -> None:
    """Do all tasks on the workers of a scheduler; without an address, on jobs of Slurm.

    Raises
    ------
    DataError
        If dask is not installed.
    WorkerError
        If the scheduler does not answer, has no workers, or is gone before all tasks are done.
    """
    with _quiet(), _connected(scheduler) if scheduler else _slurm(jobs) as client:
        _share_out(client, job, iter(tasks), scheduler or "of this cluster", done)


def slurm_cluster(jobs: int) -> Any:
    """A dask_jobqueue.SLURMCluster for single-threaded workers; its queue, account and limits are the user's settings.

    Notes
    -----
    dask-jobqueue reads `~/.config/dask/jobqueue.yaml`; what is not said there is one core, 2 GB and four hours. Each
    job is one process on one core, so that the queue can fill gaps. The script keeps the working directory off the
    module path, as the local engine does.
    """
    try:
        import dask
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise DataError(f"--cluster slurm: needs dask-jobqueue, which is not here; {INSTALL}") from None
    own = {key: value for key, value in (dask.config.get("jobqueue.slurm", None) or {}).items() if value is not None}
    settings = {
        "cores": 1,
        "processes": 1,
        "memory": own.get("memory", "2GB"),
        "walltime": "04:00:00" if own.get("walltime", "00:30:00") == "00:30:00" else own["walltime"],
        "job_name": "nebosvod",
        "job_script_prologue": [
            *own.get("job-script-prologue", ()),
            "export PYTHONSAFEPATH=1",
            *(f"export {name}=1" for name in ONE_THREAD),
            *(f"export {name}={os.path.abspath(path)}" for name in _FILES if (path := os.environ.get(name))),
        ],
    }
    return SLURMCluster(**settings)


_FILES = ("NEBOSVOD_EPHEMERIS",)


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """A client of a scheduler that runs, with at least one worker."""
    try:
        from distributed import Client
    except ImportError:
        raise DataError(f"--scheduler: needs dask.distributed, which is not here; {INSTALL}") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError):
        raise WorkerError(
            f"--scheduler: {address}: does not answer within {CONNECT_S:.0f} s; is it running, and is this machine "
            "allowed to reach it? Start one with: dask scheduler"
        ) from None
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"--scheduler: is no address (got {address}; such as tcp://10.0.0.1:8786): {error}") from None
    try:
        _await_workers(client, address)
        yield client
    finally:
        client.close(timeout=5.0)


def _await_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        raise WorkerError(
            f"--scheduler: {address}: has no workers after {WORKERS_S:.0f} s; start some with: "
            f"dask worker {address} --nthreads 1"
        ) from None


@contextmanager
def _slurm(jobs: int) -> Iterator[Any]:
    """A client of a cluster that is started for it; jobs may wait in the queue as long as they have to."""
    from distributed import Client

    if shutil.which("sbatch") is None:  # dask_jobqueue would wait for ever for jobs that were not submitted
        raise WorkerError("--cluster slurm: there is no sbatch here; start this where Slurm's commands are")
    try:
        cluster = slurm_cluster(jobs)
        cluster.scale(jobs=jobs)
    except (OSError, RuntimeError, ValueError) as error:
        raise WorkerError(f"--cluster slurm: cannot be started: {error}") from None
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


def _share_out(client: Any, job: Job, tasks: Iterator[int], address: str, done: Done) -> None:
    """Keep some tasks for each worker with the scheduler, and take the values as they come."""
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    given: dict[Any, int] = {}
    last_heard = time.monotonic()
    most, look = AHEAD, 0.0
    try:
        while True:
            if time.monotonic() >= look and client.status == "running":
                most, look = AHEAD * max(1, sum(client.nthreads().values())), time.monotonic() + LOOK_S
            while len(given) < most and (task := next(tasks, None)) is not None:
                future = client.submit(perform, job, task, pure=False, retries=2)
                given[future] = task
                future.add_done_callback(finished.put)
            if not given:
                return
            last_heard = time.monotonic() if client.status == "running" else last_heard
            if time.monotonic() - last_heard > QUIET_S or client.status == "closed":
                raise _gone(address)
            try:
                future = finished.get(timeout=1.0)
            except queue.Empty:
                continue
            done(given.pop(future), _value(future, address))
    finally:
        for future in given:
            future.release()


def _value(future: Any, address: str) -> Any:
    """The value of a task, or what went wrong with it."""
    if future.status != "finished":
        if future.status in ("cancelled", "lost"):
            raise _gone(address)
        error = future.exception()
        raise WorkerError(
            f"a worker of the scheduler {address} could not do its task: {type(error).__name__}: {error}; all of them "
            "need the same nebosvod and enough memory; what is finished is kept, and the same command goes on"
        )
    answer: Answer = future.result()
    return answer.taken()


def _gone(address: str) -> WorkerError:
    return WorkerError(
        f"the scheduler {address} does not answer any more; what is finished is kept, and the same command goes on "
        "when it is there again"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """dask reports lost connections as tracebacks of its own; the sentence of the error is enough."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels):
            logger.setLevel(level)
