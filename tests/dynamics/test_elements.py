"""Elements against Horizons, against each other, and against finite differences."""

import csv
from pathlib import Path
from typing import Any

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


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_is_the_derivative(kind: str) -> None:
    """1e-7 of the largest partial of a column: central differences with a step of 1e-5 of the scale."""
    forward, _, elements = KINDS[kind]
    x = np.array(elements)
    jacobian = forward(x, GM)[1]
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-5 * max(abs(x[column]), 1.0)
        difference = (forward(x + step, GM)[0] - forward(x - step, GM)[0]) / (2 * step[column])
        error = np.abs((difference - jacobian[:, column]) / SCALE).max()
        assert error < 1e-7 * np.abs(jacobian[:, column] / SCALE).max() + 1e-12, column


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
        (equinoctial_to_state, [AU_KM, 0.9, 0.9, 0, 0, 0], "h\\^2"),
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
