"""What residuals say: jumps found at their date, rhythms by their name, noise left in peace, in runs and in records."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from nebosvod.cli import main
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.truth import draw
from nebosvod.findings.bias_tests import LEVEL, NOTHING, bias_tests
from nebosvod.findings.doctor import Diagnosis, diagnose, orbital_periods, rhythm_words, sentence
from nebosvod.findings.residual_tests import residual_tests, worst_of_state
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Setting = tuple[Scene, PriorTable, View]
MakeSetting = Callable[[Mission], Setting]
SHARED = Path(__file__).resolve().parents[4] / "shared"
SCHEMA = Path(__file__).resolve().parents[3] / "nebosvod" / "results" / "summary.schema.json"


def solved(setting: Setting, added: Array | None = None, seed: int = 1) -> tuple[Scene, Fit]:
    """The first estimator of a mission on drawn measurements, with something added to them (n, 2), rad."""
    scene, priors, nominal = setting
    truth = draw(scene, priors, np.random.default_rng(seed))
    psi = truth.psi if added is None else truth.psi + added / np.array([1.0, 1.0])
    return scene, fit(scene, scene.mission.estimators[0], nominal, psi, truth.priors)


@pytest.fixture(scope="module")
def neb_setting(make_setting: MakeSetting, neb_text: str) -> Setting:
    """Two geostationary telescopes, every two days."""
    return make_setting(load_mission_text(neb_text.replace("cadence: 6 d", "cadence: 2 d")))


def jump(scene: Scene, telescope: int, after: float, size: tuple[float, float]) -> Array:
    """A bias, arcsec in RA and Dec, of one telescope after a part of its exposures."""
    rows = np.flatnonzero(scene.exposures.telescope_index == telescope)
    added = np.zeros((len(scene.exposures), 2))
    added[rows[int(after * len(rows)) :]] = np.array(size) * ARCSEC
    return added


def test_a_bias_that_appears_is_found_with_its_date_and_the_other_telescope_is_cleared(neb_setting: Setting) -> None:
    scene = neb_setting[0]
    _, found = solved(neb_setting, jump(scene, 0, 0.5, (0.0, 0.3)))
    first, second = bias_tests(scene, found).tests
    assert first.verdict == "appearing"
    assert second.verdict == NOTHING  # the orbit has moved to where this one saw a bias too
    rows = np.flatnonzero(scene.exposures.telescope_index == 0)
    begun = scene.exposures.t_s[rows[len(rows) // 2]]
    told = first.leading
    assert told.since_s is not None
    assert abs(told.since_s - begun) < 10.0 * 86400.0
    assert told.chance < 1e-6
    np.testing.assert_allclose(told.bias_rad / ARCSEC, [0.0, 0.3], atol=4.0 * np.max(told.sigma_rad) / ARCSEC)
    assert told.shift_km > 10.0
    told_in_words = diagnose(scene, found)
    assert told_in_words is not None
    assert told_in_words.findings[0].startswith("NEB-1 has a bias since 2029-0")


def test_a_constant_bias_is_told_from_one_that_appears(make_setting: MakeSetting, neb_text: str) -> None:
    text = neb_text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "")
    setting = make_setting(load_mission_text(text.replace("cadence: 6 d", "cadence: 2 d")))
    scene, found = solved(setting, jump(setting[0], 1, 0.0, (0.4, 0.0)))
    first, second = bias_tests(scene, found).tests
    assert second.verdict == "constant"
    assert first.verdict == NOTHING
    assert not second.modelled
    assert "estimated with the orbit it would move the position" in sentence(scene.epoch, second)
    known = sentence(scene.epoch, replace(second, modelled=True))  # nothing would move: it is done
    assert "it is estimated with the orbit, which without it would be off" in known
    np.testing.assert_allclose(
        second.leading.bias_rad / ARCSEC, [0.4, 0.0], atol=4 * second.leading.sigma_rad.max() / ARCSEC
    )


def test_a_bias_that_an_estimator_ignores_is_found_by_a_run(minimal_text: str, tmp_path: Path, capsys) -> None:
    """`run` says it on the terminal, in the summary, on the page, and how large it would have to be."""
    text = minimal_text.replace("sigma: 0.05 arcsec, treatment: estimated", "sigma: 3 arcsec, treatment: ignored")
    (tmp_path / "blind.yaml").write_text(text, "utf-8")
    assert main(["run", str(tmp_path / "blind.yaml"), "-o", str(tmp_path / "out"), "--seed", "3"]) == 0
    assert "residuals: " in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    jsonschema.validate(summary, json.loads(SCHEMA.read_text("utf-8")))
    told = summary["diagnosis"]
    found = [one for one in told["bias_tests"] if one["verdict"] == "constant"]
    assert found
    assert any(f"{one['telescope']} has a bias: RA*" in told["findings"][k] for k, one in enumerate(found))
    assert 0.05 < found[0]["found_constant_arcsec"]["0.5"] < found[0]["found_constant_arcsec"]["0.9"] < 6.0
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "What the residuals say" in page
    assert "Chance to find a bias by its size" in page
    arrays = np.load(tmp_path / "out" / "arrays.npz")
    power = arrays["bias_power"][0, 0]
    assert power[0] == pytest.approx(LEVEL / 4, rel=1e-3)  # two telescopes, two questions
    assert (np.diff(power) >= 0.0).all()


def test_a_bias_larger_than_assumed_is_found_by_a_run(minimal_text: str) -> None:
    """What is declared true beside the assumption is what the residuals show of it."""
    bias = "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {sigma: 0.05 arcsec, mean_ra: 3 arcsec}}"
    text = minimal_text.replace("{lead: -10 deg}", "{lead: -10 deg}, " + bias)
    told = json.loads(run(load_mission_text(text), seed=2).summary_text())["diagnosis"]
    first, second = told["bias_tests"]
    assert second["verdict"] == "constant"
    assert second["constant"]["bias_arcsec"][0] == pytest.approx(3.0, abs=4.0 * second["constant"]["sigma_arcsec"][0])
    assert first["verdict"] == "no bias"


def test_noise_is_left_in_peace(neb_setting: Setting) -> None:
    found = diagnose(*solved(neb_setting))
    assert found is not None
    assert found.findings == ()
    assert {one.verdict for one in found.biases.tests} == {NOTHING}
    for telescope in found.residuals.telescopes:
        assert telescope.scatter == pytest.approx(1.0, abs=0.25)


@pytest.mark.long
def test_families_of_tests_hold_their_level_in_three_hundred_runs(neb_setting: Setting) -> None:
    runs, alarms = 300, np.zeros(2, dtype=int)
    for seed in range(runs):
        found = diagnose(*solved(neb_setting, seed=seed))
        assert found is not None
        # the bias that the mission says may be there is often really there: only appearing ones are alarms
        alarms += [any(one.verdict == "appearing" for one in found.biases.tests), bool(found.residuals.findings)]
    for one in alarms:
        assert stats.binomtest(int(one), runs, LEVEL, alternative="greater").pvalue > 1e-3


def test_a_rhythm_of_the_residuals_is_found_with_its_period(neb_setting: Setting) -> None:
    scene = neb_setting[0]
    rows = scene.exposures.telescope_index == 1
    added = np.zeros((len(scene.exposures), 2))
    added[rows, 1] = 0.15 * ARCSEC * np.sin(2.0 * np.pi * scene.exposures.t_s[rows] / (9.0 * 86400.0))
    _, found = solved(neb_setting, added)
    told = residual_tests(scene, found, None)
    assert len(told.findings) == 1
    assert told.findings[0].startswith("NEB-2")
    series = next(one for one in told.telescopes if one.telescope == "NEB-2").series[1]
    assert series.period_s == pytest.approx(9.0 * 86400.0, rel=0.05)
    assert series.rhythm_chance < told.alone


def test_the_rhythm_that_would_hurt_most_is_named(make_setting: MakeSetting) -> None:
    """Exposures by night: noise of a day hurts; 757 km instead of 434 by a dense matrix of the admissible family."""
    file = SHARED / "cases" / "akim-first.yaml"
    if not file.exists():
        pytest.skip("needs ../shared/cases/akim-first.yaml")
    result = run_of(file)
    rows = result["accuracy_comparison"]["rows"]
    row = next(one for one in rows if one["prediction"] == "pos0" and one["component"] == 0)
    assert row["worst_correlation"] == pytest.approx(757.0, rel=0.01)
    assert row["worst_correlation_period_s"] == pytest.approx(0.998 * 86400.0, rel=0.005)
    told = result["diagnosis"]["worst_rhythm"]
    assert told["times_worse"] >= row["worst_correlation"] / row["extended"] * (1.0 - 1e-9)
    if abs(told["period_s"] / 86400.0 - 0.998) < 0.02:
        assert "daily" in told["name"]


def run_of(file: Path) -> dict[str, Any]:
    return dict(json.loads(run(load_mission(file)).summary_text()))


def test_orbital_periods_are_those_of_the_telescopes(neb_setting: Setting) -> None:
    for _, period in orbital_periods(neb_setting[0]):
        assert period == pytest.approx(86164.1, rel=2e-3)


def test_the_worst_rhythm_of_a_state_is_at_least_what_a_few_periods_give(neb_setting: Setting) -> None:
    _, found = solved(neb_setting)
    close, rough = worst_of_state(found), worst_of_state(found, rough=True)
    assert close is not None
    assert rough is not None
    assert rough.times_worse <= close.times_worse * (1.0 + 1e-9)
    assert rough.times_worse > 0.5 * close.times_worse
    told = rhythm_words(residual_tests(neb_setting[0], found, close))
    assert told is not None
    assert "would hurt most: position at the reference epoch" in told


def records(setting: Setting, alike: float, added: Array | None, seed: int) -> Diagnosis:
    """Diagnosis of measurements whose errors are twice as large as stated, a part of each night's being one draw."""
    scene = setting[0]
    rng = np.random.default_rng(seed)
    night = np.floor(scene.exposures.t_s / 86400.0).astype(int)
    draws = rng.standard_normal((night.max() + 1, 2, 2))
    shared = draws[night, scene.exposures.telescope_index]
    extra = 0.2 * ARCSEC * np.sqrt(alike) * shared
    extra += 0.2 * ARCSEC * np.sqrt(1.0 - alike) * rng.standard_normal(extra.shape)
    found = diagnose(*solved(setting, extra if added is None else extra + added), recorded=True)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def nights(make_setting: MakeSetting, neb_text: str) -> Setting:
    """Four exposures a night, every third night, by two telescopes whose biases nobody knows of."""
    text = neb_text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "")
    return make_setting(load_mission_text(text.replace("cadence: 6 d", "cadence: 3 d, exposures: 4, spacing: 30 min")))


def test_records_are_not_believed_to_be_as_good_as_stated(nights: Setting) -> None:
    quiet = [records(nights, 0.8, None, seed) for seed in range(3)]
    assert all(one.verdict == NOTHING for found in quiet for one in found.biases.tests)
    assert all(one.power_constant is None for found in quiet for one in found.biases.tests)
    # errors of a night that are alike are told as such
    assert any("residuals are correlated" in text for found in quiet for text in found.findings)
    loud = records(nights, 0.8, jump(nights[0], 1, 0.4, (1.0, 0.0)), 5)
    assert [one.verdict for one in loud.biases.tests] == [NOTHING, "appearing"]
