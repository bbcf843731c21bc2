"""What an answer of the first hour costs: a tracklet of each kind, and a night of 130, CPU seconds after imports.

    python benchmarks/alert.py [--night 130]

The tracklets are made up: what comes near, what falls twelve hours later, a near-Earth asteroid, one of the main belt,
each with 3 to 6 observations.
"""

import argparse
import time

import numpy as np

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.impact import follow
from nebosvod.first_hour.alert import Alert, Question, alert
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import GroundSite, Telescope
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC, AU_KM

EPOCH = Epoch.parse("2026-03-21T08:00:00 TDB")
SITE = (np.radians(203.74409), 0.936241, 0.351543)  # F51
KINDS = {  # range in au, range rate and motion across, km/s, V
    "comes near, 0.005 au": (0.005, -12.0, (0.8, -0.5), 19.0),
    "near-Earth asteroid, 0.05 au": (0.05, -4.0, (7.0, 3.0), 20.0),
    "main belt, 1.5 au": (1.5, 2.0, (-12.0, 1.0), 21.0),
}
AIMED, LEAD_S = "impactor, 12 h before", 43200.0
# geocentric ICRF, km and km/s: comes from where midnight looks, and ends 60 deg below the horizon of the place it hits
END = np.array([-6200.0, 400.0, -1750.0, 14.6, 3.6, -1.0])


def planned(seed: int, ephemeris: Ephemeris) -> tuple[np.random.Generator, Exposures]:
    """3 to 6 observations over 20 to 60 minutes, and who draws the rest."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 7))
    t_s = np.linspace(0.0, 60.0 * rng.uniform(20.0, 60.0), n)
    site = Telescope(name="F51", spacecraft=GroundSite.from_parallax(*SITE, extrapolate=True), sigma_rad=0.2 * ARCSEC)
    return rng, Exposures.of(EPOCH, [(site, t_s)], ephemeris)


def aimed(seed: int, ephemeris: Ephemeris) -> Tracklet:
    """A tracklet of what falls twelve hours after its first observation."""
    rng, exposures = planned(seed, ephemeris)
    forces, falls = ForceModel(ephemeris=ephemeris), EPOCH + LEAD_S
    earth, sun = (ephemeris.state_km_km_s(body, falls, np.zeros(1))[0] for body in ("earth", "sun"))
    flown = follow(END + earth - sun, falls, (-LEAD_S - 3600.0, 1.0), 0.0, forces, True)
    psi = compute(flown, exposures.counted_from(falls)).psi
    noise = 0.2 * ARCSEC * rng.standard_normal(psi.shape) / np.stack([np.cos(psi[:, 1]), np.ones(len(psi))], axis=1)
    return Tracklet.of(AIMED, exposures, psi + noise, forces, Columns.none(len(psi)), 19.0)


def made(kind: str, seed: int, ephemeris: Ephemeris) -> Tracklet:
    """A tracklet of a kind."""
    if kind == AIMED:
        return aimed(seed, ephemeris)
    rng, exposures = planned(seed, ephemeris)
    n = len(exposures)
    rho, rate, across, V = KINDS[kind]
    psi = np.tile([3.2 + 0.2 * rng.random(), 0.15 * rng.random()], (n, 1))
    bare = Tracklet.of(kind, exposures, psi, ForceModel(ephemeris=ephemeris), Columns.none(n), V)
    conditional = Conditional(bare)
    truth = np.array([[np.log(rho), rate, 0.0, 0.0, *(np.array(across) / rho / AU_KM)]])
    seen = conditional.sight.see(conditional.sight.fly(conditional.states(truth)))
    noise = 0.2 * ARCSEC * rng.standard_normal((n, 2))
    moved = (noise - seen.residual[0]) / np.stack([np.cos(psi[:, 1]), np.ones(n)], axis=1)
    return Tracklet.of(kind, exposures, psi + moved, bare.forces, bare.columns, V)


def cost(tracklet: Tracklet) -> tuple[float, Alert]:
    """CPU seconds of one answer."""
    start = time.process_time()
    found = alert(tracklet, Question())
    return time.process_time() - start, found


def main() -> None:
    """Print a line for each kind, and one for a night."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--night", type=int, default=130, help="tracklets of the night; 0: none")
    night = parser.parse_args().night
    ephemeris = Ephemeris.load()
    for kind in (AIMED, *KINDS):
        cost(made(kind, 0, ephemeris))  # kernels are compiled, tables read
        spent = [cost(made(kind, seed, ephemeris)) for seed in range(1, 6)]
        median = float(np.median([seconds for seconds, _ in spent]))
        flown = np.mean([found.falls.flown.sum() for _, found in spent])
        chances = ", ".join(f"{found.headline.probability:.3g}" for _, found in spent)
        print(f"{kind:<32}{median:8.2f} s CPU; {flown:.0f} orbits flown; P {chances}")
    if night:
        kinds, total = list(KINDS), 0.0
        for k in range(night):
            seconds, _ = cost(made(kinds[k % 3 if k % 10 == 0 else 2 - (k % 3 == 0)], 100 + k, ephemeris))
            total += seconds
        print(f"{f'a night of {night}':<32}{total:8.1f} s CPU")


if __name__ == "__main__":
    main()
