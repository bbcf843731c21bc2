"""`nebosvod plan`: every score is what a new run with that measurement gives, and the advice is the best of them."""

import itertools
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
from nebosvod.cli import main
from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import SOLVERS
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Estimate
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.planning.planner import plan
from nebosvod.planning.wish import Wish, read_wish
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import build_scene
from nebosvod.timescale import Epoch

NAME = "ten days later"
SCHEMA = json.loads((Path(nebosvod.__file__).parent / "planning" / "plan.schema.json").read_text("utf-8"))
PAGE = (Path(__file__).resolve().parents[3] / "docs" / "validation-command.md").read_text("utf-8")
HOUR = 3600.0
DAY = 24 * HOUR
# between the mission's own epochs, so that a schedule can hold each candidate as an arc of its own
GRID = {"start_s": 5.25 * DAY, "end_s": 33.25 * DAY, "step_s": 7.0 * DAY}
BIAS = "bias: {sigma: 0.05 arcsec, treatment: estimated}"
WHITE = "sigma: 3 km, correlation: white"
CHANGES = {
    "as it is": ("", ""),
    "considered bias": (BIAS, BIAS.replace("estimated", "considered")),
    "ignored position": (f"{WHITE}, treatment: estimated", "sigma: 300 km, correlation: white, treatment: ignored"),
    "orbit error": (WHITE, "sigma: 3 km, velocity_sigma: 1 mm/s, correlation: orbit_error, renewal: 3 d"),
    "correlated position": (WHITE, "sigma: 300 km, correlation: gauss_markov, time: 5 d"),
}


def changed(text: str, change: str) -> str:
    before, after = CHANGES[change]
    assert before in text
    return text.replace(before, after, 1) if before else text


def with_visits(text: str, visits: list[tuple[str, str]], more: str = "") -> Mission:
    """The mission with visits more in its schedule: (telescope, epoch)."""
    arcs = "".join(
        f"  - {{telescopes: [{telescope}], start: {epoch}, end: {epoch}, cadence: 1 d{more}}}\n"
        for telescope, epoch in visits
    )
    return load_mission_text(text.replace("predictions:", arcs + "predictions:"))


def solved_from_scratch(mission: Mission) -> tuple[float, float]:
    """(root trace, geometric mean of the semi-axes) of the prediction, by the whole chain."""
    scene = build_scene(mission)
    nominal = nominal_view(scene)
    priors = prior_table(mission, scene.forces, scene.state)
    problem = linear_problem(scene, mission.estimators[0], nominal, computed_psi(nominal), priors, about=nominal.point)
    estimate: Estimate = SOLVERS[mission.estimators[0].method](problem)
    asked = quantity(scene, scene.trajectory, mission.predictions[0])
    known = [name in estimate.names + estimate.left_out for name in asked.names]
    names = [name for name in asked.names if name in estimate.names + estimate.left_out]
    covariance = estimate.predict(asked.partials[:, known], names).covariance
    return float(np.sqrt(np.trace(covariance))), float(np.linalg.det(covariance) ** (1 / 6))


@pytest.mark.parametrize("change", CHANGES)
def test_every_candidate_scores_what_the_mission_with_that_visit_gives(minimal_text: str, change: str) -> None:
    """Tolerance 1e-7 of sigma: the orbit is integrated again with another span."""
    text = changed(minimal_text, change)
    found = plan(load_mission_text(text), Wish(prediction=NAME, visits=1, **GRID))  # type: ignore[arg-type]
    assert found["n_candidates"] == 10
    assert found["sigma_now"]["a"] == pytest.approx(solved_from_scratch(load_mission_text(text))[0], rel=1e-7)
    for curve in found["curves"]:
        for epoch, a, d in zip(curve["epoch_tdb"], curve["sigma_after"]["a"], curve["sigma_after"]["d"]):
            wanted = solved_from_scratch(with_visits(text, [(curve["telescope"], epoch)]))
            assert (a, d) == pytest.approx(wanted, rel=1e-7), (curve["telescope"], epoch)


@pytest.mark.parametrize("change", ["as it is", "considered bias", "correlated position"])
def test_the_greedy_schedule_is_the_best_at_each_step_by_brute_force(minimal_text: str, change: str) -> None:
    text = changed(minimal_text, change)
    found = plan(load_mission_text(text), Wish(prediction=NAME, visits=3, **GRID))  # type: ignore[arg-type]
    everything = [(curve["telescope"], epoch) for curve in found["curves"] for epoch in curve["epoch_tdb"]]
    taken: list[tuple[str, str]] = []
    for row in found["greedy"]["a"][:2]:
        scores = {
            visit: solved_from_scratch(with_visits(text, [*taken, visit]))[0]
            for visit in everything
            if visit not in taken
        }
        best = min(scores, key=lambda visit: scores[visit])
        assert (row["telescope"], row["epoch_tdb"]) == best
        assert row["sigma_after"]["a"] == pytest.approx(scores[best], rel=1e-7)
        taken.append(best)


@pytest.mark.parametrize("change", ["considered bias", "ignored position", "orbit error", "correlated position"])
def test_a_visit_of_three_exposures_scores_what_the_mission_with_them_gives(minimal_text: str, change: str) -> None:
    text = changed(minimal_text, change)
    wish = Wish(prediction=NAME, visits=2, exposures=3, spacing_s=600.0, **GRID)  # type: ignore[arg-type]
    found = plan(load_mission_text(text), wish)
    assert (found["n_observations"], found["n_candidates"], found["exposures"]) == (62, 8, 3)
    three = ", exposures: 3, spacing: 10 min"
    for curve in found["curves"]:
        for epoch, a, d in zip(curve["epoch_tdb"], curve["sigma_after"]["a"], curve["sigma_after"]["d"]):
            wanted = solved_from_scratch(with_visits(text, [(curve["telescope"], epoch)], three))
            assert (a, d) == pytest.approx(wanted, rel=1e-7), (curve["telescope"], epoch)
    both = [(row["telescope"], row["epoch_tdb"]) for row in found["greedy"]["d"]]
    wanted = solved_from_scratch(with_visits(text, both, three))
    assert found["greedy"]["d"][-1]["sigma_after"]["d"] == pytest.approx(wanted[1], rel=1e-7)


def test_visits_of_one_telescope_do_not_overlap(minimal: Mission) -> None:
    wish = Wish(prediction=NAME, visits=6, exposures=4, spacing_s=1200.0, step_s=HOUR / 2, end_s=30 * DAY)
    found = plan(minimal, wish)
    for schedule in (*found["greedy"].values(), found["uniform"]):
        assert len(schedule) == 6
        for one, other in itertools.combinations(schedule, 2):
            if one["telescope"] == other["telescope"]:
                apart = abs(Epoch.parse(one["epoch_tdb"]) - Epoch.parse(other["epoch_tdb"]))
                assert apart > 3 * 1200.0


def test_greedy_comes_close_to_the_best_of_all_triples(minimal_text: str) -> None:
    """The 20 triples of late visits by brute force: greedy is no better than the best, and within 2 % of it here."""
    found = plan(load_mission_text(minimal_text), Wish(prediction=NAME, visits=3, **GRID))  # type: ignore[arg-type]
    everything = [(curve["telescope"], epoch) for curve in found["curves"] for epoch in curve["epoch_tdb"]]
    best = min(
        solved_from_scratch(with_visits(minimal_text, list(three)))[0]
        for three in itertools.combinations(everything, 3)
        if all(epoch >= "2028-04-08" for _, epoch in three)
    )
    reached = found["greedy"]["a"][-1]["sigma_after"]["a"]
    assert best * (1.0 - 1e-7) <= reached <= 1.02 * best


@pytest.mark.parametrize("name", ["minimal", "surveyor-venus"])
def test_the_result_follows_its_schema_and_the_page_names_every_key(name: str) -> None:
    mission = load_mission(name)
    found = plan(mission, Wish(prediction=mission.predictions[0].name, visits=2, exposures=2, spacing_s=60.0))
    jsonschema.Draft202012Validator(SCHEMA).validate(json.loads(json.dumps(found)))
    keys = {*found, *found["windows"][0], *found["curves"][0]} - {"mission", "title", "object", "schema_version"}
    assert sorted(key for key in keys if f"`{key}" not in PAGE) == []


def test_windows_are_the_times_in_which_a_telescope_sees_the_object() -> None:
    """Three of the six surveyors never see it; one that begins to see it late has a window from then on."""
    found = plan(load_mission("surveyor-venus"), Wish(prediction="encounter", visits=1))
    assert found["never_visible"] == ["V1", "V5", "V6"]
    windows = {row["telescope"]: row["visible_tdb"] for row in found["windows"]}
    assert windows["V2"] == [["2029-03-22T00:00:00 TDB", "2029-04-13T00:00:00 TDB"]]
    assert windows["V3"] == [["2029-02-05T00:00:00 TDB", "2029-04-13T00:00:00 TDB"]]


def test_chosen_visits_beat_even_ones_and_each_helps(minimal: Mission) -> None:
    found = plan(minimal, Wish(prediction=NAME, visits=6))
    for criterion in ("a", "d"):
        sigmas = [found["sigma_now"][criterion]]
        sigmas += [row["sigma_after"][criterion] for row in found["greedy"][criterion]]
        assert np.all(np.diff(sigmas) < 0.0)
        assert sigmas[-1] < found["uniform"][-1]["sigma_after"][criterion]
    assert found["n_candidates"] == 20  # ten days after the schedule, two telescopes
    assert len({(row["telescope"], row["epoch_tdb"]) for row in found["greedy"]["a"]}) == 6
    assert {row["telescope"] for row in found["uniform"]} == {"ahead", "behind"}


def test_a_visit_that_takes_longer_must_bring_more(minimal: Mission) -> None:
    plain = plan(minimal, Wish(prediction=NAME, visits=1))
    first = plain["windows"][0]["telescope"]
    slow = plan(minimal, Wish(prediction=NAME, visits=1, visit_s={first: 100 * HOUR}))
    assert slow["windows"][0]["telescope"] != first
    assert slow["greedy"]["a"][0]["telescope"] != first
    assert slow["visit_hours"][first] == 100.0


def test_a_window_holds_the_neighbours_that_are_nearly_as_good(minimal: Mission) -> None:
    found = plan(minimal, Wish(prediction=NAME, visits=1, step_s=2 * HOUR))
    for row in found["windows"]:
        (curve,) = (curve for curve in found["curves"] if curve["telescope"] == row["telescope"])
        gain = found["sigma_now"]["a"] - np.array(curve["sigma_after"]["a"])
        first, last = (curve["epoch_tdb"].index(epoch) for epoch in row["window_tdb"])
        best = curve["epoch_tdb"].index(row["epoch_tdb"])
        assert first <= best <= last
        assert gain[best] == gain.max()
        assert np.all(gain[first : last + 1] >= 0.9 * gain.max())
        assert first == 0 or gain[first - 1] < 0.9 * gain.max()


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["-p", "ten days latter"], 2, "did you mean 'ten days later'"),
        (["-p", NAME, "--visits", "0"], 2, "out of range"),
        (["-p", NAME, "--step", "6"], 2, "--step: needs a duration with a unit"),
        (["-p", NAME, "--step", "-6 h"], 2, "more than 0"),
        (["-p", NAME, "--step", "1 ms"], 2, "too many"),
        (["-p", NAME, "--from", "yesterday"], 2, "--from:"),
        (["-p", NAME, "--to", "2100-01-01T00:00:00 TDB"], 2, "beyond the orbit"),
        (["-p", NAME, "--estimator", "oracle"], 2, "no estimator 'oracle'; there are: batch"),
        (["-p", NAME, "--visit-time", "hubble=1 h"], 2, "no telescope 'hubble'"),
        (["-p", NAME, "--exposures", "0"], 2, "--exposures: 0 is out of range"),
        (["-p", NAME, "--exposures", "3"], 2, "--spacing: goes with --exposures"),
        (["-p", NAME, "--spacing", "1 min"], 2, "--spacing: goes with --exposures"),
        (["-p", NAME, "--exposures", "3", "--spacing", "1 h"], 2, "3 exposures last 2 h, longer than the 1 h"),
    ],
)
def test_wrong_options_say_what_is_allowed(
    options: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "minimal", *options]) == code
    err = capsys.readouterr().err
    assert words in err
    assert "Traceback" not in err


def test_a_mission_that_sees_nothing_more_or_too_little_is_exit_1(minimal_text: str) -> None:
    short = minimal_text.replace("end: 2028-04-19T00:00:00 TDB", "end: 2028-03-20T00:00:00 TDB")
    with pytest.raises(GeometryError, match="nothing to improve yet"):
        plan(load_mission_text(short), Wish(prediction=NAME))
    late = "noise: {sigma: 0.1 arcsec}\n    duty: [{start: 2028-03-20T00:00:00 TDB, end: 2028-04-10T00:00:00 TDB}]"
    seldom = load_mission_text(minimal_text.replace("noise: {sigma: 0.1 arcsec}", late))
    with pytest.raises(GeometryError, match="any candidate epoch"):
        plan(seldom, Wish(prediction=NAME, start_s=25 * DAY, end_s=30 * DAY))


def test_a_telescope_that_has_measured_nothing_yet_is_a_candidate(minimal_text: str) -> None:
    """Its duty begins after the schedule, so that its sources of error are not in the mission's own problem."""
    before = "like: ahead, orbit: {lead: -10 deg}"
    duty = "duty: [{start: 2028-04-20T00:00:00 TDB, end: 2028-05-20T00:00:00 TDB}]"
    assert before in minimal_text
    text = minimal_text.replace(before, f"{before}, {duty}")
    found = plan(load_mission_text(text), Wish(prediction=NAME, visits=2, **GRID))  # type: ignore[arg-type]
    (curve,) = (curve for curve in found["curves"] if curve["telescope"] == "behind")
    wanted = solved_from_scratch(with_visits(text, [("behind", curve["epoch_tdb"][0])]))
    assert curve["sigma_after"]["a"][0] == pytest.approx(wanted[0], rel=1e-7)


def test_the_command_prints_advice_and_writes_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "plan.json"
    assert main(["plan", "minimal", "-p", NAME, "-k", "2", "-o", str(path)]) == 0
    out = capsys.readouterr().out
    assert "measure next with ahead at 2028-04-29T00:00:00 TDB" in out
    assert "…" not in out
    assert main(["plan", "minimal", "-p", NAME, "-k", "2", "--json"]) == 0
    stored: dict[str, Any] = json.loads(path.read_text("utf-8"))
    assert json.loads(capsys.readouterr().out) == stored
    assert main(["plan", "minimal", "-p", NAME, "-o", str(path)]) == 3
    with pytest.raises(InputError):
        plan(load_mission("minimal"), Wish(prediction="nothing"))


def test_without_a_named_prediction_the_first_encounter_is_improved(minimal_text: str) -> None:
    def wished(text: str) -> str:
        return read_wish(load_mission_text(text), None, 5, None, "a", (None, None, None), ()).prediction

    head = minimal_text[: minimal_text.index("predictions:")]
    place = "{name: place, plane: position, at: 2028-04-29 TDB}"
    near = "{name: pass, plane: b_plane, body: earth, near: 2028-04-28 TDB}"
    assert wished(f"{head}predictions: [{place}, {near}]\n") == "pass"
    assert wished(f"{head}predictions: [{place}]\n") == "place"
    with pytest.raises(InputError, match="predictions: there is none"):
        wished(head)


def test_only_times_not_yet_measured_are_proposed_up_to_the_encounter(minimal_text: str) -> None:
    """After the schedule, and in the gap of one telescope; nothing after what is predicted."""
    gap = "like: ahead, orbit: {lead: -10 deg}"
    duty = "duty: [{start: 2028-03-20T00:00:00 TDB, end: 2028-04-01T00:00:00 TDB}, "
    duty += "{start: 2028-04-05T12:00:00 TDB, end: 2028-05-20T00:00:00 TDB}]"
    found = plan(load_mission_text(minimal_text.replace(gap, f"{gap}, {duty}")), Wish(prediction=NAME, visits=1))
    for curve in found["curves"]:
        assert curve["epoch_tdb"][0] == "2028-04-20T00:00:00 TDB"
        assert curve["epoch_tdb"][-1] == "2028-04-29T00:00:00 TDB"
    again = plan(load_mission_text(minimal_text), Wish(prediction=NAME, visits=1, start_s=28 * DAY, step_s=DAY / 2))
    for curve in again["curves"]:
        noon = [epoch for epoch in curve["epoch_tdb"] if epoch < "2028-04-19T12"]
        assert noon == ["2028-04-17T12:00:00 TDB", "2028-04-18T12:00:00 TDB"]


def test_where_all_is_measured_visits_between_are_proposed(minimal_text: str) -> None:
    text = minimal_text.replace("at: 2028-04-29T00:00:00 TDB", "at: 2028-04-10T00:00:00 TDB")
    found = plan(load_mission_text(text), Wish(prediction=NAME, visits=1))
    assert all(epoch.endswith("T12:00:00 TDB") for curve in found["curves"] for epoch in curve["epoch_tdb"])
    assert found["n_candidates"] == 60
    with pytest.raises(GeometryError, match="has been measured already; name others with --from"):
        plan(load_mission_text(text), Wish(prediction=NAME, step_s=DAY))
