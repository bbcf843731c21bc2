"""How good each thing must be: against closed forms."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
from nebosvod.borders.expression import read_expression
from nebosvod.cli import main
from nebosvod.errors import GeometryError, InputError
from nebosvod.studies.point import evaluate
from nebosvod.studies.reading import load_study_text
from nebosvod.studies.requirement import Needed, Requirement, required
from nebosvod.studies.study import requirement_of

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "studies" / "study.schema.json").read_text("utf-8"))
A = {"noise": 3.0, "bias": 5.0, "position": 0.7}
EACH = tuple(Needed(name=name, paths=(f"x.{name}",), unit="km", now=1.0 + k) for k, name in enumerate(A))
REST = 2.0


def quadratic(changes: Mapping[str, Any]) -> float:
    """f^2 = rest^2 + sum (a v)^2: sources of error that nobody estimates."""
    return math.sqrt(REST**2 + sum((a * float(changes[f"x.{name}"].split()[0])) ** 2 for name, a in A.items()))


def wanted(limit: float, cost: str | None = None) -> Requirement:
    formula = None if cost is None else read_expression(cost, list(A))
    return Requirement(answer="f", limit=limit, text=f"at most {limit} km", each=EACH, cost=formula)


def test_one_at_a_time_is_what_the_sum_of_squares_leaves() -> None:
    found = required(wanted(11.0), quadratic)
    now = quadratic({f"x.{one.name}": f"{one.now} km" for one in EACH})
    assert found["now"] == pytest.approx(now)
    for one, row in zip(EACH, found["each"]):
        others = math.sqrt(now**2 - (A[one.name] * one.now) ** 2)
        assert row["floor"] == pytest.approx(others, rel=1e-9)
        if others > 11.0:
            assert row["needed"] is None
            assert "cannot do it alone" in row["verdict"]
        else:
            assert row["needed"] == pytest.approx(math.sqrt(11.0**2 - others**2) / A[one.name], rel=2e-6)
    assert [row["needed"] is None for row in found["each"]] == [False, False, False] if now < 11.0 else True


@pytest.mark.parametrize("limit", [6.0, 11.0, 40.0])
def test_together_at_least_cost_is_lagranges_point(limit: float) -> None:
    """Cost sum c/v under sum (a v)^2 = L^2: c / v^2 = 2 lambda a^2 v, so v goes with (c / a^2)^(1/3)."""
    weights = {"noise": 1.0, "bias": 4.0, "position": 0.5}
    found = required(wanted(limit, "1/noise + 4/bias + 0.5/position"), quadratic)["together"]
    v = np.array([(weights[name] / A[name] ** 2) ** (1 / 3) for name in A])
    v *= math.sqrt(limit**2 - REST**2) / np.linalg.norm(v * np.array(list(A.values())))
    least = sum(c / x for c, x in zip(weights.values(), v))
    assert found["cost"] == pytest.approx(least, rel=1e-4)
    assert list(found["values"].values()) == pytest.approx(v.tolist(), rel=0.02)  # the cost is flat there
    assert found["answer"] == pytest.approx(limit, rel=1e-4)
    assert found["cost"] <= found["cost_equally"]


def test_together_with_a_cadence_is_as_cheap_as_the_best_of_all_that_are_tried() -> None:
    """The number of measurements is a whole one: between its steps a longer cadence is better, and partials mislead."""
    span, limit = 30.0, 2.5
    noise = Needed(name="noise", paths=("x.noise",), unit="km", now=1.0)
    cadence = Needed(name="cadence", paths=("schedule.*.cadence",), unit="d", now=1.0)

    def left(noise: float, cadence: float) -> float:
        n = math.floor(span / cadence) + 1
        return math.hypot(REST, 8.0 * noise / math.sqrt(n) / (0.5 + 0.5 * cadence * (n - 1) / span))

    def number(changes: Mapping[str, Any]) -> float:
        return left(*(float(changes[path].split()[0]) for path in ("x.noise", "schedule.*.cadence")))

    each = (noise, cadence)
    cost = read_expression("2/noise + 1/cadence", ["noise", "cadence"])
    asked = Requirement(answer="f", limit=limit, text="at most 2.5 km", each=each, cost=cost)
    found = required(asked, number)["together"]
    tried = np.exp(np.linspace(np.log(1 / 32), np.log(32), 4001))
    needed = [math.sqrt(limit**2 - REST**2) / (math.sqrt(left(1.0, c) ** 2 - REST**2)) for c in tried]
    least = min(2 / v + 1 / c for v, c in zip(needed, tried))
    assert found["answer"] <= limit * (1 + 2e-5)
    assert least * 0.999 < found["cost"] < 1.05 * least


def test_a_clock_may_be_worse_by_as_much_as_a_noise_though_its_unit_is_one_of_time() -> None:
    """Of what is now 1 ms "however bad" is more than 32 ms; only a schedule has a longest cadence."""
    clock = Needed(name="clock", paths=("telescopes.*.timing.sigma",), unit="ms", now=1.0)

    def number(changes: Mapping[str, Any]) -> float:
        return math.hypot(REST, 0.01 * float(changes["telescopes.*.timing.sigma"].split()[0]))

    (row,) = required(Requirement(answer="f", limit=3.0, text="", each=(clock,), cost=None), number)["each"]
    assert row["verdict"] == "may be worse"
    assert row["needed"] == pytest.approx(100.0 * math.sqrt(5.0), rel=1e-5)


def test_what_does_not_matter_and_what_nothing_helps_is_said() -> None:
    rows = {row["name"]: row for row in required(wanted(1.0), quadratic)["each"]}
    assert all("cannot do it alone" in row["verdict"] for row in rows.values())
    assert required(wanted(1.0), quadratic)["together"] is None
    constant = required(wanted(3.0), lambda changes: 2.0)
    assert all(not row["matters"] for row in constant["each"])
    assert all("does not matter" in row["verdict"] for row in constant["each"])


def test_a_value_with_which_there_is_no_answer_is_as_bad_as_can_be() -> None:
    def brittle(changes: Mapping[str, Any]) -> float:
        if float(changes["x.noise"].split()[0]) > 2.0:
            raise GeometryError("not observable")
        return quadratic(changes)

    (row, *_) = required(wanted(1e3), brittle)["each"]
    assert row["without"] is None
    assert row["needed"] == pytest.approx(2.0, rel=2e-6)


def test_noise_alone_leaves_sigma2_over_n_times_the_inverse_of_d0(place: Path) -> None:
    """Guo, Ivashkin 2018, figure 1: position by sigma^2 / N D0^-1 with numpy is what the mission answers."""
    text = TEXT.replace("predictions.ten days later.semi_axes_km.0", "state.sigma_position_km")
    study = load_study_text(text, path=place / "s.yaml")
    found = requirement_of(study)
    assert found is not None
    told = found["averaging"]
    sigma = np.radians(0.1 / 3600.0)
    scaled = np.array(told["D0"])
    unit = np.sqrt(np.diag(scaled))
    K = np.linalg.solve(scaled / unit[:, None] / unit, np.eye(6)) / unit[:, None] / unit * sigma**2 / told["components"]
    assert told["components"] == 124
    assert np.sqrt(np.trace(K[:3, :3])) == pytest.approx(found["now"], rel=1e-6)


def test_a_prior_of_position_and_velocity_is_scaled_as_one_and_knees_are_where_it_stops_to_help(
    minimal_text: str, tmp_path: Path
) -> None:
    """All six things of a mission; at the knees the answer is 5 % from what it is at the ends."""
    clock = "    timing: {sigma: 1 s, treatment: estimated}\n"
    text = minimal_text.replace("    position: {sigma: 3 km", f"{clock}    position: {{sigma: 3 km")
    text += "prior: {sigma: {position: 100 km, velocity: 100 mm/s}}\n"
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    each = (
        "{noise: telescopes.*.noise.sigma, bias: telescopes.*.bias.sigma, clock: telescopes.*.timing.sigma, "
        "position: telescopes.*.position.sigma, radius: object.radius.sigma, "
        "prior: [prior.sigma.position, prior.sigma.velocity]}"
    )
    study = load_study_text(
        TEXT.replace("bare.yaml", "m.yaml").replace("5 km", "12 km").split("require:")[0]
        + f"require: {{of: later, at_most: 12 km, each: {each}}}\n",
        path=tmp_path / "s.yaml",
    )
    assert study.requirement is not None
    prior = study.requirement.each[-1]
    assert prior.changes(50.0) == {"prior.sigma.position": "50.0 km", "prior.sigma.velocity": "50.0 mm/s"}

    def number(changes: Mapping[str, Any]) -> float:
        found = evaluate(study.editable.edited(changes), study.wanted, None, study.shared).prediction("ten days later")
        assert found is not None
        return float(found.semi_axes[0])

    found = required(study.requirement, number)
    rows = {row["name"]: row for row in found["each"]}
    assert set(rows) == {"noise", "bias", "clock", "position", "radius", "prior"}
    for one in study.requirement.each:
        row = rows[one.name]
        if row["no_better_below"] is not None:
            assert number(one.changes(row["no_better_below"])) == pytest.approx(1.05 * row["floor"], rel=0.02)
        if row["no_worse_above"] is not None:
            assert number(one.changes(row["no_worse_above"])) == pytest.approx(row["without"] / 1.05, rel=0.02)
    assert rows["prior"]["no_worse_above"] > rows["prior"]["no_better_below"] > 0.0
    assert found["together"]["answer"] == pytest.approx(12.0, rel=1e-3)


TEXT = """\
schema_version: 1
study: how good
mission: bare.yaml
answer:
  - {name: later, of: predictions.ten days later.semi_axes_km.0}
require: {of: later, at_most: 5 km, each: {noise: telescopes.*.noise.sigma, cadence: schedule.*.cadence}}
"""


@pytest.fixture(scope="module")
def place(minimal_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission in which noise is all that is uncertain."""
    folder = tmp_path_factory.mktemp("require")
    bare = minimal_text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "")
    bare = bare.replace("    position: {sigma: 3 km, correlation: white, treatment: estimated}\n", "")
    bare = "\n".join(line.replace("treatment: estimated", "treatment: fixed") for line in bare.split("\n"))
    (folder / "bare.yaml").write_text(bare, "utf-8")
    (folder / "study.yaml").write_text(TEXT, "utf-8")
    return folder


def test_of_noise_alone_the_needed_noise_is_in_proportion(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", str(place / "study.yaml"), "-o", str(place / "o"), "--workers", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    noise, cadence = found["require"]["each"]
    assert noise["needed"] == pytest.approx(0.1 * 5.0 / found["require"]["now"], rel=2e-6)
    assert noise["floor"] == pytest.approx(1e-6 * found["require"]["now"], rel=1e-6)
    assert 1.0 / 32.0 < cadence["needed"] < 1.0
    page = (place / "o" / "study.html").read_text("utf-8")
    assert "How good it must be" in page
    assert "measurements of the same kind bring it as well (now 62)" in page
    jsonschema.Draft202012Validator(SCHEMA).validate(found)
    told = found["require"]["averaging"]
    assert told["n_needed"] == pytest.approx(62.0 * (found["require"]["now"] / 5.0) ** 2, rel=1e-5)
    assert told["n_where_equal"] is None or told["n_where_equal"] > 1e6  # of noise alone averaging always helps


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("of: later,", "of: latter,", r'study:6:15: require\.of: .*did you mean "later"'),
        ("5 km", "5 s", r"study:6:31: require\.at_most: .*different kinds"),
        ("5 km", "-5 km", r"require\.at_most: is not more than 0"),
        ("noise.sigma", "noise.sgma", r"require\.each\.noise: .*says nothing there"),
        ("noise.sigma", "name", r"require\.each\.noise: .*no number above 0"),
        ("each: {", "cost: 1/nois, each: {", r'require\.cost: letter 3: .*did you mean "noise"'),
    ],
)
def test_what_is_wrong_is_said_at_its_line(place: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_study_text(TEXT.replace(old, new), path=place / "s.yaml")
