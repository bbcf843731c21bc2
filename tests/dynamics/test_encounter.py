"""Close approaches and target planes: on JPL's trajectory, against finite differences, against the two-body limit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, find_encounters, perigee_distance, propagate, target_plane
from nebosvod.dynamics.constants import DAY_S, RADIUS_KM
from nebosvod.dynamics.encounter import Encounter, closest_approaches
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import GeometryError, InputError
from nebosvod.timescale import Epoch

Array = np.ndarray
EPOCH = Epoch.parse("2028-11-15T00:00:00 TDB")
END_S = Epoch.parse("2029-05-10T00:00:00 TDB") - EPOCH
NAMES = ("a1_au_d2", "a2_au_d2")


@pytest.fixture(scope="module")
def start(apophis: Callable[[Epoch, Any], Array]) -> Array:
    return apophis(EPOCH, 0.0)[0]


@pytest.fixture(scope="module")
def forces(ephemeris: Ephemeris, apophis_nongrav: Nongrav) -> ForceModel:
    return ForceModel(ephemeris=ephemeris, nongrav=apophis_nongrav, parameters=NAMES)


@pytest.fixture(scope="module")
def flight(start: Array, forces: ForceModel) -> Trajectory:
    return propagate(start, EPOCH, [END_S], forces)


@pytest.fixture(scope="module")
def flyby(flight: Trajectory) -> Encounter:
    (found,) = find_encounters(flight, "earth", 1e6)
    return found


def test_finder_on_jpls_own_trajectory(ephemeris: Ephemeris, apophis: Callable[[Epoch, Any], Array]) -> None:
    """1 s and 1 m: JPL publishes 2029-04-13 21:46 TDB, 38,011 to 38,013 km; here against a fine scan of the file."""

    def relative(t: Array) -> Array:
        earth, sun = (ephemeris.state_km_km_s(body, EPOCH, t) for body in ("earth", "sun"))
        return apophis(EPOCH, t) - (earth - sun)

    found = [e for e in closest_approaches(relative, np.arange(0.0, END_S, DAY_S)) if np.linalg.norm(e[1][:3]) < 1e6]
    ((t, state),) = found
    around = t + np.arange(-20.0, 20.5, 0.5)
    distance = np.linalg.norm(relative(around)[:, :3], axis=1)
    assert abs(around[np.argmin(distance)] - t) < 1.0
    assert np.linalg.norm(state[:3]) == pytest.approx(distance.min(), abs=1e-3)
    assert (EPOCH + t).iso()[:16] == "2029-04-13T21:46"
    assert 37990.0 < np.linalg.norm(state[:3]) < 38030.0


def test_own_trajectory_meets_the_earth_where_jpls_does(flyby: Encounter) -> None:
    """0.1 km and 0.1 s, with the default forces: 38,011.45 km at 21:46:12.75."""
    assert flyby.distance_km == pytest.approx(38011.45, abs=0.1)
    assert abs(flyby.epoch - Epoch.parse("2029-04-13T21:46:12.75 TDB")) < 0.1
    assert not flyby.impact


def test_moon_is_passed_after_the_earth(flight: Trajectory, flyby: Encounter) -> None:
    """JPL lists the Moon at 0.00064 au on 2029-04-14."""
    (moon,) = find_encounters(flight, "moon", 2e5)
    assert 0.5 < (moon.epoch - flyby.epoch) / 3600.0 / 16.0 < 1.1
    assert moon.distance_km == pytest.approx(0.00064 * 149597870.7, rel=0.01)


def test_every_minimum_is_a_minimum(flight: Trajectory) -> None:
    for body in ("earth", "venus", "mars", "jupiter", "moon"):
        for e in find_encounters(flight, body):
            assert abs(e.state[:3] @ e.state[3:]) < 1e-5 * e.distance_km * e.speed_km_s
            assert e.distance_km == pytest.approx(np.linalg.norm(e.state[:3]))


def test_b_plane_point_is_where_the_asymptote_would_pass(
    ephemeris: Ephemeris, flyby: Encounter, flight: Trajectory
) -> None:
    """1e-4 of |b|: the hyperbola followed back 300 years, where its direction has 1e-10 left to turn."""
    plane = target_plane(flight, flyby, "b_plane")
    gm = ephemeris.gm_km3_s2["earth"]
    far = kepler(flyby.state, [-1e10], gm)[0]
    inward = far[3:] / np.linalg.norm(far[3:])
    offset = far[:3] - (far[:3] @ inward) * inward
    assert inward == pytest.approx(plane.axes[1], abs=1e-6)
    b = np.linalg.norm(np.cross(flyby.state[:3], flyby.state[3:])) / plane.v_infinity_km_s
    assert np.linalg.norm(plane.coordinates_km) == pytest.approx(b, rel=1e-12)
    assert np.linalg.norm(offset) == pytest.approx(b, rel=1e-4)


def test_published_size_of_the_2029_encounter(flight: Trajectory, flyby: Encounter) -> None:
    """b is about 1.27 perigee distances; v_inf 5.84 km/s; a hit needs b below 2.16 radii of the Earth."""
    plane = target_plane(flight, flyby, "b_plane")
    assert np.linalg.norm(plane.coordinates_km) / flyby.distance_km == pytest.approx(1.27, abs=0.005)
    assert plane.v_infinity_km_s == pytest.approx(5.84, abs=0.01)
    focusing = np.sqrt(1.0 + 2.0 * 398600.4355 / (RADIUS_KM["earth"] * plane.v_infinity_km_s**2))
    assert plane.capture_radius_km == pytest.approx(RADIUS_KM["earth"] * focusing, rel=1e-9)


@pytest.mark.parametrize("kind", ["b_plane", "mtp"])
def test_axes_are_right_handed_and_zeta_points_against_the_earths_motion(
    ephemeris: Ephemeris, flight: Trajectory, flyby: Encounter, kind: Any
) -> None:
    axes = target_plane(flight, flyby, kind).axes
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.cross(axes[1], axes[2]) == pytest.approx(axes[0], abs=1e-14)
    earth, sun = (ephemeris.state_km_km_s(body, EPOCH, flyby.t_s)[0, 3:] for body in ("earth", "sun"))
    assert axes[0] @ (earth - sun) == pytest.approx(0.0, abs=1e-9)
    assert axes[2] @ (earth - sun) < 0.0


def crossing(flight: Trajectory, kind: Any, nominal: Any) -> Array:
    """Coordinates of another orbit in the nominal axes: by its own hyperbola, or by its own crossing of the plane."""
    (e,) = find_encounters(flight, "earth", 1e6)
    state = e.state
    ephemeris = flight.forces.ephemeris
    gm = ephemeris.gm_km3_s2["earth"]
    if kind == "b_plane":
        speed2 = state[3:] @ state[3:] - 2.0 * gm / e.distance_km
        far = kepler(state, [-3e12], gm)[0, 3:]
        inward = far / np.linalg.norm(far)
        return nominal.axes[[0, 2]] @ np.cross(inward, np.cross(state[:3], state[3:])) / np.sqrt(speed2)
    t = e.t_s
    for _ in range(6):
        earth, sun = (ephemeris.state_km_km_s(body, EPOCH, t)[0] for body in ("earth", "sun"))
        state = flight.state_at([t])[0] - (earth - sun)
        t -= (state[:3] @ nominal.axes[1]) / (state[3:] @ nominal.axes[1])
    return nominal.axes[[0, 2]] @ state[:3]


@pytest.mark.parametrize("kind", ["b_plane", "mtp"])
def test_partials_follow_finite_differences_of_the_crossing(
    start: Array, forces: ForceModel, flight: Trajectory, flyby: Encounter, kind: Any
) -> None:
    """2e-5 of the larger row: central differences of 5 km, 1e-6 km/s; their third order is 1e-6."""
    plane = target_plane(flight, flyby, kind)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 5.0 if column < 3 else 1e-6
        ahead, behind = (
            crossing(propagate(start + s * step, EPOCH, [END_S], forces, False), kind, plane) for s in (1.0, -1.0)
        )
        wanted = plane.partials_state[:, column]
        error = np.abs((ahead - behind) / (2.0 * step[column]) - wanted).max()
        assert error < 2e-5 * np.abs(plane.partials_state[:, column]).max(), column
    for column, name in enumerate(NAMES):
        value = forces.values[column]
        size = {"a1_au_d2": 3e-12, "a2_au_d2": 1e-12}[name]
        ahead, behind = (
            crossing(propagate(start, EPOCH, [END_S], forces.with_values({name: value + s * size}), False), kind, plane)
            for s in (1.0, -1.0)
        )
        error = np.abs((ahead - behind) / (2.0 * size) - plane.partials_parameters[:, column]).max()
        assert error < 2e-5 * np.abs(plane.partials_parameters[:, column]).max(), name


def test_perigee_partials_follow_finite_differences(
    start: Array, forces: ForceModel, flight: Trajectory, flyby: Encounter
) -> None:
    """2e-5 of the largest partial of its kind."""
    distance, by_state, by_parameters = perigee_distance(flight, flyby)
    assert distance == flyby.distance_km
    assert by_parameters.shape == (2,)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 5.0 if column < 3 else 1e-6
        (ahead,), (behind,) = (
            find_encounters(propagate(start + s * step, EPOCH, [END_S], forces, False), "earth", 1e6)
            for s in (1.0, -1.0)
        )
        difference = (ahead.distance_km - behind.distance_km) / (2.0 * step[column])
        assert difference == pytest.approx(by_state[column], abs=2e-5 * np.abs(by_state[3 * (column // 3) :]).max())


def test_captured_orbit_has_no_b_plane(flight: Trajectory, flyby: Encounter) -> None:
    slow = Encounter(
        body="earth",
        epoch=flyby.epoch,
        t_s=flyby.t_s,
        distance_km=flyby.distance_km,
        speed_km_s=1.0,
        state=np.concatenate([flyby.state[:3], flyby.state[3:] / flyby.speed_km_s]),
    )
    with pytest.raises(GeometryError, match="captured"):
        target_plane(flight, slow, "b_plane")
    assert np.isnan(target_plane(flight, slow, "mtp").v_infinity_km_s)


def test_unknown_plane_is_refused(flight: Trajectory, flyby: Encounter) -> None:
    with pytest.raises(InputError, match="b_plane, mtp"):
        target_plane(flight, flyby, "c_plane")  # type: ignore[arg-type]


def test_plane_without_sensitivities_is_refused(start: Array, forces: ForceModel) -> None:
    bare = propagate(start, EPOCH, [END_S], forces, False)
    (e,) = find_encounters(bare, "earth", 1e6)
    with pytest.raises(InputError, match="without sensitivities"):
        target_plane(bare, e)
