"""Mutated mission files through `check`: always an exit code and a sentence, never a traceback, a signal or a hang.

NEBOSVOD_FUZZ_CASES raises the number of cases (1,500 by default; 50 more as processes).
"""

import io
import os
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from nebosvod.cli import main

ROOT = Path(__file__).resolve().parents[4]
SEEDS = [path.read_text("utf-8") for path in sorted((ROOT / "scenarios").glob("*.yaml"))]
CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "1500"))
LIMIT_S = 2.0  # CPU seconds for one file
WORDS = (
    "", "null", "~", "true", "no", "0", "1e400", ".nan", "-.inf", "017", "0x10", "12:30:00", "1" * 400, "[]", "{}",
    "[[[[]]]]", "{a: b}", "&a x", "*a", "!!python/name:os.system x", "'", '"', "|", ">", "# c", "0 km", "-3 arcsec",
    "1e308 au", "1e-320 kg", "5 parsec", "1e-320 s", "1e200 km",
    "2028-11-15", "9999-12-31T23:59:60 UTC", "0000-00-00 TDB", "1e9 JD TDB",
    "2459215.5 JD TDB", "2016-12-31T23:59:60 UTC", "all", "none", "orbit", "sbdb", "{value: 1}", "estimated", "ignored",
    "../../etc/passwd", "/dev/zero", "\u202e", "\ufeff", "☄", "a" * 3000, "{sigma: {position: 1 km, velocity: 1 m/s}}",
    "{covariance: [[1,2],[2,1]], names: [e, q]}", "{kind: sbdb, file: x.json}", "- x", "? y", ": z", "---", "...", "<<",
)  # fmt: skip
Mutation = Callable[[random.Random, str], str]


def swap_value(rng: random.Random, text: str) -> str:
    """Put an odd word after a colon."""
    spots = [i for i, letter in enumerate(text) if letter == ":" and text[i : i + 2] == ": "]
    if not spots:
        return text
    start = rng.choice(spots) + 2
    stop = min((j for mark in ",}\n" if (j := text.find(mark, start)) >= 0), default=len(text))
    return text[:start] + rng.choice(WORDS) + text[stop:]


def insert_word(rng: random.Random, text: str) -> str:
    """Put an odd word anywhere."""
    i = rng.randrange(len(text) + 1)
    return text[:i] + rng.choice(WORDS) + text[i:]


def delete_span(rng: random.Random, text: str) -> str:
    """Take out some letters."""
    i = rng.randrange(len(text) + 1)
    return text[:i] + text[i + rng.choice((1, 2, 5, 20, 200)) :]


def flip_letter(rng: random.Random, text: str) -> str:
    """Change one letter into any other."""
    i = rng.randrange(len(text)) if text else 0
    return text[:i] + chr(rng.choice((rng.randrange(32, 127), rng.randrange(0x110000 - 0x900), 9, 10))) + text[i + 1 :]


def move_line(rng: random.Random, text: str) -> str:
    """Delete, double, indent or move one line."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.randrange(3)):
        lines.insert(rng.randrange(len(lines) + 1), rng.choice(("", " ", "  ", "\t")) + line)
    return "".join(lines)


def cut_short(rng: random.Random, text: str) -> str:
    """Keep the beginning only."""
    return text[: rng.randrange(len(text) + 1)]


def mix_digits(rng: random.Random, text: str) -> str:
    """Make numbers huge, tiny or negative."""
    spots = [i for i, letter in enumerate(text) if letter.isdigit()]
    if not spots:
        return text
    i = rng.choice(spots)
    return text[:i] + rng.choice(("-", "9" * 30, "e99", "e-99", ".", "/", "0" * 50)) + text[i + 1 :]


def nest(rng: random.Random, text: str) -> str:
    """Open many brackets."""
    i = rng.randrange(len(text) + 1)
    return text[:i] + rng.choice("[{(-?") * rng.choice((1, 10, 40, 5000)) + text[i:]


MUTATIONS: tuple[Mutation, ...] = (
    swap_value, swap_value, swap_value, insert_word, delete_span, flip_letter, move_line, cut_short, mix_digits, nest,
)  # fmt: skip


def mutant(seed: int) -> bytes:
    """One mutated mission file; the same for the same seed."""
    rng = random.Random(seed)
    text = rng.choice(SEEDS)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        text = rng.choice(MUTATIONS)(rng, text)
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.05:
        i = rng.randrange(len(data) + 1)
        data = data[:i] + rng.randbytes(rng.choice((1, 4, 64))) + data[i:]
    return data


def check(path: Path) -> tuple[int, str, str, float]:
    """Exit code, output, errors and CPU seconds of `nebosvod check` inside this process."""
    out, err = io.StringIO(), io.StringIO()
    began = time.process_time()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(["check", str(path)])
    return code, out.getvalue(), err.getvalue(), time.process_time() - began


def test_mutated_missions_always_get_an_answer(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    codes: Counter[int] = Counter()
    slowest = (0.0, -1)
    for seed in range(CASES):
        path.write_bytes(mutant(seed))
        code, out, err, spent = check(path)
        codes[code] += 1
        slowest = max(slowest, (spent, seed))
        assert code in (0, 2), f"seed {seed}: exit code {code}\n{err}"
        assert "Traceback" not in err, f"seed {seed}\n{err}"
        assert bool(out) == (code == 0), f"seed {seed}"
        if code == 2:
            first = err.removeprefix("error: ")
            assert first.startswith(f"{path}:"), f"seed {seed}: no place in the message\n{err}"
        assert spent < LIMIT_S, f"seed {seed}: {spent:.1f} s of CPU"
    assert codes[2] > CASES // 4, f"the mutations hardly ever break a mission: {codes}"
    assert codes[0] > CASES // 100, f"the mutations never leave a mission whole: {codes}"


@pytest.mark.parametrize("seed", range(0, 50, 10))
def test_mutated_missions_as_processes_end_without_a_signal(seed: int, tmp_path: Path) -> None:
    running = []
    for number in range(seed, seed + 10):
        path = tmp_path / f"{number}.yaml"
        path.write_bytes(mutant(1_000_000 + number))
        command = [sys.executable, "-m", "nebosvod", "check", str(path)]
        done = subprocess.run(command, capture_output=True, timeout=60, check=False)
        running.append((number, done.returncode, done.stderr))
    for number, code, err in running:
        assert code in (0, 2), f"case {number}: {code}\n{err.decode('utf-8', 'replace')}"
        assert b"Traceback" not in err, f"case {number}"


BASE = (ROOT / "scenarios" / "apophis-2029.yaml").read_text("utf-8")
ROWS = range(8000)
CHAIN = ["NEB-2", *(f"T{i}" for i in ROWS)]
BLOB = "    blob: [" + "a," * 20000 + "]\n    limiting"
NAMES = ",".join(f"NEB{i}" for i in range(40000))
GROUPS = ",".join(f"bias {i}: fixed" for i in range(20000))
HOSTILE = {
    "24,000 unknown keys": BASE + "".join(f"cadenc{i}: 1\n" for i in range(24000)),
    "24,000 duplicate keys": BASE + "name: x\n" * 24000,
    "8,000 telescopes like one": BASE.replace(
        "\nschedule:", "".join(f"  - {{name: T{i}, like: NEB-1}}\n" for i in ROWS) + "\nschedule:"
    ),
    "8,000 telescopes, each like the one before": BASE.replace(
        "\nschedule:", "".join(f"  - {{name: T{i}, like: {CHAIN[i]}}}\n" for i in ROWS) + "\nschedule:"
    ),
    "98 telescopes inherit 20,000 values": BASE.replace("    limiting", BLOB).replace(
        "\nschedule:", "".join(f"  - {{name: T{i}, like: NEB-1}}\n" for i in range(98)) + "\nschedule:"
    ),
    "40,000 unknown names": BASE.replace("telescopes: all", f"telescopes: [{NAMES}]"),
    "20,000 unknown groups": BASE.replace(
        "method: batch_qr}", f"method: batch_qr, treatment: {{{GROUPS}}}}}"
    ),
    "a name of 900,000 letters": BASE.replace("name: NEB-1\n", "name: " + "x" * 900_000 + "\n"),
    "a number of 900,000 digits": BASE.replace("170 m", "1" * 900_000 + " m"),
    "a matrix of 12,000 rows": BASE.replace("prior: none", "prior: {covariance: [" + "[1,2]," * 12000 + "]}"),
}  # fmt: skip


@pytest.mark.parametrize("what", HOSTILE)
def test_large_hostile_files_are_refused_in_bounded_time_with_few_lines(what: str, tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(HOSTILE[what], "utf-8")
    code, _, err, spent = check(path)
    assert code == 2
    assert len(err.splitlines()) <= 51
    assert len(err) < 25_000
    assert spent < LIMIT_S
