"""What is optional may be left out: the rest of the answer comes."""

import json
import math
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main
from nebosvod.mission import list_missions
from nebosvod.mission.reading.schema import fit_schema, mission_schema
from nebosvod.timescale import Epoch

sys.path.insert(0, str(Path(__file__).resolve().parent))
import leave_outs  # type: ignore[import-not-found]

ROOT = Path(__file__).resolve().parents[4]
MINIMAL = (ROOT / "scenarios" / "minimal.yaml").read_text("utf-8")
WITHOUT_PREDICTIONS = MINIMAL[: MINIMAL.index("predictions:")]


@pytest.mark.parametrize("ending", ["", "predictions: []\n", "predictions: []\nmonte_carlo: {runs: 20}\n"])
def test_a_mission_without_predictions_gives_the_orbit_and_its_budget(
    tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mission, folder = tmp_path / "m.yaml", tmp_path / "run"
    mission.write_text(WITHOUT_PREDICTIONS + ending)
    assert main(["check", str(mission)]) == 0
    assert main(["run", str(mission), "-o", str(folder)]) == 0
    assert "What is to blame" in capsys.readouterr().out
    without = json.loads((folder / "summary.json").read_text("utf-8"))
    mission.write_text(MINIMAL)
    assert main(["run", str(mission), "-o", str(tmp_path / "with")]) == 0
    whole = json.loads((tmp_path / "with" / "summary.json").read_text("utf-8"))
    assert without["predictions"] == []
    assert without["curves"] == []
    for mine, theirs in zip(without["budget"], whole["budget"], strict=True):
        assert mine["source"] == theirs["source"]
        assert mine["sigma_position_km"] == pytest.approx(theirs["sigma_position_km"], rel=1e-6)
    page = (folder / "report.html").read_text("utf-8")
    assert "Predictions" not in page
    for command in (["report", str(folder)], ["compare", str(folder), str(tmp_path / "with")]):
        assert main(command) == 0


HERE = Path(__file__).resolve().parents[2]
EVERYTHING = HERE / "everything"
NAMES = [*(name for name, _ in list_missions()), "template"]
FILES = ["mission.yaml", "prior.yaml", "fall.yaml", "fit.yaml"]
SAMPLED, RARELY = 40, 200  # every so many variants are tried in the suite, all of them in the long tests


def faults(name: str, folder: Path, every: int = 1) -> Iterator[str]:
    """What is wrong with the variants of a built-in mission, the template or a file of `everything`."""
    for file in EVERYTHING.glob("*.*"):
        shutil.copy(file, folder)
    tree = leave_outs.thinned(leave_outs.tree_of(str(EVERYTHING / name) if name in FILES else name))
    command = "fit" if "fit" in tree else "run"
    for number, (what, variant) in enumerate(leave_outs.variants(tree)):
        if number % every == every // 2:
            got = leave_outs.outcome(variant, folder, command)
            if got.fault:
                yield f"{number} {what}: {got.fault}\n{got.said[-2000:]}"


@pytest.mark.parametrize("name", ["minimal", *FILES])
def test_some_variants_of_a_file_are_answered_or_refused_alike_by_check_and_run(name: str, tmp_path: Path) -> None:
    assert not list(faults(name, tmp_path, RARELY if name == "mission.yaml" else SAMPLED))


@pytest.mark.long
@pytest.mark.parametrize("name", [*NAMES, *FILES])
def test_every_key_may_be_left_out_and_every_group_treated_otherwise(name: str, tmp_path: Path) -> None:
    assert not list(faults(name, tmp_path))


@pytest.mark.parametrize("name", ["mission.yaml", "fit.yaml"])
def test_a_file_with_every_key_is_answered(name: str, tmp_path: Path) -> None:
    """With few exposures; the page is written."""
    for file in EVERYTHING.glob("*.*"):
        shutil.copy(file, tmp_path)
    tree = leave_outs.thinned(leave_outs.tree_of(str(EVERYTHING / name)))
    got = leave_outs.outcome(tree, tmp_path, "fit" if "fit" in name else "run")
    assert (got.check, got.work) == (0, 1)  # the entry asked for does not exist
    rows = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))["predictions"]
    status = {row["name"]: row["status"] for row in rows}
    assert {status[plane] for plane in ("sky", "position", "rtn", "velocity")} == {"answered"}
    assert status["entry"] != "answered"
    assert all(math.isfinite(x) for row in rows for x in row.get("sigma_km", ()))


# keys of other forms of a block than those the files have: JPL's answers, the law of A1..A3, equinoctial elements, a
# site by its constants, files of the ephemeris, of an SPK and of star catalogues
ELSEWHERE = {
    "A1", "alpha", "data", "debias", "elements", "ephemeris", "h", "k", "labels", "m", "model_pars", "n", "p", "r0",
    "rho_cos_phi", "rho_sin_phi", "shared_errors", "target",
}  # fmt: skip


@pytest.mark.parametrize("fit", [False, True])
def test_every_key_there_is_stands_in_a_file_with_every_key(fit: bool) -> None:
    """So that a new key is left out by the tests above as soon as there is one."""
    schema, files = (fit_schema(), FILES) if fit else (mission_schema(), FILES[:-1])
    known = {key for part in schema["$defs"].values() for key in part.get("properties", {})} | set(schema["properties"])
    trees = [leave_outs.tree_of(str(EVERYTHING / name)) for name in files]
    said = {key for tree in trees for path, _ in leave_outs.nodes(tree) for key in path if isinstance(key, str)}
    assert known - said <= ELSEWHERE


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ({"predictions": []}, ""),
        ({"shared": []}, ""),
        ({"estimators": []}, "estimators: has the wrong length (got 0; allowed at least 1)"),
        ({"telescopes": []}, "telescopes: has the wrong length (got 0; allowed at least 1)"),
        ({"schedule": []}, "schedule: has the wrong length (got 0; allowed at least 1)"),
        ({"telescopes": None}, "telescopes: needs a list"),
        ({"predictions": None}, "predictions: needs a list"),
        ({"predictions": {}}, "predictions: needs a list"),
    ],
)
def test_empty_lists_are_taken_or_refused_by_name(edit: dict[str, Any], words: str, tmp_path: Path) -> None:
    got = leave_outs.outcome({**leave_outs.thinned(leave_outs.tree_of("minimal")), **edit}, tmp_path)
    assert (got.check, got.work) == ((2, 2) if words else (0, 0))
    assert words in got.said


def test_a_telescope_that_sees_nothing_leaves_the_answer_of_the_others(tmp_path: Path) -> None:
    tree = leave_outs.thinned(leave_outs.tree_of("minimal"))
    tree["telescopes"][1]["exclusion"] = {"sun": "179.9 deg"}
    got = leave_outs.outcome(tree, tmp_path)
    assert (got.check, got.work) == (0, 0)
    assert "behind never sees the object" in got.said


@pytest.mark.parametrize("seconds", ["1 s", "10 min", "1 d"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_an_arc_that_is_hardly_observable_ends_with_a_status_and_a_reason(
    count: int, seconds: str, tmp_path: Path
) -> None:
    """No wrong input (2), no crash: the last state, its status and why (1)."""
    tree = leave_outs.tree_of("minimal")
    cadence = {"1 s": 1.0, "10 min": 600.0, "1 d": 86400.0}[seconds]
    end = Epoch.parse("2028-03-20T00:00:00 TDB") + cadence * (count - 1)
    tree["schedule"] = [{"start": "2028-03-20T00:00:00 TDB", "end": str(end), "cadence": seconds}]
    tree["telescopes"] = tree["telescopes"][:1]
    tree["telescopes"][0]["noise"]["sigma"] = "60 arcsec"
    for key in ("radius", "mass", "albedo"):
        del tree["object"][key]
    got = leave_outs.outcome(tree, tmp_path)
    assert (got.check, got.work) == (0, 1)
    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))["estimators"]
    assert row["status"] in ("not_observable", "diverged", "iteration_limit", "converged")
    assert row["status"] != "converged" or count == 3
    assert "warning: batch: " in got.said


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 2), slice(0, 3), slice(0, 60, 20)])
@pytest.mark.parametrize("given", [False, True], ids=["found", "given"])
def test_a_fit_of_a_few_records_ends_with_a_reason(rows: slice, given: bool, tmp_path: Path) -> None:
    tree = leave_outs.tree_of(str(EVERYTHING / "fit.yaml"))
    records = (EVERYTHING / "made.obs80").read_text("ascii").splitlines()
    (tmp_path / "few.obs80").write_text("\n".join(records[rows]) + "\n")
    tree = {key: tree[key] for key in ("schema_version", "name")} | {"fit": {"observations": ["few.obs80"]}}
    if given:
        orbit = leave_outs.tree_of(str(EVERYTHING / "fit.yaml"))["object"]["orbit"]
        tree["object"] = {"orbit": {**orbit, "M": "41 deg"}}
    got = leave_outs.outcome(tree, tmp_path, "fit")
    assert got.check == 0
    assert got.work in ((1,) if len(records[rows]) < 3 else (0, 1))
    assert got.said.strip()
