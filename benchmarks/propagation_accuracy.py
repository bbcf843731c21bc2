"""Integration errors of the programs, and times at equal error.

Every end is compared with a propagation in long double under the forces of that program (peers/reference.py), so that
neither a difference of forces nor another program's error enters. Sun, planets and Moon, relativity of the Sun, A1-A3;
nebosvod and kete with J2 of Sun and Earth, kete also with relativity and J2 of Jupiter, assist without oblateness. Once
without asteroids (kete then without Pluto, and nebosvod too), once with sixteen.

Usage: python benchmarks/propagation_accuracy.py
"""

import datetime
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from peers.cases import A123, EPOCH, OBJECTS, YEAR_D, Array, start_km
from peers.programs import Assist, Bodies, Kete, Ours, Program, cpu_ms
from peers.reference import Forces, propagate

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.ephemeris import ASTEROIDS, PLANETS
from nebosvod.dynamics.model import SUN_POLE

TOLERANCES = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 3e-9, 1e-8, 1e-7, 1e-6)
LIMIT_M = 0.02
FLOORS_M = {1.0: 0.001, 10.0: 0.02}  # what the rounding of starts and times alone may make, by years


def forces_of(program: str, asteroids: Bodies) -> Forces:
    """The forces of a program as its sources state them."""
    ephemeris = Ephemeris.load()
    gm = {name: ephemeris.gm_km3_s2[name] for name in PLANETS + ASTEROIDS * (asteroids == "sixteen")}
    if program != "assist" and asteroids == "none":
        del gm["pluto"]
    scalars, north, ecliptic = ephemeris.scalars, (0.0, 0.0, 1.0), np.radians(84381.448 / 3600.0)
    if program == "kete":
        pole = (0.0, -np.sin(ecliptic), np.cos(ecliptic))
        oblate = {
            "sun": (2.2e-7, 0.0046547588 * AU_KM, SUN_POLE),
            "earth": (0.00108262998905, 6378.137, north),
            "jupiter": (0.014696572, 0.0004778945 * AU_KM, pole),
        }
        return Forces(ephemeris=ephemeris, gm=gm, relativistic=("sun", "jupiter"), oblate=oblate, a123=A123)
    if program == "assist":
        return Forces(ephemeris=ephemeris, gm=gm, oblate={}, a123=A123)
    oblate = {
        "sun": (scalars["sun_j2"], scalars["sun_radius_km"], SUN_POLE),
        "earth": (scalars["earth_j2"], scalars["earth_radius_km"], north),
    }
    return Forces(ephemeris=ephemeris, gm=gm, oblate=oblate, a123=A123)


@dataclass(eq=False)
class Runs:
    """One program at one setting over all objects: errors in m, CPU ms of X and of X, Phi, zeta."""

    program: str
    setting: str
    make: Callable[[], Program]
    errors_m: list[float] = field(default_factory=list)
    state_ms: list[float] = field(default_factory=list)
    partials_ms: list[float] = field(default_factory=list)


def candidates(asteroids: Bodies) -> list[Runs]:
    """All programs and settings that run here."""
    rows = [Runs("nebosvod", f"{t:.0e}", partial(Ours, asteroids, "kete", t)) for t in TOLERANCES]
    rows.append(Runs("kete", "only", partial(Kete, asteroids)))
    epsilons = (1e-11, None, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
    rows += [Runs("assist", f"{e or 1e-9:.0e}", partial(Assist, asteroids, e, oblate=False)) for e in epsilons]
    return rows


def measure(rows: list[Runs], asteroids: Bodies, years: float) -> None:
    """Fill in errors and times, the programs in turn at each object."""
    programs: list[tuple[Runs, Program]] = []
    for row in rows:
        try:
            programs.append((row, row.make()))
        except (ImportError, AttributeError, RuntimeError, OSError) as error:
            print(f"{row.program} is left out: {error}", flush=True)
    forces = {name: forces_of(name, asteroids) for name in {row.program for row, _ in programs}}
    days = years * YEAR_D
    for name in OBJECTS:
        start = start_km(name)
        ends = {which: propagate(f, start, EPOCH, days * DAY_S)[:3] for which, f in forces.items()}
        for row, program in programs:
            row.errors_m.append(error_m(program, start, days, ends[row.program]))
            repeats = 9 if years < 2.0 else 4
            row.state_ms.append(cpu_ms(program, start, days, False, repeats))
            row.partials_ms.append(cpu_ms(program, start, days, True, repeats))


def error_m(program: Program, start: Array, days: float, end_km: Array) -> float:
    """Distance of a program's end from the reference, m."""
    found = program.position_km(program.prepare(start, days, False)())
    return 1e3 * float(np.linalg.norm(found - end_km))


def show(rows: list[Runs], years: float) -> None:
    """Errors and times of every setting."""
    heads = ("setting", "error: median, largest but Apophis, Apophis (m)", f"within {LIMIT_M} m", "X ms", "var ms")
    print(f"{years:g} y | {' | '.join(heads)}")
    apophis = list(OBJECTS).index("99942 Apophis")
    for row in rows:
        if row.errors_m:
            e = np.array(row.errors_m)
            errors = f"{np.median(e):.1e}, {np.delete(e, apophis).max():.1e}, {e[apophis]:.1e}"
            line = f"{row.program} | {row.setting} | {errors}"
            times = f"{np.median(row.state_ms):.3f} | {np.median(row.partials_ms):.3f}"
            print(f"{line} | {(e <= LIMIT_M).sum()} of {len(e)} | {times}", flush=True)


def match(rows: list[Runs], years: float) -> None:
    """Ratios of times where nebosvod takes the loosest tolerance whose error is not larger than the other program's."""
    ours = [row for row in rows if row.program == "nebosvod"]
    for other in (row for row in rows if row.program != "nebosvod" and row.errors_m):
        ratios = []
        for k, allowed in enumerate(np.maximum(other.errors_m, FLOORS_M[years])):
            fit = [row for row in ours if row.errors_m[k] <= allowed] or ours[:1]
            best = min(fit, key=lambda row: row.state_ms[k])
            ratios.append((other.state_ms[k] / best.state_ms[k], other.partials_ms[k] / best.partials_ms[k]))
        tell(f"{years:g} y, at the error of {other.program} {other.setting}", np.array(ratios))


def at_limit(rows: list[Runs], years: float) -> None:
    """Each program at its fastest setting within the limit, object by object, where both of a pair reach it."""
    fastest: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        for k, error in enumerate(row.errors_m):
            best = fastest.setdefault(row.program, [(np.inf, np.inf)] * len(OBJECTS))
            if error <= LIMIT_M:
                best[k] = (min(best[k][0], row.state_ms[k]), min(best[k][1], row.partials_ms[k]))
    mine = np.array(fastest.pop("nebosvod"))
    for name, times in fastest.items():
        t = np.array(times)
        both = np.isfinite(t[:, 0]) & np.isfinite(mine[:, 0])
        reached = f"nebosvod {np.isfinite(mine[:, 0]).sum()}, {name} {np.isfinite(t[:, 0]).sum()} of {len(t)} objects"
        if both.any():
            a, b = np.median(mine[both], axis=0).round(3), np.median(t[both], axis=0).round(3)
            print(f"{years:g} y, within {LIMIT_M} m: {reached}; X, var: {a} and {b} ms", flush=True)
            tell(f"{years:g} y, within {LIMIT_M} m, both at their fastest", t[both] / mine[both])


def tell(title: str, ratios: Array) -> None:
    """Median and range of the ratios of both kinds of propagation."""
    parts = [f"{kind} {np.median(r):.1f} ({r.min():.1f} to {r.max():.1f})" for kind, r in zip(("X", "var"), ratios.T)]
    print(f"{title}: other / nebosvod {', '.join(parts)}", flush=True)


def main() -> None:
    """Without and with asteroids, one and ten years."""
    every: tuple[Bodies, ...] = ("none", "sixteen")
    for asteroids in every:
        for years in FLOORS_M:
            print(f"\n{datetime.date.today()}, load average {os.getloadavg()[0]:.1f}, asteroids: {asteroids}")
            rows = candidates(asteroids)
            measure(rows, asteroids, years)
            show(rows, years)
            match(rows, years)
            at_limit(rows, years)


if __name__ == "__main__":
    main()
