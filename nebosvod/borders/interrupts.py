"""Ctrl-C and SIGTERM: one exception for both, one exit code, and none that is lost on the way."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

EXIT_INTERRUPTED = 130
AGAIN_S = 0.02


def _interrupt(signum: int, frame: object) -> NoReturn:
    """SIGTERM is handled like Ctrl-C, so that nothing half-written is left."""
    raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Both signals raise KeyboardInterrupt inside, and do so again where that was swallowed.

    A signal may meet a library's callback or the end of an object: Python prints such an exception and goes on. The
    event that is given is set then: what fails next may have failed of it.
    """
    lost = threading.Event()
    try:
        before = signal.signal(signal.SIGTERM, _interrupt)
    except ValueError:  # not in the main thread: signals are the host program's business
        yield lost
        return
    lock, over, shown = threading.Lock(), threading.Event(), sys.unraisablehook

    def again() -> None:
        with lock:
            if not over.is_set():
                signal.raise_signal(signal.SIGTERM)

    def swallowed(told: "sys.UnraisableHookArgs") -> None:
        if not issubclass(told.exc_type, KeyboardInterrupt):
            shown(told)
            return
        lost.set()
        timer = threading.Timer(AGAIN_S, again)
        timer.daemon = True
        timer.start()

    sys.unraisablehook = swallowed
    try:
        yield lost
    finally:
        with lock:
            over.set()
        sys.unraisablehook = shown
        signal.signal(signal.SIGTERM, before)


def end(code: int) -> NoReturn:
    """End the process with an exit code, after an interrupt as well.

    Where an interrupt leaves code that a library runs from text (a named tuple, a compiler), Python remembers it and
    would end by SIGINT whatever it is told.
    """
    if code == EXIT_INTERRUPTED:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(code)
    sys.exit(code)
