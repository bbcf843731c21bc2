"""Lognormal errors of radius, mass and albedo: forces by logarithms, priors, draws, estimates, words, wrong input."""

import dataclasses
import re

import numpy as np
import pytest

from nebosvod.commands.check_answer import describe
from nebosvod.dynamics import propagate
from nebosvod.engine.assembly import nominal_view
from nebosvod.engine.fitting import fit
from nebosvod.engine.montecarlo import repeat, state_nees
from nebosvod.engine.truth import draw
from nebosvod.errors import InputError
from nebosvod.mission import load_fit, load_mission_text
from nebosvod.pipeline import run
from nebosvod.report.run.physical import parameter_table
from nebosvod.scene.logarithmic import LogarithmicForces
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import build_scene

LN = ("ln_radius", "ln_mass", "ln_albedo")
PHYSICAL = ("radius_m", "mass_kg", "albedo")
BODY = re.compile(r"^(  (?:radius|mass|albedo|density): \{.*sigma: [^,]+,)", re.MULTILINE)


def lognormal(text: str) -> str:
    """The same mission with lognormal errors of the body."""
    changed, count = BODY.subn(r"\1 distribution: lognormal,", text)
    assert count == 3
    return changed


def treated(text: str, treatment: str) -> str:
    """Another treatment of the body."""
    return re.sub(r"^(  (?:radius|mass|albedo): .*treatment: )\w+", rf"\g<1>{treatment}", text, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def light(minimal_text: str) -> str:
    """A body of 20 kg on which the light acts so strongly that a month of measurements narrows kappa."""
    text = minimal_text.replace("{value: 10 m, sigma: 2 m,", "{value: 1 m, sigma: 0.4 m,")
    text = text.replace("{value: 8e6 kg, sigma: 2e6 kg,", "{value: 20 kg, sigma: 8 kg,")
    assert text != minimal_text
    return lognormal(text)


def forces_of(text: str):
    """Force model and state of a mission."""
    scene = build_scene(load_mission_text(text))
    return scene.forces, scene


def test_sensitivities_are_by_the_logarithms(light: str) -> None:
    forces, scene = forces_of(light)
    assert isinstance(forces, LogarithmicForces)
    assert forces.parameters == LN
    np.testing.assert_allclose(forces.values, np.log([1.0, 20.0, 0.15]), rtol=1e-14)
    far, steps = [30.0 * 86400.0], 1e-4
    along = propagate(scene.state, scene.epoch, far, forces)
    assert along.parameter_names == LN
    values = dict(zip(LN, forces.values.tolist()))
    for column, name in enumerate(LN):
        ends = [
            propagate(scene.state, scene.epoch, far, forces.with_values(values | {name: values[name] + h})).state[0]
            for h in (steps, -steps)
        ]
        numeric = (ends[0] - ends[1]) / (2.0 * steps)
        # differences of 1e8 km to 1e-8 km over 2e-4, and their third derivative
        np.testing.assert_allclose(along.zeta[0, :3, column], numeric[:3], rtol=1e-6, atol=1e-3)
        np.testing.assert_allclose(along.zeta[0, 3:, column], numeric[3:], rtol=1e-6, atol=1e-9)


def test_a_point_elsewhere_keeps_names_and_moves_columns(light: str) -> None:
    forces, _ = forces_of(light)
    moved = forces.with_values({"ln_radius": np.log(3.0)})
    assert moved.parameters == LN
    assert moved.radiation.radius_m == pytest.approx(3.0, rel=1e-14)
    # kappa goes with the square of the radius, and so do all its derivatives by logarithms
    np.testing.assert_allclose(moved.columns()[1], 9.0 * forces.columns()[1], rtol=1e-13)
    assert dataclasses.replace(moved, parameters=()).columns()[1].shape == (0, 0)


@pytest.mark.parametrize("treatment", ["considered", "ignored", "estimated"])
def test_to_first_order_a_lognormal_error_counts_as_the_normal_one(light: str, make_setting, treatment: str) -> None:
    """sigma / value is the sigma of the logarithm: on the nominal orbit covariance and shares are the same."""
    found = []
    for text in (light, light.replace("distribution: lognormal, ", "")):
        scene, priors, nominal = make_setting(load_mission_text(treated(text, treatment)))
        found.append(repeat(scene, scene.mission.estimators[0], nominal, priors, 1, 0).reference)
    other, normal = found
    covariance, expected = (one.covariance(STATE_NAMES) for one in found)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)
    body = [sum(np.trace(one.shares[name][:3, :3]) for name in ("radius", "mass", "albedo")) for one in found]
    assert body[0] == pytest.approx(body[1], rel=1e-9)
    if treatment == "estimated":
        sigmas = [other.sigma(name) for name in LN], [normal.sigma(name) for name in PHYSICAL]
        np.testing.assert_allclose(sigmas[0], np.array(sigmas[1]) / [1.0, 20.0, 0.15], rtol=1e-9)
    else:
        assert body[1] > 0.1 * np.trace(expected[:3, :3])


def test_a_prior_orbit_carried_to_another_epoch_is_correlated_with_the_logarithms(light: str) -> None:
    rows = [[(100.0 if i < 3 else 1e-8) if i == j else 0.0 for j in range(6)] for i in range(6)]
    prior = f"prior: {{names: [x, y, z, vx, vy, vz], covariance: {rows}, epoch: 2028-03-01 TDB}}\n"
    tables = []
    for text in (light, light.replace("distribution: lognormal, ", "")):
        forces, scene = forces_of(text + prior)
        tables.append(prior_table(scene.mission, forces, scene.state).entries[0])
    (title, names, mean, covariance), (_, plain_names, _, plain) = tables
    assert title == "prior orbit and parameters"
    assert names == (*STATE_NAMES, *LN)
    assert plain_names == (*STATE_NAMES, *PHYSICAL)
    per = np.array([1.0] * 6 + [1.0, 20.0, 0.15])
    expected = plain / np.outer(per, per)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-11)
    assert np.abs(expected[:6, 6:] / np.outer(scale[:6], scale[6:])).max() > 0.1
    np.testing.assert_allclose(mean[6:], np.log([1.0, 20.0, 0.15]), rtol=1e-14)


def test_draws_are_lognormal_with_the_value_as_median(minimal_text: str) -> None:
    text = lognormal(minimal_text).replace("sigma: 2 m", "sigma: 9 m")
    forces, scene = forces_of(text)
    priors = prior_table(scene.mission, forces, scene.state)
    rng = np.random.default_rng(1)
    radius = np.exp([priors.draw(rng)["ln_radius"] for _ in range(4000)])
    # ln R ~ N(ln 10, 0.9^2): standard errors 0.014 of the mean and 1.1 % of the sigma; 4 of them
    assert np.mean(np.log(radius)) == pytest.approx(np.log(10.0), abs=0.057)
    assert np.std(np.log(radius)) == pytest.approx(0.9, rel=0.045)
    assert radius.min() > 0.0
    assert np.mean(radius) == pytest.approx(10.0 * np.exp(0.405), rel=0.1)
    truth = draw(scene, priors, np.random.default_rng(0))
    assert set(LN) <= set(truth.point.parameters)
    assert np.all(np.isfinite(truth.psi))


def test_estimates_follow_a_truth_that_is_far_off_and_stay_positive(light: str) -> None:
    """kappa, known to a factor of 2.5 beforehand, is narrowed at least fivefold."""
    _, scene = forces_of(light)
    priors = prior_table(scene.mission, scene.forces, scene.state)
    nominal = nominal_view(scene)
    gains = []
    for seed in range(6):
        truth = draw(scene, priors, np.random.default_rng(seed))
        one = fit(scene, scene.mission.estimators[0], nominal, truth.psi, priors)
        assert str(one.status) == "converged"
        off = np.array([one.point.values[name] - truth.point.values[name] for name in (*STATE_NAMES, *LN)])
        factor = one.estimate.factor((*STATE_NAMES, *LN))
        assert np.sum(np.linalg.solve(factor, off) ** 2) < 27.9  # 99.9 % of chi squared, 9
        slope = np.array([2.0, -1.0, 0.15 * 4 / 9 / (1 + 0.15 * 4 / 9)])
        before = np.linalg.norm(slope * [0.4, 0.4, 1 / 3])
        gains.append(np.linalg.norm(slope @ factor[6:]) / before)
    assert max(gains) < 0.2


def test_a_campaign_judges_lognormal_errors_honest(light: str, make_setting) -> None:
    scene, priors, nominal = make_setting(load_mission_text(light))
    found = state_nees(repeat(scene, scene.mission.estimators[0], nominal, priors, 400, 7))
    low, high = found.nees_interval_99
    assert low < found.nees_mean < high


def test_a_mass_from_radius_and_density_is_correlated_in_the_logarithms(minimal_text: str) -> None:
    text = lognormal(
        minimal_text.replace("mass: {value: 8e6 kg, sigma: 2e6 kg,", "density: {value: 2 g/cm^3, sigma: 0.5 g/cm^3,")
    )
    forces, scene = forces_of(text)
    entry = next(e for e in prior_table(scene.mission, forces, scene.state).entries if e[0] == "radius and density")
    _, names, mean, covariance = entry
    assert names == ("ln_radius", "ln_mass")
    np.testing.assert_allclose(mean, [np.log(10.0), np.log(4.0 / 3.0 * np.pi * 1000.0 * 2000.0)], rtol=1e-13)
    # ln m = const + ln rho + 3 ln R, exactly
    np.testing.assert_allclose(covariance, [[0.04, 0.12], [0.12, 0.36 + 0.0625]], rtol=1e-13)


def test_a_report_gives_medians_and_factors(light: str, tmp_path) -> None:
    result = run(load_mission_text(light), seed=0)
    found = result.summary["estimators"][0]["parameters"]
    assert set(LN) <= set(found)
    radiation = result.summary["physics"]["radiation_pressure"]
    assert [radiation[name] for name in PHYSICAL] == pytest.approx([1.0, 20.0, 0.15], rel=1e-14)
    assert any("radius is lognormal: 1 is the median" in text for text in result.summary["assumptions"])
    table = parameter_table(result.summary["estimators"][0])
    cells = {str(row[0]): [re.sub(r"<[^>]+>", "", str(cell)) for cell in row[1:]] for row in table.rows}
    shown = cells["mass, lognormal"]
    assert float(shown[0].replace("\xa0", " ").split()[0]) == pytest.approx(
        np.exp(found["ln_mass"]["estimate"]), rel=0.01
    )
    assert shown[1] == "×/÷\xa01.492"  # exp(0.4)


def test_check_says_the_median_and_the_factor(light: str) -> None:
    words = describe(load_mission_text(light))
    assert re.search(r"mass_kg +20 times or over 1\.492 \(lognormal, 0\.4\), estimated", words)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("value: 10 m, sigma: 2 m,", "value: 10 m,", r"radius.distribution.*lognormal needs a sigma"),
        ("sigma: 2 m,", "sigma: 11 m,", r"radius.sigma.*must not exceed the value .*\(got 11, value 10\)"),
        ("value: 0.15,", "value: 0,", r"albedo.value.*must be positive where distribution is lognormal \(got 0\)"),
        ("distribution: lognormal, treatment", "distribution: log, treatment", r"radius.distribution"),
        ("mass: {value: 8e6 kg, sigma: 2e6 kg, distribution: lognormal,",
         "density: {value: 2 g/cm^3, sigma: 0.5 g/cm^3,",
         r"density.distribution.*radius is lognormal and density normal; give both one distribution"),
    ],
)  # fmt: skip
def test_what_cannot_be_lognormal_is_named(minimal_text: str, old: str, new: str, said: str) -> None:
    text = lognormal(minimal_text)
    assert old in text
    with pytest.raises(InputError, match=said):
        load_mission_text(text.replace(old, new, 1))


def test_a_fit_refuses_it_with_the_line(tmp_path) -> None:
    text = (
        "schema_version: 1\nname: a\nobject:\n  radius: {value: 10 m, sigma: 2 m, distribution: lognormal, "
        "treatment: estimated}\n  mass: 8e6 kg\n  albedo: 0.15\nfit: {observations: [a.psv]}\n"
    )
    (tmp_path / "a.yaml").write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"a\.yaml:4.*object\.radius\.distribution.*use normal here"):
        load_fit(tmp_path / "a.yaml")
