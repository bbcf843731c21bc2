"""Epochs per second of the computed measurements: psi alone, and psi with H_x, H_x0, H_z, H_c, by kind of spacecraft.

Light time included; 3 dynamic parameters; goal 10^6 epochs/s with all partials on one core once kernels are compiled.
Times are CPU seconds of one thread, the best of several passes over a year, with those that the system takes to provide
memory (0.7 kB an epoch; shown apart for 10^6 epochs); the baseline is the same measurement by
jplephem, numpy and astropy (target from the same dense output, so it is flattered), in the same run.
Usage: python benchmarks/observation.py [epochs, default 100000]
"""

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np
from astropy import units
from astropy.coordinates import CartesianRepresentation, SkyCoord
from jplephem.spk import SPK

from nebosvod.dynamics import Ephemeris, ForceModel, RadiationPressure, Trajectory, propagate
from nebosvod.dynamics.constants import AU_KM, SPEED_OF_LIGHT_KM_S
from nebosvod.observation import (
    GeocentricOrbit,
    Geostationary,
    GroundSite,
    HeliocentricCompanion,
    HeliocentricOrbit,
    LibrationOrbit,
    Spacecraft,
    Telescope,
    observe,
    residual,
    sight,
    table,
)
from nebosvod.observation.spacecraft.kinds import turn_about_ecliptic_pole
from nebosvod.timescale import Epoch

EPOCH = Epoch.parse("2020-11-15T00:00:00 TDB")
YEAR_S = 365.25 * 86400.0
LEAD = -0.17
STATE = [1.2e8, 8.0e7, 3.0e7, -17.0, 23.0, 12.0]  # a near-Earth asteroid, heliocentric ICRF, km and km/s
GOAL_S = 1.0  # for 10^6 epochs


def flight(ephemeris: Ephemeris) -> Trajectory:
    """One year of the asteroid, with Phi and zeta by radius, mass and albedo."""
    forces = ForceModel(
        ephemeris=ephemeris,
        radiation=RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.16),
        parameters=("radius_m", "mass_kg", "albedo"),
    )
    return propagate(np.array(STATE), EPOCH, np.array([-86400.0, YEAR_S + 86400.0]), forces)


def carriers(ephemeris: Ephemeris) -> dict[str, Spacecraft]:
    """One spacecraft of each kind."""
    companion = HeliocentricCompanion(lead_rad=LEAD)
    nodes = np.arange(-10.0, YEAR_S / 86400.0 + 10.0) * 86400.0
    states = companion.state_km_km_s(ephemeris, EPOCH, nodes)
    low = GeocentricOrbit(elements_epoch=EPOCH, a_km=7078.0, e=0.001, i_rad=1.71)
    return {
        "companion": companion,
        "heliocentric": HeliocentricOrbit(elements_epoch=EPOCH, a_km=0.7 * AU_KM, e=0.02),
        "geostationary": Geostationary(longitude_rad=0.3),
        "low orbit": low,
        "L1": LibrationOrbit(point="L1", elements_epoch=EPOCH, amplitude_km=5e5),
        "table": table(EPOCH, nodes, states, "barycentre"),
        "ground site": GroundSite(itrf_km=np.array([3980.6, -13.0, 4966.8]), extrapolate=True),
    }


def rate(work: Callable[[], object], epochs: int, passes: int = 12) -> float:
    """Epochs per CPU second, the best of several passes after one that loads the kernels."""
    work()
    times = []
    for _ in range(passes):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return epochs / min(times)


def baseline(trajectory: Trajectory, ephemeris: Ephemeris, t_s: np.ndarray) -> np.ndarray:
    """Directions and partials from the companion, by jplephem, numpy and astropy; returns psi (n, 2)."""

    def body(kernel: SPK, pairs: tuple[tuple[int, int], ...], t: np.ndarray) -> np.ndarray:
        place = np.zeros((len(t), 6))
        for pair in pairs:
            r, v = kernel[pair].compute_and_differentiate(EPOCH.day, EPOCH.fraction + t / 86400.0)
            place += np.concatenate([r, v / 86400.0]).T
        return place

    with SPK.open(str(ephemeris.path)) as kernel:
        sun = body(kernel, ((0, 10),), t_s)
        earth = body(kernel, ((0, 3), (3, 399)), t_s)
        turned = (earth - sun).reshape(-1, 3) @ turn_about_ecliptic_pole(LEAD).T
        telescope = sun + turned.reshape(-1, 6)
        tau = np.zeros_like(t_s)
        for _ in range(4):
            target = trajectory.state_at(t_s - tau) + body(kernel, ((0, 10),), t_s - tau)
            rho = target[:, :3] - telescope[:, :3]
            tau = np.linalg.norm(rho, axis=1) / SPEED_OF_LIGHT_KM_S
    sky = SkyCoord(CartesianRepresentation(*rho.T * units.km), frame="icrs")
    ra, dec = sky.ra.rad, sky.dec.rad
    d = np.linalg.norm(rho, axis=1)[:, None, None]
    u, V = rho / d[:, 0], target[:, 3:]
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1)
    L = np.eye(3) - V[:, :, None] * (u / (SPEED_OF_LIGHT_KM_S + np.sum(u * V, axis=1))[:, None])[:, None]
    DL = np.stack([east, north], axis=1) / d @ L
    emitted = trajectory.at(t_s - tau)
    r2 = np.sum(emitted.state[:, :3] ** 2, axis=1)[:, None, None]
    r = emitted.state[:, :3]
    G = ephemeris.gm_km3_s2["sun"] / r2**1.5 * (3.0 * r[:, :, None] * r[:, None] / r2 - np.eye(3))
    t = tau[:, None, None]
    back = np.concatenate([np.eye(3) + t**2 / 2.0 * G, -t * np.eye(3) - t**3 / 6.0 * G], axis=2)
    partials = (DL @ back, DL @ emitted.Phi[:, :3], -DL, DL @ emitted.zeta[:, :3])
    assert all(np.all(np.isfinite(part)) for part in partials)
    return np.stack([ra, dec], axis=1)


def million(kind: str) -> None:
    """Print time and peak memory of 10^6 epochs with all partials, from a process of its own."""
    ephemeris = Ephemeris.load()
    trajectory = flight(ephemeris)
    telescope = Telescope(name="A", spacecraft=carriers(ephemeris)[kind], sigma_rad=5e-7)
    t_s = np.linspace(0.0, YEAR_S, 10**6)
    user, system = [], []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_SELF)
        observe(trajectory, telescope, t_s, ephemeris)
        after = resource.getrusage(resource.RUSAGE_SELF)
        user.append(after.ru_utime - before.ru_utime)
        system.append(after.ru_stime - before.ru_stime)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(json.dumps({"user": min(user), "system": min(system), "gigabytes": peak}))


def main(epochs: int) -> None:
    """Print the table."""
    ephemeris = Ephemeris.load()
    trajectory = flight(ephemeris)
    t_s = np.linspace(0.0, YEAR_S, epochs)
    few = t_s[:: max(1, epochs // 10_000)]
    plain = rate(lambda: baseline(trajectory, ephemeris, few), few.size)
    ours = sight(trajectory, HeliocentricCompanion(lead_rad=LEAD), few, ephemeris).psi
    # two records of one float64 Julian date: 40 us, or a metre, at the baseline
    assert np.abs(residual(baseline(trajectory, ephemeris, few), ours)).max() < 1e-10
    print(f"{date.today()}, {_processor()}, load {os.getloadavg()[0]:.1f}; {epochs} epochs over a year, 3 parameters")
    print("10^6 epochs per CPU second; ratio to jplephem + numpy + astropy with all partials, companion")
    print(f"{'spacecraft':14s} {'its states':>10s} {'psi':>7s} {'psi, H_x, H_x0, H_z, H_c':>25s} {'ratio':>6s}")
    print(f"{'baseline':14s} {'':>10s} {'':>7s} {plain / 1e6:25.3f} {1.0:6.1f}")
    for kind, spacecraft in carriers(ephemeris).items():
        telescope = Telescope(name="A", spacecraft=spacecraft, sigma_rad=5e-7)
        places = rate(lambda s=spacecraft: s.state_km_km_s(ephemeris, EPOCH, t_s), epochs)
        psi = rate(lambda s=spacecraft: sight(trajectory, s, t_s, ephemeris), epochs)
        full = rate(lambda t=telescope: observe(trajectory, t, t_s, ephemeris), epochs)
        print(f"{kind:14s} {places / 1e6:10.2f} {psi / 1e6:7.2f} {full / 1e6:25.2f} {full / plain:6.1f}", flush=True)
    for kind in ("companion", "geostationary"):
        command = [sys.executable, __file__, "--million", kind]
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        found = json.loads(subprocess.run(command, env=environment, check=True, capture_output=True).stdout)
        print(
            f"10^6 epochs, {kind}: computing {found['user']:.2f} s (goal {GOAL_S:.0f} s), "
            f"memory provided by the system in {found['system']:.2f} s, peak {found['gigabytes']:.2f} GB"
        )


def _processor() -> str:
    """Name of the processor, as far as the system tells."""
    info = Path("/proc/cpuinfo")
    names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--million"]:
        million(sys.argv[2])
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
