"""Sunlight behind the Earth: how much of it is covered, and the derivative of the force that is left."""

from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, RadiationPressure, propagate, radiation
from nebosvod.dynamics.constants import AU_KM, RADIUS_KM
from nebosvod.timescale import Epoch

Array = np.ndarray
STRENGTH, PER_KAPPA = 3.0e5, 1.0e5
UMBRA_KM = RADIUS_KM["earth"] * AU_KM / (RADIUS_KM["sun"] - RADIUS_KM["earth"])  # its length


def plain(kernel: Any) -> Any:
    return getattr(kernel, "py_func", kernel)


def scene(places: Any) -> tuple[Array, Array]:
    """Eight asteroids at (behind, aside) km of an Earth on the x axis at 1 au; Sun at the origin."""
    P, X = np.zeros((4, 24)), np.zeros(24)
    P[3, :8] = AU_KM
    for lane, (behind, aside) in enumerate(places):
        X[lane], X[8 + lane], X[16 + lane] = AU_KM + behind, 0.6 * aside, 0.8 * aside
    return X, P


def share(X: Array, P: Array) -> Array:
    """Part of the radiation that is left, (8,)."""
    full, left = np.zeros(24), np.zeros(24)
    radiation.radiation(8, X, P, STRENGTH, full)
    radiation.radiation(8, X, P, STRENGTH, left)
    radiation.shade(8, X, P, STRENGTH, left)
    ratio: Array = left[:8] / full[:8]
    return ratio


def test_umbra_is_dark_and_day_is_bright() -> None:
    places = [(5e4, 0.0), (5e4, 5000.0), (1.3e6, 0.0), (-5e4, 0.0), (-7e3, 0.0), (5e4, 2e4), (0.0, 7e3), (1e6, 5e4)]
    assert share(*scene(places)) == pytest.approx(np.array([0, 0, 0, 1, 1, 1, 1, 1]), abs=1e-15)


def test_cones_have_their_textbook_radii() -> None:
    """1 km: umbra R (1 - x/L), penumbra R + x (R_sun + R)/1 au, at x = 40,000 km."""
    x, radius = 4e4, RADIUS_KM["earth"]
    umbra = radius * (1.0 - x / UMBRA_KM)
    penumbra = radius + x * (RADIUS_KM["sun"] + radius) / AU_KM
    places = [(x, umbra - 1), (x, umbra + 1), (x, penumbra - 1), (x, penumbra + 1)] * 2
    left = share(*scene(places))
    assert abs(left[0]) < 1e-15 < left[1] < 1e-3
    assert 1.0 - 1e-3 < left[2] < 1.0 - 1e-12 < left[3]


def test_beyond_the_umbra_a_ring_of_the_sun_is_left() -> None:
    """1 - (ratio of the apparent radii)^2."""
    x = 2.0 * UMBRA_KM
    ratio = np.arcsin(RADIUS_KM["earth"] / x) / np.arcsin(RADIUS_KM["sun"] / (AU_KM + x))
    assert share(*scene([(x, 0.0)] * 8)) == pytest.approx(np.full(8, 1.0 - ratio**2), rel=1e-12)


def test_penumbra_covers_what_a_count_of_points_on_the_disk_says() -> None:
    """2e-3: a million points on the Sun's disk, counted behind the Earth's."""
    rng = np.random.default_rng(1)
    a, b = 4.65e-3, 3.3e-3
    points = a * np.sqrt(rng.random(1_000_000)) * np.exp(2j * np.pi * rng.random(1_000_000))
    for apart in (1.4e-3, 3e-3, 6e-3, 7.9e-3):
        counted = np.mean(np.abs(points - apart) < b)
        assert radiation.dimming(a, b, apart)[0] == pytest.approx(counted, abs=2e-3)


# umbra, three places in the penumbra, antumbra, its penumbra, day, day side
PLACES = [
    (5e4, 100.0),
    (5e4, 6200.0),
    (5e4, 6400.0),
    (3e5, 6000.0),
    (3e6, 900.0),
    (3e6, 12000.0),
    (5e4, 9e3),
    (-1e5, 0.0),
]


def test_gradient_of_the_shade_is_its_complex_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """1e-9 of the largest entry of each lane: the angle between Sun and Earth is a small sine."""
    monkeypatch.setattr(radiation, "dimming", plain(radiation.dimming))
    X, P = scene(PLACES)
    G, F = np.zeros(72), np.zeros(24)
    plain(radiation.shade_gradient)(8, X, P, STRENGTH, PER_KAPPA, G, F)
    for axis in range(3):
        Z = X.astype(complex)
        Z[8 * axis : 8 * axis + 8] += 1e-30j
        A = np.zeros(24, dtype=complex)
        plain(radiation.shade)(8, Z, P, STRENGTH, A)
        wanted, ours = np.imag(A).reshape(3, 8) / 1e-30, G.reshape(3, 3, 8)[:, axis]
        scale = np.abs(G.reshape(9, 8)).max(axis=0) + 1e-300
        assert (np.abs(ours - wanted) / scale).max() < 1e-9
        assert axis or np.count_nonzero(np.abs(wanted).max(axis=0)) == 6
    A = np.zeros(24)
    radiation.shade(8, X, P, STRENGTH, A)
    assert pytest.approx(A * PER_KAPPA / STRENGTH, rel=1e-14) == F


@pytest.fixture(scope="module")
def eclipsed(ephemeris: Ephemeris) -> tuple[Epoch, Array]:
    """A light body that falls through the shadow 100,000 km behind the Earth at 3 km/s, an hour before its axis."""
    epoch = Epoch.parse("2029-06-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    outward = earth[:3] / np.linalg.norm(earth[:3])
    aside = np.cross([0.0, 0.0, 1.0], outward)
    aside /= np.linalg.norm(aside)
    start = earth + np.concatenate([1e5 * outward - 3.0 * 3600.0 * aside, 3.0 * aside])
    return epoch, start


@pytest.fixture(scope="module")
def foil(ephemeris: Ephemeris) -> RadiationPressure:
    return RadiationPressure(radius_m=1.0, mass_kg=10.0, albedo=0.1)


def test_shadow_takes_away_the_push_of_an_hour(
    ephemeris: Ephemeris, eclipsed: tuple[Epoch, Array], foil: RadiationPressure
) -> None:
    """5 %: pressure times the diameter of the Earth over 3 km/s, away from the Sun."""
    epoch, start = eclipsed
    ends = [
        propagate(
            start, epoch, [7200.0], ForceModel(ephemeris=ephemeris, radiation=foil, earth_shadow=on), False
        ).state[0]
        for on in (True, False)
    ]
    lost = (ends[1] - ends[0])[3:]
    pressure = 4.54e-6 * foil.kappa_m2_kg * 1e-3 * (AU_KM / np.linalg.norm(start[:3])) ** 2
    assert np.linalg.norm(lost) == pytest.approx(pressure * 2.0 * 6378.0 / 3.0, rel=0.05)
    assert lost @ start[:3] > 0.99 * np.linalg.norm(lost) * np.linalg.norm(start[:3])


def test_transition_and_radius_columns_hold_through_an_eclipse(
    ephemeris: Ephemeris, eclipsed: tuple[Epoch, Array], foil: RadiationPressure
) -> None:
    """1e-5 by orbits 1 km aside, 1e-4 by spheres 1 % larger and smaller, whose arc ends inside the shadow."""
    epoch, start = eclipsed
    model = ForceModel(ephemeris=ephemeris, radiation=foil, parameters=("radius_m",))
    t = [3600.0 + 2000.0]
    nominal = propagate(start, epoch, t, model)
    for column in range(3):
        step = np.eye(6)[column]
        ahead, behind = (propagate(start + s * step, epoch, t, model, False).state[0] for s in (1.0, -1.0))
        assert (ahead - behind) / 2.0 == pytest.approx(nominal.Phi[0][:, column], rel=1e-5, abs=2e-10)
    big, small = (propagate(start, epoch, t, model.with_values({"radius_m": r}), False).state[0] for r in (1.01, 0.99))
    assert (big - small)[:3] / 0.02 == pytest.approx(nominal.zeta[0][:3, 0], rel=1e-4)
