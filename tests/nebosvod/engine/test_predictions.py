"""Predicted quantities: partials against re-propagated orbits, impact probability, and the measure of nonlinearity."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.engine.trial import DRAWING, generator
from nebosvod.findings.cloud import displacements
from nebosvod.findings.displacement import displaced, moved_quantities, uncertain
from nebosvod.findings.drawn import against_linear, clones, impact_share, spread_of
from nebosvod.findings.nonlinearity import Nonlinearity, curvature, nonlinearity, ordered_factor
from nebosvod.findings.prediction import answered
from nebosvod.mission import Mission, load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene

Setting = tuple[Scene, PriorTable, View]
MakeSetting = Callable[[Mission], Setting]
EVERY_PLANE = """  - {name: axes, plane: rtn, at: 2029-04-06T00:00:00 TDB}
  - {name: speed, plane: rtn_velocity, at: 2029-04-06T00:00:00 TDB}
  - {name: target, plane: mtp, body: earth, near: 2029-04-13T21:46:00 TDB}
"""


@pytest.fixture(scope="module")
def flyby(make_setting: MakeSetting, apophis: Mission) -> tuple[Scene, Fit, list[Quantity]]:
    """Apophis with a prediction of every kind."""
    scene, priors, nominal = make_setting(load_mission_text(apophis.text.rstrip() + "\n" + EVERY_PLANE))
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    return scene, one, [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]


@pytest.mark.parametrize("index", range(7))
def test_partials_are_those_of_a_propagated_orbit(flyby: tuple[Scene, Fit, list[Quantity]], index: int) -> None:
    scene, one, asked = flyby
    steps = dict(zip(STATE_NAMES, [1.0] * 3 + [1e-7] * 3)) | {"radius_m": 0.5}
    for name, step in steps.items():
        up, down = (moved_quantities(scene, one, [asked[index]], {name: sign * step})[0] for sign in (1.0, -1.0))
        slope = (up - down) / (2.0 * step)
        column = asked[index].partials[:, asked[index].names.index(name)]
        # round-off of 3e-8 km and the third-order term; even terms cancel
        assert np.abs(slope - column).max() <= 1e-4 * np.abs(column).max()


def test_a_quantity_does_not_move_on_its_own_orbit(flyby: tuple[Scene, Fit, list[Quantity]]) -> None:
    scene, one, asked = flyby
    for points in moved_quantities(scene, one, asked, {}):
        assert np.abs(points).max() < 1e-6


def test_a_line_far_from_the_base_is_carried_along_itself_into_the_plane_of_the_base() -> None:
    """A straight relative orbit: its own closest point goes in, its crossing of the base plane comes out."""

    def mtp(axes: npt.NDArray[np.float64], point: npt.NDArray[np.float64]) -> SimpleNamespace:
        request = SimpleNamespace(plane="mtp")
        return SimpleNamespace(unit="km", axes=axes, value=axes[[0, 2]] @ point, request=request, facts=None)

    base_axes = np.eye(3)
    direction = np.array([0.3, 0.9, -0.2])
    direction /= np.linalg.norm(direction)
    first = np.cross(direction, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    axes = np.stack([first, direction, np.cross(first, direction)])
    closest = 800.0 * axes[0] - 300.0 * axes[2]
    crossing = closest - closest[1] / direction[1] * direction
    moved = displaced(mtp(base_axes, np.array([100.0, 0.0, 50.0])), mtp(axes, closest))  # type: ignore[arg-type]
    np.testing.assert_allclose(moved, [crossing[0] - 100.0, crossing[2] - 50.0], rtol=1e-12)


def test_curvature_of_a_quadratic_is_its_trace_and_does_not_depend_on_the_axes() -> None:
    """w = x^T C x / 2 with x of covariance K = S S^T has mean tr(C K) / 2."""
    rng = np.random.default_rng(2)
    C = rng.normal(size=(2, 3, 3))
    C = C + C.transpose(0, 2, 1)
    S = rng.normal(size=(3, 3))
    second = np.einsum("ri,drs,sj->dij", S, C, S)
    found = curvature(np.einsum("dii->id", second), np.eye(2))
    np.testing.assert_allclose(found.shift, 0.5 * np.einsum("drs,rs->d", C, S @ S.T), rtol=1e-12)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned = np.einsum("dii->id", np.einsum("ri,drs,sj->dij", S @ turn, C, S @ turn))
    np.testing.assert_allclose(curvature(turned, np.eye(2)).shift, found.shift, rtol=1e-10)


def test_the_measure_is_the_rms_departure_of_a_bent_needle() -> None:
    """w = (x, b x^2 / 2 + s y): the bend b / 2 x^2 against the short axis s is what misleads."""
    long, short, bend = 100.0, 1.0, 3e-4
    draws = np.random.default_rng(0).standard_normal(400_000)
    departure = 0.5 * bend * (long * draws) ** 2
    second = np.array([[0.0, bend * long**2], [0.0, 0.0]])
    found = curvature(second, np.diag([long, short]))
    assert found.measure == pytest.approx(np.sqrt(np.mean(departure**2)) / short, rel=2e-2)
    assert found.shift[1] == pytest.approx(departure.mean(), rel=1e-2)
    assert found.spread[1] == pytest.approx(departure.std(), rel=2e-2)
    assert found.measure > 0.3


def test_the_ordered_factor_is_a_factor_whose_last_columns_move_no_prediction(
    flyby: tuple[Scene, Fit, list[Quantity]],
) -> None:
    _, one, asked = flyby
    names = (*STATE_NAMES, "radius_m", "mass_kg", "albedo")
    S = ordered_factor(one.estimate, names, asked[2:3])
    K = one.estimate.covariance(names)
    sigma = np.sqrt(np.diag(K))
    assert np.abs((S @ S.T - K) / np.outer(sigma, sigma)).max() < 1e-9
    moved = np.linalg.norm(asked[2].partials @ S, axis=0)
    assert moved[2:].max() < 1e-6 * moved[0]


def test_the_second_order_shift_is_that_of_drawn_orbits(flyby: tuple[Scene, Fit, list[Quantity]]) -> None:
    """The mean of drawn orbits less their own linear displacement, a paired difference with little noise."""
    scene, one, asked = flyby
    names = [n for n in (*STATE_NAMES, *one.observation.parameter_names) if n in one.estimate.names]
    target = [asked[2]]
    expected = nonlinearity(scene, one, target)[0].mean_shift
    S = one.estimate.factor(names)
    W = asked[2].partials[:, [asked[2].names.index(n) for n in names]]
    departure = []
    for i, points in enumerate(clones(scene, one, target, 150, 9)[0][0]):
        rng = np.random.default_rng(np.random.SeedSequence(9, spawn_key=(1, i)))
        departure.append(points - W @ (S @ rng.standard_normal(len(names))))
    error = np.std(departure, axis=0) / np.sqrt(150)
    assert np.all(np.abs(np.mean(departure, axis=0) - expected) < 4.0 * error + 0.2 * np.abs(expected))


GIVEN_TIMES = """
  - {name: speed, plane: rtn_velocity, at: 2028-06-29T00:00:00 TDB}
  - {name: axes, plane: rtn, at: 2028-08-29T00:00:00 TDB}
  - {name: sky, plane: sky, from: ahead, at: 2028-05-29T00:00:00 TDB}
"""


def test_a_cloud_flown_at_once_is_the_orbits_flown_one_by_one(make_setting: MakeSetting, minimal_text: str) -> None:
    """Each plane that is about a given time, on 40 drawn orbits; some masses are below zero, which a draw may be."""
    text = minimal_text.replace("sigma: 2e6 kg", "sigma: 2e7 kg").rstrip() + GIVEN_TIMES
    scene, priors, nominal = make_setting(load_mission_text(text))
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    asked = [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]
    at_once, _ = clones(scene, one, asked, 40, 3)
    names, S = uncertain(one), one.estimate.factor(uncertain(one))
    for i in range(40):
        drawn = dict(zip(names, (S @ generator(3, DRAWING, i).standard_normal(S.shape[1])).tolist()))
        for each, points, moved in zip(asked, at_once, moved_quantities(scene, one, asked, drawn)):
            assert moved is not None
            sigma = np.linalg.norm(each.partials_by(names) @ S, axis=1)
            np.testing.assert_allclose(points[i] / sigma, moved / sigma, atol=1e-6)


def test_a_cloud_has_what_comes_before_the_end_of_an_orbit(make_setting: MakeSetting, minimal_text: str) -> None:
    """A mass of nothing has no force; from rest an orbit falls into the Sun in 65 days, after the first time asked."""
    scene, priors, nominal = make_setting(load_mission_text(minimal_text.rstrip() + GIVEN_TIMES))
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    asked = [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]
    rest = {name: -one.point.values[name] for name in STATE_NAMES[3:]}
    deviations: list[dict[str, float]] = [{}, {"mass_kg": -one.point.values["mass_kg"]}, {"x_km": 5.0}, rest]
    found = displacements(scene, one, asked, deviations)
    assert found is not None
    there = np.array([np.isfinite(points).all(axis=1) for points in found])
    np.testing.assert_array_equal(there, [[True, False, True, True]] + 3 * [[True, False, True, False]])


def test_impact_probability_is_the_share_of_normal_points_on_the_disc(flyby: tuple[Scene, Fit, list[Quantity]]) -> None:
    _, one, asked = flyby
    curved = Nonlinearity(orbits=2, mean_shift=np.array([0.3, -0.2]), measure=0.1, misleads=False)
    factor = one.estimate.predict(*known_partials(asked[2], one.estimate)).factor
    radius = asked[2].encounter.capture_radius_km
    edge = replace(asked[2], value=np.array([radius, 0.5]))
    row = answered(edge, one.estimate, "batch", [], curved)
    draws = edge.value + np.random.default_rng(1).standard_normal((400_000, 2)) @ factor.T
    share = np.mean(np.hypot(*draws.T) <= radius)
    assert row.impact_probability == pytest.approx(share, abs=4.0 * np.sqrt(0.25 / 400_000))
    assert 0.3 < share < 0.7
    np.testing.assert_allclose(row.max_deviation, [0.3, 0.2] + 3.0 * row.sigma, rtol=1e-12)
    assert answered(asked[2], one.estimate, "batch", [], curved).impact_probability == 0.0


def test_the_share_of_impacts_has_the_exact_binomial_interval() -> None:
    fate = np.zeros(200)
    none = impact_share(fate)
    assert none.hits == 0
    # closed form at zero hits: (1 - p)^n = 0.025
    assert none.interval_95 == (0.0, pytest.approx(1.0 - 0.025 ** (1 / 200), rel=1e-9))  # type: ignore[comparison-overlap]
    fate[:50] = 1.0
    some = impact_share(fate)
    assert some.probability == 0.25
    assert some.interval_95 == pytest.approx((0.1916, 0.3159), abs=2e-3)
    fate[:50] = np.nan
    assert impact_share(fate).runs == 150
    one, points = SimpleNamespace(value=np.array([0.0, 10.0]), unit="km"), np.zeros((200, 2))
    points[:50] = np.nan
    assert spread_of(one, points, np.eye(2)).undefined == 50  # type: ignore[arg-type]


def test_the_distance_of_a_vague_flyby_misleads_where_its_target_plane_does_not(
    make_setting: MakeSetting, apophis: Mission
) -> None:
    """Six days of data five months before: 100,000 km on the target plane, still linear; a distance cannot be."""
    text = apophis.text.replace("end: 2029-04-08T00:00:00 TDB", "end: 2028-11-20T00:00:00 TDB")
    scene, priors, nominal = make_setting(load_mission_text(text))
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    asked = [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]
    plane, distance = nonlinearity(scene, one, asked)[2:]
    sigma = one.estimate.predict(*known_partials(asked[3], one.estimate)).sigma[0]
    assert sigma > 0.5 * asked[3].value[0]  # type: ignore[index]  # the mean distance lies within two sigmas of zero
    assert distance.misleads
    assert distance.mean_shift[0] > 0.0  # a distance has a floor
    assert not plane.misleads


@pytest.fixture(scope="module")
def weak_arc(
    make_setting: MakeSetting, apophis: Mission
) -> tuple[Scene, Fit, list[Quantity], list[npt.NDArray[np.float64]]]:
    """Forty days, then the encounter: predictions before and after it, with 300 drawn orbits."""
    text = apophis.text.replace(
        "end: 2029-04-08T00:00:00 TDB, cadence: 12 h", "end: 2028-12-25T00:00:00 TDB, cadence: 2 d"
    )
    head = text[: text.index("predictions:")]
    near = "body: earth, near: 2029-04-13T21:46:00 TDB"
    text = f"""{head}predictions:
  - {{name: encounter, plane: b_plane, {near}}}
  - {{name: after, plane: rtn, at: 2029-06-13T21:46:00 TDB}}
  - {{name: speed after, plane: rtn_velocity, at: 2029-06-13T21:46:00 TDB}}
"""
    scene, priors, nominal = make_setting(load_mission_text(text))
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    asked = [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]
    return scene, one, asked, clones(scene, one, asked, 300, 5)[0]


def test_a_weak_arc_through_an_encounter_misleads_after_it_and_not_before(
    weak_arc: tuple[Scene, Fit, list[Quantity], list[npt.NDArray[np.float64]]],
) -> None:
    """In kind the published case of this object (data to 2008): 389.6 x 16.4 km linear, 330.0 x 11.1 km drawn."""
    scene, one, asked, drawn = weak_arc
    bent = nonlinearity(scene, one, asked)
    factors = [one.estimate.predict(*known_partials(each, one.estimate)).factor for each in asked]
    before, after, speed = (spread_of(each, points, S) for each, points, S in zip(asked, drawn, factors))
    assert not before.misleads
    assert not bent[0].misleads
    assert before.cloud.semi_axes == pytest.approx(np.linalg.svd(factors[0], compute_uv=False), rel=0.15)
    assert "the linear ellipse holds" in before.cloud.statement
    for row, found, S in ((after, bent[1], factors[1]), (speed, bent[2], factors[2])):
        assert row.misleads
        assert found.misleads  # the second-order term says so without drawing
        linear = np.linalg.svd(S, compute_uv=False)
        assert row.cloud.semi_axes[0] == pytest.approx(linear[0], rel=0.15)
        assert row.cloud.semi_axes[2] > 10.0 * linear[2]  # a bent needle is wide where the straight one is thin
        assert row.cloud.against.inside_linear_3_sigma < 0.5
        assert "the linear ellipse misleads" in row.cloud.statement
        wanted = np.abs(row.cloud.mean_shift) + 3.0 * row.cloud.sigma
        np.testing.assert_allclose(row.cloud.max_deviation, wanted, rtol=1e-12)


def test_normal_points_hold_and_half_as_much_again_in_one_direction_does_not() -> None:
    """The verdict over 200 samples of 400: right ones are called wrong in less than 5 %, wrong ones found each time."""
    rng, factor = np.random.default_rng(4), np.array([[3.0, 0.0], [4.0, 1e-3]])
    right = [against_linear(rng.standard_normal((400, 2)) @ factor.T, factor).misleads for _ in range(200)]
    assert np.mean(right) < 0.05
    wide = factor * [1.0, 1.5]
    assert all(against_linear(rng.standard_normal((400, 2)) @ wide.T, factor).misleads for _ in range(20))


def test_levels_of_an_ellipse_hold_the_share_of_normal_points_they_say(
    flyby: tuple[Scene, Fit, list[Quantity]],
) -> None:
    _, one, asked = flyby
    curved = Nonlinearity(orbits=2, mean_shift=np.zeros(2), measure=0.0, misleads=False)
    levels = answered(asked[2], one.estimate, "batch", [], curved).levels
    squares = np.sum(np.random.default_rng(2).standard_normal((400_000, 2)) ** 2, axis=1)
    for level in levels:
        assert np.mean(squares <= level.sigma**2) == pytest.approx(level.probability, abs=3e-3)
    assert [round(level.probability, 4) for level in levels] == [0.3935, 0.8647, 0.9889, 0.5, 0.9, 0.99]


def test_an_orbit_without_the_prediction_leaves_its_nonlinearity_open(
    flyby: tuple[Scene, Fit, list[Quantity]], monkeypatch: pytest.MonkeyPatch
) -> None:
    from nebosvod.errors import InputError
    from nebosvod.findings import displacement as module

    scene, one, asked = flyby

    def none(*_: object) -> Quantity:
        raise InputError("no closest approach")

    monkeypatch.setattr(module, "quantity", none)
    row = nonlinearity(scene, one, asked[2:3])[0]
    assert row.measure is None
    assert row.misleads is None
    assert "no such prediction" in str(row.reason)


def test_a_run_with_monte_carlo_has_points_shares_and_a_fifth_accuracy(apophis: Mission) -> None:
    text = apophis.text + "\nmonte_carlo: {runs: 40}\n"
    for name in ("blocks", "identity", "filter"):
        text = "\n".join(line for line in text.split("\n") if f"{{name: {name}, method" not in line)
    result = run(load_mission_text(text), seed=2)
    rows = {row["name"]: row for row in result.summary["predictions"] if row["estimator"] == "batch"}
    target = rows["encounter"]
    points = result.arrays["clones_encounter_km"]
    assert points.shape == (40, 2)
    np.testing.assert_allclose(target["monte_carlo"]["sigma_km"], points.std(axis=0, ddof=1), rtol=1e-12)
    assert target["impact_probability_monte_carlo"]["hits"] == 0
    for k in range(2):  # a sample of 40 has its sigma within 2.6 / sqrt(80)
        assert points[:, k].std(ddof=1) == pytest.approx(target["sigma_km"][k], rel=0.35)
    assert all(row["monte_carlo"] is not None for row in result.summary["accuracy_comparison"]["rows"])
