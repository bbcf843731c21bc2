"""Many clones at once: the same orbits as one by one."""

from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, find_encounters, propagate, propagate_many
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import ImpactError, InputError
from nebosvod.timescale import Epoch

Array = np.ndarray
Neo = tuple[Epoch, Array]
SPREAD = np.array([100.0, 100.0, 100.0, 1e-5, 1e-5, 1e-5])  # km, km/s


def cloud(start: Array, count: int, spread: Array = SPREAD) -> Array:
    return start + np.random.default_rng(4).normal(size=(count, 6)) * spread


def test_clones_with_their_own_parameters_fly_as_one_by_one(full_forces: ForceModel, neo: Neo) -> None:
    """1 mm at a year each way, in any order of times."""
    epoch, start = neo
    times = np.array([365.25, -100.0, 0.0, 40.0]) * DAY_S
    starts = cloud(start, 8)
    values = full_forces.values * (1.0 + 0.1 * np.random.default_rng(5).normal(size=(8, 7)))
    values[:, 2:4] = np.abs(values[:, 2:4])
    many = propagate_many(starts, epoch, times, full_forces, values)
    assert not many.alone.any()
    assert many.state.shape == (8, 4, 6)
    for k in range(8):
        own = full_forces.with_values(dict(zip(full_forces.parameters, values[k])))
        one = propagate(starts[k], epoch, times, own, False).state
        assert np.abs((many.state[k] - one)[:, :3]).max() < 1e-6
        assert np.abs((many.state[k] - one)[:, 3:]).max() < 1e-13


def test_clones_differ_by_their_parameters(full_forces: ForceModel, neo: Neo) -> None:
    """Radiation on twice the area: the displacement that zeta gives, to 1 %."""
    epoch, start = neo
    values = np.array([full_forces.values, full_forces.values])
    values[1, 0] *= 1.001
    state = propagate_many([start, start], epoch, [100 * DAY_S], full_forces, values).state[:, 0]
    wanted = propagate(start, epoch, [100 * DAY_S], full_forces).zeta[0, :3, 0] * 0.001 * values[0, 0]
    assert np.linalg.norm((state[1] - state[0])[:3] - wanted) < 0.01 * np.linalg.norm(wanted)


def test_the_number_of_threads_changes_nothing(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    starts = cloud(start, 13)
    one, three = (propagate_many(starts, epoch, [90 * DAY_S], full_forces, threads=k) for k in (1, 3))
    assert np.array_equal(one.state, three.state)


def test_a_clone_whose_orbit_needs_other_steps_gets_its_own(full_forces: ForceModel, neo: Neo) -> None:
    """One clone among 30 starts a million km from the Earth, where the others' steps are far too long."""
    epoch, start = neo
    earth = full_forces.ephemeris.state_km_km_s("earth", epoch, 0.0)[0]
    earth -= full_forces.ephemeris.state_km_km_s("sun", epoch, 0.0)[0]
    near = earth + np.array([2e5, 1e5, 0.0, 2.0, 0.0, 1.0])
    starts = np.vstack([cloud(start, 29), near])
    many = propagate_many(starts, epoch, [50 * DAY_S], full_forces)
    assert many.alone[-1]
    one = propagate(near, epoch, [50 * DAY_S], full_forces, False, margin_s=0.0).state
    assert np.array_equal(many.state[-1], one)
    assert not many.lost


def test_a_clone_that_hits_a_body_is_lost_and_the_others_go_on(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    earth = full_forces.ephemeris.state_km_km_s("earth", epoch, 0.0)[0]
    earth -= full_forces.ephemeris.state_km_km_s("sun", epoch, 0.0)[0]
    falling = earth + np.array([2e5, 0.0, 0.0, -3.0, 0.0, 0.0])
    many = propagate_many(np.vstack([cloud(start, 29), falling]), epoch, [50 * DAY_S], full_forces)
    assert list(many.lost) == [29]
    assert "earth" in many.lost[29]
    assert np.isnan(many.state[29]).all()
    assert np.isfinite(many.state[:29]).all()


def passing(forces: ForceModel, epoch: Epoch, lowest_km: list[float], lead_s: float) -> Array:
    """States that pass the Earth's centre at these distances, lead_s after (or before) the epoch."""
    gm = forces.ephemeris.gm_km3_s2["earth"]
    earth, sun = (forces.ephemeris.state_km_km_s(body, epoch, 0.0)[0] for body in ("earth", "sun"))
    rows = [kepler([0.0, q, 0.0, np.sqrt(25.0 + 2.0 * gm / q), 0.0, 0.0], [-lead_s], gm)[0] for q in lowest_km]
    found: Array = np.array(rows) + earth - sun
    return found


@pytest.mark.parametrize("lead_s", [7200.0, -7200.0])
def test_a_clone_below_the_surface_is_lost_though_the_middle_misses(full_forces: ForceModel, lead_s: float) -> None:
    """78 km below the surface, on steps that suit its orbit: nothing but the search for impacts can tell."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    starts = passing(full_forces, epoch, [6300.0, 6480.0, 6480.0, 6470.0], lead_s)
    many = propagate_many(starts, epoch, np.array([-14400.0, 14400.0]), full_forces)
    assert list(many.lost) == [0]
    assert "hits earth" in many.lost[0]
    assert np.isnan(many.state[0]).all()
    for k in (1, 2, 3):
        one = propagate(starts[k], epoch, [-14400.0, 14400.0], full_forces, False, margin_s=0.0).state
        assert np.abs(many.state[k] - one)[:, :3].max() < 1e-6


@pytest.mark.parametrize("lead_s", [7200.0, 20000.0])
@pytest.mark.parametrize("middle_km", [1.0, 3000.0, 40000.0])
def test_each_clone_has_the_fate_of_its_hyperbola_though_the_middle_hits(
    full_forces: ForceModel, middle_km: float, lead_s: float
) -> None:
    """Pericentre, its time, and the time at the ground, in closed form; J2, Moon, Sun move them by km and s."""
    epoch, gm = Epoch.parse("2030-05-01T00:00:00 TDB"), full_forces.ephemeris.gm_km3_s2["earth"]
    lowest = middle_km + np.array([0.0, 0.0, 500.0, 5000.0, 9000.0, 21000.0])
    starts = passing(full_forces, epoch, lowest.tolist(), lead_s)
    many = propagate_many(starts, epoch, [lead_s + 5.0 * DAY_S], full_forces, body="earth")
    loose = (lead_s / 7200.0) ** 2  # of the pull of Moon and Sun
    for k, q in enumerate(lowest):
        assert many.fates.body[k] == "earth"
        assert many.fates.distance_km[k] == pytest.approx(np.linalg.norm(many.fates.position_km[k]), rel=1e-12)
        if q > 6378.137 + 20.0 * loose:
            assert not many.fates.impact[k]
            assert many.fates.distance_km[k] == pytest.approx(q, abs=20.0 * loose)
            assert many.fates.t_s[k] == pytest.approx(lead_s, abs=5.0 * loose)
            assert np.isfinite(many.state[k]).all()
        elif q < 6350.0 - 20.0 * loose:
            assert many.fates.impact[k]
            assert 6356.7 < many.fates.distance_km[k] < 6378.2
            assert k in many.lost
            a, e = gm / 25.0, 1.0 + q * 25.0 / gm
            F = np.arccosh((6367.0 / a + 1.0) / e)
            before = (e * np.sinh(F) - F) * np.sqrt(a**3 / gm)
            assert many.fates.t_s[k] == pytest.approx(lead_s - before, abs=5.0 * loose)


def test_without_a_body_impacts_alone_are_told(full_forces: ForceModel) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    starts = passing(full_forces, epoch, [3000.0, 60000.0], 7200.0)
    fates = propagate_many(starts, epoch, [14400.0], full_forces).fates
    assert fates.body.tolist() == ["earth", ""]
    assert fates.impact.tolist() == [True, False]
    assert np.isnan(fates.t_s[1])


def test_fates_after_years_are_those_of_orbits_flown_alone(full_forces: ForceModel) -> None:
    """A cloud 60,000 km wide about an impact three years ahead: time to 0.1 s, distance to 0.5 km, states to 1 m."""
    epoch = Epoch.parse("2027-05-01T00:00:00 TDB")
    when = Epoch.parse("2030-05-01T00:00:00 TDB") - epoch
    hit = passing(full_forces, epoch + when, [3000.0], 7200.0)[0]
    start = propagate(hit, epoch + when, [-when], full_forces, False).state[0]
    starts = start + np.random.default_rng(3).normal(size=(60, 6)) * np.array([500.0] * 3 + [2e-5] * 3)
    end = when + 25.0 * DAY_S
    many = propagate_many(starts, epoch, [0.0, DAY_S, end], full_forces, body="earth")
    assert 5 < many.fates.impact.sum() < 55
    for k in range(12):
        if many.fates.impact[k]:
            with pytest.raises(ImpactError) as caught:
                propagate(starts[k], epoch, [end], full_forces, False)
            assert many.fates.t_s[k] == pytest.approx(caught.value.t_s, abs=0.1)
            continue
        one = propagate(starts[k], epoch, [0.0, DAY_S, end], full_forces, False)
        event = min(find_encounters(one, "earth", 1e7), key=lambda event: event.distance_km)
        assert many.fates.t_s[k] == pytest.approx(event.t_s, abs=0.1)
        assert many.fates.distance_km[k] == pytest.approx(event.distance_km, abs=0.5)
        assert np.linalg.norm(many.fates.position_km[k] - event.state[:3]) < 5.0
        assert np.abs(many.state[k] - one.state)[:, :3].max() < 1e-3 * max(1.0, 1e5 / event.distance_km)


def test_a_body_without_a_surface_is_refused(full_forces: ForceModel, neo: Neo) -> None:
    with pytest.raises(InputError, match='body "vulcan" is unknown'):
        propagate_many([neo[1]], neo[0], [DAY_S], full_forces, body="vulcan")


def test_a_clone_that_flies_alone_keeps_its_parameters_and_the_tolerance(full_forces: ForceModel, neo: Neo) -> None:
    """The bytes of `propagate` with the same arguments."""
    epoch, start = neo
    near = passing(full_forces, epoch, [60000.0], 5.0 * DAY_S)[0]
    values = np.tile(full_forces.values, (20, 1))
    values[-1, :2] = 1.0, 10.0  # a light ball
    starts = np.vstack([cloud(start, 19), near])
    many = propagate_many(starts, epoch, [-20.0 * DAY_S, 20.0 * DAY_S], full_forces, values, tolerance=1e-9)
    own = full_forces.with_values(dict(zip(full_forces.parameters, values[-1])))
    one = propagate(near, epoch, [-20.0 * DAY_S, 20.0 * DAY_S], own, False, tolerance=1e-9, margin_s=0.0).state
    assert many.alone.tolist() == 19 * [False] + [True]
    assert np.array_equal(many.state[-1], one)


@pytest.mark.parametrize(
    ("states", "parameters", "message"),
    [
        (np.zeros((0, 6)), None, "shape"),
        (np.zeros(6), None, "shape"),
        (np.full((2, 6), np.nan), None, "finite"),
        (np.full((2, 6), np.nan), None, "states: clones 0, 1 are not finite"),
        (np.where(np.eye(3, 6, -1), np.nan, 1.0), None, r"states: clones 1, 2 are not finite \(got \[nan, 1\.0"),
        (np.where(np.eye(2, 6, -1), np.inf, 1.0), None, r"states: clone 1 is not finite \(got \[inf, 1\.0"),
        (np.ones((2, 6)), np.ones((3, 7)), "parameters"),
        (np.ones((2, 6)), np.where(np.eye(2, 7, -1), np.nan, 1.0), "parameters: clone 1 is not finite"),
    ],
)
def test_wrong_input_is_refused(full_forces: ForceModel, neo: Neo, states: Any, parameters: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        propagate_many(states, neo[0], [0.0], full_forces, parameters)


@pytest.mark.parametrize(("threads", "got"), [(0, "0"), (-2, "-2"), ("two", "two")])
def test_threads_must_be_one_or_more(full_forces: ForceModel, neo: Neo, threads: Any, got: str) -> None:
    with pytest.raises(InputError, match=rf"^threads: needs a positive number \(got {got}\)$"):
        propagate_many([neo[1]], neo[0], [0.0], full_forces, threads=threads)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mass_kg", 0.0, r"^parameters: clone 1: mass_kg = 0\.0 is not allowed"),
        ("radius_m", 0.0, r"^parameters: clone 1: radius_m = 0\.0 is not allowed"),
        ("radius_m", "opposite", r"^parameters: the mean of the clones: radius_m = 0\.0 is not allowed"),
    ],
)
def test_parameters_without_a_force_name_the_clone(
    full_forces: ForceModel, neo: Neo, name: str, value: Any, message: str
) -> None:
    values = np.tile(full_forces.values, (2, 1))
    place = full_forces.parameters.index(name)
    values[1, place] = -values[0, place] if value == "opposite" else value
    with pytest.raises(InputError, match=message):
        propagate_many([neo[1], neo[1]], neo[0], [DAY_S], full_forces, values)


def test_parameters_outside_the_physical_range_are_points_of_the_model(full_forces: ForceModel, neo: Neo) -> None:
    """A draw of albedo 7 or of a radius of -5 m flies as alone: kappa is smooth there. 1 mm after a hundred days."""
    values = np.tile(full_forces.values, (3, 1))
    values[1, full_forces.parameters.index("albedo")] = 7.0
    values[2, full_forces.parameters.index("radius_m")] = -5.0
    many = propagate_many(3 * [neo[1]], neo[0], [100.0 * DAY_S], full_forces, values)
    for k in range(3):
        own = full_forces.with_values(dict(zip(full_forces.parameters, values[k])))
        one = propagate(neo[1], neo[0], [100.0 * DAY_S], own, False).state
        assert np.abs((many.state[k] - one)[:, :3]).max() < 1e-6


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_orbits_torn_apart_by_the_earth_fly_as_one_by_one_either_way(full_forces: ForceModel, sign: float) -> None:
    """From 7000 to 600,000 km in every direction: flocks part; those that come below the ground are lost, no others."""
    epoch, ephemeris = Epoch.parse("2026-03-21T00:00:00 TDB"), full_forces.ephemeris
    forces = ForceModel(ephemeris=ephemeris, asteroids=False)
    now, rng = np.zeros(1), np.random.default_rng(1)
    earth = (ephemeris.state_km_km_s("earth", epoch, now) - ephemeris.state_km_km_s("sun", epoch, now))[0]
    line = rng.standard_normal((40, 3))
    line *= (np.exp(rng.uniform(np.log(7e3), np.log(6e5), 40)) / np.linalg.norm(line, axis=1))[:, None]
    starts = earth + np.hstack([line, 8.0 * rng.standard_normal((40, 3))])
    times = sign * np.array([3600.0, 7200.0, 20000.0])
    many = propagate_many(starts, epoch, times, forces, threads=1)
    assert many.alone.any()
    for k, start in enumerate(starts):
        try:
            one = propagate(start, epoch, times, forces, False, margin_s=0.0).state
        except ImpactError:
            assert k in many.lost
            continue
        assert np.abs((many.state[k] - one)[:, :3]).max() < 1e-5
    assert 0 < len(many.lost) < 20
