"""Clouds through an encounter: CPU time and accuracy against single propagations.

Run: python benchmarks/risk.py [--draws 20000] [--clones 20000]

A cloud about an orbit that passes the Earth's centre at 3,000 km in 2038, twelve years ahead, 29,000 km long there (1
sigma) as that of the exercise 2026 PDC27: each member's fate to its impact or past the Earth, by `propagate_many`.
Then clones of the same orbit over one year, without encounter; a million of them are timed by a part and scaled, unless
--clones says so.
"""

import argparse
import time

import numpy as np

from nebosvod.dynamics import Ephemeris, ForceModel, find_encounters, propagate, propagate_many
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import ImpactError
from nebosvod.timescale import Epoch

EPOCH = Epoch.parse("2026-06-21 TDB")
WHEN = Epoch.parse("2038-07-10T05:30:00 TDB")
V_INFINITY_KM_S, LOWEST_KM = 14.2, 3000.0
LONG_KM, LEAD_S = 29_000.0, 7200.0
TOLERANCE = 1e-8
CHECKED = 40


def cloud(forces: ForceModel, count: int) -> tuple[np.ndarray, float]:
    """Starts (count, 6) at EPOCH, and seconds to the encounter."""
    ephemeris, end = forces.ephemeris, WHEN - EPOCH
    before = WHEN + -LEAD_S
    earth, sun = (ephemeris.state_km_km_s(body, before, 0.0)[0] for body in ("earth", "sun"))
    gm = ephemeris.gm_km3_s2["earth"]
    speed = np.sqrt(V_INFINITY_KM_S**2 + 2.0 * gm / LOWEST_KM)
    falling = kepler([LOWEST_KM, 0.0, 0.0, 0.0, 0.8 * speed, 0.6 * speed], [-LEAD_S], gm)[0]
    start = propagate(earth - sun + falling, before, [EPOCH - before], forces, False).state[0]
    along = start[3:] / np.linalg.norm(start[3:])
    rng = np.random.default_rng(1)
    # a change of speed of 1 mm/s is some 1,100 km along the track after twelve years
    push = rng.standard_normal(count) * LONG_KM / (3.0 * end)
    starts = start + np.hstack([rng.standard_normal((count, 3)), push[:, None] * along])
    return starts, end


def through_the_encounter(forces: ForceModel, count: int) -> None:
    """CPU time and accuracy of a cloud with its fates."""
    starts, end = cloud(forces, count)
    propagate_many(starts[:20], EPOCH, [end + DAY_S], forces, tolerance=TOLERANCE, body="earth", threads=1)
    begin = time.process_time()
    many = propagate_many(starts, EPOCH, [end + DAY_S], forces, tolerance=TOLERANCE, body="earth", threads=1)
    spent = time.process_time() - begin
    print(f"{count} orbits over {end / DAY_S / 365.25:.1f} years through the encounter: {spent:.2f} CPU s, ", end="")
    print(f"{1e6 * spent / count:.0f} us each; {many.fates.impact.mean():.3f} hit")
    off_s, off_km = [], []
    begin = time.process_time()
    for k in range(min(CHECKED, count)):
        try:
            one = propagate(starts[k], EPOCH, [end + DAY_S], forces, False, tolerance=1e-12)
        except ImpactError as error:
            off_s.append(abs(error.t_s - many.fates.t_s[k]))
            continue
        event = min(find_encounters(one, "earth"), key=lambda event: event.distance_km)
        off_s.append(abs(event.t_s - many.fates.t_s[k]))
        off_km.append(abs(event.distance_km - many.fates.distance_km[k]))
    alone = (time.process_time() - begin) / min(CHECKED, count)
    print(f"  one by one, at 1e-12: {1e6 * alone:.0f} us each; times agree to {max(off_s):.1e} s, ", end="")
    print(f"distances of those that pass to {1e3 * max(off_km, default=0.0):.1e} m")


def clones_over_a_year(forces: ForceModel, count: int) -> None:
    """CPU time of many clones over a year."""
    starts, _ = cloud(forces, min(count, 20_000))
    starts = np.tile(starts, (-(-count // len(starts)), 1))[:count]
    begin = time.process_time()
    propagate_many(starts, EPOCH, [365.25 * DAY_S], forces, tolerance=TOLERANCE, threads=1)
    spent = time.process_time() - begin
    scaled = "" if count == 1_000_000 else f"; a million, scaled: {spent * 1e6 / count:.0f} CPU s"
    print(f"{count} clones over one year: {spent:.2f} CPU s, {1e6 * spent / count:.1f} us each{scaled}")


def main() -> None:
    """Both, with as many orbits as asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--draws", type=int, default=20_000)
    parser.add_argument("--clones", type=int, default=20_000)
    asked = parser.parse_args()
    forces = ForceModel(ephemeris=Ephemeris.load())
    through_the_encounter(forces, asked.draws)
    clones_over_a_year(forces, asked.clones)


if __name__ == "__main__":
    main()
