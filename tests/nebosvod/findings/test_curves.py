"""Curves of accuracy: their ends against missions that say the same, their slopes against closed forms."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.estimation import Block, LinearProblem
from nebosvod.estimation.solvers import recursive
from nebosvod.findings.curves import curves, last_slope, prior_sigma
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

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
    found = curves(one, asked)[0].measurements
    assert found.count[-1] == one.problem.n
    assert found.days[-1] == pytest.approx(30.0, abs=1e-6)
    assert found.totals["all"][-1] == pytest.approx(total(make_setting, minimal_text), rel=1e-7)
    quiet = without_nuisances(minimal_text)
    assert found.totals["noise_and_prior"][-1] == pytest.approx(total(make_setting, quiet), rel=1e-6)
    assert found.totals["noise_only"][-1] == pytest.approx(total(make_setting, fixed_body(quiet)), rel=1e-6)
    assert found.prior_only is None
    assert found.totals["noise_only"][0] == np.inf
    for low, high in (("noise_only", "noise_and_prior"), ("noise_and_prior", "all")):
        both = [(a, b) for a, b in zip(found.totals[low], found.totals[high]) if np.isfinite([a, b]).all()]
        assert all(a <= b * (1 + 1e-6) for a, b in both)


PLACE = "    position: {sigma: 3 km, correlation: white, treatment: estimated}\n"
BIAS = "    bias: {sigma: 0.05 arcsec, treatment: estimated}\n"
KINDS = {
    "white": "sigma: 30 km, correlation: white",
    "constant": "sigma: 30 km, correlation: constant",
    "gauss_markov": "sigma: 30 km, correlation: gauss_markov, time: 4 d",
    "orbit_error": "sigma: 30 km, velocity_sigma: 10 mm/s, correlation: orbit_error",
}


def dense_sigma(one: Fit, asked: Quantity, rows: int) -> float:
    """Total sigma after some measurements by matrices of full size: weights as assumed, errors as they are."""
    problem, t_s, m = one.problem, one.observation.t_s[:rows], 2 * rows
    noise = np.zeros((m, m))
    for k in range(rows):
        noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.broadcast_to(problem.R, (problem.n, 2, 2))[k]
    weighed, unseen = noise.copy(), np.zeros((m, m))
    groups: tuple[Any, ...] = (*problem.white, *problem.markov)
    for group in groups:
        D = np.zeros((m, 3 * rows))
        for H, k in zip(group.H, group.rows):
            if k < rows:
                D[2 * k : 2 * k + 2, 3 * k : 3 * k + 3] = H
        white = group in problem.white
        kernel = np.eye(rows) if white else np.exp(-np.abs(t_s[:, None] - t_s) / (4 * 86400.0))
        covariance = D @ np.kron(kernel, 900.0 * np.eye(3)) @ D.T
        weighed += covariance if group.treatment == "estimated" else 0.0
        unseen += covariance if group.treatment in ("considered", "ignored") else 0.0
    variance = {name: prior.covariance[i, i] for prior in problem.priors for i, name in enumerate(prior.names)}
    blocks = {how: [b for b in problem.blocks if b.treatment == how] for how in ("estimated", "considered", "ignored")}
    left_out = [*blocks["considered"], *blocks["ignored"]]
    names = [name for b in blocks["estimated"] for name in b.names]
    H_e = np.concatenate([b.H[:rows] for b in blocks["estimated"]], axis=2).reshape(m, -1)
    for block in left_out:
        H_j = block.H[:rows].reshape(m, -1)
        unseen += H_j @ np.diag([variance[name] for name in block.names]) @ H_j.T
    unit = np.array([one.estimate.sigma_formal(name) for name in names])  # columns of one size: the matrices stay good
    prior = np.diag([1.0 / variance[name] if name in variance else 0.0 for name in names]) * np.outer(unit, unit)
    U = H_e * unit
    K = np.linalg.solve(U.T @ np.linalg.solve(weighed, U) + prior, np.eye(len(names)))
    gain = K @ np.linalg.solve(weighed, U).T
    W = np.zeros((len(asked.partials), len(names)))
    for column, name in enumerate(asked.names):
        if name in names:
            W[:, names.index(name)] = asked.partials[:, column] * unit[names.index(name)]
    true = gain @ (weighed + unseen) @ gain.T + K @ prior @ K
    return float(np.sqrt(np.trace(W @ true @ W.T)))


@pytest.mark.parametrize("bias", ["fixed", "ignored", "considered", "estimated"])
@pytest.mark.parametrize("position", ["estimated", "considered"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_curve_is_the_true_sigma_in_every_mix_of_treatments(
    kind: str, position: str, bias: str, make_setting: MakeSetting, minimal_text: str
) -> None:
    """After a third of the measurements and after all, against dense algebra; the end is what the run reports too."""
    text = minimal_text.replace(PLACE, f"    position: {{{KINDS[kind]}, treatment: {position}}}\n")
    text = text.replace(BIAS, f"    bias: {{sigma: 0.3 arcsec, treatment: {bias}}}\n")
    one, asked = solved(make_setting(load_mission_text(text)))
    found = curves(one, asked)[0]
    curve = found.measurements
    for place in (next(i for i, count in enumerate(curve.count) if count > one.problem.n // 3), -1):
        wanted = dense_sigma(one, asked[0], curve.count[place])
        assert curve.totals["all"][place] == pytest.approx(wanted, rel=1e-4)
    reported = np.sqrt(np.trace(one.estimate.predict(*known_partials(asked[0], one.estimate)).covariance))
    assert curve.totals["all"][-1] == pytest.approx(reported, rel=1e-7)
    assert found.cadence.total[0] == pytest.approx(reported, rel=1e-9)
    quiet = found.telescope_noise
    assert quiet.total[quiet.factor.index(1.0)] == pytest.approx(reported, rel=1e-9)


def test_a_prior_of_what_is_fixed_is_not_part_of_the_prior_alone(make_setting: MakeSetting, minimal_text: str) -> None:
    """An estimator may fix what the mission calls uncertain: the prior stays in the table, its error is gone."""
    text = minimal_text + "prior: {sigma: {position: 10 km, velocity: 1 mm/s}}\nestimators:\n"
    fixed = "  - {name: a, method: batch_qr, treatment: {radius: fixed, mass: fixed, albedo: fixed}}\n"
    one, asked = solved(make_setting(load_mission_text(text + fixed + "  - {name: b, method: batch_qr}\n")))
    wanted = np.sqrt(np.sum((asked[0].partials[:, :6] * np.repeat([10.0, 1e-6], 3)) ** 2))
    assert prior_sigma(one.problem, asked[0]) == pytest.approx(wanted, rel=1e-9)


def test_half_an_arc_is_the_mission_of_half_the_arc(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str
) -> None:
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0].measurements
    k = next(i for i, count in enumerate(found.count) if count % 2 == 0 and found.days[i] > 12.0)
    days = round(found.days[k])
    text = minimal_text.replace(
        "end: 2028-04-19", f"end: 2028-{'03' if 20 + days <= 31 else '04'}-{(20 + days - 1) % 31 + 1:02d}"
    )
    assert found.totals["all"][k] == pytest.approx(total(make_setting, text), rel=1e-6)


def test_the_slope_against_the_arc_is_that_of_the_curve(minimal_setting: Setting) -> None:
    """By the points of the curve over the second half of the arc; they are thinner than the curve: 10 %."""
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0].measurements
    late = [(d, s) for d, s in zip(found.days, found.totals["all"]) if d >= 15.0]
    slope = np.polyfit(*np.log(np.array(late)).T, 1)[0]  # type: ignore[call-overload]
    assert found.slope_arc["all"] == pytest.approx(slope, rel=0.1)
    assert found.slope_arc["noise_only"] < found.slope_arc["all"] < -1.0


def test_noise_and_cadence_are_those_of_the_missions_that_say_so(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str
) -> None:
    one, asked = solved(minimal_setting)
    found = curves(one, asked)[0]
    noisy = found.telescope_noise
    ten = noisy.total[noisy.factor.index(10.0)]
    assert ten == pytest.approx(total(make_setting, minimal_text.replace("0.1 arcsec", "1 arcsec")), rel=1e-6)
    half = found.cadence.total[found.cadence.every.index(2)]
    assert half == pytest.approx(total(make_setting, minimal_text.replace("cadence: 1 d", "cadence: 2 d")), rel=1e-6)
    assert 0.8 < noisy.slope_noisy <= 1.0 + 1e-9
    assert 0.0 <= noisy.slope_quiet < 0.2


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
