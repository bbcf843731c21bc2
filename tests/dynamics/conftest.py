"""What the tests of dynamics share: reference data, an ephemeris, JPL's trajectory of Apophis."""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, RadiationPressure, chebyshev, nodes, stages, workspace
from nebosvod.dynamics import forces as forces_module
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.workspace import Work
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
# how much of their rows the narrow arrays of a `Work` use
USED = {"strength": 4, "law": 16, "t": 8, "pole": 3, "tide": 8, "bend": 8}
USED |= {"Q": 32, "S0": 48, "S": 48, "G": 72, "K": 72, "F": 96}
REFERENCE = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def reference() -> Path:
    """The folder of reference data beside the project."""
    if not REFERENCE.is_dir():
        pytest.skip(f"reference data not found at {REFERENCE}")
    return REFERENCE


@pytest.fixture(scope="session")
def ephemeris() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="session")
def jpl_states(reference: Path) -> dict[str, Any]:
    """Start and end states of JPL's small-body code, as the file holds them (au, au/d, JD TDB)."""
    states: dict[str, Any] = json.loads((reference / "dynamics" / "jpl_small_body_reference_states.json").read_text())
    return states


@pytest.fixture(scope="session")
def km() -> Callable[[Any], Array]:
    """Six numbers in au and au/d -> km and km/s."""

    def convert(state: Any) -> Array:
        x = np.array(state, dtype=np.float64)
        return np.concatenate([x[:3] * AU_KM, x[3:] * AU_KM / DAY_S])

    return convert


@pytest.fixture(scope="session")
def at_jd() -> Callable[[float], Epoch]:
    def convert(jd: float) -> Epoch:
        day = math.floor(jd - 0.5) + 0.5
        return Epoch.from_jd(day, jd - day)

    return convert


@pytest.fixture(scope="session")
def apophis(reference: Path) -> Iterator[Callable[[Epoch, Any], Array]]:
    """JPL's trajectory of Apophis: (epoch, t_s) -> heliocentric states (n, 6), km, km/s."""
    from jplephem.spk import SPK

    kernel = SPK.open(str(reference / "dynamics" / "apophis_jpl220_2021_2050.bsp"))

    def state(epoch: Epoch, t_s: Any) -> Array:
        rows = []
        for t in np.atleast_1d(t_s):
            moment = epoch + float(t)
            segment = next(s for s in kernel.segments if s.start_jd <= moment.jd_tdb <= s.end_jd)
            position, velocity = segment.compute_and_differentiate(moment.day, moment.fraction)
            rows.append(np.concatenate([position, velocity / DAY_S]))
        return np.array(rows)

    yield state
    kernel.close()


@pytest.fixture(scope="session")
def apophis_nongrav() -> Nongrav:
    """A1, A2 of JPL solution 220."""
    return Nongrav(a1_au_d2=4.999999873689e-13, a2_au_d2=-2.901766637153165e-14)


# An orbit like that of Apophis, far from every planet for a year, and its epoch
NEO = np.array([-0.559, 0.856, 0.304, -0.01382, -0.00601, -0.00258])
NEO_STATE: Array = np.concatenate([NEO[:3] * AU_KM, NEO[3:] * AU_KM / DAY_S])


@pytest.fixture
def neo() -> tuple[Epoch, Array]:
    return Epoch.parse("2025-03-01T00:00:00 TDB"), NEO_STATE.copy()


@pytest.fixture(scope="session")
def full_forces(ephemeris: Ephemeris) -> ForceModel:
    """Everything on, with all sensitivities."""
    return ForceModel(
        ephemeris=ephemeris,
        radiation=RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.159, thermal_emission=0.1),
        nongrav=Nongrav(a1_au_d2=1e-12, a2_au_d2=-2.9e-14, a3_au_d2=2e-14),
        parameters=("radius_m", "mass_kg", "albedo", "thermal_emission", "a1_au_d2", "a2_au_d2", "a3_au_d2"),
    )


@pytest.fixture(scope="session")
def inside() -> Any:
    """What the modules of a step define, and `make_work(bodies, columns)`; called from here they are plain Python."""
    known: dict[str, Any] = {**vars(chebyshev), **vars(workspace), **vars(nodes), **vars(stages)}

    def make_work(bodies: int, columns: int) -> Work:
        work: Work = known["laid_out"](workspace.new_memory(bodies, columns), bodies)
        return work._replace(**{name: getattr(work, name)[:size] for name, size in USED.items()})

    return SimpleNamespace(**known, make_work=make_work)


@pytest.fixture(scope="session")
def summed_forces(inside: Any) -> Callable[[int, Work, Physics], tuple[Array, Array]]:
    """(lanes, work, physics) -> A (24,) and dA/dX (72,): every body summed where it is, nothing expanded.

    It also leaves dA/dV and dA/d(parameters) in w.K and w.F.
    """

    def field(n: int, w: Work, p: Physics) -> tuple[Array, Array]:
        A, S = np.zeros(24), np.zeros(48)
        w.strength[:] = p.strength
        forces_module.point_masses(n, w.X, w.P, p.gm, A, np.zeros(8))
        forces_module.point_masses_gradient(n, w.X, w.P, p.gm, S)
        if p.earth_range > 0.0:
            figure = (n, w.X, w.P, 3, p.gm[3], p.earth_zonal, w.pole)
            if forces_module.near(p.earth_range, n, w.X, w.P, 3):
                forces_module.zonal_harmonics(*figure, A)
                forces_module.zonal_harmonics_gradient(*figure, S)
        inside.add_small_forces(n, w, p, A)
        w.S[:] = S
        inside.add_small_gradients(n, w, p)
        return A, w.G.copy()

    return field
