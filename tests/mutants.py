"""What the scripts share that try damaged files by the thousand: the limits of one mutant, the count, changed text."""

import json
import random
import resource
import signal
import sys
from collections import Counter
from collections.abc import Callable, Sequence

LIMIT_BYTES, LIMIT_S = 1_000_000_000, 20


class TooLong(BaseException):
    """Raised by the alarm; nothing that catches Exception may swallow it."""


def _alarm(signum: int, frame: object) -> None:
    raise TooLong


def limit(kind: int = resource.RLIMIT_AS) -> None:
    """Limit the memory of this process: all of it, or by RLIMIT_DATA what is not a file only mapped."""
    resource.setrlimit(kind, (LIMIT_BYTES, LIMIT_BYTES))
    signal.signal(signal.SIGPROF, _alarm)
    signal.signal(signal.SIGALRM, _alarm)


def in_time(work: Callable[[], str]) -> str:
    """What a piece of work says, or how it failed: 20 s of its own time, however busy the machine is."""
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    signal.alarm(30 * LIMIT_S)
    try:
        return work()
    except TooLong:
        return f"longer than {LIMIT_S} s"
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        return repr(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)


def count_readings(kind: str, first: int, count: int, tried: Callable[[int], str]) -> None:
    """Try mutants by their seeds and print how many were read and refused, and what was wrong, as JSON."""
    results: Counter[str] = Counter()
    wrong: list[str] = []
    for seed in range(first, first + count):
        result = in_time(lambda seed=seed: tried(seed))  # type: ignore[misc]
        results[result if result in ("read", "refused") else "wrong"] += 1
        if result not in ("read", "refused"):
            wrong.append(f"{kind} {seed}: {result[:400]}")
    sys.stdout.write(json.dumps({"codes": results, "wrong": wrong}))


def change_text(rng: random.Random, text: str, words: Sequence[str]) -> bytes:
    """Change words, lines and letters, and cut."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        lines = text.split("\n")
        row = rng.randrange(len(lines))
        what = rng.randrange(9)
        if what == 0:
            text = text[: rng.randrange(len(text) + 1)]
            continue
        if what == 1:
            del lines[row]
        elif what == 2:
            lines.insert(rng.randrange(len(lines)), lines[row])
        elif what == 3:
            lines.insert(row, rng.choice(words))
        elif what == 4 and lines[row]:
            i = rng.randrange(len(lines[row]))
            lines[row] = lines[row][:i] + rng.choice((*words, chr(rng.randrange(32, 0xD7FF)))) + lines[row][i + 1 :]
        else:
            changed = lines[row].split(" ")
            changed[rng.randrange(len(changed))] = rng.choice(words)
            lines[row] = " ".join(changed)
        text = "\n".join(lines)
    return text.encode("utf-8", "surrogatepass")
