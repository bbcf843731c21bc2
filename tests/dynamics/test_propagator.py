"""The integrator: against another integrator, against shadow orbits, against its own symmetries."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from nebosvod.dynamics import Ephemeris, ForceModel, integrator, propagate
from nebosvod.dynamics.constants import ASTEROID_RADIUS_KM, AU_KM, DAY_S, SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.ephemeris import ASTEROIDS
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.dynamics.model import arc_of
from nebosvod.dynamics.twobody import kepler
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.timescale import Epoch

Array = np.ndarray
YEAR_S = 365.25 * DAY_S
# Typical size of an error of each component that means the same displacement within a year
WEIGHT = np.array([1.0, 1.0, 1.0, 1e7, 1e7, 1e7])
Neo = tuple[Epoch, Array]


@pytest.fixture(scope="module")
def newton(ephemeris: Ephemeris) -> ForceModel:
    """Point masses only."""
    return ForceModel(ephemeris=ephemeris, relativity="none", earth_oblateness=False, sun_oblateness=False)


def dop853(
    start: Array, epoch: Epoch, end_s: float, forces: ForceModel, summed: Any, inside: Any
) -> tuple[Array, Array]:
    """State and partials (6, 6 + q) at end_s by scipy's Dormand-Prince 8(5,3), with the same forces in one lane."""
    columns, _ = forces.columns()
    count = 6 + len(columns)
    physics = forces.physics(epoch)
    window = forces.ephemeris.window(epoch, min(0.0, end_s), max(0.0, end_s), asteroids=forces.asteroids)
    w = inside.make_work(window.layout.shape[0], 0)
    sun = forces.ephemeris.state_km_km_s("sun", epoch, [0.0, end_s])
    jacobian_x, jacobian_v, by_parameters = (np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, len(columns))))

    def rates(t: float, y: Array) -> Array:
        here = (window.coefficients, window.layout, window.timing)
        inside.read_ephemeris(1, t, 0.0, w, physics, *here)
        inside.velocity_at(1, w.t, *here, 0, w.T, w.u, w.record, w.VS)
        w.X[::8], w.V[::8] = y[:3], y[3:6]
        acceleration, _ = summed(1, w, physics)
        jacobian_x[:], jacobian_v[:] = w.G[::8].reshape(3, 3), w.K[::8].reshape(3, 3)
        by_parameters[:] = w.F.reshape(4, 3, 8)[columns, :, 0].T
        M = y[6:].reshape(6, count)
        slope = jacobian_x @ M[:3] + jacobian_v @ M[3:]
        slope[:, 6:] += by_parameters
        return np.concatenate([y[3:6], acceleration[::8], M[3:].ravel(), slope.ravel()])

    first = np.concatenate([start + sun[0], np.eye(6, count).ravel()])
    size = np.concatenate([np.abs(first[:6]) + 1.0, np.ones(6 * count)])
    solution = solve_ivp(rates, (0.0, end_s), first, method="DOP853", rtol=1e-13, atol=1e-13 * size)
    assert solution.success
    last = solution.y[:, -1]
    return last[:6] - sun[1], last[6:].reshape(6, count)


def test_state_and_partials_agree_with_an_independent_integrator(
    full_forces: ForceModel, neo: Neo, summed_forces: Any, inside: Any
) -> None:
    """0.1 m and 1e-9 of each column: what DOP853 reaches at rtol 1e-13 over 100 days."""
    epoch, start = neo
    state, partials = dop853(start, epoch, 100 * DAY_S, full_forces, summed_forces, inside)
    ours = propagate(start, epoch, [100 * DAY_S], full_forces)
    assert np.abs((ours.state[0] - state) * WEIGHT).max() < 1e-4
    _, chain = full_forces.columns()
    theirs = np.hstack([partials[:, :6], partials[:, 6:] @ chain])
    both = np.hstack([ours.Phi[0], ours.zeta[0]])
    error = np.abs((both - theirs) * WEIGHT[:, None]).max(axis=0) / np.abs(theirs * WEIGHT[:, None]).max(axis=0)
    assert error.max() < 1e-9


@pytest.mark.parametrize("relativity", ["none", "sun", "eih"])
def test_every_relativity_agrees_with_the_independent_integrator(
    ephemeris: Ephemeris, neo: Neo, relativity: Any, summed_forces: Any, inside: Any
) -> None:
    epoch, start = neo
    forces = ForceModel(ephemeris=ephemeris, relativity=relativity)
    state, partials = dop853(start, epoch, -40 * DAY_S, forces, summed_forces, inside)
    ours = propagate(start, epoch, [-40 * DAY_S], forces)
    assert np.abs((ours.state[0] - state) * WEIGHT).max() < 1e-4
    assert np.abs((ours.Phi[0] - partials) * WEIGHT[:, None] / WEIGHT).max() < 1e-8


def test_transition_matrix_follows_shadow_orbits(full_forces: ForceModel, neo: Neo) -> None:
    """1e-7 of each column: orbits displaced by 100 km and 1e-5 km/s on both sides; their curvature is 1e-12."""
    epoch, start = neo
    times = np.array([-50.0, 30.0, 365.25]) * DAY_S
    middle = propagate(start, epoch, times, full_forces)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 100.0 if column < 3 else 1e-5
        ahead, behind = (propagate(start + s * step, epoch, times, full_forces, False).state for s in (1.0, -1.0))
        difference = (ahead - behind) / (2.0 * step[column])
        error = np.abs((difference - middle.Phi[:, :, column]) * WEIGHT).max()
        assert error < 1e-7 * np.abs(difference * WEIGHT).max(), column


def test_sensitivities_follow_finite_differences_of_the_parameters(full_forces: ForceModel, neo: Neo) -> None:
    """1e-6 of each column: central differences of a body light enough to be moved by 1000 km."""
    epoch, start = neo
    times = np.array([-100.0, 400.0]) * DAY_S
    light = full_forces.with_values({"mass_kg": 6.1e7, "a1_au_d2": 1e-9, "a2_au_d2": -3e-11, "a3_au_d2": 2e-11})
    middle = propagate(start, epoch, times, light)
    for column, (name, value) in enumerate(zip(light.parameters, light.values)):
        step = 3e-4 * value if name == "mass_kg" else 0.02 * value  # the inverse of the mass is the only curved one
        ahead, behind = (
            propagate(start, epoch, times, light.with_values({name: value + s * step}), False).state
            for s in (1.0, -1.0)
        )
        difference = (ahead - behind) / (2.0 * step)
        error = np.abs((difference - middle.zeta[:, :, column]) * WEIGHT).max()
        assert error < 1e-6 * np.abs(difference * WEIGHT).max(), name


def test_transitions_chain(full_forces: ForceModel, neo: Neo) -> None:
    """1e-10: Phi(t2, t1) Phi(t1, t0) = Phi(t2, t0), in scaled units."""
    epoch, start = neo
    whole = propagate(start, epoch, [150 * DAY_S, 365.25 * DAY_S], full_forces)
    second = propagate(whole.state[0], epoch + 150 * DAY_S, [215.25 * DAY_S], full_forces)
    product = second.Phi[0] @ whole.Phi[0]
    size = np.abs(whole.Phi[1] * WEIGHT[:, None] / WEIGHT).max()
    assert np.abs((product - whole.Phi[1]) * WEIGHT[:, None] / WEIGHT).max() < 1e-10 * size


def test_there_and_back_ends_where_it_began(full_forces: ForceModel, neo: Neo) -> None:
    """1 cm after a year each way."""
    epoch, start = neo
    there = propagate(start, epoch, [YEAR_S], full_forces, False).state[0]
    back = propagate(there, epoch + YEAR_S, [-YEAR_S], full_forces, False).state[0]
    assert np.linalg.norm(back[:3] - start[:3]) < 1e-5


@pytest.mark.parametrize("days", [-200.0, 365.25])
def test_point_masses_keep_the_symplectic_form_and_the_volume(newton: ForceModel, neo: Neo, days: float) -> None:
    """1e-10 in units of 1 au and a mean motion of a year."""
    epoch, start = neo
    Phi = propagate(start, epoch, [days * DAY_S], newton).Phi[0]
    units = np.array([1.0, 1.0, 1.0, 2e-7, 2e-7, 2e-7])
    scaled = Phi / units[:, None] * units
    J = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    size = np.abs(scaled).max() ** 2
    assert np.abs(scaled.T @ J @ scaled - J).max() < 1e-10 * size
    assert np.linalg.det(scaled) == pytest.approx(1.0, abs=1e-10)


def test_relativity_changes_the_volume_as_its_divergence_says(ephemeris: Ephemeris, neo: Neo) -> None:
    """1e-12: ln det Phi = 14 GM/c^2 (1/r0 - 1/r1) for the Schwarzschild term, itself 3e-8."""
    epoch, start = neo
    forces = ForceModel(ephemeris=ephemeris, relativity="sun")
    end = propagate(start, epoch, [120 * DAY_S], forces)
    gm, c = ephemeris.gm_km3_s2["sun"], ephemeris.scalars["speed_of_light_km_s"]
    units = np.array([1.0, 1.0, 1.0, 2e-7, 2e-7, 2e-7])
    sign, logarithm = np.linalg.slogdet(end.Phi[0] / units[:, None] * units)
    r0, r1 = np.linalg.norm(start[:3]), np.linalg.norm(end.state[0, :3])
    wanted = 14.0 * gm / c**2 * (1.0 / r0 - 1.0 / r1)
    assert sign == 1.0
    assert abs(wanted) > 1e-8
    assert logarithm == pytest.approx(wanted, abs=2e-11)


def test_two_bodies_keep_their_energy(ephemeris: Ephemeris, neo: Neo) -> None:
    """1e-12 of the energy over 30 days, after the Sun's own acceleration (by the planets) is taken out.

    With every other mass at zero the asteroid is drawn by the Sun alone, whose motion is that of the file: relative to
    the Sun an inertial force of at most 1e-9 km/s^2 remains, whose work is integrated along the orbit.
    """
    epoch, start = neo
    gm = {body: (value if body == "sun" else 0.0) for body, value in ephemeris.gm_km3_s2.items()}
    alone = dataclasses.replace(ephemeris, gm_km3_s2=gm)
    forces = ForceModel(
        ephemeris=alone, asteroids=False, relativity="none", earth_oblateness=False, sun_oblateness=False
    )
    times = np.linspace(0.0, 30 * DAY_S, 3001)
    state = propagate(start, epoch, times, forces, False).state
    energy = 0.5 * np.einsum("ij,ij->i", state[:, 3:], state[:, 3:]) - gm["sun"] / np.linalg.norm(state[:, :3], axis=1)
    sun = ephemeris.state_km_km_s("sun", epoch, np.append(times - 60.0, times + 60.0))[:, 3:]
    inertial = -(sun[3001:] - sun[:3001]) / 120.0
    power = np.einsum("ij,ij->i", inertial, state[:, 3:])
    work = np.trapezoid(power, times)
    assert abs(work) > 1e-8 * abs(energy[0])
    assert energy[-1] - energy[0] == pytest.approx(work, abs=1e-12 * abs(energy[0]))


@settings(max_examples=8, deadline=None)
@given(shift=st.floats(-300.0, 300.0))
def test_the_origin_of_time_does_not_matter(ephemeris: Ephemeris, shift: float) -> None:
    """1 cm: the same arc counted from another epoch, both legs of it integrated."""
    epoch = Epoch.parse("2025-03-01T00:00:00 TDB")
    start = np.array([-83626000.0, 128056000.0, 45477000.0, -23.93, -10.4, -4.47])
    forces = ForceModel(ephemeris=ephemeris)
    direct = propagate(start, epoch, [100 * DAY_S], forces, False).state[0]
    moved = propagate(start, epoch, [shift * DAY_S], forces, False).state[0]
    again = propagate(moved, epoch + shift * DAY_S, [(100.0 - shift) * DAY_S], forces, False).state[0]
    assert np.linalg.norm(again[:3] - direct[:3]) < 1e-5 * (1.0 + abs(shift) / 30.0)


def test_tolerances_converge_on_one_orbit(full_forces: ForceModel, neo: Neo) -> None:
    """1 cm after three years between tolerances two orders apart."""
    epoch, start = neo
    coarse, fine = (
        propagate(start, epoch, [3 * YEAR_S], full_forces, False, tolerance=t).state[0] for t in (1e-11, 1e-13)
    )
    assert np.linalg.norm(coarse[:3] - fine[:3]) < 1e-5


def test_times_come_back_in_the_order_asked(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    times = np.array([5.0, -3.0, 0.0, 2.0, 2.0]) * DAY_S
    mixed = propagate(start, epoch, times, full_forces)
    assert np.array_equal(mixed.t_s, times)
    assert np.array_equal(mixed.state[3], mixed.state[4])
    assert np.abs(mixed.state[2] - start)[:3].max() < 1e-6  # km; heliocentric to barycentric and back
    assert np.abs(mixed.Phi[2] - np.eye(6)).max() == 0.0
    assert not mixed.zeta[2].any()
    for k in range(5):
        single = propagate(start, epoch, times[k : k + 1], full_forces)
        assert np.abs((single.state[0] - mixed.state[k]) * WEIGHT).max() < 1e-6


def test_single_moment_needs_no_integration_span(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    here = propagate(start, epoch, [0.0], full_forces, margin_s=0.0)
    assert np.abs(here.state[0] - start)[:3].max() < 1e-6


def test_state_only_and_full_runs_give_the_same_states(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    a = propagate(start, epoch, [100 * DAY_S], full_forces)
    b = propagate(start, epoch, [100 * DAY_S], full_forces, False)
    assert np.array_equal(a.state, b.state)
    with pytest.raises(InputError, match="without sensitivities"):
        _ = b.Phi


def test_light_time_before_the_first_time_is_covered(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    ahead = propagate(start, epoch, [0.0, 10 * DAY_S], full_forces)
    assert ahead.span_s[0] <= -500.0
    assert ahead.at([-499.0]).state.shape == (1, 6)


@pytest.mark.parametrize(
    ("distance_au", "speed_km_s", "days"),
    [(39.0, 4.6, 0.0), (50.0, 3.0, -3000.0), (95.0, 4.0, 10.0), (300.0, -2.0, -3000.0), (900.0, 20.0, -8000.0)],
)
def test_it_reaches_back_over_the_light_time_from_wherever_it_is(
    full_forces: ForceModel, distance_au: float, speed_km_s: float, days: float
) -> None:
    """From 50 au, where the planets end, light takes seven hours; outward and inward, to the first time asked for."""
    start = np.array([distance_au * AU_KM, 0.0, 0.0, speed_km_s, 0.0, 1.0])
    flown = propagate(start, Epoch.parse("2026-03-01T00:00:00 TDB"), [days * DAY_S, 20 * DAY_S], full_forces)
    first = min(days, 0.0) * DAY_S
    light_s = np.linalg.norm(flown.state_at([first])[0, :3]) / SPEED_OF_LIGHT_KM_S
    assert flown.span_s[0] < first - light_s - 499.0
    assert flown.at([first - light_s]).Phi.shape == (1, 6, 6)


def test_epoch_at_the_edge_of_the_ephemeris_works(neo: Neo) -> None:
    from nebosvod.dynamics.ephemeris import DATA

    excerpt = Ephemeris.load(DATA / "de440_1990_2060.bsp", DATA / "sb441_n16_1990_2060.bsp")
    first, last = excerpt.span
    forces = ForceModel(ephemeris=excerpt)
    assert propagate(neo[1], first, [0.0, DAY_S], forces).span_s[0] == -21600.0  # the light time over 43 au
    assert propagate(neo[1], last, [0.0], forces).state.shape == (1, 6)
    with pytest.raises(CoverageError, match="2060-01-01"):
        propagate(neo[1], last, [DAY_S], forces)
    assert propagate(neo[1], last, [0.0], forces, margin_s=0.0).state[0] == pytest.approx(neo[1], rel=1e-15)
    with pytest.raises(CoverageError, match=r"1989-12-\d\dT.* lies outside the ephemeris"):
        propagate(neo[1], first, [-20.0 * DAY_S, DAY_S], forces)


def test_asteroids_that_begin_after_the_planets_or_end_before_them_end_the_arc(neo: Neo) -> None:
    from nebosvod.dynamics.ephemeris import DATA

    full = Ephemeris.load()
    if "naif" not in full.source:
        pytest.skip("the full DE440 is not installed")
    mixed = Ephemeris.load(full.path, DATA / "sb441_n16_1990_2060.bsp")
    early, epoch = Epoch.parse("1990-02-01T00:00:00 TDB"), Epoch.parse("2059-12-01T00:00:00 TDB")
    for start, days in ((epoch, 60.0), (early, -60.0)):
        with pytest.raises(CoverageError, match="switch the asteroids off"):
            propagate(neo[1], start, [days * DAY_S], ForceModel(ephemeris=mixed), False)
    assert propagate(neo[1], epoch, [60.0 * DAY_S], ForceModel(ephemeris=mixed, asteroids=False), False).t_s.size == 1


@pytest.mark.parametrize(
    ("state", "times", "message"),
    [
        ([1.0, 2.0, 3.0], [0.0], "six finite numbers"),
        ([np.nan] * 6, [0.0], "six finite numbers"),
        (None, [np.inf], "finite seconds"),
        (None, [], "n > 0"),
        (None, [[0.0]], "shape"),
    ],
)
def test_wrong_input_is_refused(full_forces: ForceModel, neo: Neo, state: Any, times: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        propagate(neo[1] if state is None else state, neo[0], times, full_forces)


def falling(ephemeris: Ephemeris, epoch: Epoch, aim_km: float) -> Array:
    """A heliocentric state ten days before an encounter with the Earth at the impact parameter aim_km."""
    lead = 10 * DAY_S
    target = ephemeris.state_km_km_s("earth", epoch, lead)[0] - ephemeris.state_km_km_s("sun", epoch, lead)[0]
    velocity = target[3:] + R_icrf_from_ecliptic @ np.array([6.0, -8.0, 3.0])
    across = np.cross(velocity - target[3:], [0.0, 0.0, 1.0])
    end = np.concatenate([target[:3] + aim_km * across / np.linalg.norm(across), velocity])
    sun = ephemeris.gm_km3_s2["sun"]
    return kepler(end, [-lead], sun)[0]


def test_impact_ends_the_arc_with_body_and_time(ephemeris: Ephemeris) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    with pytest.raises(EventError, match=r"hits earth at about 2030-05-1\dT.*: \d{4} km from its centre"):
        propagate(falling(ephemeris, epoch, 0.0), epoch, [30 * DAY_S], ForceModel(ephemeris=ephemeris), False)


def test_near_miss_goes_on(ephemeris: Ephemeris) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    miss = falling(ephemeris, epoch, 60000.0)
    assert propagate(miss, epoch, [30 * DAY_S], ForceModel(ephemeris=ephemeris), False).state.shape == (1, 6)


def test_start_below_the_surface_is_an_event(ephemeris: Ephemeris) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = ephemeris.state_km_km_s("earth", epoch, 0.0)[0] - ephemeris.state_km_km_s("sun", epoch, 0.0)[0]
    with pytest.raises(EventError, match="earth"):
        propagate(
            [earth[0] + 3000.0, *earth[1:4], earth[4] + 12.0, earth[5]],
            epoch,
            [DAY_S],
            ForceModel(ephemeris=ephemeris),
            False,
        )


@pytest.mark.parametrize("days", [20.0, -20.0])
def test_start_at_the_centre_of_a_body_stops_at_once(ephemeris: Ephemeris, days: float) -> None:
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    venus = ephemeris.state_km_km_s("venus", epoch, 0.0)[0] - ephemeris.state_km_km_s("sun", epoch, 0.0)[0]
    with pytest.raises(EventError, match=r"venus at about 2030-05-01T00:00:00.* 0 km from .*starts below the surface"):
        propagate(venus, epoch, [days * DAY_S], ForceModel(ephemeris=ephemeris))


def toward_ceres(ephemeris: Ephemeris, epoch: Epoch) -> Array:
    """A state 20,000 km from the centre of Ceres, falling there at 1 km/s."""
    ceres = (ephemeris.state_km_km_s("ceres", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    start: Array = ceres + np.array([20000.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    return start


def test_fall_into_an_asteroid_ends_at_its_surface(ephemeris: Ephemeris) -> None:
    """1 s of print: 19,530 km at 1 km/s, and the last thousand a little faster by the pull of Ceres."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    with pytest.raises(EventError, match=r"hits ceres at about .*: 470 km from its centre, radius 470 km") as caught:
        propagate(toward_ceres(ephemeris, epoch), epoch, [3.0 * DAY_S], ForceModel(ephemeris=ephemeris), False)
    r, gm = np.linspace(470.0, 20000.0, 200001), ephemeris.gm_km3_s2["ceres"]
    flight_s = np.trapezoid(1.0 / np.sqrt(1.0 + 2.0 * gm * (1.0 / r - 1.0 / 20000.0)), r)
    arrived = Epoch.parse(str(caught.value).split("about ")[1].split(": ")[0]) - epoch
    assert arrived == pytest.approx(flight_s, abs=1.0)


def test_integration_that_stops_near_an_asteroid_names_it(
    ephemeris: Ephemeris, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the surface nothing is left to stop at, so here the real integration says so on its way there."""
    real, epoch = integrator.integrate, Epoch.parse("2030-05-01T00:00:00 TDB")
    monkeypatch.setattr(integrator, "integrate", lambda *a: (integrator.STALLED, *real(*a)[1:]))
    with pytest.raises(EventError, match=r"the integration stops at .*asteroid is \d+ km from the centre of ceres"):
        propagate(
            toward_ceres(ephemeris, epoch), epoch, [15000.0], ForceModel(ephemeris=ephemeris), False, margin_s=0.0
        )


def test_arc_of_too_many_steps_is_an_event_and_no_trajectory(
    ephemeris: Ephemeris, neo: Neo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two million steps take a minute: here the real integration says so after its last one."""
    real = integrator.integrate
    monkeypatch.setattr(integrator, "integrate", lambda *a: (integrator.TOO_MANY_STEPS, *real(*a)[1:]))
    wanted = r"gives up at 2025-06-09T.*the 2000000 steps .* km from .*shorter arc, or a tolerance looser than 1e-10"
    with pytest.raises(EventError, match=wanted):
        propagate(neo[1], neo[0], [100.0 * DAY_S], ForceModel(ephemeris=ephemeris), False, margin_s=0.0)


def test_apophis_follows_jpl_to_the_eve_of_its_encounter(
    ephemeris: Ephemeris, apophis: Callable[[Epoch, Any], Array], apophis_nongrav: Any
) -> None:
    """1 km from 2028-06 to 2029-04-10 with A1, A2 of solution 220 and the default forces (reached: 0.03 km)."""
    epoch = Epoch.parse("2028-06-01T00:00:00 TDB")
    times = np.linspace(0.0, Epoch.parse("2029-04-10T00:00:00 TDB") - epoch, 50)
    wanted = apophis(epoch, times)
    forces = ForceModel(ephemeris=ephemeris, nongrav=apophis_nongrav)
    ours = propagate(wanted[0], epoch, times, forces, False)
    assert np.linalg.norm(ours.state[:, :3] - wanted[:, :3], axis=1).max() < 1.0


@pytest.mark.parametrize("body", ["pallas", "ceres"])
@pytest.mark.parametrize("aside_km", [0.0, 200.0])
def test_asteroid_that_is_its_own_perturber_does_not_attract_itself(
    ephemeris: Ephemeris, body: str, aside_km: float
) -> None:
    """2 km a year along the published orbit (perturbers beyond the 16 are missing); 200 km aside stays aside."""
    epoch, t = Epoch.parse("2025-03-01T00:00:00 TDB"), [0.0, 365.0 * 86400.0]
    wanted = ephemeris.state_km_km_s(body, epoch, t) - ephemeris.state_km_km_s("sun", epoch, t)
    start = wanted[0] + np.array([aside_km, 0.0, 0.0, 0.0, 0.0, 0.0])
    forces = ForceModel(ephemeris=ephemeris, parameters=())
    found = propagate(start, epoch, t[1:], forces)
    assert found.forces.excluded == (body,)
    assert forces.excluded == ()
    moved = found.Phi[0] @ (start - wanted[0])
    assert np.linalg.norm((found.state[0] - wanted[1] - moved)[:3]) < 2.0


@pytest.mark.parametrize("body", ASTEROIDS)
def test_ten_radii_decide_whether_an_orbit_is_an_asteroids_own(ephemeris: Ephemeris, body: str) -> None:
    epoch, forces = Epoch.parse("2025-03-01T00:00:00 TDB"), ForceModel(ephemeris=ephemeris)
    place = (ephemeris.state_km_km_s(body, epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    for radii, wanted in ((9.9, (body,)), (10.1, ())):
        start = place + np.array([0.6, 0.0, 0.8, 0.0, 0.0, 0.0]) * radii * ASTEROID_RADIUS_KM[body]
        assert propagate(start, epoch, [3600.0], forces, False).forces.excluded == wanted


def test_orbit_of_an_asteroid_is_that_of_a_model_without_it(ephemeris: Ephemeris) -> None:
    """Bit for bit, with the same tolerance, margin and grid; what was left out before stays out."""
    epoch, t = Epoch.parse("2025-03-01T00:00:00 TDB"), [-30.0 * DAY_S, 100.0 * DAY_S]
    start = (ephemeris.state_km_km_s("ceres", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    some, without = (ForceModel(ephemeris=ephemeris, excluded=names) for names in (("vesta",), ("vesta", "ceres")))
    options: dict[str, Any] = {"tolerance": 1e-7, "margin_s": 1000.0}
    grid = propagate(start + np.array([500.0, 0.0, 0.0, 0.0, 0.0, 0.0]), epoch, t, without, **options)
    for near in (None, grid):
        own, wanted = (propagate(start, epoch, t, forces, grid=near, **options) for forces in (some, without))
        assert own.forces.excluded == ("vesta", "ceres")
        assert np.array_equal(own.step_edges_s, wanted.step_edges_s)
        assert np.array_equal(own.state, wanted.state)
        assert np.array_equal(own.Phi, wanted.Phi)
    assert own.span_s[0] == t[0] - 1000.0


def test_asteroid_far_from_every_perturber_excludes_none(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    assert propagate(start, epoch, [86400.0], full_forces, False).forces is full_forces


def test_no_tolerance_chases_the_rounding_of_a_near_body(ephemeris: Ephemeris) -> None:
    """At ten radii from the Earth the position's rounding is 4e-15 of the acceleration: steps stop shrinking there."""
    epoch, forces = Epoch.parse("2025-03-01T00:00:00 TDB"), ForceModel(ephemeris=ephemeris)
    states = [ephemeris.state_km_km_s(body, epoch, 0.0)[0] for body in ("earth", "sun")]
    start = states[0] - states[1] + np.array([-6e5, 30000.0, 0.0, 6.0, 0.0, 0.0])
    counts = [
        len(propagate(start, epoch, [3 * DAY_S], forces, False, tolerance=tolerance).step_edges_s)
        for tolerance in (1e-13, 1e-16)
    ]
    assert counts[1] < 1.1 * counts[0]


@pytest.mark.parametrize("tolerance", [0.0, -1e-10, float("nan"), float("inf"), 1.0])
def test_a_tolerance_that_is_none_is_refused(full_forces: ForceModel, neo: Neo, tolerance: float) -> None:
    with pytest.raises(InputError, match=r"tolerance: needs a number from 1e-16 to 0.001 \(got"):
        propagate(neo[1], neo[0], [DAY_S], full_forces, tolerance=tolerance)


def test_an_arc_is_kept_for_the_next_call_and_never_taken_for_another(ephemeris: Ephemeris) -> None:
    """Epoch, either end and margin each make an arc of their own; more than a few are not kept."""
    epoch = Epoch.parse("2020-01-01T00:00:00 TDB")
    forces = ForceModel(ephemeris=ephemeris)
    first = arc_of(forces, epoch, -10.0, 10.0, 5.0)
    assert arc_of(forces, epoch, -10.0, 10.0, 5.0) is first
    assert (first.low_s, first.high_s) == (-15.0, 10.0)
    others = [
        arc_of(forces, epoch + 1.0, -10.0, 10.0, 5.0),
        arc_of(forces, epoch, -11.0, 10.0, 5.0),
        arc_of(forces, epoch, -10.0, 11.0, 5.0),
        arc_of(forces, epoch, -10.0, 10.0, 6.0),
    ]
    assert [(arc.low_s, arc.high_s) for arc in others] == [(-15.0, 10.0), (-16.0, 10.0), (-15.0, 11.0), (-16.0, 10.0)]
    assert not np.array_equal(others[0].sun, first.sun)
    assert len(forces._arcs) <= 4


@pytest.mark.parametrize(
    ("from_earth", "days"), [((7000.0, 0.0, 0.0, 0.0, 7.6, 0.0), 3.0), ((-6500.0, 1000.0, 0.0, 0.0, 13.0, 1.0), -100.0)]
)
def test_what_another_call_has_asked_for_does_not_change_an_orbit_near_the_earth(
    ephemeris: Ephemeris, from_earth: tuple[float, ...], days: float
) -> None:
    """Bit by bit: places in an ephemeris that was cut wide for somebody else were rounded by its length.

    After 60 years in one call a low orbit was metres off, and after centuries the integration stalled.
    """
    epoch = Epoch.parse("2025-03-01T00:00:00 TDB")
    fresh = dataclasses.replace(ephemeris, _windows={}, _suns={}, _coverage={})
    start = fresh.state_km_km_s("earth", epoch, 0.0)[0] - fresh.state_km_km_s("sun", epoch, 0.0)[0] + from_earth
    alone = propagate(start, epoch, [days * DAY_S], ForceModel(ephemeris=fresh, asteroids=False), False)
    belt = np.array([4.0e8, 0.0, 0.0, 0.0, 18.0, 0.0])
    years = np.array([-30.0, 30.0]) * YEAR_S
    propagate(belt, epoch, years, ForceModel(ephemeris=fresh, asteroids=False), False)
    after = propagate(start, epoch, [days * DAY_S], ForceModel(ephemeris=fresh, asteroids=False), False)
    assert np.array_equal(alone.state, after.state)
