"""Time of an orbit fit: one of 200 directions over 60 days, against their number, and a hundred objects in a row.

The orbits are those of peers/cases.py (JPL Horizons), seen from two places on the ground with noise of
0.2 arcsec; the fit starts 1e-4 au away from the truth. `correct` is the fit proper: damped Gauss-Newton with transition
matrix through the compiled kernel, residuals, partials, QR, covariance. A hundred objects go through everything that
`nebosvod fit --split` does but the files it writes: observers, weights, starting orbit, growth of the arc, rejection,
estimate, answer. Times are CPU times of one thread, medians over repeats.
peers/layup_fit.py does the same fits by turns with layup.
Usage: python benchmarks/fit.py [--objects 100] [--observations 510] [--years 6]
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from peers.cases import EPOCH, OBJECTS, start_km
from peers.skies import SIGMA_RAD, off, sky_of

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.fits.correction import Correction, correct
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.observation.reduction.observers import telescopes
from nebosvod.timescale import SECONDS_PER_DAY

GOAL_MS = 1.5
STATIONS = ("F51", "G96", "703", "I41", "T05", "T08", "F52", "W84")
COUNTS = (50, 100, 200, 500, 1000, 2000, 5000, 10000)


def orbits() -> dict[str, np.ndarray]:
    """Starts (6,) of peers/cases.py."""
    return {name: start_km(name) for name in OBJECTS}


def timed(run: Callable[[], object], repeats: int) -> float:
    """Median CPU time of a call, ms."""
    run()
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return 1000.0 * statistics.median(spent)


def check(found: Correction, truth: np.ndarray) -> float:
    """Chi squared (6) of the error."""
    return float(np.sum(np.linalg.solve(lower_factor(found.S), found.x - truth) ** 2))


def one_fit(forces: ForceModel, repeats: int) -> float:
    """Print the time of a fit of 200 directions over 60 d for each orbit; returns the median."""
    print(f"{'object':<30} {'ms':>7} {'iterations':>11} {'chi2 (6)':>9} {'km off':>9}")
    times = []
    for number, (name, state) in enumerate(orbits().items()):
        rng = np.random.default_rng(number)
        sky, start = sky_of(state, forces, 200, 60.0, rng), off(state, rng)
        found = correct(sky, start, forces)
        spent = timed(lambda sky=sky, start=start: correct(sky, start, forces), repeats)
        times.append(spent)
        gap = float(np.linalg.norm(found.x[:3] - state[:3]))
        print(f"{name:<30} {spent:7.3f} {found.iterations:11d} {check(found, state):9.1f} {gap:9.0f}")
    median = statistics.median(times)
    print(f"median {median:.3f} ms (goal {GOAL_MS} ms)")
    return median


def slope(forces: ForceModel, repeats: int) -> float:
    """Print the time against the number of observations and the slope of its logarithm at the upper end."""
    state = next(iter(orbits().values()))
    rng = np.random.default_rng(0)
    times = []
    for n in COUNTS:
        sky, start = sky_of(state, forces, n, 60.0, rng), off(state, rng)
        times.append(timed(lambda sky=sky, start=start: correct(sky, start, forces), repeats))
        print(f"{n:6d} observations {times[-1]:8.3f} ms")
    upper = np.array(COUNTS) >= 500
    fitted = float(np.polyfit(np.log(np.array(COUNTS)[upper]), np.log(np.array(times)[upper]), 1)[0])
    print(f"slope from 500 observations on: {fitted:.2f} (goal <= 1.1)")
    return fitted


def many(forces: ForceModel, objects: int, observations: int, years: float, given: bool) -> float:
    """Fit many objects with progress, from their records alone or from orbits 1e-4 au off; prints and returns s."""
    from nebosvod.fits.answer import answer
    from nebosvod.fits.engine import fit_object
    from nebosvod.pipeline import mission_of
    from nebosvod.results.fit_summary import summarise

    rng = np.random.default_rng(1)
    states = list(orbits().values())
    parts, starts = [], []
    print(f"making {objects * observations:,} records of {objects} objects", file=sys.stderr)
    for number in range(objects):
        state = states[number % len(states)].copy()
        state[:3] *= rng.uniform(0.97, 1.03)
        starts.append(off(state, rng))
        parts.append(records_of(state, forces, f"X{number:03d}", observations, years, rng))
    mission = mission_of(["made"])
    start, cpu, good = time.perf_counter(), time.process_time(), 0
    for number, (records, state) in enumerate(zip(parts, starts), start=1):
        orbit = mission.of(records.objects[0], (), EPOCH, state).orbit if given else None
        asked = mission.standing_for(object=mission.object.model_copy(update={"orbit": orbit}))
        found = answer(fit_object(records, asked, forces.ephemeris))
        summarise(found)
        good += not found.fit.verdict.failed
        print(f"\r{number} of {objects}, {time.perf_counter() - start:.1f} s", end="", file=sys.stderr, flush=True)
    spent, cpu = time.perf_counter() - start, time.process_time() - cpu
    print(file=sys.stderr)
    source = "orbits 1e-4 au off" if given else "the records alone"
    print(
        f"{objects} objects, {objects * observations:,} observations, from {source}: {cpu:.1f} s of CPU, "
        f"{spent:.1f} s on the clock (goal 10 s), {good} converged"
    )
    return cpu


def records_of(
    state: np.ndarray, forces: ForceModel, name: str, n: int, years: float, rng: np.random.Generator
) -> Astrometry:
    """Records of surveys: nights of three to five exposures half an hour apart, noise 0.2 arcsec, Gaia's stars."""
    nights = np.sort(rng.uniform(-years / 2.0, years / 2.0, n // 4 + 1)) * 365.25 * SECONDS_PER_DAY
    t_s = (nights[:, None] + 1800.0 * np.arange(4)).ravel()[:n]
    empty = np.full(n, np.nan)
    bare = Astrometry(
        epoch=EPOCH,
        path=np.full(n, "made"),
        line=np.arange(1, n + 1),
        designation=np.full(n, name),
        station=np.repeat(rng.choice(STATIONS, len(nights)), 4)[:n],
        t_s=t_s,
        utc=np.array([(EPOCH + t).iso(scale="utc") for t in t_s.tolist()]),
        psi=np.zeros((n, 2)),
        precision_rad=np.full((n, 2), np.radians(0.01 / 3600.0)),
        sigma_rad=np.full((n, 2), SIGMA_RAD),
        correlation=np.zeros(n),
        timing_sigma_s=empty,
        catalogue=np.full(n, "Gaia2"),
        mode=np.full(n, "CCD"),
        centre=np.full(n, ""),
        position_km=np.full((n, 3), np.nan),
        position_covariance_km2=np.full((n, 3, 3), np.nan),
        roving=np.zeros(n, dtype=bool),
        magnitude=empty,
        band=np.full(n, ""),
        discovery=np.zeros(n, dtype=bool),
    )
    places = telescopes(bare, forces.ephemeris)
    R = np.tile(SIGMA_RAD**2 * np.eye(2), (n, 1, 1))
    sky = Sky.of(EPOCH, t_s, bare.psi, R, places.state_km_km_s, forces.ephemeris)
    psi = compute(propagate(state, EPOCH, sky.span_s, forces), sky.exposures).psi
    return replace(bare, psi=offset(psi, SIGMA_RAD * rng.standard_normal((n, 2))))


def main() -> None:
    """Run all three."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--observations", type=int, default=510)
    parser.add_argument("--years", type=float, default=6.0)
    parser.add_argument("--repeats", type=int, default=50)
    asked = parser.parse_args()
    forces = ForceModel(ephemeris=Ephemeris.load())
    one_fit(forces, asked.repeats)
    slope(forces, max(5, asked.repeats // 5))
    for given in (True, False):
        many(forces, asked.objects, asked.observations, asked.years, given)


if __name__ == "__main__":
    main()
