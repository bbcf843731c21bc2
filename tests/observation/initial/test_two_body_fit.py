"""Fits of many candidate orbits at once, against integrated orbits and exact directions."""

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.twobody_many import fly
from nebosvod.observation.initial.two_body_fit import (
    STEP,
    Arc,
    _basis,
    _partials,
    costs,
    displacements,
    improve,
    residuals,
    shifts,
    trimmed_rms,
)
from nebosvod.observation.measurement.direction import ra_dec
from nebosvod.timescale import Epoch

ARCSEC = np.pi / 648000.0
SCALE = np.repeat([AU_KM, AU_KM / DAY_S], 3)
EPOCH = Epoch.parse("2023-02-26T00:00:00 TDB")
# (2023 DW), JPL, heliocentric ICRF at 2023-03-01 (au, au/d): 0.08 au from the Earth, moving away
DW_EPOCH = Epoch.parse("2023-03-01T00:00:00 TDB")


@pytest.fixture(scope="module")
def seen(ephemeris, data):
    """A trajectory of 2023 DW, and its directions from the geocentre on 30 times of 20 days: arc, true state at t0."""
    lines = (data / "orbits" / "jpl_truth_states.csv").read_text().splitlines()
    row = next(line for line in lines if line.startswith("2023 DW") and "2460004.5,SUN" in line)
    state = np.array([float(word) for word in row.split(",")[5:11]]) * SCALE
    t_s = np.sort(np.random.default_rng(5).uniform(0.2, 20.0, 30)) * DAY_S
    forces = ForceModel(ephemeris=ephemeris)
    offset = DW_EPOCH - EPOCH
    trajectory = propagate(state, DW_EPOCH, np.array([-4.0, 20.0]) * DAY_S, forces, sensitivities=False)
    earth = ephemeris.state_km_km_s("earth", EPOCH, t_s)
    light = np.zeros(t_s.size)
    for _ in range(5):
        target = trajectory.state_at(t_s - light - offset)[:, :3] + ephemeris.position_km("sun", EPOCH, t_s - light)
        light = np.linalg.norm(target - earth[:, :3], axis=1) / 299792.458
    psi = ra_dec(target - earth[:, :3])
    arc = Arc.of(EPOCH, t_s, psi, np.full((30, 2), ARCSEC), earth, ephemeris)
    truth = trajectory.state_at(np.array([arc.t0 * DAY_S - offset]))[0] / SCALE
    return arc, truth, trajectory, offset


def test_an_integrated_orbit_leaves_residuals_of_a_tenth_of_an_arcsecond(seen) -> None:
    arc, truth, *_ = seen
    v = residuals(arc, truth[None], shifts(arc, truth[None]))[0]
    # in sigmas of 1"; the pull of Venus and the bend of the displacement are left out
    assert np.max(np.abs(v)) < 0.15
    bare = residuals(arc, truth[None], np.zeros((1, arc.t.size, 3)))[0]
    assert np.max(np.abs(bare)) > 3.0


def test_the_displacement_is_what_the_perturbers_do_to_the_orbit(seen) -> None:
    arc, truth, trajectory, offset = seen
    dr, dv = displacements(arc, truth[None])
    inside = slice(1, -1)
    true = trajectory.state_at(arc.nodes[inside] * DAY_S - offset) / SCALE
    kepler = fly(truth[None], arc.nodes[inside] - arc.t0, arc.gm)
    needed = true - kepler
    # straight-line transport over 10 days either way: some per cent; 20 km in 6,000
    np.testing.assert_allclose(dr[0, inside], needed[:, :3], rtol=0.0, atol=0.04 * np.abs(needed[:, :3]).max())
    np.testing.assert_allclose(dv[0, inside], needed[:, 3:], rtol=0.0, atol=0.08 * np.abs(needed[:, 3:]).max())


def test_least_squares_finds_the_orbit_from_starts_far_off(seen) -> None:
    arc, truth, *_ = seen
    rng = np.random.default_rng(2)
    wrong = truth * (1.0 + 0.02 * rng.normal(size=(12, 6)))
    states, cost = improve(arc, wrong)
    good = cost < 1e-3
    assert good.mean() > 0.7
    # a tenth of an arcsecond of force model at 0.1 au
    assert np.max(np.linalg.norm(states[good, :3] - truth[:3], axis=1)) < 1e-5


def test_gross_errors_do_not_pull_the_orbit(seen) -> None:
    arc, truth, *_ = seen
    u = arc.u.copy()
    u[[3, 17, 25]] += 3e-4 * arc.east[[3, 17, 25]]  # a minute of arc
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    spoiled = Arc(**{name: u if name == "u" else getattr(arc, name) for name in Arc.__dataclass_fields__})
    states, _ = improve(spoiled, truth[None] * 1.001)
    v = residuals(arc, states, shifts(arc, states))[0]
    assert np.sqrt(np.mean(v**2)) < 0.5
    assert trimmed_rms(residuals(spoiled, states, shifts(spoiled, states)))[0] < 0.5


def test_the_sky_alone_may_be_free(seen) -> None:
    arc, truth, *_ = seen
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    start = truth + np.concatenate([1e-4 * arc.east[middle], 1e-5 * arc.north[middle]])
    states, cost = improve(arc, start[None], free="sky")
    change = states[0] - start
    assert cost[0] < 1e-2
    np.testing.assert_allclose(change[:3] @ arc.u[middle], 0.0, atol=1e-9)
    np.testing.assert_allclose(change[3:] @ arc.u[middle], 0.0, atol=1e-10)


def test_many_orbits_are_improved_as_each_would_be_alone(seen) -> None:
    arc, truth, *_ = seen
    starts = truth * (1.0 + 0.005 * np.random.default_rng(3).normal(size=(4, 6)))
    together, cost = improve(arc, starts, steps=5)
    for k in range(4):
        alone, one = improve(arc, starts[k : k + 1], steps=5)
        # a candidate alone may stop a step earlier, once it gains nothing
        np.testing.assert_allclose(one[0], cost[k], rtol=0.02, atol=1e-6)
        np.testing.assert_allclose(alone[0], together[k], rtol=0.0, atol=1e-5)


def test_residuals_of_directions_far_off_are_whole_angles(seen) -> None:
    arc, truth, *_ = seen
    behind = truth.copy()
    behind[:3] = 2.0 * arc.q[0] - truth[:3]
    v = residuals(arc, behind[None], np.zeros((1, arc.t.size, 3)))
    # over 2 rad; a chord in the tangent plane never passes 1
    assert np.max(np.hypot(v[0, 0], v[0, 1])) * ARCSEC > 2.0


def test_partials_of_any_orbit_are_differences_of_its_residuals(seen) -> None:
    arc, truth, *_ = seen
    # near ones of a few days' period, hyperbolic ones: each with the fictitious time of its neighbour to begin with
    rng = np.random.default_rng(8)
    states = np.concatenate([truth[:3] * rng.uniform(0.03, 3.0, (40, 1)), 0.02 * rng.normal(size=(40, 3))], axis=1)
    basis = _basis(arc, states, "all")
    shift = np.zeros((40, arc.t.size, 3))
    v = residuals(arc, states, shift)
    J = _partials(arc, states, basis, v, shift)
    for j in range(6):
        moved = residuals(arc, states + STEP * basis[:, :, j], shift)
        # rounding: 1e-16 of an angle over sigma and step
        np.testing.assert_allclose(J[:, :, j], (v - moved) / STEP, rtol=1e-6, atol=1e-6 * np.abs(J).max())


def test_what_cannot_be_computed_costs_the_most_and_stays_where_it_is(seen) -> None:
    arc, truth, *_ = seen
    broken = np.stack([truth, np.full(6, np.nan), np.zeros(6)])
    states, cost = improve(arc, broken)
    assert cost[0] < 1e-2
    assert np.all(cost[1:] == 1e6)
    assert not np.isfinite(states[1]).any()


def test_costs_and_trimmed_rms_of_known_residuals() -> None:
    v = np.array([[1.0, -1.0, 1.0, -1.0, 100.0], [2.0, 2.0, 2.0, 2.0, np.inf]])
    assert costs(v)[0] == pytest.approx((4.0 * np.log(2.0) + np.log(10001.0)) / 5.0)
    assert costs(v)[1] == 1e6
    np.testing.assert_allclose(trimmed_rms(v), [1.0, 2.0])
