"""Every force and its Jacobian are a pair: the hand-written derivative equals the complex step of the force.

The kernels run here as plain Python (`py_func`) on complex arrays, so no difference quotient blurs the comparison.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nebosvod.dynamics import Ephemeris, forces, nongrav, radiation, relativity
from nebosvod.dynamics.constants import AU_D2_KM_S2, AU_KM, RADIATION_KM3_S2_PER_M2_KG, SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.ephemeris import ASTEROIDS, PLANETS
from nebosvod.dynamics.model import SUN_POLE
from nebosvod.dynamics.nongrav import WATER_ICE, Nongrav
from nebosvod.timescale import Epoch

Array = np.ndarray
C2 = SPEED_OF_LIGHT_KM_S**2
LANES = 8
STEP = 1e-30
UNIT = AU_D2_KM_S2 * AU_KM**2


@dataclass
class Scene:
    """Eight moments of an asteroid near the Earth, the bodies there, and what EIH needs."""

    X: Array
    V: Array
    P: Array
    W: Array
    WA: Array
    U: Array
    gm: Array
    pole: Array
    zonal: Array


@pytest.fixture(scope="module")
def scene(ephemeris: Ephemeris) -> Scene:
    epoch, times = Epoch.parse("2029-04-13T20:00:00 TDB"), np.arange(8) * 600.0
    bodies = PLANETS + ASTEROIDS
    P = np.array([ephemeris.position_km(b, epoch, times).T.ravel() for b in bodies])
    W = np.array([ephemeris.state_km_km_s(b, epoch, times)[:, 3:].T.ravel() for b in PLANETS])
    gm = np.array([ephemeris.gm_km3_s2[b] for b in bodies])
    rng = np.random.default_rng(3)
    X = P[3] + rng.normal(0.0, 2.5e4, 24) + 2e4
    V = W[3] + rng.normal(0.0, 4.0, 24)
    WA, U = np.zeros((11, 24)), np.zeros((11, 8))
    relativity.major_fields(8, P, gm, WA, U)
    scalars = ephemeris.scalars
    # harmonics a thousand times too strong in J3 and J4, so that an error in them cannot hide behind J2
    zonal = np.array([scalars["earth_radius_km"], scalars["earth_j2"], -3e-3, 2e-3])
    pole = np.array([0.3, -0.2, np.sqrt(1 - 0.13)])
    return Scene(X=X, V=V, P=P, W=W, WA=WA, U=U, gm=gm, pole=pole, zonal=zonal)


def plain(kernel: Any) -> Callable[..., None]:
    """The Python function behind a kernel (the function itself where compilation is off)."""
    function: Callable[..., None] = getattr(kernel, "py_func", kernel)
    return function


@dataclass
class Pair:
    """A force and its gradient with one calling convention: f(scene, X, V) -> A, g(scene) -> (S, G, K, F)."""

    force: Callable[[Scene, Array, Array], Array]
    gradient: Callable[[Scene], tuple[Array, Array]]


def symmetric(kernel: Any) -> Callable[[Scene, tuple[Any, ...]], tuple[Array, Array]]:
    def gradient(s: Scene, more: tuple[Any, ...]) -> tuple[Array, Array]:
        S, G = np.zeros(48), np.zeros(72)
        plain(kernel)(8, s.X, s.P, *more, S)
        plain(forces.expand)(8, S, G)
        return G, np.zeros(72)

    return gradient


def masses(s: Scene, X: Array, V: Array) -> Array:
    A, tide = np.zeros(24, dtype=X.dtype), np.zeros(8, dtype=X.dtype)
    plain(forces.point_masses)(8, X, s.P, s.gm, A, tide)
    return A


def zonal(s: Scene, X: Array, V: Array) -> Array:
    A = np.zeros(24, dtype=X.dtype)
    plain(forces.zonal_harmonics)(8, X, s.P, 3, s.gm[3], s.zonal, s.pole, A)
    return A


def solar(s: Scene, X: Array, V: Array) -> Array:
    A = np.zeros(24, dtype=np.result_type(X, V))
    plain(relativity.sun_relativity)(8, X, V, s.P, s.W[0], s.gm[0], C2, A)
    return A


def solar_gradient(s: Scene) -> tuple[Array, Array]:
    G, K = np.zeros(72), np.zeros(72)
    plain(relativity.sun_relativity_gradient)(8, s.X, s.V, s.P, s.W[0], s.gm[0], C2, G, K)
    return G, K


SPIN = 3e5


def dragged(s: Scene, X: Array, V: Array) -> Array:
    A = np.zeros(24, dtype=np.result_type(X, V))
    plain(relativity.lense_thirring)(8, X, V, s.P, s.W[0], SPIN, s.pole, A)
    return A


def dragged_gradient(s: Scene) -> tuple[Array, Array]:
    G, K = np.zeros(72), np.zeros(72)
    plain(relativity.lense_thirring_gradient)(8, s.X, s.V, s.P, s.W[0], SPIN, s.pole, G, K)
    return G, K


def einstein(s: Scene, X: Array, V: Array) -> Array:
    kind = np.result_type(X, V)
    A, Q = np.zeros(24, dtype=kind), np.zeros(32, dtype=kind)
    plain(relativity.eih)(8, X, V, s.P, s.W, s.WA, s.U, s.gm, C2, Q, A)
    return A


def einstein_gradient(s: Scene) -> tuple[Array, Array]:
    G, K, Q = np.zeros(72), np.zeros(72), np.zeros(32)
    plain(relativity.eih_gradient)(8, s.X, s.V, s.P, s.W, s.WA, s.U, s.gm, C2, Q, G, K)
    return G, K


LAWS = {"r^-2": Nongrav().law, "water ice": Nongrav(**WATER_ICE).law, "r^-1.5": Nongrav(alpha=2.0, m=1.5).law}
STRENGTH = np.array([1.0, -0.7, 0.4]) * UNIT
SUNLIGHT = 3.0 * RADIATION_KM3_S2_PER_M2_KG


def light(s: Scene, X: Array, V: Array) -> Array:
    A = np.zeros(24, dtype=X.dtype)
    plain(radiation.radiation)(8, X, s.P, SUNLIGHT, A)
    return A


def light_gradient(s: Scene) -> tuple[Array, Array]:
    S, G, F = np.zeros(48), np.zeros(72), np.zeros(24)
    plain(radiation.radiation_gradient)(8, s.X, s.P, SUNLIGHT, RADIATION_KM3_S2_PER_M2_KG, S, F)
    plain(forces.expand)(8, S, G)
    return G, np.zeros(72)


def marsden(law: Array) -> Pair:
    def force(s: Scene, X: Array, V: Array) -> Array:
        A = np.zeros(24, dtype=np.result_type(X, V))
        q = np.zeros(16, dtype=X.dtype)
        plain(nongrav.law_factors)(8, X, s.P, law, q)
        plain(nongrav.nongrav)(8, X, V, s.P, s.W[0], STRENGTH, q, A)
        return A

    def gradient(s: Scene) -> tuple[Array, Array]:
        G, K, F, q = np.zeros(72), np.zeros(72), np.zeros(72), np.zeros(16)
        plain(nongrav.law_factors)(8, s.X, s.P, law, q)
        plain(nongrav.nongrav_gradient)(8, s.X, s.V, s.P, s.W[0], STRENGTH, q, UNIT, G, K, F)
        return G, K

    return Pair(force, gradient)


PAIRS = {
    "point masses": Pair(masses, lambda s: symmetric(forces.point_masses_gradient)(s, (s.gm,))),
    "zonal harmonics": Pair(
        zonal, lambda s: symmetric(forces.zonal_harmonics_gradient)(s, (3, s.gm[3], s.zonal, s.pole))
    ),
    "Sun's relativity": Pair(solar, solar_gradient),
    "Lense-Thirring": Pair(dragged, dragged_gradient),
    "EIH": Pair(einstein, einstein_gradient),
    "radiation pressure": Pair(light, light_gradient),
    **{f"A1, A2, A3 by {name}": marsden(law) for name, law in LAWS.items()},
}


def complex_step(pair: Pair, s: Scene, axis: int, of_velocity: bool) -> Array:
    """Column (3, 8) of the Jacobian by one component of position or velocity."""
    shift = np.zeros(24, dtype=complex)
    shift[8 * axis : 8 * axis + 8] = 1j * STEP
    X = s.X + (0.0 if of_velocity else shift)
    V = s.V + (shift if of_velocity else 0.0)
    return np.imag(pair.force(s, X, V)).reshape(3, 8) / STEP


@pytest.mark.parametrize("of_velocity", [False, True])
@pytest.mark.parametrize("name", PAIRS)
def test_jacobian_is_the_derivative_of_its_force(scene: Scene, name: str, of_velocity: bool) -> None:
    """1e-12 of the largest entry: rounding of sums of ten products with some cancellation."""
    pair = PAIRS[name]
    jacobian = pair.gradient(scene)[1 if of_velocity else 0].reshape(3, 3, 8)
    wanted = np.stack([complex_step(pair, scene, axis, of_velocity) for axis in range(3)], axis=1)
    size = np.abs(wanted).max()
    assert np.abs(jacobian - wanted).max() <= 1e-12 * size
    assert size > 0.0 or (of_velocity and name in ("point masses", "zonal harmonics", "radiation pressure"))


@settings(max_examples=10, deadline=None)
@given(turn=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: sum(a * a for a in q) > 0.1))
@pytest.mark.parametrize("name", PAIRS)
def test_turned_scene_has_turned_forces(scene: Scene, name: str, turn: list[float]) -> None:
    """1e-10 relative, for any rotation of bodies, poles, positions and velocities together."""
    R = rotation(np.array(turn) / np.linalg.norm(turn))

    def turned(rows: Array) -> Array:
        return np.einsum("ij,...jl->...il", R, rows.reshape(*rows.shape[:-1], 3, 8)).reshape(rows.shape)

    other = Scene(
        X=turned(scene.X), V=turned(scene.V), P=turned(scene.P), W=turned(scene.W), WA=turned(scene.WA),
        U=scene.U, gm=scene.gm, pole=R @ scene.pole, zonal=scene.zonal,
    )  # fmt: skip
    wanted = turned(PAIRS[name].force(scene, scene.X, scene.V))
    found = PAIRS[name].force(other, other.X, other.V)
    # positions of 1.5e8 km are rounded to 3e-8 km, the nearest body is 1e4 km away
    assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max()


def rotation(q: Array) -> Array:
    """Matrix of a unit quaternion (w, x, y, z)."""
    w, v = q[0], q[1:]
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R: Array = (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * cross
    return R


def test_parameter_columns_are_the_derivatives_of_the_force(scene: Scene) -> None:
    """Both forces are linear in their parameters: the column is the force at unit strength."""
    S, F = np.zeros(48), np.zeros(24)
    plain(radiation.radiation_gradient)(8, scene.X, scene.P, SUNLIGHT, RADIATION_KM3_S2_PER_M2_KG, S, F)
    assert light(scene, scene.X, scene.V) / 3.0 == pytest.approx(F, rel=1e-14)
    for law in LAWS.values():
        G, K, F3 = np.zeros(72), np.zeros(72), np.zeros(72)
        q = np.zeros(16)
        plain(nongrav.law_factors)(8, scene.X, scene.P, law, q)
        plain(nongrav.nongrav_gradient)(8, scene.X, scene.V, scene.P, scene.W[0], STRENGTH, q, UNIT, G, K, F3)
        for k in range(3):
            A = np.zeros(24)
            plain(nongrav.nongrav)(8, scene.X, scene.V, scene.P, scene.W[0], np.eye(3)[k] * UNIT, q, A)
            assert F3[24 * k : 24 * k + 24] == pytest.approx(A, rel=1e-12, abs=1e-14 * np.abs(A).max())


def test_zonal_harmonics_are_the_gradient_of_their_potential(scene: Scene) -> None:
    """1e-12 relative: potential in Legendre polynomials of numpy, derivative by complex step."""
    position = scene.X.reshape(3, 8)[:, 0] - scene.P[3].reshape(3, 8)[:, 0]
    radius, j = scene.zonal[0], scene.zonal[1:]

    def potential(r: Array) -> Any:
        distance = np.sqrt(r @ r)
        s = r @ scene.pole / distance
        polynomials = [(3 * s**2 - 1) / 2, (5 * s**3 - 3 * s) / 2, (35 * s**4 - 30 * s**2 + 3) / 8]
        terms = sum(j[k] * (radius / distance) ** (k + 2) * polynomials[k] for k in range(3))
        return -scene.gm[3] / distance * terms

    wanted = [np.imag(potential(position + 1j * STEP * axis)) / STEP for axis in np.eye(3)]
    assert zonal(scene, scene.X, scene.V).reshape(3, 8)[:, 0] == pytest.approx(np.array(wanted), rel=1e-12)


def rows(flat: Array) -> Array:
    """(24,) of x, y, z lanes -> eight vectors (8, 3)."""
    vectors: Array = flat.reshape(3, LANES).T
    return vectors


@pytest.mark.parametrize("name", LAWS)
def test_marsdens_acceleration_is_along_r_along_the_motion_and_along_the_momentum(scene: Scene, name: str) -> None:
    """1e-13 of the acceleration: Marsden, Sekanina, Yeomans (1973), in unit vectors and au."""
    alpha, r0_km, m, n, k = LAWS[name]
    found = rows(PAIRS[f"A1, A2, A3 by {name}"].force(scene, scene.X, scene.V))
    for lane in range(LANES):
        d, w = rows(scene.X - scene.P[0])[lane], rows(scene.V - scene.W[0])[lane]
        radial, normal = d / np.linalg.norm(d), np.cross(d, w) / np.linalg.norm(np.cross(d, w))
        transverse = np.cross(normal, radial)
        assert transverse @ w > 0.0
        x = np.linalg.norm(d) / r0_km
        g = alpha * x**-m * (1.0 + x**n) ** -k
        wanted = AU_D2_KM_S2 * g * (1.0 * radial - 0.7 * transverse + 0.4 * normal)
        assert np.abs(found[lane] - wanted).max() < 1e-13 * np.linalg.norm(wanted)


def test_pressure_of_sunlight_has_its_size_and_pushes_away(scene: Scene) -> None:
    """1e-13: 1361 W/m^2 over 299792458 m/s on 3 m^2/kg at 1 au (4.5398 uPa), falling with the square."""
    found = rows(light(scene, scene.X, scene.V))
    for lane in range(LANES):
        d = rows(scene.X - scene.P[0])[lane]
        r_au = np.linalg.norm(d) / 149597870.7
        wanted = 1361.0 / 299792458.0 * 3.0 * 1e-3 / r_au**2 * d / np.linalg.norm(d)
        assert np.abs(found[lane] - wanted).max() < 1e-13 * np.linalg.norm(wanted)


def test_suns_relativity_is_the_published_formula(scene: Scene) -> None:
    """1e-13 relative: IERS Conventions 2010, eq. 10.12 with beta = gamma = 1, about the Sun."""
    found = rows(solar(scene, scene.X, scene.V))
    for lane in range(LANES):
        r, v = rows(scene.X - scene.P[0])[lane], rows(scene.V - scene.W[0])[lane]
        R, gm = np.linalg.norm(r), scene.gm[0]
        wanted = gm / (C2 * R**3) * ((4.0 * gm / R - v @ v) * r + 4.0 * (r @ v) * v)
        assert np.abs(found[lane] - wanted).max() < 1e-13 * np.linalg.norm(wanted)


def test_eih_is_the_published_sum_over_the_major_bodies(scene: Scene) -> None:
    """1e-12 relative: Newhall, Standish, Williams (1983), eq. 1, with beta = gamma = 1 and its Newtonian part left out.

    Velocities of the asteroid ten times too large as well, so that no term hides behind the potential.
    """
    gm = scene.gm[:11]
    for V in (scene.V, 10.0 * scene.V):
        found = rows(einstein(scene, scene.X, V))
        for lane in range(LANES):
            x, v = rows(scene.X)[lane], rows(V)[lane]
            places, speeds = (np.array([rows(body)[lane] for body in table[:11]]) for table in (scene.P, scene.W))
            wanted = np.zeros(3)
            distance = np.linalg.norm(places - x, axis=1)
            for j in range(11):
                others = [k for k in range(11) if k != j]
                toward = places[others] - places[j]
                apart = np.linalg.norm(toward, axis=1)
                pull = (gm[others] / apart**3) @ toward
                to_j, w = places[j] - x, speeds[j]
                bracket = (
                    -4.0 * (gm / distance).sum()
                    - (gm[others] / apart).sum()
                    + v @ v
                    + 2.0 * w @ w
                    - 4.0 * v @ w
                    - 1.5 * (-to_j @ w / distance[j]) ** 2
                    + 0.5 * to_j @ pull
                )
                wanted += gm[j] / distance[j] ** 3 * to_j * bracket
                wanted += gm[j] / distance[j] ** 3 * (-to_j @ (4.0 * v - 3.0 * w)) * (v - w)
                wanted += 3.5 * gm[j] * pull / distance[j]
            wanted /= C2
            assert np.abs(found[lane] - wanted).max() < 1e-12 * np.linalg.norm(wanted)


def test_eih_without_planets_is_the_term_of_the_sun_alone(scene: Scene) -> None:
    """1e-12 relative, for a Sun at rest: the Schwarzschild term in harmonic coordinates."""
    gm = scene.gm.copy()
    gm[1:] = 0.0
    nothing, still = np.zeros((11, 24)), np.zeros((11, 24))
    A, B, Q = np.zeros(24), np.zeros(24), np.zeros(32)
    relativity.eih(8, scene.X, scene.V, scene.P, still, nothing, np.zeros((11, 8)), gm, C2, Q, A)
    relativity.sun_relativity(8, scene.X, scene.V, scene.P, np.zeros(24), gm[0], C2, B)
    assert pytest.approx(B, rel=1e-12) == A


def test_bodies_accelerate_each_other_as_their_ephemeris_says(ephemeris: Ephemeris) -> None:
    """1e-4 relative: Newton among eleven bodies against the second difference of DE440 over an hour."""
    epoch, times = Epoch.parse("2029-04-13T20:00:00 TDB"), np.array([-1800.0, 0.0, 1800.0])
    P = np.array([np.repeat(ephemeris.position_km(b, epoch, 0.0)[0], 8) for b in PLANETS])
    gm = np.array([ephemeris.gm_km3_s2[b] for b in PLANETS])
    WA, U = np.zeros((11, 24)), np.zeros((11, 8))
    relativity.major_fields(8, P, gm, WA, U)
    for row, body in enumerate(PLANETS[:7]):
        velocity = ephemeris.state_km_km_s(body, epoch, times)[:, 3:]
        wanted = (velocity[2] - velocity[0]) / 3600.0
        assert np.linalg.norm(WA[row].reshape(3, 8)[:, 0] - wanted) < 2e-4 * np.linalg.norm(wanted), body


def test_major_bodies_move_in_each_others_potential(scene: Scene) -> None:
    """1e-13 relative: sum of GM/distance, with the body itself left out."""
    P, gm = scene.P[:11].reshape(11, 3, 8), scene.gm[:11]
    for j in range(11):
        others = [k for k in range(11) if k != j]
        wanted = (gm[others, None] / np.linalg.norm(P[others] - P[j], axis=1)).sum(axis=0)
        assert scene.U[j] == pytest.approx(wanted, rel=1e-13)


def test_pole_of_the_earth_is_erfas() -> None:
    """0.25 arcsec of the full nutation (reached: 0.21): four of its terms are summed, 9 arcsec in all."""
    import erfa

    pole, worst = np.zeros(3), 0.0
    for century in np.linspace(-0.3, 0.6, 400):
        forces.earth_pole(True, century, pole)
        matrix = erfa.pnm06a(2451545.0, century * 36525.0)
        worst = max(worst, float(np.degrees(np.abs(pole - matrix[2]).max()) * 3600.0))
        assert pole @ pole == pytest.approx(1.0, abs=1e-15)
    assert worst < 0.25


def test_pole_follows_the_nutation_of_nine_years() -> None:
    """What is left of its 0.08 and 0.09 arcsec is below 0.02: the term by the double angle has its sign and size."""
    erfa, pole = pytest.importorskip("erfa"), np.zeros(3)
    centuries = np.linspace(0.0, 0.01 * 18.613 * 3.0, 3000)
    left = np.empty((len(centuries), 2))
    for row, century in zip(left, centuries):
        forces.earth_pole(True, century, pole)
        row[:] = (pole - erfa.pnm06a(2451545.0, century * 36525.0)[2])[:2]
    phase = np.exp(2j * (2.18243920 - 33.7570460 * centuries))
    amplitude = 2.0 * np.abs((left - left.mean(axis=0)).T @ phase) / len(centuries)
    assert np.degrees(amplitude).max() * 3600.0 < 0.02


def test_pole_of_j2000_stands_on_the_equator() -> None:
    pole = np.zeros(3)
    forces.earth_pole(False, 0.29, pole)
    assert pole.tolist() == [0.0, 0.0, 1.0]


def test_laws_of_marsden_have_their_published_values() -> None:
    """Water ice: g(1 au) = 1 by definition of alpha (1e-6: its digits); at 2.808 au g = alpha 2^-k."""
    for r_au, wanted in ((1.0, 1.0), (2.808, 0.1112620426 * 2.0**-4.6142)):
        assert law_at(r_au, LAWS["water ice"])[0] / r_au**2 == pytest.approx(wanted, rel=1e-6)
    assert law_at(2.0, LAWS["r^-2"]) == (1.0, 0.0)
    assert law_at(2.0, LAWS["r^-1.5"])[0] == pytest.approx(2.0 * 2.0**0.5, rel=1e-14)


def law_at(r_au: float, law: Array) -> tuple[float, float]:
    """g(r) (r/1 au)^2 and its logarithmic slope, all eight lanes being at r."""
    X, q = np.repeat([r_au * AU_KM, 0.0, 0.0], 8), np.zeros(16)
    nongrav.law_factors(8, X, np.zeros((1, 24)), law, q)
    assert np.ptp(q[:8]) == np.ptp(q[8:]) == 0.0
    return float(q[0]), float(q[8])


def test_pole_of_the_sun_is_a_unit_vector_towards_draco() -> None:
    assert np.linalg.norm(SUN_POLE) == pytest.approx(1.0, abs=1e-15)
    assert np.degrees(np.arcsin(SUN_POLE[2])) == pytest.approx(63.87, abs=1e-12)
    assert np.degrees(np.arctan2(SUN_POLE[1], SUN_POLE[0])) % 360.0 == pytest.approx(286.13, abs=1e-12)


def test_compiled_forces_equal_the_plain_ones(scene: Scene) -> None:
    """1e-13: fused multiply-adds change the last digit."""
    A, tide = np.zeros(24), np.zeros(8)
    forces.point_masses(8, scene.X, scene.P, scene.gm, A, tide)
    assert pytest.approx(masses(scene, scene.X, scene.V), rel=1e-13) == A
    assert tide.max() == pytest.approx(
        np.max(scene.gm[:, None] / np.linalg.norm((scene.X - scene.P).reshape(-1, 3, 8), axis=1) ** 3), rel=1e-12
    )


def test_only_the_asked_lanes_are_written(scene: Scene) -> None:
    A, tide = np.zeros(24), np.zeros(8)
    forces.point_masses(1, scene.X, scene.P, scene.gm, A, tide)
    assert np.count_nonzero(A) == 3
