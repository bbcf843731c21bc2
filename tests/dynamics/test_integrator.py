"""How the integrator puts the forces together: each switch brings a force, its Jacobian and its parameter columns."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel
from nebosvod.dynamics.constants import AU_D2_KM_S2, AU_KM, DAY_S, RADIATION_KM3_S2_PER_M2_KG
from nebosvod.dynamics.ephemeris import PLANETS
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.workspace import Work
from nebosvod.timescale import Epoch

Array = np.ndarray
EPOCH = Epoch.parse("2029-04-13T20:00:00 TDB")
OFF: dict[str, Any] = {
    "sun_oblate": False,
    "relativity": 0,
    "lense_thirring": 0.0,
    "radiation_on": False,
    "shadow_range": 0.0,
    "nongrav_on": False,
}
# what is switched on, and where: "near" is in the shadow's edge 60,000 km behind the Earth, "far" 0.3 au from the Sun
SWITCHES: dict[str, tuple[dict[str, Any], str]] = {
    "J2 of the Sun": ({"sun_oblate": True}, "far"),
    "relativity of the Sun": ({"relativity": 1}, "far"),
    "Lense-Thirring effect": ({"lense_thirring": 3e5}, "far"),
    "EIH": ({"relativity": 2}, "far"),
    "EIH near the Earth": ({"relativity": 2}, "near"),
    "radiation": ({"radiation_on": True}, "far"),
    "radiation in the penumbra": ({"radiation_on": True, "shadow_range": 1e7}, "near"),
    "A1, A2, A3": ({"nongrav_on": True}, "far"),
}


@dataclass
class Place:
    """Eight moments of an asteroid, with what the kernels know there, and how far one may step for a difference."""

    w: Work
    physics: Physics
    X: Array
    V: Array
    step_km: float
    inside: Any


@pytest.fixture(scope="module")
def places(full_forces: ForceModel, inside: Any) -> dict[str, Place]:
    ephemeris, physics = full_forces.ephemeris, full_forces.physics(EPOCH)
    window = full_forces.window(EPOCH, 0.0, DAY_S)
    found = {}
    for name, step_km in (("near", 4.0), ("far", 65536.0)):
        w = inside.make_work(window.layout.shape[0], 0)
        whole = physics._replace(relativity=2)
        inside.read_ephemeris(8, 0.0, 3600.0, w, whole, window.coefficients, window.layout, window.timing)
        w.strength[:] = physics.strength
        sun, earth = (ephemeris.state_km_km_s(body, EPOCH, w.t) for body in ("sun", "earth"))
        lanes = np.arange(8.0)[:, None]
        if name == "near":
            outward = (earth - sun)[:, :3] / np.linalg.norm((earth - sun)[:, :3], axis=1)[:, None]
            aside = np.cross([0.0, 0.0, 1.0], outward)
            X = earth[:, :3] + 6e4 * outward + (6260.0 + 30.0 * lanes) * aside
            V = earth[:, 3:] + np.array([3.0, -4.0, 2.0])
        else:
            X = sun[:, :3] + 0.3 * AU_KM * np.array([0.6, 0.48, 0.64]) * (1.0 + 0.05 * lanes)
            V = sun[:, 3:] + np.array([-30.0, 40.0, 9.0])
        found[name] = Place(
            w=w, physics=physics, X=np.round(X.T.ravel()), V=V.T.ravel(), step_km=step_km, inside=inside
        )
    return found


def force(place: Place, on: dict[str, Any], X: Array, V: Array) -> Array:
    """What the switched forces add (24,)."""
    A = np.zeros(24)
    place.w.X[:], place.w.V[:] = X, V
    place.inside.add_small_forces(8, place.w, place.physics._replace(**{**OFF, **on}), A)
    return A


def slope(place: Place, on: dict[str, Any], axis: int, of_velocity: bool) -> Array:
    """Fourth-order difference (3, 8) by one component."""
    unit = np.zeros(24)
    unit[8 * axis : 8 * axis + 8] = 2.0**-6 if of_velocity else place.step_km
    ends = [
        force(place, on, place.X + (0 if of_velocity else k * unit), place.V + (k * unit if of_velocity else 0))
        for k in (1, -1, 2, -2)
    ]
    found: Array = ((8.0 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12.0 * unit.max())).reshape(3, 8)
    return found


@pytest.mark.parametrize("name", SWITCHES)
def test_each_switch_brings_a_force_with_its_jacobian(places: dict[str, Place], name: str) -> None:
    """1e-8 of the largest entry, 1e-5 at the edge of the shadow (a step is a tenth of its curvature there)."""
    on, where = SWITCHES[name]
    place = places[where]
    assert np.abs(force(place, on, place.X, place.V)).min() > 0.0
    place.w.S[:] = 0.0
    place.inside.add_small_gradients(8, place.w, place.physics._replace(**{**OFF, **on}))
    limit = 1e-5 if "penumbra" in name else 1e-8
    for of_velocity, table in ((False, place.w.G.copy()), (True, place.w.K.copy())):
        wanted = np.stack([slope(place, on, axis, of_velocity) for axis in range(3)], axis=1)
        error = np.abs(table.reshape(3, 3, 8) - wanted).max(axis=(0, 1))
        assert (error <= limit * np.abs(wanted).max(axis=(0, 1))).all()


def test_parameter_columns_are_the_forces_per_unit(places: dict[str, Place]) -> None:
    """1e-12: linear forces, so the column is the force over its strength; in the penumbra too."""
    place = places["near"]
    both: dict[str, Any] = {"radiation_on": True, "shadow_range": 1e7, "nongrav_on": True}
    force(place, both, place.X, place.V)
    place.inside.add_small_gradients(8, place.w, place.physics._replace(**{**OFF, **both}))
    columns = place.w.F.reshape(4, 24).copy()
    units = [RADIATION_KM3_S2_PER_M2_KG] + [AU_D2_KM_S2 * AU_KM**2] * 3
    kept = place.w.strength.copy()
    for k, unit in enumerate(units):
        place.w.strength[:] = 0.0
        place.w.strength[k] = unit
        wanted = force(place, both, place.X, place.V)
        assert np.abs(columns[k] - wanted).max() < 1e-12 * np.abs(wanted).max()
    place.w.strength[:] = kept


def test_figure_of_the_earth_is_in_the_expansion_with_its_gradient(places: dict[str, Place]) -> None:
    """1e-12 of the whole field at 20,000 km, where J2 to J4 are more than 1e-5 of it."""
    place = places["near"]
    w, physics = place.w, place.physics
    earth = w.P[PLANETS.index("earth")]
    X = earth + np.repeat([12000.0, -9000.0, 13000.0], 8)
    parts = []
    for reach in (physics.earth_range, 0.0):
        w.X[:] = X
        place.inside.expand_here(8, w, physics._replace(earth_range=reach))
        parts.append((w.R0.copy(), w.S0.copy()))
    gm = physics.gm[PLANETS.index("earth")]
    A, S = np.zeros(24), np.zeros(48)
    place.inside.zonal_harmonics(8, X, w.P, 3, gm, physics.earth_zonal, w.pole, A)
    place.inside.zonal_harmonics_gradient(8, X, w.P, 3, gm, physics.earth_zonal, w.pole, S)
    assert np.abs(parts[0][0] - parts[1][0] - A).max() < 1e-12 * np.abs(parts[0][0]).max()
    assert np.abs(parts[0][1] - parts[1][1] - S).max() < 1e-12 * np.abs(parts[0][1]).max()
    assert np.abs(A).max() > 1e-5 * np.abs(parts[0][0]).max()


@pytest.mark.parametrize("years", [-15.0, 0.0, 25.0])
def test_pole_of_the_earth_is_that_of_the_step_not_of_the_epoch(
    full_forces: ForceModel, years: float, inside: Any
) -> None:
    """0.3 arcsec of the full theory (4 terms of nutation are summed); it moves by 20 arcsec a year."""
    import erfa

    t, w = years * 365.25 * DAY_S, inside.make_work(27, 0)
    window, physics = full_forces.window(EPOCH, t, t + DAY_S), full_forces.physics(EPOCH)
    inside.read_ephemeris(8, t, DAY_S, w, physics, window.coefficients, window.layout, window.timing)
    moment = EPOCH + (t + 0.5 * DAY_S)
    wanted = erfa.pnm06a(moment.day, moment.fraction)[2]
    assert np.degrees(np.abs(w.pole - wanted).max()) * 3600.0 < 0.3
