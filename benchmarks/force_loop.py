"""The force kernels of eight stages against the same sums in C, compiled for this machine.

27 bodies, eight nodes. Usage: python benchmarks/force_loop.py (needs cc). What limits both is the throughput of
division and square root: two divisions or one and a square root for each body, in eight lanes.
"""

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.expansion import expand_bodies
from nebosvod.dynamics.forces import point_masses

CALLS, REPEATS = 20000, 15
FLAGS = {"cc -O3 -march=native": ["-ffp-contract=fast"], "the same, 512-bit vectors": ["-mprefer-vector-width=512"]}


@kernel
def loop_expand(m, n, X, P, gm, R, S, tide, bend):  # type: ignore[no-untyped-def]
    """Call `expand_bodies` m times."""
    for _ in range(m):
        expand_bodies(n, X, P, gm, R, S, tide, bend)


@kernel
def loop_masses(m, n, X, P, gm, A, tide):  # type: ignore[no-untyped-def]
    """Call `point_masses` m times."""
    for _ in range(m):
        point_masses(n, X, P, gm, A, tide)


def best_ns(calls: list[Callable[[], object]]) -> list[float]:
    """Times of one evaluation of each, in turn, the best of some rounds."""
    best = [float("inf")] * len(calls)
    for _ in range(REPEATS):
        for place, call in enumerate(calls):
            begin = time.perf_counter()
            call()
            best[place] = min(best[place], 1e9 * (time.perf_counter() - begin) / CALLS)
    return best


def library(folder: Path, flags: list[str]) -> ctypes.CDLL:
    """The loops of force_loop.c."""
    path = folder / f"{abs(hash(tuple(flags)))}.so"
    source = Path(__file__).with_suffix(".c")
    base = ["cc", "-O3", "-march=native", "-fno-math-errno", "-shared", "-fPIC"]
    subprocess.run([*base, *flags, str(source), "-o", str(path), "-lm"], check=True)
    return ctypes.CDLL(str(path))


def main() -> None:
    """Print the times."""
    rng = np.random.default_rng(0)
    X, P, gm = rng.normal(size=24) * 1e8, rng.normal(size=(27, 24)) * 1e8, rng.uniform(1.0, 1e5, 27)
    A, S, tide, bend = np.zeros(24), np.zeros(48), np.zeros(8), np.zeros(8)
    loop_expand(1, 8, X, P, gm, A, S, tide, bend)
    loop_masses(1, 8, X, P, gm, A, tide)
    ours: list[Callable[[], object]] = [
        lambda: loop_expand(CALLS, 8, X, P, gm, A, S, tide, bend),
        lambda: loop_masses(CALLS, 8, X, P, gm, A, tide),
    ]
    if shutil.which("cc") is None:
        print("no C compiler here; kernels: {:.0f} ns, {:.0f} ns".format(*best_ns(ours)))
        return
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (X, P, gm, A, S, tide, bend)]
    counts = ctypes.c_long(CALLS), ctypes.c_long(27)
    with tempfile.TemporaryDirectory() as folder:
        for title, flags in FLAGS.items():
            loops = library(Path(folder), flags)
            theirs = [partial(loop, *counts, *pointers) for loop in (loops.loop_expand, loops.loop_masses)]
            a, b, c, d = best_ns([*ours, *theirs])
            print(f"expansion of 26 bodies: kernel {a:.0f} ns, {title} {c:.0f} ns, ratio {a / c:.2f}; ", end="")
            print(f"sum of 27 bodies: {b:.0f} ns, {d:.0f} ns, {b / d:.2f}")


if __name__ == "__main__":
    main()
