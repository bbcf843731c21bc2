"""Populations: what was known when, shares with their intervals, warnings and false ones, errors in common."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy import stats

import nebosvod
from nebosvod.cli import main
from nebosvod.dynamics import propagate
from nebosvod.engine.trial import generator
from nebosvod.engine.truth import draw
from nebosvod.errors import ImpactError, InputError
from nebosvod.mission.fields import epoch_text
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import build_scene
from nebosvod.studies.builtin import builtin_studies
from nebosvod.studies.point import evaluate
from nebosvod.studies.population import clustered, interval
from nebosvod.studies.reading import load_study, load_study_text
from nebosvod.studies.sampled import corridor_km, fall, impact_probability
from nebosvod.studies.stored import load_table
from nebosvod.studies.study import run_study
from nebosvod.tasks.engine import Workers

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "studies" / "study.schema.json").read_text("utf-8"))
WATCHES = Path(str(files("nebosvod.scenarios.studies")))
SMALL = """\
schema_version: 1
study: small
mission: soda-watch.yaml
objects:
  impactors: {n: 6, misses: 6, within: 100000 km, start: 2030-01-01T00:00:00 TDB, span: 10 yr, smallest: 20 m, seed: 2}
answer:
  - {name: sigma, of: predictions.plane.semi_axes_km.0, before: [1 d, 4 h]}
  - {name: chance, of: predictions.plane.impact_probability, before: [12 h, 4 h]}
  - {name: blame, of: predictions.plane.budget}
warning: {of: chance, at_least: 0.01}
"""
HALF_DAY = 43200.0


@pytest.fixture(scope="module")
def soda() -> Any:
    """An impactor of the built-in study that two spacecraft see: what it changes in the mission, and the point."""
    study = load_study("soda-impactors")
    changes = study.axes[0].changes(study.axes[0].values[0])
    return study, changes, evaluate(study.editable.edited(changes), study.wanted)


def test_what_was_known_before_is_what_a_schedule_that_ends_there_tells(soda: Any) -> None:
    study, changes, point = soda
    then = point.earlier(HALF_DAY)
    ends = epoch_text(point.scene.mission.object.orbit.epoch + -HALF_DAY)
    alone = evaluate(study.editable.edited({**changes, "schedule.1.end": ends}), frozenset(["plane"]))
    assert then.times_s.size == alone.times_s.size < point.times_s.size
    assert then.prediction("plane").semi_axes == pytest.approx(alone.prediction("plane").semi_axes, rel=1e-5)
    assert point.earlier(9.0 * 86400.0) is None  # too faint so early
    assert point.earlier(3600.0) is point


def test_two_spacecraft_tell_the_entry_to_tens_of_km_and_one_does_not(soda: Any) -> None:
    """As published for SODA: "accuracy of atmosphere entry point ... as high as few tens of kilometers" with two."""
    study, changes, point = soda
    alone = {**changes, "telescopes.SODA-2.limiting_magnitude": 0}
    one = evaluate(study.editable.edited(alone), study.wanted)
    assert point.visible("SODA-2") > 0 == one.visible("SODA-2")
    assert point.prediction("entry").semi_axes[0] < 100.0 < 10.0 * 100.0 < one.prediction("entry").semi_axes[0]


def test_probability_and_corridor_are_those_of_orbits_drawn_and_flown_one_by_one(soda: Any) -> None:
    """With one spacecraft the ellipse is bent: the same covariance drawn by numpy, each orbit by the propagator."""
    study, changes, _ = soda
    point = evaluate(study.editable.edited({**changes, "telescopes.SODA-2.limiting_magnitude": 0}), study.wanted)
    then = point.earlier(HALF_DAY)
    found = fall(then, "plane", corridor=False)
    assert found.bend > 0.3
    names = STATE_NAMES
    rng, scene = np.random.default_rng(5), then.scene
    draws = rng.multivariate_normal(np.zeros(6), then.estimate.covariance(names), 60, method="svd")
    hits = 0
    for move in draws:
        try:
            propagate(scene.state + move, scene.epoch, np.array([0.0, then.falls_s + 86400.0]), scene.forces, False)
        except ImpactError:
            hits += 1
    low, high = interval(hits, 60)
    assert low < impact_probability(then, "plane") < high
    assert 1e-3 < impact_probability(then, "plane") < 0.5


def test_a_corridor_is_the_ellipse_where_that_is_small(soda: Any) -> None:
    _, _, point = soda
    long = point.prediction("entry").semi_axes[0]
    assert corridor_km(point, "entry") == pytest.approx(2.0 * stats.norm.isf(0.05) * long, rel=1e-3)
    drawn = fall(point, "entry", corridor=True).corridor_km
    assert drawn == pytest.approx(corridor_km(point, "entry"), rel=0.15)


def test_a_study_of_impactors_counts_what_is_seen_and_who_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "s.yaml").write_text(SMALL.replace("soda-watch.yaml", str(WATCHES / "soda-watch.yaml")), "utf-8")
    assert main(["study", str(tmp_path / "s.yaml"), "-o", str(tmp_path / "o"), "--workers", "1"]) == 0
    said, found = capsys.readouterr().out, json.loads((tmp_path / "o" / "study.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(SCHEMA).validate(found)
    table = load_table(tmp_path / "o")
    hits, seen = table["object kind"] == "impactor", np.isin(table["status"], ["ok", "no_answer", "not_determined"])
    assert np.count_nonzero(hits) == 6
    assert (table["object sun angle"].unit, table["object diameter"].unit) == ("deg", "m")
    row = next(one for one in found["population"]["seen"] if one["group"] == "all")
    assert (row["n"], row["k"]) == (6, np.count_nonzero(hits & seen))
    alarm = np.nan_to_num(table["chance 4 h"]) >= 0.01
    last = found["population"]["warned"][-1]
    assert last["before_d"] == pytest.approx(1 / 6)
    assert last["impactors"]["k"] == np.count_nonzero(alarm & hits)
    assert last["misses"]["k"] == np.count_nonzero(alarm & ~hits)
    expected = float(np.mean((alarm * table["object weight"])[~hits]))
    assert last["false_per_impactor"]["value"] == pytest.approx(expected)
    assert "from the day sky" in said
    assert "warned of" in said
    page = (tmp_path / "o" / "study.html").read_text("utf-8")
    assert "false warnings for each impactor" in page


def test_intervals_of_shares() -> None:
    """Clopper and Pearson by scipy; of clusters, wider than binomial where a draw decides for all its objects."""
    for k, n in ((0, 20), (3, 20), (20, 20)):
        exact = stats.binomtest(k, n).proportion_ci(0.95, method="exact")
        assert interval(k, n) == pytest.approx([exact.low, exact.high], abs=1e-12)
    rng = np.random.default_rng(0)
    of_draws = np.broadcast_to(rng.random(30) < 0.5, (200, 30)).astype(float)
    low, high = clustered(of_draws, 0)
    assert high - low == pytest.approx(2.0 * 1.96 * 0.5 / np.sqrt(30), rel=0.15)
    alone = (rng.random((200, 30)) < 0.5).astype(float)
    low, high = clustered(alone, 0)
    assert 2.0 * 1.96 * 0.5 / np.sqrt(6000) < high - low < 2.0 * 1.96 * 0.5 * np.sqrt(3.6 / 6000)


def test_a_draw_has_one_bias_for_all_objects_and_noise_of_their_own(soda: Any) -> None:
    """Truths of two objects under one key: bias and clock agree to the last bit, the state does not."""
    study, _, point = soda
    other = study.editable.edited(study.axes[0].changes(study.axes[0].values[1]))
    scenes = [point.scene, build_scene(other)]
    truths = [
        draw(scene, prior_table(scene.mission, scene.forces, scene.state), generator(7, k), outer=(7, 3))
        for k, scene in enumerate(scenes)
    ]
    for name in ("bias SODA-1", "timing SODA-1"):
        assert np.array_equal(truths[0].nuisances[name], truths[1].nuisances[name]), name
    again = draw(
        scenes[0], prior_table(scenes[0].mission, scenes[0].forces, scenes[0].state), generator(7, 0), outer=(7, 4)
    )
    assert not np.array_equal(truths[0].nuisances["bias SODA-1"], again.nuisances["bias SODA-1"])
    values = [
        draw(scenes[0], prior_table(scenes[0].mission, scenes[0].forces, scenes[0].state), generator(1), outer=(1, k))
        .nuisances["bias SODA-1"] for k in range(40)
    ]  # fmt: skip
    sigma = np.radians(0.1 / 3600.0)
    assert np.sum((np.array(values) / sigma) ** 2) == pytest.approx(80.0, abs=3.0 * np.sqrt(160.0))


@pytest.mark.parametrize("name", ["neomir-impactors", "nebosvod-pair", "soda-impactors"])
def test_built_in_studies_are_read_by_name(name: str) -> None:
    study = load_study(name)
    assert study.rows in (1300, 2600)
    assert name in builtin_studies()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[1 d, 4 h]", "[1 d, 0 d]", r"answer\[0\]\.before: needs a duration above 0"),
        ("[1 d, 4 h]", "[1 d, 24 h]", r"answer\[0\]\.before: has a time twice"),
        ("[1 d, 4 h]", "[1 km]", r"answer\[0\]\.before: needs a duration above 0"),
        ("[1 d, 4 h]", "[1 d, 10 d]", None),
        ("[1 d, 4 h]", "[1 d, 11 d]", r"answer\[0\]\.before: nothing is measured until 11 d before"),
        ("impactors: {n: 6", "impactors: {orbits: granvik-2019, n: 6", r"no such file; granvik-2018 is the published"),
        ("of: chance", "of: chances", r'warning\.of: "chances" is no number of a point .*did you mean "chance"'),
        ("at_least: 0.01", "at_least: much", r"warning\.at_least: needs a number"),
        ("answer:", "repeat: {shared: true}\nanswer:", r"repeat\.shared: nothing is drawn"),
    ],
)
def test_what_is_wrong_is_said_at_its_line(old: str, new: str, said: str | None) -> None:
    text = SMALL.replace(old, new, 1)
    if said is None:
        assert load_study_text(text, path=WATCHES / "s.yaml").rows == 12
        return
    with pytest.raises(InputError, match=said):
        load_study_text(text, path=WATCHES / "s.yaml")


def test_a_mission_that_looks_on_after_the_fall_is_refused() -> None:
    text = SMALL.replace("soda-watch.yaml", "minimal")
    text = text.replace("predictions.plane.semi_axes_km.0, before: [1 d, 4 h]", "n_observations")
    with pytest.raises(InputError, match=r"mission: its schedule ends .* after the epoch of its orbit"):
        load_study_text(text.split("  - {name: chance")[0], path=Path("s.yaml"))


def test_an_unknown_name_is_told_the_built_in_studies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "soda-impactor"]) == 2
    assert 'no built-in study (nebosvod-pair, neomir-impactors, soda-impactors); did you mean "soda-impactors"?' in (
        capsys.readouterr().err
    )


def test_drawn_objects_with_errors_in_common_have_intervals_of_clusters(tmp_path: Path) -> None:
    """Three draws of two objects: what was known before is drawn as well, and shares count objects by draws."""
    text = SMALL.replace("n: 6, misses: 6", "n: 2, misses: 1").replace("mission: soda", f"mission: {WATCHES}/soda")
    text = text.replace("before: [1 d, 4 h]", "before: 4 h").replace("before: [12 h, 4 h]", "before: 4 h")
    (tmp_path / "s.yaml").write_text(f"{text}repeat: {{draws: 3, shared: true}}\n", "utf-8")
    study = load_study(tmp_path / "s.yaml")
    found = run_study(study, tmp_path / "o", workers=Workers(count=1))
    own = found["population"]
    assert (own["draws"], own["shared"], found["n_rows"]) == (3, True, 9)
    table = load_table(tmp_path / "o")
    assert table["draw"].tolist() == [0, 1, 2] * 3
    (row,) = [one for one in own["seen"] if one["group"] == "all"]
    assert row["n"] == 2  # seen or not is a matter of the object, not of the draw
    (warned,) = own["warned"]
    assert warned["impactors"]["n"] == 6
    alarm = (np.nan_to_num(table["chance 4 h"]) >= 0.01)[table["object kind"] == "impactor"]
    low, high = warned["impactors"]["interval_95"]
    assert low <= alarm.mean() <= high
    seen = np.asarray(table["sigma 4 h"])[np.isfinite(table["sigma 4 h"])]
    assert len(set(seen.tolist())) == len(seen) > 0  # each estimate has a covariance of its own
