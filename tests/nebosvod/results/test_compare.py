"""`nebosvod compare`: the numbers of the folders side by side, a warning wherever they answer different questions."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import nebosvod
from nebosvod.cli import main
from nebosvod.errors import InputError, listed
from nebosvod.results.compare import compare, shown_budget

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "results" / "comparison.schema.json").read_text("utf-8"))
Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def pair(minimal_folder: Path, tmp_path: Path) -> Callable[[Change], tuple[Path, Path]]:
    """A run, and a copy of it whose summary has been changed."""

    def make(change: Change) -> tuple[Path, Path]:
        other = tmp_path / "other"
        shutil.copytree(minimal_folder, other)
        summary = json.loads((other / "summary.json").read_text("utf-8"))
        change(summary)
        (other / "summary.json").write_text(json.dumps(summary), "utf-8")
        return minimal_folder, other

    return make


def test_numbers_are_those_of_the_summaries_and_ratios_theirs(
    pair: Callable[[Change], tuple[Path, Path]],
) -> None:
    def worse(summary: dict[str, Any]) -> None:
        summary["estimators"][0]["sigma_position_km"] *= 2.0
        row = summary["predictions"][0]
        row["sigma_km"] = [3.0 * sigma for sigma in row["sigma_km"]]
        summary["budget"][0]["share_position"] = 0.9

    first, other = pair(worse)
    found = compare([first, other])
    summary = json.loads((first / "summary.json").read_text("utf-8"))
    assert found["warnings"] == []
    assert [run["label"] for run in found["runs"]] == ["minimal", "other"]
    (estimator,) = found["estimators"]
    assert estimator["by_run"][0]["sigma_position_km"] == summary["estimators"][0]["sigma_position_km"]
    assert estimator["ratio_position"] == pytest.approx([1.0, 2.0])
    (prediction,) = found["predictions"]
    assert prediction["comparable"]
    assert prediction["ratio"] == pytest.approx([1.0, 3.0])
    assert prediction["by_run"][0]["covariance"] == summary["predictions"][0]["covariance_km2"]
    changed = summary["budget"][0]["source"]
    (row,) = (row for row in found["budget"] if row["source"] == changed)
    assert row["share"] == [summary["budget"][0]["share_position"], 0.9]
    shares = [row["share"][0] for row in prediction["budget"]]
    assert sum(shares) == pytest.approx(1.0)


def set_object(summary: dict[str, Any]) -> None:
    summary["object"] = "Another"


def set_epoch(summary: dict[str, Any]) -> None:
    summary["reference_epoch_tdb"] = "2028-03-21T00:00:00.000 TDB"


def set_force(summary: dict[str, Any]) -> None:
    summary["physics"]["asteroids"] = not summary["physics"]["asteroids"]


def set_status(summary: dict[str, Any]) -> None:
    summary["estimators"][0]["status"] = "iteration_limit"


def set_estimator(summary: dict[str, Any]) -> None:
    for part, key in (("estimators", "name"), ("predictions", "estimator"), ("budget", "estimator")):
        for row in summary[part]:
            row[key] = "filter"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_object, "the objects differ: minimal: Example; other: Another"),
        (set_epoch, "the reference epochs differ"),
        (set_force, "the forces differ in asteroids"),
        (set_status, "other: batch did not converge (iteration_limit)"),
        (set_estimator, "their first estimators differ: minimal: batch; other: filter"),
    ],
)
def test_runs_that_do_not_compare_are_warned_about(
    pair: Callable[[Change], tuple[Path, Path]], change: Change, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = pair(change)
    (warning,) = compare(folders)["warnings"]
    assert warning.startswith(words)
    assert main(["compare", *map(str, folders)]) == 0
    assert f"warning: {words}" in capsys.readouterr().out


def set_plane(summary: dict[str, Any]) -> None:
    summary["predictions"][0]["plane"] = "rtn"


def set_time(summary: dict[str, Any]) -> None:
    summary["predictions"][0]["epoch_tdb"] = "2028-04-30T00:00:00.000 TDB"


@pytest.mark.parametrize(("change", "words"), [(set_plane, "the planes differ"), (set_time, "the epochs differ")])
def test_a_prediction_of_another_plane_or_epoch_is_not_compared(
    pair: Callable[[Change], tuple[Path, Path]], change: Change, words: str
) -> None:
    found = compare(pair(change))
    (row,) = found["predictions"]
    assert not row["comparable"]
    assert words in row["warning"]
    assert row["warning"] in found["warnings"]


def test_the_sky_from_another_place_of_the_same_name_does_not_compare(
    pair: Callable[[Change], tuple[Path, Path]],
) -> None:
    def sky(distance_km: float) -> Change:
        def change(summary: dict[str, Any]) -> None:
            summary["predictions"][0].update(plane="sky", telescope="ahead", distance_km=distance_km)

        return change

    _, near = pair(sky(1.0e7))
    far = near.with_name("far")
    shutil.copytree(near, far)
    for distance, compares in ((1.0e7 + 500.0, True), (2.0e7, False)):
        summary = json.loads((near / "summary.json").read_text("utf-8"))
        sky(distance)(summary)
        (far / "summary.json").write_text(json.dumps(summary), "utf-8")
        (row,) = compare([near, far])["predictions"]
        assert row["comparable"] is compares
        assert ("different places" in row["warning"]) is not compares


def test_a_prediction_of_one_run_only_stands_alone(pair: Callable[[Change], tuple[Path, Path]]) -> None:
    found = compare(pair(lambda summary: summary["predictions"].clear()))
    (row,) = found["predictions"]
    assert row["by_run"][1] is None
    assert row["warning"] == "ten days later: only in minimal"


def test_ellipses_of_plane_predictions_lie_over_each_other(pair: Callable[[Change], tuple[Path, Path]]) -> None:
    def flat(summary: dict[str, Any]) -> None:
        plane: dict[str, Any] = summary["predictions"][0] | {
            "name": "flat",
            "plane": "b_plane",
            "body": "earth",
            "mean_km": [10.0, 20.0],
            "sigma_km": [3.0, 4.0],
            "sigma_formal_km": [3.0, 4.0],
            "semi_axes_km": [4.0, 3.0],
            "angle_deg": 90.0,
            "covariance_km2": [[9.0, 0.0], [0.0, 16.0]],
        }
        summary["predictions"].append(plane)

    _, other = pair(flat)
    again = other.with_name("again")
    shutil.copytree(other, again)
    found = compare([other, again])
    (ellipse,) = found["ellipses"]
    assert ellipse["name"] == "flat"
    assert ellipse["by_run"][0] == ellipse["by_run"][1]
    assert ellipse["by_run"][0]["mean"] == [10.0, 20.0]
    assert ellipse["by_run"][0]["covariance"] == [[9.0, 0.0], [0.0, 16.0]]


def test_wrong_folders_are_exit_2_and_say_what_to_do(
    minimal_folder: Path,
    tmp_path: Path,
    pair: Callable[[Change], tuple[Path, Path]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["compare", str(minimal_folder)]) == 2
    assert "needs 2 to 20" in capsys.readouterr().err
    assert main(["compare", str(minimal_folder), str(tmp_path)]) == 2
    assert "not a run folder" in capsys.readouterr().err
    assert main(["compare", str(minimal_folder), str(minimal_folder)]) == 2
    assert "named twice" in capsys.readouterr().err
    first, other = pair(lambda summary: summary.update(schema_version=2))
    with pytest.raises(InputError, match="schema_version 2"):
        compare([first, other])
    (other / "summary.json").write_text("{", "utf-8")
    with pytest.raises(InputError, match="is no JSON"):
        compare([first, other])
    (other / "summary.json").write_text('{"schema_version": 1}', "utf-8")
    with pytest.raises(InputError, match="lacks"):
        compare([first, other])


def test_json_alone_on_stdout(pair: Callable[[Change], tuple[Path, Path]], capsys: pytest.CaptureFixture[str]) -> None:
    folders = pair(set_object)
    assert main(["compare", *map(str, folders), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == compare(folders)


def test_every_comparison_follows_its_schema(pair: Callable[[Change], tuple[Path, Path]]) -> None:
    def less(summary: dict[str, Any]) -> None:
        summary["predictions"].clear()
        summary["estimators"][0]["name"] = "other"

    first, other = pair(less)
    again = other.with_name("again")
    shutil.copytree(first, again)
    for folders in ([first, other], [first, again]):
        jsonschema.Draft202012Validator(SCHEMA).validate(json.loads(json.dumps(compare(folders))))


def test_one_telescope_against_two_costs_what_two_missions_say(tmp_path: Path, minimal_text: str) -> None:
    """The second telescope makes every sigma smaller, and its sources stand with 0 where it is not."""
    cut = minimal_text.index("  - {name: behind")
    alone = minimal_text[:cut] + minimal_text[minimal_text.index("schedule:") :]
    folders = []
    for name, text in (("two", minimal_text), ("one", alone.replace("name: minimal", "name: alone"))):
        (tmp_path / f"{name}.yaml").write_text(text, "utf-8")
        assert main(["run", str(tmp_path / f"{name}.yaml"), "-o", str(tmp_path / name)]) == 0
        folders.append(tmp_path / name)
    found = compare(folders)
    jsonschema.Draft202012Validator(SCHEMA).validate(json.loads(json.dumps(found)))
    (row,) = found["predictions"]
    assert row["comparable"]
    assert row["ratio"][1] > 2.0
    assert found["estimators"][0]["ratio_position"][1] > 2.0
    (noise,) = (part for part in row["budget"] if part["source"] == "measurement noise behind")
    assert noise["share"][0] > 0.1
    assert noise["share"][1] == 0.0
    assert [run["telescopes"] for run in found["runs"]] == [["ahead", "behind"], ["ahead"]]


def test_the_terminal_leads_with_the_answer(
    pair: Callable[[Change], tuple[Path, Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Which run knows each prediction best, how much better, and the source that makes the difference."""
    kept: dict[str, Any] = {}

    def worse(summary: dict[str, Any]) -> None:
        row = summary["predictions"][0]
        total = sum(sigma**2 for sigma in row["sigma_km"])
        bias = next(part for part in row["budget"] if part["source"] == "bias ahead")
        own = bias["share_total"] * total
        grown = total + 8.0 * own  # that bias three times as large
        for part in row["budget"]:
            part["share_total"] *= total / grown
        bias["share_total"] *= 9.0
        row["sigma_km"] = [sigma * (grown / total) ** 0.5 for sigma in row["sigma_km"]]
        kept.update(name=row["name"], now=total**0.5, then=grown**0.5)

    first, other = pair(worse)
    assert main(["compare", str(other), str(first)]) == 0
    leading = capsys.readouterr().out.splitlines()[0]
    now, then, ratio = (f"{kept['now']:.4g}", f"{kept['then']:.4g}", f"{kept['then'] / kept['now']:.3g}")
    assert leading == (
        f"{kept['name']} (position): minimal is best, {now} km (1 sigma); other {then} km, x{ratio}, "
        "above all by bias ahead"
    )


def test_two_runs_that_say_the_same_are_told_so(
    pair: Callable[[Change], tuple[Path, Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    first, other = pair(lambda summary: None)
    assert main(["compare", str(first), str(other)]) == 0
    assert capsys.readouterr().out.startswith("ten days later (position): the same in all, ")


def test_many_telescopes_are_told_by_the_first_few_and_many_sources_by_the_largest() -> None:
    stations = [f"S{k:02d}" for k in range(40)]
    assert listed(stations) == "S00, S01, S02 and 37 others"
    assert listed(stations[:6]) == ", ".join(stations[:6])
    rows = [{"source": f"bias {name}", "share": [0.4 / 2**k, 0.2 / 2**k]} for k, name in enumerate(stations)]
    rows += [{"source": f"timing {name}", "share": [0.0, 0.015]} for name in stations[:39]]
    rows += [{"source": "prior orbit", "share": [0.0, 0.015]}, {"source": "A2", "share": [1e-5, 1e-5]}]
    rows.sort(key=lambda row: -max(row["share"]))
    shown = shown_budget(rows, stations, 4)
    names = [row["source"] for row in shown]
    assert names == [
        "bias S00", "bias S01", "bias S02", "bias S03",
        "timing, 39 together", "bias, 36 others together", "prior orbit",
    ]  # fmt: skip
    for run in (0, 1):
        whole, kept = (sum(row["share"][run] for row in part) for part in (rows, shown))
        assert kept == pytest.approx(whole, abs=2e-5)  # but for A2, which would be shown as 0
