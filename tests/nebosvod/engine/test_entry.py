"""Where an impactor comes down: against an integration by scipy and the geodesy of astropy; finite differences."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, ITRS, CartesianRepresentation, EarthLocation
from astropy.time import Time
from scipy.integrate import DOP853
from scipy.optimize import brentq

from nebosvod.dynamics import Ephemeris, ForceModel, Trajectory
from nebosvod.dynamics.impact import follow, impact, what_it_hits
from nebosvod.engine.entry import Entry, azimuth_rad, entry_point, ground_displacement
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
# An orbit like that of 2018 LA (fell on Botswana on 2018-06-02), heliocentric ICRF
EPOCH = Epoch.parse("2018-06-02T00:00:00 TDB")
POSITION = [-49268260.62584221, -132416605.76978022, -57251479.76268835]
STATE = np.array([*POSITION, 33.01293244915602, 2.059024986832969, -1.646475072089206])
SPAN = (0.0, 5.0 * 86400.0)


@pytest.fixture(scope="module")
def fall() -> Trajectory:
    return follow(STATE, EPOCH, SPAN, 0.0, ForceModel(ephemeris=Ephemeris.load()), True)


def came_down(trajectory: Trajectory, altitude_km: float) -> Entry:
    hit = impact(trajectory, "earth")
    assert hit is not None
    entry = entry_point(trajectory, hit, altitude_km)
    assert entry is not None
    return entry


def geocentric_by_scipy() -> tuple[Array, list[object]]:
    """End times (n,) and dense outputs of the geocentric fall: Sun, Moon, Earth with J2, relativity left out (1 m)."""
    ephemeris = Ephemeris.load()
    gm = ephemeris.gm_km3_s2

    def relative(body: str, t: float) -> Array:
        at = np.array([t])
        return np.asarray((ephemeris.state_km_km_s(body, EPOCH, at) - ephemeris.state_km_km_s("earth", EPOCH, at))[0])

    def rate(t: float, x: Array) -> Array:
        r = x[:3]
        d = np.linalg.norm(r)
        a = -gm["earth"] * r / d**3
        z2 = (r[2] / d) ** 2
        j2 = 1.5 * 1.0826359e-3 * gm["earth"] * 6378.1366**2 / d**5
        a += -j2 * r * np.array([1.0 - 5.0 * z2, 1.0 - 5.0 * z2, 3.0 - 5.0 * z2])
        for body in ("sun", "moon"):
            s = relative(body, t)[:3]
            a += gm[body] * ((s - r) / np.linalg.norm(s - r) ** 3 - s / np.linalg.norm(s) ** 3)
        return np.concatenate([x[3:], a])

    start = STATE + relative("sun", 0.0)
    dense: list[Any] = []
    solver, ends = DOP853(rate, 0.0, start, 61000.0, rtol=1e-12, atol=1e-6), [0.0]
    while solver.status == "running" and (len(dense) == 0 or np.linalg.norm(solver.y[:3]) > 6330.0):
        solver.step()
        ends.append(solver.t)
        dense.append(solver.dense_output())
    return np.array(ends), dense


@pytest.fixture(scope="module")
def scipys() -> tuple[Array, list[object]]:
    return geocentric_by_scipy()


@pytest.mark.parametrize("altitude_km", [0.0, 28.7, 50.0, 100.0, 20000.0])
def test_an_entry_is_where_scipy_and_astropy_say(
    fall: Trajectory, scipys: tuple[Array, list[object]], altitude_km: float
) -> None:
    """0.02 s and 0.3 km after 17 hours of fall, without planets, relativity; a sphere would be 6 km and 0.4 s off."""
    ends, dense = scipys

    def place(t: float) -> EarthLocation:
        step = dense[min(max(int(np.searchsorted(ends, t)) - 1, 0), len(dense) - 1)]
        time = Time(EPOCH.day, EPOCH.fraction + t / 86400.0, format="jd", scale="tdb")
        position = CartesianRepresentation(*(step(t)[:3] * u.km))  # type: ignore[operator]
        ground = GCRS(position, obstime=time).transform_to(ITRS(obstime=time))
        return EarthLocation.from_geocentric(*ground.cartesian.xyz)

    t = brentq(lambda t: place(t).height.to_value(u.km) - altitude_km, ends[-1] - 6000.0, ends[-1], xtol=1e-4)
    wanted, entry = place(t), came_down(fall, altitude_km)
    assert entry.place is not None
    assert entry.t_s == pytest.approx(t, abs=0.02)
    assert entry.place.altitude_km == pytest.approx(altitude_km, abs=2e-3)
    mine = EarthLocation.from_geodetic(
        np.degrees(entry.place.longitude_rad), np.degrees(entry.place.latitude_rad), altitude_km * u.km
    )
    apart = np.linalg.norm([(getattr(mine, k) - getattr(wanted, k)).to_value(u.km) for k in "xyz"])
    assert apart < 0.3 * max(1.0, altitude_km / 1000.0)
    assert entry.place.geocentric_latitude_rad == pytest.approx(
        float(np.arctan2(wanted.z, np.hypot(wanted.x, wanted.y)).to_value(u.rad)), abs=1e-4
    )


def test_an_impact_ends_at_the_ellipsoid_and_not_at_a_sphere(fall: Trajectory) -> None:
    hit = what_it_hits(fall)
    assert hit is not None
    assert hit.body == "earth"
    latitude = np.arcsin(hit.state[2] / hit.distance_km)  # the pole of J2000 serves: 0.002 rad
    a, f = 6378.137, 1.0 / 298.257223563
    b = a * (1.0 - f)
    surface = a * b / np.hypot(b * np.cos(latitude), a * np.sin(latitude))
    assert hit.distance_km == pytest.approx(surface, abs=0.1)
    assert hit.distance_km < a - 2.0


@pytest.mark.parametrize("column", range(6))
def test_time_and_place_move_as_their_partials_say(fall: Trajectory, column: int) -> None:
    """Central differences over other falls: time of entry, longitude and latitude, downrange and crossrange."""
    step = 0.1 if column < 3 else 1e-6
    base, moved = came_down(fall, 50.0), []
    for sign in (1.0, -1.0):
        state = STATE.copy()
        state[column] += sign * step
        moved.append(_other(state))
    ahead, behind = moved
    slope = (ahead.t_s - behind.t_s) / (2.0 * step)
    assert base.time_partials[column] == pytest.approx(slope, rel=1e-3, abs=1e-6 / step)
    for row, key in enumerate(("longitude_rad", "latitude_rad")):
        slope = (getattr(ahead.place, key) - getattr(behind.place, key)) / (2.0 * step)
        assert base.place_partials is not None
        assert base.place_partials[row, column] == pytest.approx(slope, rel=2e-3, abs=1e-9 / step)
    shifts = [ground_displacement(base.position_km, base.axes, one.position_km) for one in moved]
    slope = (shifts[0] - shifts[1]) / (2.0 * step)  # type: ignore[assignment]
    assert base.partials_state[:, column] == pytest.approx(slope, rel=2e-3, abs=1e-5 / step)


def _other(state: Array) -> Entry:
    return came_down(follow(state, EPOCH, SPAN, 0.0, ForceModel(ephemeris=Ephemeris.load()), True), 50.0)


def test_far_places_are_as_far_apart_as_on_a_globe() -> None:
    """A quarter of the way round, east and north: R pi/2; near ones as in their plane."""
    base, axes = np.array([6400.0, 0.0, 0.0]), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(ground_displacement(base, axes, np.array([0.0, 6400.0, 0.0])), [6400.0 * np.pi / 2, 0.0])
    near = base + np.array([0.0, 0.003, 0.004])
    np.testing.assert_allclose(ground_displacement(base, axes, near), [0.003, 0.004], rtol=1e-6)


@pytest.mark.parametrize("lead_d", [1.0, 30.0, 400.0, 3000.0])
def test_an_orbit_is_followed_to_its_impact_however_far_ahead_it_is(fall: Trajectory, lead_d: float) -> None:
    """The same fall from other epochs: there is no number of steps after which an impact is lost."""
    from nebosvod.dynamics import propagate

    back = propagate(STATE, EPOCH, [-lead_d * 86400.0], fall.forces, False)
    early = EPOCH + -lead_d * 86400.0
    again = follow(back.state[0], early, (0.0, (lead_d + 10.0) * 86400.0), 0.0, fall.forces, False)
    hit, before = what_it_hits(again), what_it_hits(fall)
    assert hit is not None
    assert before is not None
    assert abs(hit.epoch - before.epoch) < 0.05  # s


def test_the_azimuth_is_that_of_the_path_over_the_ground(fall: Trajectory) -> None:
    """From two places of the path 4 km of altitude apart, by spherical trigonometry."""
    before, entry, after = (came_down(fall, altitude) for altitude in (52.0, 50.0, 48.0))
    (lon0, lat0), (lon1, lat1) = ((e.place.longitude_rad, e.place.latitude_rad) for e in (before, after))
    across = np.sin(lon1 - lon0) * np.cos(lat1)
    up = np.cos(lat0) * np.sin(lat1) - np.sin(lat0) * np.cos(lat1) * np.cos(lon1 - lon0)
    assert np.degrees(azimuth_rad(entry.place, entry.axes[0])) == pytest.approx(
        np.degrees(np.arctan2(across, up)) % 360.0, abs=0.3
    )
