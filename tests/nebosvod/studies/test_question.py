"""The file of a study: everything that is wrong at its line, before anything runs."""

import re
from typing import get_args

import pytest

from nebosvod.errors import InputError
from nebosvod.mission.request import ValuePrediction
from nebosvod.mission.vocabulary import PLANES
from nebosvod.studies.answers import UNITS
from nebosvod.studies.question import Study
from nebosvod.studies.reading import load_study_text

TEXT = """\
schema_version: 1
study: noise and cadence
mission: minimal
vary:
  noise: {set: telescopes.*.noise.sigma, values: 0.02 arcsec .. 1 arcsec, log: 4}
  cadence: {set: schedule.*.cadence, values: [12 h, 1 d, 3 d]}
answer:
  - {name: later, of: predictions.ten days later.semi_axes_km.0}
  - {name: blame, of: predictions.ten days later.budget}
find: {minimise: cost, where: {later: "< 10 km"}, cost: 3*noise^-0.5 + 10/cadence}
"""


def test_a_study_is_read() -> None:
    study = load_study_text(TEXT)
    assert study.rows == 12
    assert study.units == {"noise": "arcsec", "cadence": "h", "later": "km"}
    assert study.search is not None
    assert study.search.conditions[0].limit == 10.0
    mission = study.editable.edited({"telescopes.*.noise.sigma": "0.2 arcsec", "schedule.*.cadence": "3 d"})
    assert mission.telescopes[1].noise.sigma == pytest.approx(0.2 / 206264.80624709636)


WRONG = [
    ("noise.sigma", "noise.sigma, n: 3", r"vary\.noise\.n: unknown key \(allowed here: set, values, log, linear\)"),
    ("noise.sigma", "noise.sgma", r'study:5:16: vary\.noise\.set: .*unknown key .*did you mean "sigma"'),
    ("telescopes.*", "telescope.*", r'study:5:16: .*unknown key .*did you mean "telescopes"'),
    ("telescopes.*", "telescopes.ahed", r'study:5:16: .*is no element there.*did you mean "ahead"'),
    ("schedule.*.cadence", "schedule.7.cadence", r'study:6:18: .*"7" is no element there'),
    ("0.02 arcsec .. 1 arcsec", "0.02 km .. 1 km", r"study:5:50: vary\.noise\.values: .*needs an angle"),
    ("0.02 arcsec .. 1 arcsec", "1 arcsec .. 0.1 arcsec", r"study:5:50: .*downwards"),
    (", log: 4", "", r"study:5:50: .*number of steps"),
    ("log: 4", "log: 1", r"study:5:80: vary\.noise\.log: .*2 to 100,000"),
    ("1 d, 3 d", "1 day, -3 d", r'study:6:53: .*did you mean "1 d"'),
    ("1 d, 3 d", "1 day, -3 d", r"study:6:60: .*more than 0"),
    ("mission: minimal", "mission: minimum", r'study:3:10: mission: .*did you mean "minimal"'),
    ("later.semi_axes_km.0", "later.semi_axes_km", r"study:8:23: .*has 3 components"),
    ("later.semi_axes_km.0", "later.semi_axis_km.0", r'study:8:23: .*did you mean "semi_axes_km.0"'),
    ("ten days later.semi", "ten day later.semi", r'study:8:23: .*no prediction of the mission.*"ten days later"'),
    ("predictions.ten days later.budget", "prediction.budget", r'study:9:23: .*did you mean "predictions"'),
    ("name: blame", "name: noise", r'study:9:12: .*"noise" is the name of another column'),
    ("minimise: cost", "minimise: costs", r'study:10:18: .*"costs" is no number.*did you mean "cost"'),
    ("minimise: cost, ", "", r"study:10:1: find: needs minimise or maximise"),
    ("minimise: cost", "minimise: blame", r'study:10:18: .*"blame" is no number'),
    ("later: \"< 10 km\"", "late: \"< 10 km\"", r'study:10:32: .*did you mean "later"'),
    ("< 10 km", "< 10", r'study:10:39: .*such as "1 km"'),
    ("< 10 km", "< 10 s", r"study:10:39: .*different kinds"),
    ("< 10 km", "about 10 km", r"study:10:39: .*is no condition"),
    ("3*noise^-0.5", "3*nois^-0.5", r'study:10:57: find\.cost: letter 3: .*did you mean "noise"'),
    ("3*noise^-0.5", "__import__('os')", r"study:10:57: find\.cost: letter 1: "),
    ("study: noise and", "stduy: noise and", r'study:2:1: .*unknown key.*did you mean "study"'),
    ("schema_version: 1", "schema_version: 2", r"study:1:17: schema_version: is out of range"),
    ("  noise: {", "  status: {", r"study:5:3: vary\.status: is no name for a column"),
    ("answer:", "sample: sobol\nanswer:", r"study:7:9: sample: is no way to choose points"),
    ("answer:", "repeat: {seeds: 3}\nanswer:", r"study:7:17: repeat\.seeds: .*say draws: 3"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_said_at_its_line(old: str, new: str, said: str) -> None:
    with pytest.raises(InputError) as found:
        load_study_text(TEXT.replace(old, new))
    assert re.search(said, str(found.value)), found.value


def test_everything_that_is_wrong_is_said_at_once() -> None:
    text = TEXT.replace("noise.sigma", "noise.sgma").replace("1 d, 3 d", "1 day, -3 d").replace("km.0", "km.7")
    with pytest.raises(InputError) as found:
        load_study_text(text)
    lines = str(found.value).split("\n")
    places = [int(line.split(":")[1]) for line in lines]
    assert places == sorted(places)
    assert {*places} >= {5, 6, 8}
    assert '"later" is no number' not in str(found.value)  # what is wrong with it is said where it is asked for


@pytest.mark.parametrize("text", ["", "[]", "3", "vary: 3", "study: {", "schema_version: 1\nvary: {x: 1}"])
def test_what_is_no_study_is_wrong_input(text: str) -> None:
    with pytest.raises(InputError, match="study:"):
        load_study_text(text)


def test_a_cost_is_a_number_of_the_point() -> None:
    study: Study = load_study_text(TEXT)
    assert study.search is not None
    assert study.search.cost is not None
    assert study.search.cost({"noise": 0.25, "cadence": 5.0}) == pytest.approx(3 / 0.5 + 2)


def test_the_mission_of_a_built_in_study_may_be_named() -> None:
    """With another name it would be unknown: what is varied of a system needs no copy of its file."""
    for name in ("pair-watch", "pair-watch.yaml"):
        study = load_study_text(
            f"schema_version: 1\nstudy: s\nmission: {name}\nvary: {{lead: {{set: telescopes.ahead.orbit.lead, "
            "values: [10 deg, 30 deg]}}\nanswer: [{name: first, of: first_seen_d}]\n"
        )
        assert study.mission.name == "pair-watch"
    with pytest.raises(InputError, match="unknown mission"):
        load_study_text(TEXT.replace("minimal", "nebosvod-pair"))


def test_every_prediction_that_is_no_number_of_its_own_has_a_unit() -> None:
    values = set(get_args(ValuePrediction.model_fields["plane"].annotation))
    assert set(UNITS) == set(PLANES) - values
