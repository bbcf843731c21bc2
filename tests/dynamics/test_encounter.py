"""Close approaches and target planes: on JPL's trajectory, against finite differences, against the two-body limit."""

from collections.abc import Callable
from typing import Any

import erfa
import numpy as np
import pytest

from nebosvod.dynamics import (
    Ephemeris,
    ForceModel,
    Nongrav,
    find_encounters,
    integrator,
    perigee_distance,
    propagate,
    target_plane,
)
from nebosvod.dynamics.constants import DAY_S, RADIUS_KM
from nebosvod.dynamics.encounter import Encounter, closest_approaches
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import EventError, GeometryError, InputError
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


def line(t: Array) -> Array:
    """Past the centre at 3 km in a straight line, closest at t = 100/7 s."""
    x = 0.7 * (np.asarray(t) - 100.0 / 7.0)
    return np.stack([x, 3.0 + 0.0 * x, 0.0 * x, 0.7 + 0.0 * x, 0.0 * x, 0.0 * x], axis=1)


@pytest.mark.parametrize("times", [[-1e5, 1e6], [0.0, 14.0, 15.0, 20.0], [-50.0, 100.0 / 7.0, 50.0]])
def test_a_straight_line_is_closest_where_geometry_says(times: list[float]) -> None:
    """2e-6 s, whatever brackets the minimum; one that falls on a sample is found once."""
    ((t, state),) = closest_approaches(line, np.array(times))
    assert t == pytest.approx(100.0 / 7.0, abs=2e-6)
    assert np.linalg.norm(state[:3]) == pytest.approx(3.0, abs=1e-11)


def test_minima_are_found_and_maxima_are_not() -> None:
    """2e-6 s: an ellipse about its centre has two of each in a turn."""

    def ellipse(t: Array) -> Array:
        c, s = np.cos(t), np.sin(t)
        return np.stack([2.0 * c, s, 0.0 * t, -2.0 * s, c, 0.0 * t], axis=1)

    found = [t for t, _ in closest_approaches(ellipse, np.linspace(0.0, 6.2, 9))]
    assert found == pytest.approx([np.pi / 2, 3 * np.pi / 2], abs=2e-6)


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


@pytest.mark.parametrize(("body", "radius"), [("earth", 6378.1366), ("ceres", 470.0)])
def test_impact_is_a_distance_below_the_radius(flyby: Encounter, body: str, radius: float) -> None:
    """DE440's equatorial radius of the Earth; the mean radius of Ceres."""
    for share, answer in ((0.999, True), (1.001, False)):
        e = Encounter(
            body=body, epoch=flyby.epoch, t_s=0.0, distance_km=share * radius, speed_km_s=9.0, state=flyby.state
        )
        assert e.impact is answer


def test_every_perigee_of_a_fast_satellite_is_found(ephemeris: Ephemeris) -> None:
    """Nine in 46 hours, a period of Kepler apart (1 %: J2), though a sample of half a day would see one or two."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    gm, a, lowest = ephemeris.gm_km3_s2["earth"], 15000.0, 9000.0
    speed = np.sqrt(gm * (2.0 / lowest - 1.0 / a))
    start = earth + np.array([lowest, 0.0, 0.0, 0.0, 0.6 * speed, 0.8 * speed])
    period = 2.0 * np.pi * np.sqrt(a**3 / gm)
    arc = propagate(start, epoch, [9.1 * period], ForceModel(ephemeris=ephemeris), False, margin_s=0.0)
    times = np.array([e.t_s for e in find_encounters(arc, "earth") if e.t_s > 0.5 * period])
    assert len(times) == 9
    assert np.diff(times) == pytest.approx(np.full(8, period), rel=0.01)


def test_fast_planet_is_met_although_the_steps_are_long(ephemeris: Ephemeris) -> None:
    """Each approach of Mercury in five years to an orbit at 40 au, as a daily scan finds them; a step is 20 days."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    start = np.array([5.7e9, 1.3e9, 3e8, -1.1, 4.6, 0.4])
    arc = propagate(start, epoch, [1826.0 * DAY_S], ForceModel(ephemeris=ephemeris), False, margin_s=0.0)
    assert np.median(np.diff(arc.step_edges_s)) >= 20.0 * DAY_S
    t = np.arange(0.0, 1826.0) * DAY_S
    mercury, sun = (ephemeris.state_km_km_s(body, epoch, t)[:, :3] for body in ("mercury", "sun"))
    distance = np.linalg.norm(arc.state_at(t)[:, :3] - (mercury - sun), axis=1)
    low = t[1:-1][(distance[1:-1] < distance[:-2]) & (distance[1:-1] < distance[2:])]
    found = find_encounters(arc, "mercury")
    assert len(found) == len(low) > 15
    assert np.abs(np.array([e.t_s for e in found]) - low).max() < DAY_S
    middle = found[len(found) // 2].distance_km
    assert len(find_encounters(arc, "mercury", middle)) == sum(e.distance_km <= middle for e in found) < len(found)


def dive(ephemeris: Ephemeris, body: str, epoch: Epoch, depth: float, sign: float) -> tuple[Array, float, float]:
    """A state before (sign +1) or after a pericentre at `depth` radii, how long before, and from when it is below."""
    gm, radius = ephemeris.gm_km3_s2[body], RADIUS_KM[body]
    lead, q = 3.0 * np.sqrt(radius**3 / gm), depth * radius
    speed = np.sqrt(2.2 * gm / q + 9.0)
    relative = kepler([0.0, q, 0.0, 0.8 * speed, 0.0, 0.6 * speed], [-sign * lead], gm)[0]
    a = 1.0 / (speed**2 / gm - 2.0 / q)
    e, F = 1.0 + q / a, np.arccosh(max((radius / a + 1.0) / (1.0 + q / a), 1.0))
    inside = (e * np.sinh(F) - F) * np.sqrt(a**3 / gm)  # from the surface to the pericentre
    place = ephemeris.state_km_km_s(body, epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0)
    return place[0] + relative, sign * lead, float(lead - inside)


def reported(error: pytest.ExceptionInfo[EventError]) -> Epoch:
    return Epoch.parse(str(error.value).split("about ")[1].split(": ")[0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("body", RADIUS_KM)
def test_one_percent_below_a_surface_is_a_hit_and_one_above_is_none(
    ephemeris: Ephemeris, body: str, sign: float
) -> None:
    """Every body, on both legs; the time to 0.5 s of print and 0.2 % of a fall, for J2 and the Sun are left out."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    forces = ForceModel(ephemeris=ephemeris, asteroids=False)
    above, lead, _ = dive(ephemeris, body, epoch, 1.01, sign)
    assert propagate(above, epoch, [2.0 * lead], forces, False).state.shape == (1, 6)
    below, lead, entry = dive(ephemeris, body, epoch, 0.99, sign)
    advice = "end the arc before" if sign > 0.0 else "begin the arc after"
    radius = f"{RADIUS_KM[body]:.0f} km"
    wanted = f"hits {body} at about .*: {radius} from its centre, radius {radius}; {advice} this time"
    with pytest.raises(EventError, match=wanted) as caught:
        propagate(below, epoch, [2.0 * lead], forces, False)
    assert reported(caught) - epoch == pytest.approx(sign * entry, abs=0.5 + 0.002 * abs(lead))


def test_impact_on_the_way_back_is_that_of_the_way_there(ephemeris: Ephemeris) -> None:
    """1 s of print: an orbit that left the Earth, and its mirror image in time, which falls to where the other left."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    forces = ForceModel(ephemeris=ephemeris)
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    surface = earth + np.array([RADIUS_KM["earth"] + 0.01, 0.0, 0.0, 9.0, 6.0, 5.0])
    start = propagate(surface, epoch, [40000.0], forces, False, margin_s=0.0).state[0]
    with pytest.raises(EventError, match=r"hits earth .*: 6378 km from .* begin the arc after this time") as caught:
        propagate(start, epoch + 40000.0, [0.0], forces, False, margin_s=5.0e4)
    assert abs(reported(caught) - epoch) <= 1.0


def test_orbit_that_starts_below_a_surface_is_told_to_start_elsewhere(ephemeris: Ephemeris) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    start = earth + np.array([3000.0, 0.0, 0.0, 0.0, 12.0, 0.0])
    with pytest.raises(EventError, match=r"T00:00:00.*: 3000 km from .* the arc starts below the surface, check"):
        propagate(start, epoch, [DAY_S], ForceModel(ephemeris=ephemeris), False)


@pytest.mark.parametrize("a_km", [1496.0, 200_000.0])
def test_orbit_inside_the_sun_is_found_before_a_step_is_made(
    ephemeris: Ephemeris, monkeypatch: pytest.MonkeyPatch, a_km: float
) -> None:
    """At 1e-5 au a revolution takes 3 s: a month of it took 5 GB before the answer."""
    real, made = integrator.integrate, list[int]()

    def counted(*arguments: Any) -> Any:
        answer = real(*arguments)
        made.append(len(answer[1].rows))
        return answer

    monkeypatch.setattr(integrator, "integrate", counted)
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    start = np.array([a_km, 0.0, 0.0, 0.0, np.sqrt(1.32712440041e11 / a_km), 0.0])
    with pytest.raises(EventError, match=rf"hits sun .*: {a_km:.0f} km from .* starts below the surface"):
        propagate(start, epoch, [30.0 * DAY_S], ForceModel(ephemeris=ephemeris), False)
    assert made == [0]


def _height_of_wgs84(miss: Trajectory, lowest: Encounter) -> Array:
    """Geodetic heights, km, within 10 s of a closest approach, by erfa's precession and nutation and its ellipsoid."""
    t = lowest.t_s + np.linspace(-10.0, 10.0, 2001)
    ephemeris = miss.forces.ephemeris
    earth = ephemeris.state_km_km_s("earth", miss.epoch, t) - ephemeris.state_km_km_s("sun", miss.epoch, t)
    R = erfa.pnm06a(miss.epoch.day, miss.epoch.fraction + lowest.t_s / DAY_S)
    height: Array = erfa.gc2gde(6378.137, 1.0 / 298.257223563, (miss.state_at(t) - earth)[:, :3] @ R.T)[2]
    return height


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("v_infinity", [10.0, 30.0, 70.0])
@pytest.mark.parametrize("body", ["earth", "moon", "saturn", "ceres"])
def test_no_graze_of_a_fast_orbit_passes_unseen(
    ephemeris: Ephemeris, body: str, v_infinity: float, sign: float
) -> None:
    """10 m to 1 km below, on both legs, and 10 m above: an orbit that misses by 1 km is led to each by its partials.

    The Earth's surface is the ellipsoid: 14 km lower at this latitude, and lowest beside the closest approach.
    """
    epoch, gm, radius = Epoch.parse("2030-05-01T00:00:00 TDB"), ephemeris.gm_km3_s2[body], SURFACE_KM[body]
    forces = ForceModel(ephemeris=ephemeris)
    lead = sign * (20.0 * radius / v_infinity + 600.0)
    speed, q = np.sqrt(v_infinity**2 + 2.0 * gm / (radius + 1.0)), radius + 1.0
    relative = kepler([0.6 * q, 0.0, 0.8 * q, 0.8 * speed, 0.0, -0.6 * speed], [-lead], gm)[0]
    place = (ephemeris.state_km_km_s(body, epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    start, radial = place + relative, np.array([0.6, 0.0, 0.8])
    start[:3] += 0.003 * radius * radial  # the Earth's J2 lowers the pass by kilometres
    end = [2.0 * lead + sign * DAY_S]
    for _ in range(3):
        miss = propagate(start, epoch, end, forces, margin_s=0.0)
        (lowest,) = find_encounters(miss, body, 2.0 * radius)
        distance, by_state, _ = perigee_distance(miss, lowest)
        uphill = by_state[:3] / (by_state[:3] @ by_state[:3])
        above = distance - radius if body != "earth" else float(_height_of_wgs84(miss, lowest).min())
        start[:3] -= (above - 1.0) * uphill
    for depth in (0.01, 0.03, 0.1, 0.3, 1.0):
        deep = start.copy()
        deep[:3] -= (1.0 + depth) * uphill
        with pytest.raises(EventError, match=f"hits {body}"):
            propagate(deep, epoch, end, forces, False, margin_s=0.0)
    start[:3] -= 0.99 * uphill
    assert propagate(start, epoch, end, forces, False, margin_s=0.0).t_s.size == 1


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
    # the ellipsoid's radius under the perigee, 29 deg from the equator of date
    sine = flyby.state[2] / flyby.distance_km
    radius = 1.0 / np.sqrt((1.0 - sine**2) / 6378.137**2 + sine**2 / 6356.752314**2)
    focusing = np.sqrt(1.0 + 2.0 * 398600.4355 / (radius * plane.v_infinity_km_s**2))
    assert plane.capture_radius_km == pytest.approx(radius * focusing, abs=0.2)


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


def plane_point(flight: Trajectory, kind: Any, axes: Array) -> Array:
    """Coordinates of an orbit in given axes, by its own hyperbola or its own crossing of the plane.

    The asymptote in closed form, (k h x e + e)/(1 + k^2) with k = v_inf |h|/GM and h a unit vector (Battin, 1999, 4.4).
    """
    (e,) = find_encounters(flight, "earth", 1e6)
    ephemeris, r, v, t = flight.forces.ephemeris, e.state[:3], e.state[3:], e.t_s
    if kind == "b_plane":
        gm = ephemeris.gm_km3_s2["earth"]
        h = np.cross(r, v)
        ecc, speed = np.cross(v, h) / gm - r / e.distance_km, np.sqrt(v @ v - 2.0 * gm / e.distance_km)
        k = speed * np.linalg.norm(h) / gm
        S = (k * np.cross(h, ecc) / np.linalg.norm(h) + ecc) / (1.0 + k * k)
        point: Array = axes[[0, 2]] @ np.cross(S, h) / speed
        return point
    for _ in range(6):
        earth, sun = (ephemeris.state_km_km_s(body, flight.epoch, t)[0] for body in ("earth", "sun"))
        r, v = np.split(flight.state_at([t])[0] - (earth - sun), 2)
        t -= (r @ axes[1]) / (v @ axes[1])
    point = axes[[0, 2]] @ r
    return point


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
            plane_point(propagate(start + s * step, EPOCH, [END_S], forces, False), kind, plane.axes)
            for s in (1.0, -1.0)
        )
        wanted = plane.partials_state[:, column]
        error = np.abs((ahead - behind) / (2.0 * step[column]) - wanted).max()
        assert error < 2e-5 * np.abs(plane.partials_state[:, column]).max(), column
    for column, name in enumerate(NAMES):
        value = forces.values[column]
        size = {"a1_au_d2": 3e-12, "a2_au_d2": 1e-12}[name]
        ahead, behind = (
            plane_point(propagate(start, EPOCH, [END_S], forces.with_values({name: v}), False), kind, plane.axes)
            for v in (value + size, value - size)
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


MEET_S = 30 * DAY_S
LIGHT = ("a1_au_d2", "a2_au_d2")


@pytest.fixture(scope="module")
def slow(ephemeris: Ephemeris) -> tuple[Trajectory, Encounter]:
    """1 km/s at infinity, 400,000 km away: there the tide of the Sun moves the plane's point while it is crossed."""
    met = Epoch.parse("2030-05-21T00:00:00 TDB")
    forces = ForceModel(ephemeris=ephemeris, nongrav=Nongrav(a1_au_d2=1e-9, a2_au_d2=1e-10), parameters=LIGHT)
    earth = (ephemeris.state_km_km_s("earth", met, 0.0) - ephemeris.state_km_km_s("sun", met, 0.0))[0]
    speed = np.sqrt(1.0 + 2.0 * ephemeris.gm_km3_s2["earth"] / 4e5)
    closest = np.array([2.4e5, 2.56e5, 1.92e5, -0.8 * speed, 0.48 * speed, 0.36 * speed])
    start = propagate(earth + closest, met, [-MEET_S], forces, False).state[0]
    flight = propagate(start, met + (-MEET_S), [2.0 * MEET_S], forces)
    (found,) = find_encounters(flight, "earth", 1e6)
    assert found.distance_km == pytest.approx(4e5, abs=1e-6)
    return flight, found


@pytest.mark.parametrize("kind", ["b_plane", "mtp"])
def test_partials_of_a_slow_encounter_hold_the_shift_of_its_time(slow: tuple[Trajectory, Encounter], kind: Any) -> None:
    """2e-7 of each column (reached: 1e-8), where the eliminated time is 1 % of the b-plane's partials."""
    flight, e = slow
    plane, start = target_plane(flight, e, kind), flight.at([0.0]).state[0]
    assert plane.coordinates_km == pytest.approx(plane_point(flight, kind, plane.axes), abs=1e-6)
    assert plane.v_infinity_km_s == pytest.approx(1.0, abs=1e-12)
    distance, by_state, by_parameters = perigee_distance(flight, e)
    assert distance == e.distance_km
    partials = np.vstack([plane.partials_state.T, plane.partials_parameters.T])
    closer, values = np.concatenate([by_state, by_parameters]), flight.forces.values
    for k, size in enumerate([5.0] * 3 + [3e-6] * 3 + [1e-11] * 2):
        step = size * np.eye(8)[k]
        ends = []
        for move in (step, -step):
            forces = flight.forces.with_values(dict(zip(LIGHT, values + move[6:])))
            ends.append(propagate(start + move[:6], flight.epoch, [2.0 * MEET_S], forces, False))
        ahead, behind = (plane_point(end, kind, plane.axes) for end in ends)
        limit = np.abs(partials[k]).max()
        assert np.abs((ahead - behind) / (2.0 * size) - partials[k]).max() < 2e-7 * limit, k
        near = [find_encounters(end, "earth", 1e6)[0].distance_km for end in ends]
        assert (near[0] - near[1]) / (2.0 * size) == pytest.approx(closer[k], abs=2e-7 * limit), k


def test_planes_say_their_speed_at_infinity_and_what_they_capture(
    ephemeris: Ephemeris, flight: Trajectory, flyby: Encounter
) -> None:
    """In the b-plane the radius is enlarged by focusing; the crossing of the mtp is a place, so the radius itself."""
    b_plane, mtp = (target_plane(flight, flyby, kind) for kind in ("b_plane", "mtp"))
    gm = ephemeris.gm_km3_s2["earth"]
    assert mtp.v_infinity_km_s == b_plane.v_infinity_km_s
    assert mtp.v_infinity_km_s**2 == pytest.approx(flyby.speed_km_s**2 - 2.0 * gm / flyby.distance_km, rel=1e-12)
    focused = mtp.capture_radius_km * np.sqrt(1.0 + 2.0 * gm / (mtp.capture_radius_km * mtp.v_infinity_km_s**2))
    assert b_plane.capture_radius_km == pytest.approx(focused, rel=1e-12)


def test_a_pass_over_a_pole_may_be_lower_than_the_equatorial_radius(ephemeris: Ephemeris) -> None:
    """10 km above the ellipsoid at 88 deg: 6367 km from the centre, and no hit; over the equator it is one."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, -7200.0) - ephemeris.state_km_km_s("sun", epoch, -7200.0))[0]
    gm = ephemeris.gm_km3_s2["earth"]
    for direction, hits in (([0.0, 0.03, 1.0], False), ([0.0, 1.0, 0.03], True)):
        up = np.array(direction) / np.linalg.norm(direction)
        perigee = np.concatenate([6367.0 * up, [np.sqrt(36.0 + 2.0 * gm / 6367.0), 0.0, 0.0]])
        start = earth + kepler(perigee, [-7200.0], gm)[0]
        flight = propagate(start, epoch + -7200.0, [14400.0], ForceModel(ephemeris=ephemeris), solid=False)
        (near,) = find_encounters(flight, "earth", 2e4)
        plane = target_plane(flight, near)
        assert (np.linalg.norm(plane.coordinates_km) < plane.capture_radius_km) == hits


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


@pytest.mark.parametrize("miss_km", [0.0, 3000.0])
@pytest.mark.parametrize("sensitivities", [True, False])
def test_a_hit_from_the_night_side_is_a_hit(full_forces: ForceModel, miss_km: float, sensitivities: bool) -> None:
    """In the shadow and through the ground, where the Earth has no apparent radius."""
    epoch = Epoch.parse("2029-03-01T00:00:00 TDB")
    earth, sun = (full_forces.ephemeris.state_km_km_s(body, epoch, 0.0)[0] for body in ("earth", "sun"))
    outward = (earth - sun)[:3] / np.linalg.norm((earth - sun)[:3])
    aside = np.cross(outward, [0.0, 0.0, 1.0])
    start = earth - sun + np.concatenate([2e6 * outward + miss_km * aside, -20.0 * outward])
    with pytest.raises(EventError, match="hits earth at about 2029-03-02T0"):
        propagate(start, epoch, [5.0 * DAY_S], full_forces, sensitivities)


def test_an_orbit_that_falls_from_above_a_surface_hits_it_at_once(ephemeris: Ephemeris) -> None:
    """Straight down from 1 m at 12 km/s: within a millisecond or so, and not after the first step."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    start = earth + np.array([SURFACE_KM["earth"] + 0.001, 0.0, 0.0, -12.0, 0.0, 0.0])
    with pytest.raises(EventError, match=r"hits earth at about 2030-05-01T00:00:00") as said:
        propagate(start, epoch, [DAY_S], ForceModel(ephemeris=ephemeris), False)
    assert abs(said.value.t_s) < 0.1  # type: ignore[attr-defined]
