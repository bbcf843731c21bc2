"""Tasks in processes: all of them once, errors as they were raised, nobody left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from nebosvod.errors import GeometryError, InputError, WorkerError
from nebosvod.tasks.engine import Workers, run_tasks

SCRIPT = """
import os
from pathlib import Path
from nebosvod.errors import GeometryError
def open_squares(argument):
    def work(task):
        if task == argument.get("bad"):
            raise GeometryError("no such direction")
        if task == argument.get("bug"):
            return 1 / 0
        if task == argument.get("death") or (task == argument.get("once") and first(argument["mark"])):
            os._exit(9)
        return {"square": task * task, "threads": os.environ["OPENBLAS_NUM_THREADS"]}
    return work
def first(mark):
    if Path(mark).exists():
        return False
    Path(mark).touch()
    return True
"""


@pytest.fixture
def opener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module that workers can import."""
    (tmp_path / "squares_for_workers.py").write_text(SCRIPT, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "squares_for_workers:open_squares"


@pytest.mark.parametrize("workers", [1, 3])
def test_every_task_is_done_once_on_one_thread(opener: str, workers: int) -> None:
    answers: dict[int, Any] = {}

    def done(task: int, answer: Any) -> None:
        assert task not in answers
        answers[task] = answer

    run_tasks(opener, {}, range(17), Workers(count=workers), done)
    assert answers == {task: {"square": task * task, "threads": "1"} for task in range(17)}


def test_no_tasks_start_no_worker() -> None:
    run_tasks("no_such_module:f", {}, [], Workers(count=2))


def test_an_error_of_the_program_comes_back_as_itself(opener: str) -> None:
    with pytest.raises(GeometryError, match="no such direction"):
        run_tasks(opener, {"bad": 1}, range(3), Workers(count=2))


@pytest.mark.parametrize(("opened", "said"), [("", "ZeroDivisionError"), ("no_such_module:f", "no_such_module")])
def test_any_other_error_comes_back_with_its_traceback(opener: str, opened: str, said: str) -> None:
    with pytest.raises(RuntimeError, match=said):
        run_tasks(opened or opener, {"bug": 0}, range(3), Workers(count=1))


def test_the_task_of_a_worker_that_dies_is_done_by_another(opener: str, tmp_path: Path) -> None:
    answers: dict[int, Any] = {}
    argument = {"once": 3, "mark": str(tmp_path / "mark")}
    run_tasks(opener, argument, range(8), Workers(count=2), answers.__setitem__)
    assert (tmp_path / "mark").exists()
    assert sorted(answers) == list(range(8))


def test_workers_that_die_again_and_again_are_an_error_and_not_a_hang(opener: str) -> None:
    answers: dict[int, Any] = {}
    with pytest.raises(WorkerError, match="exit code 9") as found:
        run_tasks(opener, {"death": 1}, range(4), Workers(count=1), answers.__setitem__)
    assert found.value.exit_code == 3
    assert 0 in answers


SLEEPING = """
import os, sys, time
from pathlib import Path
def open_sleep(argument):
    def work(task):
        Path(argument["folder"], str(os.getpid())).touch()
        time.sleep(60)
    return work
"""
PARENT = """
import sys
sys.path.append(sys.argv[1])
from nebosvod.tasks.engine import Workers, run_tasks
run_tasks("sleeping_workers:open_sleep", {"folder": sys.argv[2]}, range(4), Workers(count=2))
"""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text("utf-8").rpartition(")")[2].split()[0] != "Z"


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_when_their_parent_does(tmp_path: Path, how: signal.Signals) -> None:
    """The parent is a script without a guard: it is not run again by its workers."""
    (tmp_path / "sleeping_workers.py").write_text(SLEEPING, "utf-8")
    (tmp_path / "pids").mkdir()
    (tmp_path / "parent.py").write_text(PARENT, "utf-8")
    command = [sys.executable, str(tmp_path / "parent.py"), str(tmp_path), str(tmp_path / "pids")]
    parent = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 30
    while len(list((tmp_path / "pids").iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    pids = [int(one.name) for one in (tmp_path / "pids").iterdir()]
    assert len(pids) == 2
    parent.send_signal(how)
    parent.wait(timeout=10)
    while any(alive(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(alive(pid) for pid in pids)


def test_nothing_of_the_parents_environment_is_left_changed(opener: str) -> None:
    before = dict(os.environ), sys.path[:], sys.modules["__main__"]
    run_tasks(opener, {}, range(2), Workers(count=1))
    assert (dict(os.environ), sys.path[:], sys.modules["__main__"]) == before


@pytest.mark.parametrize("asked", [{"count": 0}, {"count": 257}, {"scheduler": "tcp://x:1", "cluster": "slurm"}])
def test_workers_that_cannot_be_are_wrong_input(asked: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"--workers|--scheduler"):
        Workers(**asked)
