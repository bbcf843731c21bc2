"""Made-up tracklets: a truth, observers, directions computed without the program, noise; ten of them."""

from dataclasses import dataclass, replace

import hour_oracle as oracle  # type: ignore[import-not-found]
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import GroundSite, LibrationOrbit, Spacecraft, Telescope
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / 648000.0
AU = 149597870.7
EPOCH = Epoch.parse("2026-03-21T00:00:00 TDB")
SITES = {
    "F51": (np.radians(203.74409), 0.936241, 0.351543),
    "G96": (np.radians(249.21128), 0.845111, 0.533614),
    "W84": (np.radians(289.19423), 0.864981, -0.500958),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One made-up tracklet: who observed, how often and how long, how far it was and what is uncertain."""

    name: str
    observers: tuple[str, ...]
    minutes: float
    each: int
    rho_au: float
    rate_km_s: float
    sigma_arcsec: float = 0.3
    across_km_s: tuple[float, float] = (6.0, -4.0)
    bias_arcsec: float = 0.0
    clock_s: float = 0.0
    place_km: float = 0.0
    direction: tuple[float, float] = (3.2, 0.15)
    seed: int = 1


CASES = (
    Case(name="one station, 10 min, 0.003 au", observers=("F51",), minutes=10, each=3, rho_au=0.003, rate_km_s=-8.0),
    Case(name="one station, 22 min, 0.05 au", observers=("G96",), minutes=22, each=4, rho_au=0.05, rate_km_s=5.0),
    Case(name="one station, 40 min, 1 au", observers=("F51",), minutes=40, each=4, rho_au=1.0, rate_km_s=-3.0,
         across_km_s=(-9.0, -2.0), clock_s=1.0),
    Case(name="one station, 3 h, 0.01 au", observers=("F51",), minutes=180, each=5, rho_au=0.01, rate_km_s=-9.0,
         bias_arcsec=0.2, clock_s=1.0),
    Case(name="two stations, 1 h, 0.02 au", observers=("F51", "G96"), minutes=60, each=4, rho_au=0.02, rate_km_s=7.0,
         bias_arcsec=0.2, clock_s=1.0),
    Case(name="two stations, 6 h, 0.2 au", observers=("F51", "W84"), minutes=360, each=4, rho_au=0.2, rate_km_s=2.0,
         bias_arcsec=0.1),
    Case(name="one spacecraft, 30 min, 0.03 au", observers=("L1a",), minutes=30, each=5, rho_au=0.03, rate_km_s=-11.0,
         sigma_arcsec=0.1, place_km=3.0),
    Case(name="one spacecraft, 6 h, 0.3 au", observers=("L1a",), minutes=360, each=6, rho_au=0.3, rate_km_s=4.0,
         sigma_arcsec=0.1, bias_arcsec=0.05),
    Case(name="two spacecraft, 20 min, 0.02 au", observers=("L1a", "L1b"), minutes=20, each=3, rho_au=0.02,
         rate_km_s=-10.0, sigma_arcsec=0.1, bias_arcsec=0.1, place_km=10.0),
    Case(name="two spacecraft, 2 h, 1 au", observers=("L1a", "L1b"), minutes=120, each=4, rho_au=1.0, rate_km_s=1.0,
         sigma_arcsec=0.1, across_km_s=(-9.0, 1.0), clock_s=0.1),
)  # fmt: skip


def spacecraft(name: str) -> Spacecraft:
    """A site on the ground or an orbit about L1."""
    if name in SITES:
        return GroundSite.from_parallax(*SITES[name], extrapolate=True)
    phase = 0.0 if name == "L1a" else np.pi
    return LibrationOrbit(
        point="L1", elements_epoch=EPOCH, amplitude_km=2e5, amplitude_z_km=4e5, phase_rad=phase, phase_z_rad=phase
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """A tracklet of the program, and the same for the oracle."""

    tracklet: Tracklet
    problem: oracle.Problem
    region: Region
    truth: Array


def made(case: Case, ephemeris: Ephemeris) -> Made:
    """The tracklet of a case."""
    rng = np.random.default_rng(case.seed)
    telescopes = tuple(Telescope(name=name, spacecraft=spacecraft(name), sigma_rad=1.0) for name in case.observers)
    t = np.linspace(0.0, 60.0 * case.minutes, case.each)
    planned = [(telescope, t + 37.0 * k) for k, telescope in enumerate(telescopes)]
    exposures = Exposures.of(EPOCH, planned, ephemeris)
    sigma = case.sigma_arcsec * ARCSEC
    exposures = replace(exposures, sigma_rad=np.full((len(exposures), 2), sigma))
    columns = columns_of(case, exposures)
    empty = Tracklet.of(case.name, exposures, np.zeros((len(exposures), 2)), ForceModel(ephemeris=ephemeris), columns)
    step_s = oracle.STEPS_S[int(case.rho_au > 0.05)]
    bodies = oracle.Bodies.of(ephemeris, empty.epoch, empty.exposures.t_s, step_s)
    ra, dec = case.direction
    truth = np.array([np.log(case.rho_au), case.rate_km_s, 0.0, 0.0, *(np.array(case.across_km_s) / case.rho_au / AU)])
    frame = oracle.frame_of(ra, dec)
    psi, rate, far = oracle.directions(bodies, empty.exposures, empty.reference, frame, truth[None])
    Cov = oracle.covariance(case, columns, far, rate, psi, sigma)[0]
    noise = np.linalg.cholesky(Cov) @ rng.standard_normal(len(Cov))
    observed = psi[0] + noise.reshape(-1, 2) / np.stack([np.cos(psi[0, :, 1]), np.ones(len(exposures))], axis=1)
    observed[:, 0] %= 2.0 * np.pi
    tracklet = replace(empty, observed=observed)
    region = Region(nearest_au=1e-4, farthest_au=5.0)
    problem = oracle.Problem(
        bodies=bodies, exposures=tracklet.exposures, reference=tracklet.reference, observed=observed, case=case,
        columns=columns, sigma=sigma, low=np.log(1e-4), high=np.log(5.0),
    )  # fmt: skip
    return Made(tracklet=tracklet, problem=problem, region=region, truth=truth)


def aimed(case: Case, ephemeris: Ephemeris) -> Case:
    """The same, approaching, and moving across as what comes down on the Earth within ten days does."""
    case = replace(case, rate_km_s=min(case.rate_km_s, -8.0))
    one = made(case, ephemeris)
    tried = np.stack(np.meshgrid(*[np.linspace(-0.8, 0.8, 41)] * 2), axis=-1).reshape(-1, 2)
    x = np.repeat(one.truth[None], len(tried), axis=0)
    x[:, 4:] = tried / case.rho_au / AU
    hit = oracle.falls(one.problem, x, one.tracklet.epoch, ephemeris, 10.0)
    assert hit.any()
    east, north = tried[hit].mean(axis=0).tolist()
    return replace(case, across_km_s=(east, north))


def columns_of(case: Case, exposures: Exposures) -> Columns:
    """Bias, clock and place of each observer, as far as the case has them."""
    n, who = len(exposures), exposures.telescope_index
    parts: list[tuple[str, Array, Array, Array, float]] = []
    for k, name in enumerate(case.observers):
        on = (who == k).astype(float)
        for axis in range(2 if case.bias_arcsec else 0):
            bias = np.zeros((n, 2))
            bias[:, axis] = on
            parts.append((f"bias {name} {axis}", bias, np.zeros(n), np.zeros((n, 3)), case.bias_arcsec * ARCSEC))
        if case.clock_s:
            parts.append((f"clock {name}", np.zeros((n, 2)), on, np.zeros((n, 3)), case.clock_s))
        for axis in range(3 if case.place_km else 0):
            place = np.zeros((n, 3))
            place[:, axis] = on
            parts.append((f"place {name} {axis}", np.zeros((n, 2)), np.zeros(n), place, case.place_km))
    if not parts:
        return Columns.none(n)
    return Columns(
        names=tuple(part[0] for part in parts),
        bias=np.stack([part[1] for part in parts], axis=2),
        clock=np.stack([part[2] for part in parts], axis=1),
        place=np.stack([part[3] for part in parts], axis=2),
        mean=np.zeros(len(parts)),
        information=np.diag([1.0 / part[4] for part in parts]),
    )
