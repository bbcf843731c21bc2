"""The figures that are watched: `make bench` prints each beside the one stored in baseline.json.

CPU times of one thread, the best of several calls. A machine is not always equally fast, and not the same as another:
each figure is also given as a ratio to a yardstick of fixed work in numpy and in Python, timed just before and after
it, and ratios are what is compared. Those of calls below a millisecond still scatter by a fifth, those of whole
commands by a quarter; what is within FACTOR of its baseline is never called slower.

Usage: python benchmarks/figures.py [--store] [--factor 1.6] [NAME ...]
    --store   writes baseline.json anew: all figures, date, machine, load, versions
    NAME      only figures whose name holds one of these words
Exit code: 1 if a figure is slower than FACTOR times its baseline in two measurements, else 0.
"""

import argparse
import functools
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.version import __version__

Array = npt.NDArray[np.float64]
Call = Callable[[], object]
HERE = Path(__file__).parent
BASELINE = HERE / "baseline.json"
FACTOR = 1.6
SECONDS = 1.5  # of repeated calls for a figure
FEWEST, MOST = 3, 400  # calls
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def yardstick_ms() -> float:
    """CPU time of fixed work, the best of five: a Cholesky factor, sines, a loop in Python."""
    A = np.eye(150) * 150.0 + np.add.outer(np.arange(150.0), np.arange(150.0)) / 150.0
    angles = np.linspace(0.0, 50.0, 60_000)

    def work() -> None:
        for _ in range(4):
            np.linalg.cholesky(A)
            np.sin(angles)
        total = 0
        for k in range(25_000):
            total += k % 7

    return best_ms(work, 5)


def best_ms(call: Call, calls: int) -> float:
    """Least CPU time of so many calls."""
    times = []
    for _ in range(calls):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)


def steady_ms(call: Call) -> float:
    """Least CPU time of as many calls as SECONDS allow, after one that loads what is needed."""
    call()
    begin = time.process_time()
    call()
    once = time.process_time() - begin
    return best_ms(call, int(np.clip(SECONDS / max(once, 1e-6), FEWEST, MOST)))


def forces() -> Any:
    """All forces of a near-Earth asteroid, three partials beside Phi."""
    from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav

    return ForceModel(
        ephemeris=Ephemeris.load(),
        nongrav=Nongrav(a1_au_d2=5e-13, a2_au_d2=-2.9e-14, a3_au_d2=1e-14),
        parameters=("a1_au_d2", "a2_au_d2", "a3_au_d2"),
    )


def propagation(days: float, partials: bool, name: str = "433 Eros, Amor") -> Call:
    """One orbit, with the sixteen asteroids."""
    from peers.cases import EPOCH, start_km

    from nebosvod.dynamics import propagate

    start, model, t_s = start_km(name), forces(), [days * 86400.0]
    return lambda: propagate(start, EPOCH, t_s, model, sensitivities=partials)


def clones() -> Call:
    """A thousand orbits over one year."""
    from peers.cases import EPOCH, start_km

    from nebosvod.dynamics import propagate_many

    rng, model = np.random.default_rng(1), forces()
    starts = start_km("433 Eros, Amor") + rng.normal(size=(1000, 6)) * np.repeat([100.0, 1e-5], 3)
    return lambda: propagate_many(starts, EPOCH, [365.25 * 86400.0], model, threads=1)


def fit(n: int) -> Call:
    """Differential correction from a start 1e-4 au off, n directions over 60 d."""
    from peers.cases import start_km
    from peers.skies import off, sky_of

    from nebosvod.dynamics import Ephemeris, ForceModel
    from nebosvod.fits.correction import correct

    rng, model, state = np.random.default_rng(7), ForceModel(ephemeris=Ephemeris.load()), start_km("433 Eros, Amor")
    sky, start = sky_of(state, model, n, 60.0, rng), off(state, rng)
    return lambda: correct(sky, start, model)


def records(given: bool) -> Call:
    """Everything `nebosvod fit` does for one object of 510 records over six years but its files."""
    from fit import records_of
    from peers.cases import EPOCH, start_km

    from nebosvod.dynamics import Ephemeris, ForceModel
    from nebosvod.fits.answer import answer
    from nebosvod.fits.engine import fit_object
    from nebosvod.pipeline import mission_of

    rng, model, state = np.random.default_rng(1), ForceModel(ephemeris=Ephemeris.load()), start_km("10297, main belt")
    table = records_of(state, model, "X001", 510, 6.0, rng)
    mission = mission_of(["made"])
    if given:
        known = mission.object.model_copy(update={"orbit": mission.of(table.objects[0], (), EPOCH, state).orbit})
        mission = mission.standing_for(object=known)
    return lambda: answer(fit_object(table, mission, model.ephemeris))


def seen(kind: str) -> Call:
    """100,000 directions with all partials."""
    from nebosvod.dynamics import Ephemeris
    from nebosvod.observation import Telescope, observe
    from observation import YEAR_S, carriers, flight  # noqa: TID251 - the script beside this one

    ephemeris = Ephemeris.load()
    trajectory, t_s = flight(ephemeris), np.linspace(0.0, YEAR_S, 100_000)
    telescope = Telescope(name="A", spacecraft=carriers(ephemeris)[kind], sigma_rad=5e-7)
    return lambda: observe(trajectory, telescope, t_s, ephemeris)


def estimator(name: str, n: int) -> Call:
    """One of benchmarks/estimation.py."""
    import estimation  # noqa: TID251 - the script beside this one

    solve, kind, _ = estimation.SOLVERS[name]
    case = estimation.problem(n, kind)
    return lambda: solve(case)


def mission(name: str) -> Call:
    """The numerics of a built-in mission, from the mission to the summary."""
    from nebosvod.mission import load_mission
    from nebosvod.pipeline import run

    return lambda: run(load_mission(name))


FIGURES: Mapping[str, tuple[str, Callable[[], Call]]] = {
    "call": ("propagate over 0.1 d: the fixed cost of a call", lambda: propagation(0.1, False)),
    "state 1 y": ("state of 433 Eros, 16 asteroids", lambda: propagation(365.25, False)),
    "state 10 y": ("the same", lambda: propagation(3652.5, False)),
    "partials 1 y": ("state, Phi and zeta by three parameters", lambda: propagation(365.25, True)),
    "partials 10 y": ("the same", lambda: propagation(3652.5, True)),
    "clones": ("1000 orbits over one year", clones),
    "see companion": ("10^5 directions with all partials, companion of the Earth", lambda: seen("companion")),
    "see geostationary": ("the same, geostationary", lambda: seen("geostationary")),
    "batch 10^4": ("batch, QR, 10^4 epochs", lambda: estimator("batch qr", 10_000)),
    "batch 10^5": ("batch, QR, 10^5 epochs", lambda: estimator("batch qr", 100_000)),
    "recursive 10^5": ("recursive with history, 10^5 epochs", lambda: estimator("recursive with history", 100_000)),
    "fit 200": ("correction by 200 directions over 60 d", lambda: fit(200)),
    "fit 5000": ("the same by 5000", lambda: fit(5000)),
    "records, start given": ("a fit of 510 records over six years, from an orbit", lambda: records(True)),
    "records alone": ("the same without a start", lambda: records(False)),
    "run minimal": ("pipeline.run of minimal", lambda: mission("minimal")),
    "run apophis-2029": ("pipeline.run of apophis-2029", lambda: mission("apophis-2029")),
}
COMMANDS: Mapping[str, tuple[str, Sequence[str]]] = {
    "--help": ("nebosvod --help, beyond Python itself", ("--help",)),
    "check minimal": ("nebosvod check minimal, beyond Python itself", ("check", "minimal")),
}


def command_ms(arguments: Sequence[str], calls: int = 5) -> float:
    """CPU time of a command in a process of its own, less that of an empty Python; the best of some."""

    def spent(words: Sequence[str]) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], stdout=subprocess.DEVNULL, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    full, bare = (min(spent(words) for _ in range(calls)) for words in (("-m", "nebosvod", *arguments), ("-c", "")))
    return 1e3 * (full - bare)


def measured(name: str) -> dict[str, float]:
    """Milliseconds of a figure, and their ratio to the yardstick beside it."""
    if name in COMMANDS:
        timed = functools.partial(command_ms, COMMANDS[name][1])
    else:
        timed = functools.partial(steady_ms, FIGURES[name][1]())
    before = yardstick_ms()
    ms = timed()
    return {"ms": round(ms, 4), "ratio": float(f"{ms / (0.5 * (before + yardstick_ms())):.4g}")}


def machine() -> dict[str, Any]:
    """When and on what this runs."""
    info = Path("/proc/cpuinfo")
    names = [x.split(":", 1)[1].strip() for x in info.read_text().splitlines() if x.startswith("model name")]
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores",
        "load": round(os.getloadavg()[0], 1),
        "versions": {"python": platform.python_version(), "nebosvod": __version__}
        | {name: version(name) for name in ("numpy", "scipy", "numba")},
    }


def verdict(ratio: float, baseline: float, factor: float) -> str:
    """A word for a ratio beside its baseline: slower or faster only beyond the factor."""
    if ratio > factor * baseline:
        return "SLOWER"
    return "faster" if ratio < baseline / factor else ""


def line(name: str, now: Mapping[str, float], then: Mapping[str, float] | None, factor: float) -> str:
    """One row of the table."""
    text = f"{name:<22} {now['ms']:10.3f} {now['ratio']:9.4g}"
    if then is None:
        return f"{text} {'':10} {'':9}        new"
    times = now["ratio"] / then["ratio"]
    return f"{text} {then['ms']:10.3f} {then['ratio']:9.4g} {times:6.2f} {verdict(now['ratio'], then['ratio'], factor)}"


def compared(names: Sequence[str], stored: Mapping[str, Any], factor: float) -> list[str]:
    """Print every figure beside its baseline; returns those that are slower, measured twice."""
    figures = stored["figures"]
    here = machine()
    print(f"today:    {here['date']}, {here['machine']}, load {here['load']}, {said(here['versions'])}")
    print(f"baseline: {stored['date']}, {stored['machine']}, load {stored['load']}, {said(stored['versions'])}")
    print(f"{'figure':<22} {'ms':>10} {'ratio':>9} {'baseline':>10} {'ratio':>9} {'times':>6}")
    slower = []
    for name in names:
        now, then = measured(name), figures.get(name)
        if then is not None and verdict(now["ratio"], then["ratio"], factor) == "SLOWER":
            now = min(now, measured(name), key=lambda one: one["ratio"])  # something else may have had the machine
        print(line(name, now, then, factor), flush=True)
        if then is not None and verdict(now["ratio"], then["ratio"], factor) == "SLOWER":
            slower.append(name)
    print(f"ratio: to {yardstick_ms():.2f} ms of fixed work; times: ratio today over that of the baseline")
    return slower


def said(versions: Mapping[str, str]) -> str:
    """Versions in one line."""
    return ", ".join(f"{name} {number}" for name, number in versions.items())


def store(names: Sequence[str]) -> None:
    """Measure every figure twice, keep the lower ratio, write baseline.json."""
    figures = {}
    for name in names:
        figures[name] = min((measured(name) for _ in range(2)), key=lambda one: one["ratio"])
        figures[name]["what"] = (FIGURES | COMMANDS)[name][0]
        print(line(name, figures[name], None, FACTOR), flush=True)
    content = {**machine(), "yardstick_ms": round(yardstick_ms(), 3), "figures": figures}
    BASELINE.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(f"written: {BASELINE}")


def main() -> int:
    """Compare with the baseline, or write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", metavar="NAME")
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--factor", type=float, default=FACTOR)
    asked = parser.parse_args()
    names = [n for n in (*FIGURES, *COMMANDS) if not asked.words or any(word in n for word in asked.words)]
    if asked.store:
        store([*FIGURES, *COMMANDS])
        return 0
    slower = compared(names, json.loads(BASELINE.read_text("utf-8")), asked.factor)
    if slower:
        print(f"slower than {asked.factor:g} times the baseline: {', '.join(slower)}")
    return 1 if slower else 0


if __name__ == "__main__":
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):  # read when the libraries load
        raise SystemExit(subprocess.run([sys.executable, *sys.argv], env=os.environ | ONE_THREAD).returncode)
    raise SystemExit(main())
