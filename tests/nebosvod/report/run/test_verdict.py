"""The sentences: what they say follows from the numbers, and changes with them."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.findings.kinds import kind_of
from nebosvod.report.kit.facts import earlier_orbit, grouped, impact_clause, position_shares
from nebosvod.report.run.physical import kappa_partials, kappa_sentence
from nebosvod.report.run.trust import doubtful, nonlinearity_sentence
from nebosvod.report.run.verdict import blame_of, verdict
from nebosvod.results.agreement import chi2_interval
from nebosvod.results.folder import RunFolder, read_folder


@pytest.fixture(scope="module")
def run(run_folder: Path) -> RunFolder:
    return read_folder(run_folder)


def changed(run: RunFolder, **keys: Any) -> RunFolder:
    """The run with keys of its summary replaced (a deep copy)."""
    return replace(run, summary=json.loads(json.dumps({**run.summary, **keys})))


def spoken(run: RunFolder) -> str:
    """All sentences as plain text."""
    words = verdict(run)
    return " ".join(s.striptags() for s in (words.headline, *words.sentences))


def test_headline_is_the_target_plane_and_its_largest_source(run: RunFolder) -> None:
    first = run.predictions("batch")[0]
    a, b = first["semi_axes_km"]
    headline = verdict(run).headline.striptags()
    assert headline.startswith(f"Earth b-plane on 2029-04-13: {a:.3g} × {b:.3g}")
    totals: dict[str, float] = {}
    for row in first["budget"]:
        kind = kind_of(row["source"], run.telescopes)
        totals[kind] = totals.get(kind, 0.0) + row["share_total"]
    top = max(totals, key=lambda kind: totals[kind])
    assert f"{top} (2 telescopes) makes up {100 * totals[top]:.0f} %" in headline


def test_headline_names_every_source_that_nearly_ties(run: RunFolder) -> None:
    first = run.predictions("batch")[0]
    half = [row for row in first["budget"] if kind_of(row["source"], run.telescopes) in ("bias", "measurement noise")]
    budget = [{**row, "share_total": 1.0 / len(half)} for row in half]
    rows = [{**p, "budget": budget} if p is first else p for p in run.summary["predictions"]]
    headline = verdict(changed(run, predictions=rows)).headline.striptags()
    assert len(half) == 4
    assert "measurement noise 50" in headline.replace("(", "")
    assert "bias 50" in headline.replace("(", "")


def test_headline_without_predictions_is_the_position(run: RunFolder) -> None:
    assert verdict(changed(run, predictions=[])).headline.striptags().startswith("Position known to ")


def test_shares_added_over_telescopes_still_make_the_whole(run: RunFolder) -> None:
    kinds = grouped(position_shares(run, run.estimators[0]), run.telescopes)
    assert sum(share for _, share, _ in kinds) == pytest.approx(1.0, abs=1e-9)
    assert {(kind, n) for kind, _, n in kinds} >= {("bias", 2), ("measurement noise", 2), ("mass", 1)}


def test_source_that_only_contains_a_telescope_name_keeps_its_name() -> None:
    assert kind_of("bias NEB-1", ["NEB-1", "B-1"]) == "bias"
    assert kind_of("bias XNEB-1", ["NEB-1"]) == "bias XNEB-1"
    assert kind_of("NEB-1", ["NEB-1"]) == "NEB-1"


def test_estimator_that_ignores_the_bias_is_said_to_mislead_and_why(run: RunFolder) -> None:
    blind = run.estimators[2]
    ratio = blind["sigma_position_km"] / blind["sigma_formal_position_km"]
    assert ratio > 1.2
    text = spoken(run)
    assert f"formal sigma is {ratio:.3g}" in text
    assert "Bias NEB-1 and bias NEB-2 are left out of its weights" in text
    assert verdict(run).tone == "good"
    alone = changed(run, estimators=[blind], predictions=[])
    assert verdict(alone).tone == "caution"


@pytest.mark.parametrize(
    ("source", "said", "unsaid"),
    [
        ("mass", "from these measurements alone; no earlier orbit was used.", "the mission's prior"),
        ("prior orbit", "from these measurements and an earlier orbit, the mission's prior.", "alone"),
        ("prior orbit and parameters", "from these measurements and an earlier orbit, the mission's prior.", "alone"),
    ],
)
def test_answer_says_once_whether_an_earlier_orbit_was_used(
    run: RunFolder, source: str, said: str, unsaid: str
) -> None:
    row = {**run.budget("batch")[0], "source": source}
    answers = dict(verdict(changed(run, budget=[*run.summary["budget"], row])).answers)
    text = " ".join(sentence.striptags() for sentence in answers["How accurate"])
    assert text.count(said) == 1
    assert unsaid not in text


def test_without_a_budget_nothing_is_said_of_an_earlier_orbit(run: RunFolder) -> None:
    assert earlier_orbit(run.summary, "no such estimator") is None
    assert "earlier orbit" not in spoken(changed(run, budget=[]))


def test_a_total_sigma_is_explained_where_it_first_appears(real_folder: Path) -> None:
    found = read_folder(real_folder)
    sky, space = found.predictions("batch")
    for predictions, key, axes in (([sky, space], "arcsec", "both"), ([space], "km", "the three")):
        total = float(np.linalg.norm(predictions[0][f"semi_axes_{key}"]))
        text = spoken(changed(found, predictions=predictions))
        meaning = f"(the root of the sum of {axes} semi-axes squared)"
        assert text.count(meaning) == 1
        shown = re.search(r"instead of ([\d.]+)\s(\w+) " + re.escape(meaning), text)
        assert shown is not None
        scale = {"mas": 1e-3}.get(shown[2], 1.0)
        assert float(shown[1]) * scale == pytest.approx(total, rel=6e-3)  # three digits are shown


def test_formal_sigma_too_large_is_said_too(run: RunFolder) -> None:
    timid = {**run.estimators[0], "sigma_formal_position_km": 2.0 * run.estimators[0]["sigma_position_km"]}
    assert "its formal sigma is 2.00 times too large" in spoken(changed(run, estimators=[timid]))


@pytest.mark.parametrize(
    ("factor", "said"), [(1.6, "larger than the noise model"), (0.5, "smaller than the noise model")]
)
def test_chi2_outside_its_interval_is_a_caution(run: RunFolder, factor: float, said: str) -> None:
    assert "inside its 99" in spoken(run)
    odd = {**run.estimators[0], "chi2": factor * run.estimators[0]["dof"]}
    words = verdict(changed(run, estimators=[odd]))
    assert words.tone == "caution"
    assert said in " ".join(words.sentences)


def test_chi2_interval_is_that_of_the_distribution() -> None:
    """Tabulated 0.5 % and 99.5 % points of chi-square: 0.41174 and 16.750 at 5, 67.328 and 140.169 at 100."""
    assert chi2_interval(5) == pytest.approx((0.41174 / 5, 16.750 / 5), rel=1e-4)
    assert chi2_interval(100) == pytest.approx((0.67328, 1.40169), rel=1e-5)


def test_estimators_that_agree_are_said_to_and_one_that_failed_is_named(run: RunFolder) -> None:
    same = [run.estimators[0], run.estimators[1]]
    assert "“batch” and “filter” give the same position sigma" in spoken(changed(run, estimators=same))
    assert "runs from" in spoken(run)
    failed = {**run.estimators[1], "status": "diverged"}
    words = verdict(changed(run, estimators=[run.estimators[0], failed]))
    assert words.tone == "caution"
    assert "The estimator “filter” gives no answer: the fit diverged." in [s.striptags() for s in words.sentences]


def test_partials_of_kappa_are_those_of_its_formula() -> None:
    values = {"radius_m": 170.0, "mass_kg": 6.1e10, "albedo": 0.16, "thermal_emission": 0.1}

    def log_kappa(v: dict[str, float]) -> float:
        reflection = 1 + 4 * v["albedo"] / 9 + v["thermal_emission"] * (1 - v["albedo"])
        return float(np.log(np.pi * v["radius_m"] ** 2 / v["mass_kg"] * reflection))

    for name, partial in kappa_partials(values).items():
        step = 1e-5 * values[name]
        up, down = ({**values, name: values[name] + sign * step} for sign in (1, -1))
        assert partial == pytest.approx((log_kappa(up) - log_kappa(down)) / (2 * step), rel=1e-8)


def test_kappa_before_the_fit_is_the_sum_of_the_priors_and_a_gain_is_said(run: RunFolder) -> None:
    estimator = run.estimators[0]
    partial = kappa_partials({"radius_m": 170.0, "mass_kg": 6.1e10, "albedo": 0.159})
    before = np.hypot(np.hypot(20.0 * partial["radius_m"], 1.5e10 * partial["mass_kg"]), 0.05 * partial["albedo"])
    sentence = kappa_sentence(run, estimator)
    assert sentence is not None
    assert f"{100 * before:.0f}" in sentence.striptags()
    assert "do not narrow it" in sentence
    factor = np.array(run.arrays["factor_batch"])
    factor[6:9] *= 0.25
    better = kappa_sentence(replace(run, arrays={**run.arrays, "factor_batch": factor}), estimator)
    assert better is not None
    assert "narrow it to 25" in better.striptags()


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        ({"bias": 0.50, "mass": 0.41, "albedo": 0.09}, "bias (50 %) and mass (41 %) are about equally to blame for it"),
        ({"bias": 0.55, "mass": 0.40, "albedo": 0.05}, "bias makes up 55 % of it"),
        ({"bias": 0.35, "mass": 0.33, "albedo": 0.32}, "bias (35 %), mass (33 %) and albedo (32 %) are about equally"),
    ],
)
def test_sources_that_nearly_tie_are_all_named(shares: dict[str, float], said: str) -> None:
    text = blame_of(list(shares.items()), [], "it").striptags().replace("\N{NO-BREAK SPACE}", " ")
    assert text.startswith(said)


def test_a_warning_of_linearity_takes_the_green_away(run: RunFolder) -> None:
    assert verdict(run).tone == "good"
    assert verdict(run, sound=False).tone == "caution"
    first = {**run.predictions("batch")[0], "nonlinearity": {"measure": 0.7, "misleads": True}}
    bent = changed(run, predictions=[first])
    sentence = nonlinearity_sentence(bent, bent.estimators[0])
    assert sentence is not None
    assert "The linear ellipse of encounter misleads" in sentence.striptags()
    second = {**run.predictions("batch")[1], "nonlinearity": {"measure": 0.02, "misleads": False}}
    lost = {**first, "nonlinearity": {"measure": None, "misleads": None, "reason": "an orbit misses"}}
    open_question = changed(run, predictions=[lost, second])
    sentence = nonlinearity_sentence(open_question, open_question.estimators[0])
    assert sentence is not None
    assert sentence.striptags().startswith(
        "How far the linear ellipse of encounter holds is not known: an orbit misses."
    )
    assert "The other predictions are linear enough" in sentence.striptags()
    assert doubtful(open_question, open_question.estimators[0])
    assert not doubtful(changed(run, predictions=[second]), run.estimators[0])


def test_impact_is_told_by_both_ways_and_never_as_a_rounded_zero_or_one() -> None:
    drawn = {"hits": 3, "runs": 400, "interval_95": [0.0015, 0.0217]}
    said = impact_clause({"impact_probability_linear": 0.006, "impact_probability_monte_carlo": drawn}).striptags()
    assert "0.00600 (linear), 3 of 400 drawn orbits" in said.replace("\N{NO-BREAK SPACE}", " ")
    assert "10⁻¹²" in impact_clause({"impact_probability_linear": 0.0})
    assert impact_clause({}) == ""


def test_the_answer_under_each_question_is_short_and_says_why_a_sigma_is_not_to_be_believed(run: RunFolder) -> None:
    """A line of the page holds some 95 characters: two of them, and each first sentence comes from the numbers."""
    answers = dict(verdict(run).answers)
    for told in answers.values():
        assert len(told[0].striptags()) < 200
    names = [e["name"] for e in run.estimators]
    blind = changed(run, estimators=[run.estimators[names.index("bias ignored")]])
    said = dict(verdict(blind).answers)["Can it be believed"][0].striptags()
    true, formal = (blind.estimators[0][f"sigma_{kind}position_km"] for kind in ("", "formal_"))
    assert said.startswith("With caution: the realistic sigma is")
    assert float(said.split("sigma is ")[1].split()[0]) == pytest.approx(true / formal, rel=5e-3)
    assert "(not in its weights: bias NEB-1, bias NEB-2)" in said
    p = run.predictions("batch")[0]
    bent = {**p, "nonlinearity": {"misleads": True, "measure": 2.0}, "monte_carlo": {"semi_axes_km": [7.0, 3.0]}}
    accurate = dict(verdict(changed(run, predictions=[bent])).answers)["How accurate"][0].striptags()
    assert "drawn orbits spread over 7.00 × 3.00 km" in accurate.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("ratio", "tone", "said"),
    [
        (1.0, "good", "residuals are as large as expected"),
        (0.04, "caution", "residuals are 5.0 × smaller than the stated noise, which is overstated"),
        (25.0, "caution", "residuals are 5.0 × larger than the stated noise"),
        (0.0, "caution", "residuals are next to nothing"),
    ],
)
def test_residuals_too_small_are_as_doubtful_as_too_large_ones(
    run: RunFolder, ratio: float, tone: str, said: str
) -> None:
    batch = {**run.estimators[0], "chi2": ratio * run.estimators[0]["dof"]}
    told = verdict(changed(run, estimators=[batch]))
    assert told.tone == tone
    assert said in dict(told.answers)["Can it be believed"][0].striptags()


def test_without_drawn_errors_residuals_tell_nothing(run: RunFolder) -> None:
    """`run --nominal`: what is measured is what the reference orbit shows."""
    batch = {**run.estimators[0], "chi2": 0.0}
    nominal = replace(changed(run, estimators=[batch]), manifest={**run.manifest, "drawn": False})
    told = verdict(nominal)
    assert told.tone == "good"
    assert "residual" not in dict(told.answers)["Can it be believed"][0]
