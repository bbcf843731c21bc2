"""Tasks in worker processes: all of them once, errors as they were raised, nobody left behind."""

import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from nebosvod.errors import GeometryError, InputError
from nebosvod.studies.executor import run_tasks, serve

SCRIPT = """
import os
from nebosvod.errors import GeometryError
def open_squares(argument):
    def work(task):
        if task == argument.get("bad"):
            raise GeometryError("no such direction")
        if task == argument.get("bug"):
            return 1 / 0
        if task == argument.get("death"):
            os._exit(9)
        return {"square": task * task, "threads": os.environ["OPENBLAS_NUM_THREADS"]}
    return work
"""


@pytest.fixture
def opener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module that workers can import."""
    (tmp_path / "squares_for_workers.py").write_text(SCRIPT, "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "squares_for_workers:open_squares"


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_task_is_done_once_on_one_thread(opener: str, workers: int) -> None:
    answers: dict[int, Any] = {}

    def done(task: int, answer: Any) -> None:
        assert task not in answers
        answers[task] = answer

    run_tasks(opener, {}, range(7), workers, done)
    assert answers == {task: {"square": task * task, "threads": "1"} for task in range(7)}


def test_no_tasks_start_no_worker() -> None:
    run_tasks("no_such_module:f", {}, [], 2)


def test_an_error_of_the_program_comes_back_as_itself(opener: str) -> None:
    with pytest.raises(GeometryError, match="no such direction"):
        run_tasks(opener, {"bad": 1}, range(3), 2)


def test_any_other_error_comes_back_with_its_traceback(opener: str) -> None:
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        run_tasks(opener, {"bug": 0}, range(3), 1)


def test_an_opener_that_fails_is_an_error(opener: str) -> None:
    with pytest.raises(RuntimeError, match="no_such_module"):
        run_tasks("no_such_module:f", {}, range(2), 1)


def test_a_worker_that_dies_is_an_error_and_not_a_hang(opener: str) -> None:
    with pytest.raises(RuntimeError, match="exit code 9"):
        run_tasks(opener, {"death": 1}, range(4), 2)


def test_a_worker_ends_when_its_parent_does(opener: str) -> None:
    """The end of input is all a worker ever learns of a parent that was killed."""
    worker = subprocess.Popen(
        [sys.executable, "-m", "nebosvod.studies.executor"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(json.dumps({"opener": opener, "argument": {}}) + "\n3\n")
    worker.stdin.flush()
    assert json.loads(worker.stdout.readline())["value"]["square"] == 9
    worker.stdin.close()
    started = time.monotonic()
    assert worker.wait(timeout=10) == 0
    assert time.monotonic() - started < 10
    worker.stdout.close()


def test_what_is_served_is_one_line_for_each_task(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(argument: Mapping[str, Any]) -> Callable[[int], Any]:
        def work(task: int) -> Any:
            if task == 2:
                raise InputError("two is too many")
            return task + argument["add"]

        return work

    monkeypatch.setattr("nebosvod.studies.executor._exception", opened)  # any attribute of any module can be opened
    lines = io.StringIO(
        json.dumps({"opener": "nebosvod.studies.executor:_exception", "argument": {"add": 10}}) + "\n1\n2\n3\n"
    )
    out = io.StringIO()
    serve(lines, out)
    answers = [json.loads(line) for line in out.getvalue().splitlines()]
    assert answers[0] == {"value": 11}
    assert answers[1]["kind"] == "InputError"
    assert answers[1]["message"] == "two is too many"
    assert answers[2] == {"value": 13}
    serve(io.StringIO(""), out)


@pytest.mark.parametrize("answer", ["hello", "[]", '{"square": 4}', '{"kind": 3}'])
def test_an_answer_that_is_none_is_an_error_and_not_a_hang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    babbler = tmp_path / "babbler"
    babbler.write_text(
        f"#!{sys.executable}\nimport sys\nfor line in sys.stdin: print({answer!r}, flush=True)\n", "utf-8"
    )
    babbler.chmod(0o755)
    monkeypatch.setattr("nebosvod.studies.executor.sys.executable", str(babbler))
    with pytest.raises(RuntimeError, match="a worker answered"):
        run_tasks("any:thing", {}, [1], 1)
