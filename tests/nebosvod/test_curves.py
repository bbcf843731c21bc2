"""Curves of accuracy: their ends against missions that say the same, their slopes against closed forms."""

from collections.abc import Callable

import numpy as np
import pytest

from nebosvod.assembly import View, computed_psi
from nebosvod.curves import curves, last_slope, prior_sigma
from nebosvod.estimation import Block, LinearProblem, recursive
from nebosvod.fitting import Fit, fit
from nebosvod.mission import Mission, load_mission_text
from nebosvod.predictions import Quantity, known_partials, quantity
from nebosvod.prior import PriorTable
from nebosvod.scene import Scene

Setting = tuple[Scene, PriorTable, View]
MakeSetting = Callable[[Mission], Setting]
BODY = (
    "radius: {value: 10 m, sigma: 2 m, treatment: estimated}",
    "mass: {value: 8e6 kg, sigma: 2e6 kg, treatment: estimated}",
    "albedo: {value: 0.15, sigma: 0.05, treatment: estimated}",
)


def solved(setting: Setting) -> tuple[Fit, list[Quantity]]:
    scene, priors, nominal = setting
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    return one, [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]


def total(make_setting: MakeSetting, text: str) -> float:
    one, asked = solved(make_setting(load_mission_text(text)))
    return float(np.linalg.norm(one.estimate.predict(*known_partials(asked[0], one.estimate)).factor))


def without_nuisances(text: str) -> str:
    return text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "").replace(
        "    position: {sigma: 3 km, correlation: white, treatment: estimated}\n", ""
    )


def fixed_body(text: str) -> str:
    for line in BODY:
        assert line in text
        text = text.replace(line, line.replace("estimated", "fixed"))
    return text


def test_each_curve_ends_where_a_mission_of_that_kind_ends(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str
) -> None:
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0]["measurements"]
    assert found["count"][-1] == one.problem.n
    assert found["days"][-1] == pytest.approx(30.0, abs=1e-6)
    assert found["all_km"][-1] == pytest.approx(total(make_setting, minimal_text), rel=1e-7)
    quiet = without_nuisances(minimal_text)
    assert found["noise_and_prior_km"][-1] == pytest.approx(total(make_setting, quiet), rel=1e-6)
    assert found["noise_only_km"][-1] == pytest.approx(total(make_setting, fixed_body(quiet)), rel=1e-6)
    assert found["prior_only_km"] is None
    assert found["noise_only_km"][0] is None
    for low, high in (("noise_only_km", "noise_and_prior_km"), ("noise_and_prior_km", "all_km")):
        both = [(a, b) for a, b in zip(found[low], found[high]) if a is not None and b is not None]
        assert all(a <= b * (1 + 1e-6) for a, b in both)


def test_half_an_arc_is_the_mission_of_half_the_arc(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str
) -> None:
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0]["measurements"]
    k = next(i for i, count in enumerate(found["count"]) if count % 2 == 0 and found["days"][i] > 12.0)
    days = round(found["days"][k])
    text = minimal_text.replace(
        "end: 2028-04-19", f"end: 2028-{'03' if 20 + days <= 31 else '04'}-{(20 + days - 1) % 31 + 1:02d}"
    )
    assert found["all_km"][k] == pytest.approx(total(make_setting, text), rel=1e-6)


def test_the_slope_against_the_arc_is_that_of_the_curve(minimal_setting: Setting) -> None:
    """By the points of the curve over the second half of the arc; they are thinner than the curve: 10 %."""
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0]["measurements"]
    late = [(d, s) for d, s in zip(found["days"], found["all_km"]) if d >= 15.0]
    slope = np.polyfit(*np.log(np.array(late)).T, 1)[0]
    assert found["slope_arc"]["all"] == pytest.approx(slope, rel=0.1)
    assert found["slope_arc"]["noise_only"] < found["slope_arc"]["all"] < -1.0


def test_noise_and_cadence_are_those_of_the_missions_that_say_so(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str
) -> None:
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0]
    noisy = found["telescope_noise"]
    ten = noisy["sigma_total_km"][noisy["factor"].index(10.0)]
    assert ten == pytest.approx(total(make_setting, minimal_text.replace("0.1 arcsec", "1 arcsec")), rel=1e-6)
    half = found["cadence"]["sigma_total_km"][found["cadence"]["every"].index(2)]
    assert half == pytest.approx(total(make_setting, minimal_text.replace("cadence: 1 d", "cadence: 2 d")), rel=1e-6)
    assert 0.8 < noisy["slope_noisy"] <= 1.0 + 1e-9
    assert 0.0 <= noisy["slope_quiet"] < 0.2


def test_a_repeated_geometry_has_the_slope_of_one_over_root_n() -> None:
    H = np.tile(np.random.default_rng(0).normal(size=(4, 1, 3)), (100, 1, 1))
    block = Block(name="x", names=("a", "b", "c"), H=H)
    sigma, _ = recursive.follow(
        LinearProblem(residual=np.zeros((400, 1)), R=[[1.0]], blocks=(block,)), np.eye(3), "abc"
    )
    every = np.arange(4, 401, 4)
    assert last_slope(every.astype(float), sigma[every - 1, 0]) == pytest.approx(-0.5, abs=1e-9)


def test_the_slope_of_a_power_is_its_exponent_and_too_few_points_have_none() -> None:
    x = np.arange(1.0, 101.0)
    assert last_slope(x, 3.0 * x**-1.5) == pytest.approx(-1.5, rel=1e-12)
    assert last_slope(np.array([1.0, 2.0]), np.array([1.0, 2.0])) is None
    assert last_slope(x, np.full(100, np.inf)) is None


def test_the_prior_alone_is_the_prior_carried_by_the_partials(make_setting: MakeSetting, minimal_text: str) -> None:
    text = fixed_body(minimal_text) + "prior: {sigma: {position: 10 km, velocity: 1 mm/s}}\n"
    one, asked = solved(make_setting(load_mission_text(text)))
    W = asked[0].partials[:, :6]
    wanted = np.sqrt(np.sum((W * np.repeat([10.0, 1e-6], 3)) ** 2))
    assert prior_sigma(one.problem, asked[0]) == pytest.approx(wanted, rel=1e-9)
