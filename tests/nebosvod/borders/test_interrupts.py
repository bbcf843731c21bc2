"""An interrupt is never lost, and its exit code is 130: 6 of 50 runs ended by 0 or by SIGINT."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nebosvod import cli
from nebosvod.borders.interrupts import interruptible


class Ends:
    """Something whose end a signal meets; what is raised there, Python prints and forgets."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def _ends_and_waits(until: float) -> None:
    """Have a signal come where it is lost, then wait for it."""
    with interruptible():
        Ends()
        while time.monotonic() < until:
            time.sleep(0.01)


def test_an_interrupt_that_was_swallowed_comes_again() -> None:
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        _ends_and_waits(began + 10.0)
    assert time.monotonic() < began + 5.0


def test_the_handlers_of_the_host_come_back() -> None:
    before = signal.getsignal(signal.SIGTERM), sys.unraisablehook
    with interruptible():
        assert signal.getsignal(signal.SIGTERM) is not before[0]
    assert (signal.getsignal(signal.SIGTERM), sys.unraisablehook) == before


@pytest.mark.parametrize("code", [0, 3, 130])
def test_the_exit_code_is_ours_though_the_interrupt_left_code_that_was_run_from_text(code: int, tmp_path: Path) -> None:
    """CPython remembers it and ends `python -m` by SIGINT, whatever code sys.exit is given."""
    script = f"""
from nebosvod.borders.interrupts import end
try:
    exec("raise KeyboardInterrupt" if {code} == 130 else "pass")
except KeyboardInterrupt:
    print("interrupted")
end({code})
"""
    (tmp_path / "ended.py").write_text(script)
    command = [sys.executable, "-m", "ended"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == code
    assert done.stdout == ("interrupted\n" if code == 130 else "")


def test_what_fails_of_a_swallowed_interrupt_is_no_internal_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A compiler that was broken into says that it has no code: a crash file was written, and a traceback shown."""

    def compiles(argv: object) -> int:
        Ends()
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(cli, "_invoke", compiles)
    assert cli.main(["version"]) == 130
    assert capsys.readouterr().err == "interrupted; nothing half-written is left\n"


def test_an_interrupt_while_a_failure_is_told_ends_by_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def writes(argv: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    def fails(argv: object) -> int:
        raise RuntimeError("anything")

    monkeypatch.setattr(cli, "_invoke", fails)
    monkeypatch.setattr(cli, "_crash_file", writes)
    assert cli.main(["version"]) == 130
    assert capsys.readouterr().err == "interrupted; nothing half-written is left\n"
