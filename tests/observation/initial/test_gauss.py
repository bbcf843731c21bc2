"""Gauss's method on orbits whose answer is known."""

import numpy as np
import pytest

from nebosvod.dynamics.twobody_many import fly
from nebosvod.observation.initial.gauss import SPEED_OF_LIGHT_AU_D, _roots, gauss

GM = 0.01720209895**2
EARTH = np.array([[0.9, 0.43, 0.0, -0.0075, 0.0155, 0.0]])


def triplet(target: np.ndarray, t: np.ndarray):
    """Directions of a target from a circling Earth, with light time."""
    q = fly(EARTH, t, GM)[:, :3]
    light = np.zeros(3)
    for _ in range(6):
        rho = fly(target[None], t - light, GM)[:, :3] - q
        light = np.linalg.norm(rho, axis=1) / SPEED_OF_LIGHT_AU_D
    return rho / np.linalg.norm(rho, axis=1, keepdims=True), q, light


def solve(target: np.ndarray, t: np.ndarray):
    u, q, light = triplet(target, t)
    states, when, number = gauss(u[None], q[None], t[None], GM)
    assert np.all(number == 0)
    return states, when, t[1] - light[1]


@pytest.mark.parametrize("span", [1.0, 4.0, 10.0, 25.0, 40.0])
@pytest.mark.parametrize(
    "target",
    [
        np.array([1.3, 0.5, 0.2, -0.006, 0.0125, 0.002]),
        np.array([-0.4, 1.6, 0.5, -0.0125, -0.003, 0.004]),
        np.array([2.2, 1.5, -0.3, -0.005, 0.0085, 0.001]),
    ],
)
def test_it_finds_the_orbit_and_undoes_the_light_time(target: np.ndarray, span: float) -> None:
    t = np.array([-0.5 * span, 0.03 * span, 0.5 * span])
    states, when, emission = solve(target, t)
    best = np.argmin(np.linalg.norm(states - fly(target[None], when, GM), axis=1))
    # refinement ends at 1e-9 of the distance; over one day the same error of a direction counts a thousandfold
    np.testing.assert_allclose(states[best], fly(target[None], when[best : best + 1], GM)[0], rtol=0.0, atol=3e-6)
    assert when[best] == pytest.approx(emission, abs=3e-7)


def test_every_positive_root_is_followed() -> None:
    """Near the Earth's orbit at an elongation under 90 deg the equation has three positive roots; one is the Earth."""
    target = _elliptic(np.random.default_rng(8), 1.7, 0.2)
    t = np.array([-7.0, 0.4, 7.0])
    u, q, _ = triplet(target, t)
    number, roots = _roots(u[None], q[None], t[None], GM)
    np.testing.assert_array_equal(number, 0)
    curve = np.poly1d(np.poly(roots))
    assert np.min(np.abs(roots - np.linalg.norm(target[:3]))) < 0.02
    assert len(roots) == 3, roots
    assert curve(roots[0]) == pytest.approx(0.0, abs=1e-6)


def test_the_truth_is_among_the_roots_of_nearly_all_orbits() -> None:
    rng = np.random.default_rng(8)
    found = tried = 0
    for _ in range(80):
        a, e = rng.uniform(0.8, 3.2), rng.uniform(0.0, 0.5)
        state = _elliptic(rng, a, e)
        if np.linalg.norm(state[:3] - EARTH[0, :3]) < 0.15:
            continue
        states, when, _ = solve(state, np.array([-7.0, 0.4, 7.0]))
        tried += 1
        if len(states):
            truth = fly(state[None], when, GM)
            found += bool(np.min(np.linalg.norm(states[:, :3] - truth[:, :3], axis=1)) < 0.1)
    assert tried > 70
    # near enough for least squares to end at the truth. What is missed moves in the plane of the observer's own orbit,
    # where three directions lie on one great circle
    assert found / tried > 0.88


def _elliptic(rng: np.random.Generator, a: float, e: float) -> np.ndarray:
    """A state on an ellipse of random orientation and phase."""
    E = rng.uniform(0.0, 2.0 * np.pi)
    root, n = np.sqrt(1.0 - e * e), np.sqrt(GM / a**3)
    plane = a * np.array([np.cos(E) - e, root * np.sin(E)])
    speed = a * n / (1.0 - e * np.cos(E)) * np.array([-np.sin(E), root * np.cos(E)])
    axes, _ = np.linalg.qr(np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]) + 0.3 * rng.normal(size=(3, 2)))
    return np.concatenate([axes @ plane, axes @ speed])


def test_many_triplets_at_once_are_those_one_by_one() -> None:
    target = np.array([1.3, 0.5, 0.2, -0.006, 0.0125, 0.002])
    spans = (6.0, 11.0, 17.0)
    data = [(np.array([-0.5 * s, 0.1, 0.5 * s]), *triplet(target, np.array([-0.5 * s, 0.1, 0.5 * s]))) for s in spans]
    t, u, q = (np.stack([one[k] for one in data]) for k in (0, 1, 2))
    states, _, number = gauss(u, q, t, GM)
    for k in range(3):
        alone, *_ = gauss(u[k : k + 1], q[k : k + 1], t[k : k + 1], GM)
        np.testing.assert_allclose(np.sort(states[number == k], axis=0), np.sort(alone, axis=0), rtol=1e-6, atol=1e-9)


def test_directions_in_one_plane_and_no_motion_give_nothing_and_no_warning() -> None:
    u = np.tile(np.array([1.0, 0.0, 0.0]), (1, 3, 1))
    q = fly(EARTH, np.array([-1.0, 0.0, 1.0]), GM)[None, :, :3]
    states, when, number = gauss(u, q, np.array([[-1.0, 0.0, 1.0]]), GM)
    assert states.shape == (0, 6)
    assert when.shape == number.shape == (0,)
