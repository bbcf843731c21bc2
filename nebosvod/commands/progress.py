"""What a command says on stderr while it works, if that is a terminal: where it is, and every two seconds that it is
still there."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

QUIET_S = 1.5  # without a word; looked at four times as often, so that nothing is silent for two seconds


@contextmanager
def heard(tell: Callable[[str, float], None], quiet_s: float = QUIET_S) -> Iterator[Callable[[str], None]]:
    """A function that takes a line on what is being done; it is told at once, and again while it lasts.

    Parameters
    ----------
    tell : called with the line and the seconds it has lasted: 0 at first, then whenever `quiet_s` have passed.
    """
    lock, over = threading.Lock(), threading.Event()
    now: list[tuple[str, float]] = []  # the line, and since when
    last = time.monotonic()

    def say(line: str) -> None:
        nonlocal last
        with lock:
            last = time.monotonic()
            now[:] = [(line, last)]
            tell(line, 0.0)

    def beat() -> None:
        nonlocal last
        while not over.wait(quiet_s / 4.0):
            with lock:
                if now and not over.is_set() and time.monotonic() - last >= quiet_s:
                    last = time.monotonic()
                    tell(now[0][0], last - now[0][1])

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield say
    finally:
        over.set()
        thread.join()


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """A function that shows one line for each stage on stderr; it says nothing where that is no terminal."""
    if not sys.stderr.isatty():
        yield lambda line: None
        return
    with heard(lambda line, so_far_s: click.echo(f"  {line}{_lasting(so_far_s)}", err=True)) as say:
        say("reading the input")
        yield say


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """A function (done, all) that keeps one line on stderr, if that is a terminal; silent otherwise."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    started: list[tuple[float, int]] = []

    def show(line: str, so_far_s: float) -> None:
        click.echo(f"\r\x1b[K  {line}{_lasting(so_far_s)}", nl=False, err=True)

    with heard(show) as say:

        def count(done: int, total: int) -> None:
            now = time.monotonic()
            if not started:
                started.append((now, done))
            rate = (done - started[0][1]) / max(now - started[0][0], 1e-9)
            left = f", {(total - done) / rate:.0f} s left" if rate > 0.0 and done < total else ""
            say(f"{done} of {total} {what}{left}")

        try:
            say("reading the input")
            yield count
        except KeyboardInterrupt:
            click.echo("\n  finished runs are kept; the same command continues", err=True)
            raise
    click.echo("\r\x1b[K", nl=False, err=True)


def _lasting(so_far_s: float) -> str:
    return f" ({so_far_s:.0f} s)" if so_far_s > 0.0 else ""
