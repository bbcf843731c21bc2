"""Tasks on dask: a real scheduler with two workers, a real local cluster, and the script that Slurm would get."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from nebosvod.errors import GeometryError, InputError, WorkerError
from nebosvod.mission import Mission
from nebosvod.studies.reading import load_study_text
from nebosvod.studies.study import run_study
from nebosvod.studies.validation import validate
from nebosvod.tasks import cluster
from nebosvod.tasks.cluster import slurm_cluster
from nebosvod.tasks.engine import Workers, run_tasks
from nebosvod.tasks.worker import Job, perform

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # of dask's own threads

SCRIPT = """
import os, time
from nebosvod.errors import GeometryError
def open_squares(argument):
    def work(task):
        if task == argument.get("bad"):
            raise GeometryError("no such direction")
        if task == argument.get("death"):
            os._exit(9)
        time.sleep(argument.get("sleep", 0.0))
        return task * task
    return work
"""
OPENER = "squares_of_a_cluster:open_squares"


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
    return port


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., "subprocess.Popen[bytes]"]]:
    """Starts `dask` with some words, in a folder of its own."""
    place = tmp_path_factory.mktemp("dask")
    (place / "squares_of_a_cluster.py").write_text(SCRIPT, "utf-8")
    started: list[subprocess.Popen[bytes]] = []

    def begin(*words: str) -> "subprocess.Popen[bytes]":
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        started.append(subprocess.Popen(command, cwd=place, **quiet))  # type: ignore[call-overload]
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.wait()


WORKER = ("--nthreads", "1", "--no-dashboard", "--no-nanny")


@pytest.fixture(scope="module")
def scheduler(start: Callable[..., "subprocess.Popen[bytes]"]) -> str:
    """The address of a real scheduler with two workers."""
    port = free_port()
    start("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    address = f"tcp://127.0.0.1:{port}"
    for _ in range(2):
        start("worker", address, *WORKER)
    return address


def test_every_task_is_done_once_by_a_scheduler_with_two_workers(scheduler: str) -> None:
    answers: dict[int, Any] = {}
    run_tasks(OPENER, {}, range(40), Workers(scheduler=scheduler), answers.__setitem__)
    assert answers == {task: task * task for task in range(40)}


def test_an_error_of_the_program_comes_back_as_itself(scheduler: str) -> None:
    with pytest.raises(GeometryError, match="no such direction"):
        run_tasks(OPENER, {"bad": 3}, range(5), Workers(scheduler=scheduler))


def test_a_campaign_has_the_same_bytes_from_dask(scheduler: str, minimal: Mission, tmp_path: Path) -> None:
    validate(minimal, tmp_path / "local", runs=100, workers=1)
    validate(minimal, tmp_path / "dask", runs=100, workers=Workers(scheduler=scheduler))
    for name in ("validation.json", "chunks/000000.npz", "chunks/000001.npz"):
        assert (tmp_path / "local" / name).read_bytes() == (tmp_path / "dask" / name).read_bytes()


def test_a_study_has_the_same_bytes_from_dask(scheduler: str, tmp_path: Path) -> None:
    study = load_study_text(
        "schema_version: 1\nstudy: dask\nmission: minimal\n"
        "vary: {noise: {set: telescopes.*.noise.sigma, values: [0.1 arcsec, 0.2 arcsec, 0.4 arcsec, 0.8 arcsec]}}\n"
        "answer: [{name: later, of: predictions.ten days later.semi_axes_km.0}, {name: blame, of: state.budget}]\n"
    )
    for name, workers in (("local", Workers(count=1)), ("dask", Workers(scheduler=scheduler))):
        run_study(study, tmp_path / name, workers=workers)
    for name in ("study.json", "results.ecsv", "chunks/000000.npz", "chunks/000003.npz"):
        assert (tmp_path / "local" / name).read_bytes() == (tmp_path / "dask" / name).read_bytes(), name


def test_a_local_cluster_of_dask_serves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    answers: dict[int, Any] = {}
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as made:
        (tmp_path / "squares_of_a_cluster.py").write_text(SCRIPT, "utf-8")
        monkeypatch.syspath_prepend(str(tmp_path))
        run_tasks(OPENER, {}, range(9), Workers(scheduler=made.scheduler_address), answers.__setitem__)
    assert answers == {task: task * task for task in range(9)}


def test_a_scheduler_that_is_not_there_is_exit_3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises(WorkerError, match="does not answer within") as found:
        run_tasks(OPENER, {}, [1], Workers(scheduler=f"tcp://127.0.0.1:{free_port()}"))
    assert found.value.exit_code == 3


@pytest.mark.parametrize("address", ["nonsense://x", "tcp://[", "http://127.0.0.1:1"])
def test_what_is_no_address_is_said(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises((InputError, WorkerError), match="--scheduler: "):
        run_tasks(OPENER, {}, [1], Workers(scheduler=address))


def test_a_scheduler_that_dies_is_a_sentence_and_what_is_done_is_kept(
    start: Callable[..., "subprocess.Popen[bytes]"], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "QUIET_S", 1.5)
    port, answers = free_port(), dict[int, Any]()
    process = start("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    worker = start("worker", f"tcp://127.0.0.1:{port}", *WORKER, "--death-timeout", "3")

    def done(task: int, value: Any) -> None:
        answers[task] = value
        process.kill()

    began = time.monotonic()
    with pytest.raises(WorkerError, match="does not answer any more; what is finished is kept"):
        run_tasks(OPENER, {"sleep": 0.1}, range(1000), Workers(scheduler=f"tcp://127.0.0.1:{port}"), done)
    assert answers[0] == 0
    assert time.monotonic() - began < 30
    worker.kill()


def test_workers_with_another_version_are_refused() -> None:
    answer = perform(Job(OPENER, "{}", "0.0.1"), 3)
    with pytest.raises(WorkerError, match=r"a worker has nebosvod .*, and this is 0\.0\.1"):
        answer.taken()


def test_the_script_for_slurm_starts_one_thread_and_imports_nothing_from_its_folder() -> None:
    pytest.importorskip("dask_jobqueue")
    with slurm_cluster(2) as made:
        script = made.job_script()
    assert "#SBATCH -n 1\n" in script
    assert "#SBATCH --cpus-per-task=1\n" in script
    assert "#SBATCH --mem=2G\n" in script
    assert "#SBATCH -t 04:00:00\n" in script
    assert "#SBATCH -J nebosvod\n" in script
    assert "export PYTHONSAFEPATH=1\n" in script
    assert "export OPENBLAS_NUM_THREADS=1\n" in script
    assert "distributed.cli.dask_worker tcp://" in script
    assert "--nthreads 1 " in script
