"""Elements against Horizons, against each other, and against finite differences."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.elements import (
    cometary_to_state,
    equinoctial_to_state,
    keplerian_to_state,
    state_to_cometary,
    state_to_equinoctial,
    state_to_keplerian,
)
from nebosvod.errors import GeometryError, InputError

GM = 2.9591220828411956e-4 * AU_KM**3 / DAY_S**2  # Gaussian system of DE440: the one of Horizons' elements
SCALE = np.array([AU_KM] * 3 + [30.0] * 3)


def rows(reference: Path, frame: str) -> list[dict[str, Any]]:
    with (reference / "dynamics" / f"elements_{frame}.csv").open(encoding="utf-8") as file:
        return [{k: v if k == "targetname" else float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def state_of(row: dict[str, Any]) -> np.ndarray:
    return np.array([row[k] * AU_KM for k in ("x", "y", "z")] + [row[k] * AU_KM / DAY_S for k in ("vx", "vy", "vz")])


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(
        max(
            np.linalg.norm(a[:3] - b[:3]) / np.linalg.norm(b[:3]), np.linalg.norm(a[3:] - b[3:]) / np.linalg.norm(b[3:])
        )
    )


@pytest.mark.parametrize("frame", ["sun_eq", "sun_ec"])
def test_states_of_28_objects_follow_from_their_elements(reference: Path, frame: str) -> None:
    """1e-11 relative: Horizons prints 16 digits, but the perihelion date only to 1e-9 d, hence up to 6e-12."""
    seen = rows(reference, frame)
    assert len(seen) == 28
    for row in seen:
        angles = np.radians([row["Omega"], row["w"], row["incl"]])
        tp = (row["tp_mjd"] - row["mjd_tdb"]) * DAY_S
        state = cometary_to_state([row["e"], row["q"] * AU_KM, tp, *angles], GM)[0]
        assert relative(state, state_of(row)) < 1e-11, row["targetname"]
        kepler = [row["a"] * AU_KM, row["e"], angles[2], angles[0], angles[1], np.radians(row["M"])]
        assert relative(keplerian_to_state(kepler, GM)[0], state_of(row)) < 1e-13, row["targetname"]


@pytest.mark.parametrize("frame", ["sun_eq", "sun_ec"])
def test_elements_of_28_objects_follow_from_their_states(reference: Path, frame: str) -> None:
    """1e-11 relative, in e, q, angles; an object's tp is as exact as its printed date."""
    for row in rows(reference, frame):
        found = state_to_cometary(state_of(row), GM)[0]
        angles = np.radians([row["Omega"], row["w"], row["incl"]])
        wanted = np.array([row["e"], row["q"] * AU_KM, (row["tp_mjd"] - row["mjd_tdb"]) * DAY_S, *angles])
        assert np.abs(found / wanted - 1.0)[[0, 1, 3, 4, 5]].max() < 1e-11, row["targetname"]
        assert abs(found[2] - wanted[2]) < 1e-3, row["targetname"]  # s; 1e-8 d


ECCENTRICITIES = (1e-9, 1e-3, 0.5, 0.97, 1 - 1e-7, 1 - 1e-12, 1.0, 1 + 1e-12, 1 + 1e-7, 1.001, 3.0, 30.0)


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("days", [-2000.0, -10.0, 0.0, 0.1, 300.0])
def test_cometary_elements_make_a_round_trip_at_every_eccentricity(e: float, days: float) -> None:
    """1e-14 of the state, on both sides of the parabola."""
    state = cometary_to_state([e, 0.7 * AU_KM, days * DAY_S, 1.0, 2.0, 0.5], GM)[0]
    elements = state_to_cometary(state, GM)[0]
    assert relative(cometary_to_state(elements, GM)[0], state) < 1e-14
    assert elements[0] == pytest.approx(e, rel=1e-13, abs=2e-13)
    assert elements[1] == pytest.approx(0.7 * AU_KM, rel=1e-12)


@pytest.mark.parametrize("e", [0.0, 1e-6, 0.3, 0.99])
@pytest.mark.parametrize("inclination", [0.0, 0.4, 2.8])
def test_equinoctial_elements_are_regular_on_circles_and_in_the_plane(e: float, inclination: float) -> None:
    size, node, peri, mean = 2.2 * AU_KM, 0.8, -1.1, 2.5
    tangent = np.tan(inclination / 2)
    wanted = [size, e * np.sin(node + peri), e * np.cos(node + peri), tangent * np.sin(node), tangent * np.cos(node)]
    wanted.append(np.remainder(mean + node + peri, 2 * np.pi))
    state = keplerian_to_state([size, e, inclination, node, peri, mean], GM)[0]
    found, jacobian = state_to_equinoctial(state, GM)
    assert np.abs((found - wanted) / [AU_KM, 1, 1, 1, 1, 1]).max() < 2e-13
    assert relative(equinoctial_to_state(found, GM)[0], state) < 2e-14
    assert np.isfinite(jacobian).all()


KINDS = {
    "cometary": (cometary_to_state, state_to_cometary, [0.4, 0.8 * AU_KM, 5e6, 1.0, 2.0, 0.5]),
    "comet": (cometary_to_state, state_to_cometary, [1.0 - 1e-9, 0.8 * AU_KM, 5e6, 1.0, 2.0, 0.5]),
    "hyperbola": (cometary_to_state, state_to_cometary, [1.4, 0.8 * AU_KM, -5e6, 1.0, 2.0, 0.5]),
    "keplerian": (keplerian_to_state, state_to_keplerian, [1.3 * AU_KM, 0.4, 0.5, 1.0, 2.0, 2.5]),
    "keplerian hyperbola": (keplerian_to_state, state_to_keplerian, [-1.3 * AU_KM, 1.4, 0.5, 1.0, 2.0, 2.5]),
    "equinoctial": (equinoctial_to_state, state_to_equinoctial, [1.3 * AU_KM, 0.2, -0.3, 0.1, 0.2, 4.0]),
}


def anomaly(function: Callable[[mp.mpf], mp.mpf], slope: Callable[[mp.mpf], mp.mpf], reach: int) -> mp.mpf:
    """Root of a rising function by bisection, then Newton to all digits."""
    low, high = mp.mpf(-reach), mp.mpf(reach)
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    for _ in range(6):
        low -= function(low) / slope(low)
    return low


def by_anomalies(a: mp.mpf, e: mp.mpf, i: mp.mpf, node: mp.mpf, peri: mp.mpf, mean: mp.mpf) -> list[mp.mpf]:
    """State by the eccentric or hyperbolic anomaly and the textbook's rotation matrix, in 50 digits."""
    size, n = abs(a), mp.sqrt(mp.mpf(GM) / abs(a) ** 3)
    if a > 0:
        E = anomaly(lambda x: x - e * mp.sin(x) - mean, lambda x: 1 - e * mp.cos(x), 7)
        c, s, root = mp.cos(E), mp.sin(E), mp.sqrt(1 - e * e)
        x, y, rate = size * (c - e), size * root * s, size * n / (1 - e * c)
        u, v = -rate * s, rate * root * c
    else:
        F = anomaly(lambda x: e * mp.sinh(x) - x - mean, lambda x: e * mp.cosh(x) - 1, 20)
        c, s, root = mp.cosh(F), mp.sinh(F), mp.sqrt(e * e - 1)
        x, y, rate = size * (e - c), size * root * s, size * n / (e * c - 1)
        u, v = -rate * s, rate * root * c
    turn = spin(2, node) * spin(0, i) * spin(2, peri)
    return [*(turn * mp.matrix([x, y, 0])), *(turn * mp.matrix([u, v, 0]))]


def spin(axis: int, angle: mp.mpf) -> mp.matrix:
    """Rotation about one axis."""
    R, j, k = mp.eye(3), (axis + 1) % 3, (axis + 2) % 3
    R[j, j] = R[k, k] = mp.cos(angle)
    R[j, k], R[k, j] = -mp.sin(angle), mp.sin(angle)
    return R


def classical(kind: str, x: list[mp.mpf]) -> list[mp.mpf]:
    """Any of the three sets through its Keplerian elements."""
    if kind == "keplerian":
        return by_anomalies(*x)
    if kind == "cometary":
        e, q, tp, node, peri, i = x
        a = q / (1 - e)
        return by_anomalies(a, e, i, node, peri, -tp * mp.sqrt(mp.mpf(GM) / abs(a) ** 3))
    a, h, k, p, q, longitude = x
    node, varpi = mp.atan2(p, q), mp.atan2(h, k)
    i, mean = 2 * mp.atan(mp.hypot(p, q)), longitude - varpi
    return by_anomalies(a, mp.hypot(h, k), i, node, varpi - node, mp.fmod(mean + 9 * mp.pi, 2 * mp.pi) - mp.pi)


@pytest.mark.parametrize("kind", KINDS)
def test_state_and_jacobian_are_those_of_the_classical_formulas(kind: str) -> None:
    """1e-14 of the state and of each column (reached: 1e-15): anomalies in 50 digits, differences of 1e-18."""
    forward, _, elements = KINDS[kind]
    name = forward.__name__.removesuffix("_to_state")
    state, jacobian = forward(np.array(elements), GM)
    with mp.workdps(50):
        x = [mp.mpf(value) for value in elements]
        wanted = np.array([float(value) for value in classical(name, x)])
        assert np.abs((state - wanted) / SCALE).max() < 1e-14
        for column in range(6):
            step = mp.mpf(10) ** -18 * max(abs(x[column]), 1)
            sides = [classical(name, [v + (s * step if j == column else 0) for j, v in enumerate(x)]) for s in (1, -1)]
            slope = np.array([float((a - b) / (2 * step)) for a, b in zip(*sides)])
            assert np.abs((jacobian[:, column] - slope) / SCALE).max() < 1e-14 * np.abs(slope / SCALE).max(), column


@pytest.mark.parametrize("days", [-900.0, -3.0, 40.0, 3000.0])
def test_parabola_follows_barkers_equation(days: float) -> None:
    """1e-14: t = sqrt(2 q^3/GM) (D + D^3/3), D the tangent of half the true anomaly, solved by Cardano's formula."""
    q = 0.7 * AU_KM
    state = cometary_to_state([1.0, q, -days * DAY_S, 0.0, 0.0, 0.0], GM)[0]
    w = 1.5 * days * DAY_S / np.sqrt(2.0 * q**3 / GM)
    root = np.cbrt(abs(w) + np.sqrt(w * w + 1.0))
    D = np.copysign(root - 1.0 / root, w)
    speed = np.sqrt(2.0 * GM / q) / (1.0 + D * D)
    wanted = np.array([q * (1.0 - D * D), 2.0 * q * D, 0.0, -speed * D, speed, 0.0])
    assert relative(state, wanted) < 1e-14 + 4e-16 / abs(D)  # the cube roots cancel where D is small


@pytest.mark.parametrize("kind", KINDS)
def test_the_two_jacobians_are_inverse_to_each_other(kind: str) -> None:
    forward, backward, elements = KINDS[kind]
    state, there = forward(np.array(elements), GM)
    again, back = backward(state, GM)
    size = np.maximum(np.abs(again), 1.0)
    assert np.abs((back @ there) * size / size[:, None] - np.eye(6)).max() < 1e-9


@settings(max_examples=60, deadline=None)
@given(
    e=st.floats(0.0, 0.98),
    angles=st.tuples(*[st.floats(0.05, 3.0)] * 3),
    mean=st.floats(-3.1, 3.1),
    size=st.floats(0.3, 50.0),
)
def test_three_sets_of_elements_describe_one_state(
    e: float, angles: tuple[float, float, float], mean: float, size: float
) -> None:
    i, node, peri = angles
    state = keplerian_to_state([size * AU_KM, e, i, node, peri, mean], GM)[0]
    n = np.sqrt(GM / (size * AU_KM) ** 3)
    comet = cometary_to_state([e, size * AU_KM * (1 - e), -mean / n, node, peri, i], GM)[0]
    t = np.tan(i / 2)
    equinoctial = [size * AU_KM, e * np.sin(node + peri), e * np.cos(node + peri), t * np.sin(node), t * np.cos(node)]
    other = equinoctial_to_state([*equinoctial, mean + node + peri], GM)[0]
    assert relative(comet, state) < 1e-12 / (1 - e)
    assert relative(other, state) < 1e-12 / (1 - e)


@pytest.mark.parametrize(
    ("convert", "elements", "message"),
    [
        (cometary_to_state, [-0.1, AU_KM, 0, 0, 0, 0], "e >= 0"),
        (cometary_to_state, [0.1, 0.0, 0, 0, 0, 0], "q > 0"),
        (keplerian_to_state, [AU_KM, 1.2, 0, 0, 0, 0], "a \\(1 - e\\) > 0"),
        (keplerian_to_state, [-AU_KM, 0.8, 0, 0, 0, 0], "a \\(1 - e\\) > 0"),
        (keplerian_to_state, [AU_KM, 1.0, 0, 0, 0, 0], "e != 1"),
        (equinoctial_to_state, [AU_KM, 0.9, 0.9, 0, 0, 0], "h\\^2"),
        (equinoctial_to_state, [AU_KM, 0.6, 0.8, 0, 0, 0], "h\\^2"),
        (equinoctial_to_state, [-AU_KM, 0.1, 0.1, 0, 0, 0], "a > 0"),
        (cometary_to_state, [0.1, AU_KM, np.nan, 0, 0, 0], "finite"),
        (keplerian_to_state, [AU_KM, 0.2], "six finite numbers"),
    ],
)
def test_impossible_elements_are_refused(convert: Any, elements: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        convert(elements, GM)


def test_rectilinear_orbit_has_no_elements() -> None:
    with pytest.raises(GeometryError, match="rectilinear"):
        state_to_cometary([AU_KM, 0, 0, 10.0, 0, 0], GM)


def test_unbound_orbit_has_no_equinoctial_elements() -> None:
    with pytest.raises(GeometryError, match="ellipse"):
        state_to_equinoctial([AU_KM, 0, 0, 0, 60.0, 1.0], GM)


def test_parabola_has_no_keplerian_elements() -> None:
    with pytest.raises(GeometryError, match="parabola"):
        state_to_keplerian([1.0, 0.0, 0.0, 0.0, 0.8, 0.6], 0.5)


def test_retrograde_orbit_in_the_plane_has_no_equinoctial_elements() -> None:
    with pytest.raises(GeometryError, match="180 deg"):
        state_to_equinoctial([AU_KM, 0, 0, 3.0, -28.0, 0.0], GM)


@pytest.mark.parametrize("convert", [state_to_cometary, state_to_keplerian])
@pytest.mark.parametrize(
    ("velocity", "message"),
    [
        ([0.0, 0.8, 0.6], "a circle has no perihelion"),
        ([0.1, 0.9, 0.0], "at inclination 0 there is no node"),
        ([0.0, 1.0, 0.0], "at inclination 0 there is no node"),
        ([0.1, -0.9, 0.0], "at inclination 180 deg there is no node"),
        ([0.1, -0.9, 1e-17], "at inclination 180 deg there is no node"),
        ([0.0, -1.0, -0.0], "at inclination 180 deg there is no node"),
    ],
)
def test_elements_that_are_undefined_are_reported(convert: Any, velocity: list[float], message: str) -> None:
    """A circle has no perihelion, an orbit in the plane no node, whichever way round it goes."""
    with pytest.raises(GeometryError, match=message):
        convert([1.0, 0.0, 0.0, *velocity], 1.0)


@pytest.mark.parametrize("convert", [state_to_cometary, state_to_keplerian])
def test_state_made_at_half_a_turn_of_inclination_has_no_node(convert: Any) -> None:
    """Its momentum is off the axis by the rounding of pi, 1e-16."""
    state = keplerian_to_state([AU_KM, 0.3, np.pi, 1.0, 2.0, 0.7], GM)[0]
    assert np.cross(state[:3], state[3:])[:2].any()
    with pytest.raises(GeometryError, match="180 deg"):
        convert(state, GM)


@pytest.mark.parametrize("tilt", [1e-9, 1e-5, np.pi - 1e-5])
def test_small_inclinations_keep_their_digits(tilt: float) -> None:
    """1e-14 rad: the rounding of the state, and of pi itself."""
    state = keplerian_to_state([1.3 * AU_KM, 0.4, tilt, 1.0, 2.0, 0.7], GM)[0]
    assert state_to_keplerian(state, GM)[0][2] == pytest.approx(tilt, rel=2e-12 if tilt < 1.0 else 0.0, abs=1e-15)


@settings(max_examples=60, deadline=None)
@given(
    e=st.floats(0.01, 0.95),
    angles=st.tuples(st.floats(0.05, 3.0), *[st.floats(0.0, 6.2)] * 2),
    mean=st.floats(-3.1, 3.1),
)
def test_angles_of_states_lie_between_nothing_and_a_turn(
    e: float, angles: tuple[float, float, float], mean: float
) -> None:
    state = keplerian_to_state([AU_KM, e, *angles, mean], GM)[0]
    for found in (state_to_cometary(state, GM)[0][3:5], state_to_keplerian(state, GM)[0][3:5]):
        assert ((found >= 0.0) & (found < 2.0 * np.pi)).all()
    assert 0.0 <= state_to_equinoctial(state, GM)[0][5] < 2.0 * np.pi
    assert 0.0 <= state_to_cometary(state, GM)[0][5] <= np.pi
    assert abs(state_to_keplerian(state, GM)[0][5]) <= np.pi


@pytest.mark.parametrize("tiny", [1e-17, -1e-17])
@pytest.mark.parametrize("place", [1, 2])
@pytest.mark.parametrize("speed", [0.9, 1.1])
def test_angle_a_hair_below_zero_is_zero_and_no_whole_turn(tiny: float, place: int, speed: float) -> None:
    """1e-15 rad: at an apse on the node all angles are multiples of half a turn, but for the hair."""
    state = np.array([1.0, 0.0, 0.0, 0.0, 0.8 * speed, 0.6 * speed])
    state[place] = tiny
    longitude = state_to_equinoctial(state, 1.0)[0][5]
    node, peri = state_to_cometary(state, 1.0)[0][3:5]
    half = np.pi if speed < 1.0 else 0.0
    assert [node, peri, longitude] == pytest.approx([0.0, half, 0.0], abs=1e-15)


def test_far_perihelion_costs_no_more_than_the_digits_of_its_distance() -> None:
    """4e-12 after a thousand revolutions (reached: 2e-12): the rounding of e and q times the angle gone through."""
    rng, n = np.random.default_rng(1), 40
    for size, e, mean in zip(rng.uniform(0.5, 3.0, n) * AU_KM, rng.uniform(0.0, 0.97, n), rng.uniform(-3.0, 3.0, n)):
        q = size * (1.0 - e)
        tp = -(mean + 2000.0 * np.pi) * np.sqrt(size**3 / GM)
        with mp.workdps(50):
            a = mp.mpf(q) / (1 - mp.mpf(e))
            turned = mp.fmod(-mp.mpf(tp) * mp.sqrt(mp.mpf(GM) / a**3) + mp.pi, 2 * mp.pi) - mp.pi
            wanted = np.array([float(v) for v in by_anomalies(a, mp.mpf(e), *map(mp.mpf, (0.5, 1, 2)), turned)])  # type: ignore[call-arg]
        assert relative(cometary_to_state([e, q, tp, 1.0, 2.0, 0.5], GM)[0], wanted) < 4e-12 / (1.0 - e)
