"""`nebosvod validate`: honest estimators pass, dishonest ones are caught, and nothing depends on interruptions."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
from nebosvod.cli import main
from nebosvod.engine.trial import Setting
from nebosvod.errors import InputError, OutputError
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.studies.campaign import CHUNK_RUNS, Campaign, CampaignFolder, compute_chunk, passes
from nebosvod.studies.chunk import chunk_path
from nebosvod.studies.validation import summary, validate

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "studies" / "validation.schema.json").read_text("utf-8"))
SEED = 20290413
ESTIMATORS = """
estimators:
  - {name: honest, method: batch_qr}
  - {name: filter, method: recursive}
  - {name: consider, method: batch_qr, treatment: {bias: considered}}
  - {name: deaf, method: batch_blocks, treatment: {bias: ignored}}
"""
OVERCONFIDENT = """
estimators:
  - {name: stiff, method: batch_qr, treatment: {bias: fixed}}
"""


@pytest.fixture(scope="module")
def four(minimal_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smallest mission with four estimators, as a file."""
    path = tmp_path_factory.mktemp("four") / "four.yaml"
    path.write_text(minimal_text + ESTIMATORS, "utf-8")
    return path


@pytest.fixture(scope="module")
def campaign_of_four(four: Path) -> Path:
    """Its validation folder: 200 runs by two workers."""
    folder = four.parent / "validation"
    validate(load_mission(str(four)), folder, runs=200, seed=SEED, workers=2)
    return folder


def rows(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in found["estimators"]}


def read(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "validation.json").read_text("utf-8"))
    return found


def test_the_result_follows_its_schema(campaign_of_four: Path) -> None:
    jsonschema.Draft202012Validator(SCHEMA).validate(read(campaign_of_four))


def test_the_page_of_the_command_names_every_key(campaign_of_four: Path) -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "validation-command.md").read_text("utf-8")
    found = read(campaign_of_four)
    judged = found["estimators"][0]["judged"]["true"]
    keys = {*found, *found["estimators"][0], *judged, *judged["nees_quantiles"], *judged["directions"][0]}
    assert sorted(key for key in keys if f"`{key}" not in page and f"{key}`" not in page) == []


def test_honest_estimators_pass_and_what_is_left_out_shows_in_k_formal_only(campaign_of_four: Path) -> None:
    found = read(campaign_of_four)
    assert found["passed"]
    judged = {name: row["judged"] for name, row in rows(found).items()}
    for name in ("honest", "filter"):
        assert judged[name]["true"]["consistent"]
        assert judged[name]["formal"]["consistent"]
        assert judged[name]["formal"]["claimed"]
    for name in ("consider", "deaf"):
        assert judged[name]["true"]["consistent"]
        assert not judged[name]["formal"]["consistent"]
        assert not judged[name]["formal"]["claimed"]
        assert "optimistic" in judged[name]["formal"]["verdict"]
    assert "consider, deaf are wrong, as they must be" in found["verdict"]


def test_every_method_agrees_with_the_shared_factorisation(campaign_of_four: Path) -> None:
    assert all(row["check_sigma"] < 1e-9 for row in read(campaign_of_four)["estimators"])


def test_an_estimator_that_denies_an_error_the_truth_has_fails_with_exit_1(
    minimal_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stiff.yaml"
    path.write_text(minimal_text + OVERCONFIDENT, "utf-8")
    assert main(["validate", str(path), "--runs", "100", "-o", str(tmp_path / "v"), "--workers", "1"]) == 1
    out = capsys.readouterr().out
    assert "FAILED" in out
    assert "optimistic" in out


def test_the_bytes_do_not_depend_on_workers_or_on_the_order_of_chunks(
    four: Path, campaign_of_four: Path, tmp_path: Path
) -> None:
    """One worker, first 60 runs, then 200; 200 at once by three; against 200 at once by two."""
    mission = load_mission(str(four))
    validate(mission, tmp_path / "v", runs=60, seed=SEED, workers=1)
    validate(mission, tmp_path / "v", runs=200, seed=SEED, workers=1)
    validate(mission, tmp_path / "w", runs=200, seed=SEED, workers=3)
    for name in ("validation.json", *(f"chunks/{i:06d}.npz" for i in range(4))):
        wanted = (campaign_of_four / name).read_bytes()
        assert (tmp_path / "v" / name).read_bytes() == wanted, name
        assert (tmp_path / "w" / name).read_bytes() == wanted, name


def start(four: Path, folder: Path) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "nebosvod", "validate", str(four), "-n", "200", "--seed", str(SEED)]
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([*command, "-o", str(folder), "--workers", "1"], **quiet)  # type: ignore[call-overload,no-any-return]


def test_a_campaign_killed_in_three_ways_keeps_its_chunks_and_ends_with_the_same_bytes(
    four: Path, campaign_of_four: Path, tmp_path: Path
) -> None:
    folder, kept = tmp_path / "v", {}
    for number, how in enumerate((signal.SIGTERM, signal.SIGINT, signal.SIGKILL)):
        process = start(four, folder)
        deadline = time.monotonic() + 60
        while not chunk_path(folder, number).exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(how)
        _, err = process.communicate(timeout=30)
        assert process.returncode == (-9 if how == signal.SIGKILL else 130)
        assert b"Traceback" not in err
        kept[number] = chunk_path(folder, number).stat().st_mtime_ns
    validate(load_mission(str(four)), folder, runs=200, seed=SEED, workers=1)
    assert {number: chunk_path(folder, number).stat().st_mtime_ns for number in kept} == kept
    assert (folder / "validation.json").read_bytes() == (campaign_of_four / "validation.json").read_bytes()
    assert not list(folder.rglob("*.partial"))


def test_a_damaged_chunk_is_computed_again(four: Path, campaign_of_four: Path, tmp_path: Path) -> None:
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    whole = chunk_path(folder, 2).read_bytes()
    chunk_path(folder, 2).write_bytes(whole[: len(whole) // 2])
    validate(load_mission(str(four)), folder, runs=200, seed=SEED, workers=1)
    assert chunk_path(folder, 2).read_bytes() == whole


def test_another_seed_or_a_foreign_folder_is_refused(four: Path, campaign_of_four: Path, tmp_path: Path) -> None:
    mission = load_mission(str(four))
    with pytest.raises(OutputError, match="another mission, seed"):
        validate(mission, campaign_of_four, runs=50, seed=SEED + 1)
    (tmp_path / "thesis.tex").write_text("x", "utf-8")
    with pytest.raises(OutputError, match="not a validation folder"):
        validate(mission, tmp_path, runs=50, overwrite=True)
    assert (tmp_path / "thesis.tex").exists()


def test_fewer_runs_do_not_replace_a_larger_result_unless_told(
    four: Path, campaign_of_four: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    before = (folder / "validation.json").read_bytes()
    mission = load_mission(str(four))
    with pytest.raises(OutputError, match=r"with 200 runs, and 100 would replace.*--runs 200 or more.*--overwrite"):
        validate(mission, folder, runs=100, seed=SEED)
    assert (folder / "validation.json").read_bytes() == before
    assert validate(mission, folder, runs=100, seed=SEED, overwrite=True)["n_runs"] == 100
    # the other runs stay, so the larger result comes back as it was
    assert all(chunk_path(folder, number).is_file() for number in range(4))
    validate(mission, folder, runs=200, seed=SEED)
    assert (folder / "validation.json").read_bytes() == before


def test_overwrite_begins_anew(four: Path, campaign_of_four: Path, tmp_path: Path) -> None:
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    mission = load_mission(str(four))
    other = Campaign.of(mission, SEED + 1, False, 62)
    with CampaignFolder(folder, other, overwrite=True) as held:
        assert held.missing(200) == [0, 1, 2, 3]
    assert not (folder / "validation.json").exists()


def test_two_validations_in_one_folder_are_refused(minimal: Mission, tmp_path: Path) -> None:
    campaign = Campaign.of(minimal, 1, False, 62)
    with (
        CampaignFolder(tmp_path / "v", campaign),
        pytest.raises(OutputError, match="another validation"),
        CampaignFolder(tmp_path / "v", campaign),
    ):
        pass
    with CampaignFolder(tmp_path / "v", campaign):
        pass  # the refused one has not taken the lock away


@pytest.mark.parametrize("runs", [0, 19, 1_000_000_000])
def test_too_few_and_too_many_runs_are_wrong_input(minimal: Mission, tmp_path: Path, runs: int) -> None:
    with pytest.raises(InputError, match="out of range"):
        validate(minimal, tmp_path / "v", runs=runs)
    assert not (tmp_path / "v").exists()


def test_a_mission_that_cannot_be_observed_is_exit_1(
    minimal_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.yaml"
    path.write_text(minimal_text.replace("end: 2028-04-19T00:00:00 TDB", "end: 2028-03-20T00:00:00 TDB"), "utf-8")
    assert main(["validate", str(path), "-n", "50", "-o", str(tmp_path / "v")]) == 1
    assert "nothing to validate" in capsys.readouterr().err


def test_json_alone_on_stdout_and_silence_on_stderr(
    four: Path, campaign_of_four: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All runs are there already, so the command only judges them."""
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    assert main(["validate", str(four), "-n", "200", "--seed", str(SEED), "-o", str(folder), "--json"]) == 0
    said = capsys.readouterr()
    assert said.out == (campaign_of_four / "validation.json").read_text("utf-8")
    assert said.err == ""


def test_full_mode_agrees_with_the_linear_one_for_a_mission_that_is_linear(minimal: Mission, tmp_path: Path) -> None:
    """The same seeds draw the same truths; NEES of 20 runs differ by the curvature alone, a few percent."""
    full = validate(minimal, tmp_path / "full", runs=20, seed=SEED, workers=2, full=True)
    linear = validate(minimal, tmp_path / "linear", runs=20, seed=SEED, workers=1)
    jsonschema.Draft202012Validator(SCHEMA).validate(full)
    assert full["passed"]
    assert full["estimators"][0]["n_failed"] == 0
    one, other = (found["estimators"][0]["judged"]["true"]["nees"]["value"] for found in (full, linear))
    assert one == pytest.approx(other, rel=0.05)


def test_a_campaign_is_bound_to_what_fixes_its_runs(minimal: Mission, minimal_text: str) -> None:
    campaign = Campaign.of(minimal, 1, False, 62)
    assert campaign.chunk_runs == CHUNK_RUNS["linear"]
    assert campaign.same_runs(json.loads(json.dumps(asdict(campaign))))
    for other in (
        Campaign.of(minimal, 2, False, 62),
        Campaign.of(minimal, 1, True, 62),
        Campaign.of(load_mission_text(minimal_text + "\n# changed\n"), 1, False, 62),
    ):
        assert not campaign.same_runs(asdict(other))
    assert Campaign.of(minimal, 1, False, 1_000_000).chunk_runs == 2


PRIOR = "prior: {sigma: {position: 1000 km, velocity: 1 m/s}}\n"


def judged_here(mission: Mission, runs: int) -> dict[str, Any]:
    """A campaign inside this process, without a folder."""
    setting = Setting.of(mission)
    campaign = Campaign.of(mission, SEED, False, setting.nominal.observation.t_s.size)
    chunk = compute_chunk(setting, passes(setting), campaign, range(runs))
    return summary(setting, campaign, runs, chunk, 0.0)


def test_the_filter_as_printed_is_caught_by_its_own_claim(minimal_text: str) -> None:
    """It counts a common bias and a common radius as fresh noise at each measurement and believes itself too good."""
    text = minimal_text.replace("sigma: 0.05 arcsec", "sigma: 0.5 arcsec")
    estimators = "estimators: [{name: printed, method: as_printed}, {name: batch, method: batch_qr}]\n"
    found = judged_here(load_mission_text(text.replace("predictions:", PRIOR + estimators + "predictions:")), 400)
    assert not found["passed"]
    caught, honest = found["estimators"]
    assert caught["claims_formal"]
    assert caught["left_out"] == ["radius", "mass", "albedo", "bias ahead", "bias behind"]
    assert not caught["judged"]["formal"]["consistent"]
    assert "optimistic" in caught["judged"]["formal"]["verdict"]
    assert caught["judged"]["true"]["consistent"]
    assert caught["judged"]["true"]["nis"] == []
    assert honest["passed"]


def test_schmidt_keeps_its_own_claim_and_two_stage_the_one_of_the_batch(minimal_text: str) -> None:
    estimators = (
        "estimators:\n"
        "  - {name: schmidt, method: schmidt, treatment: {bias: considered, radius: considered}}\n"
        "  - {name: two stages, method: two_stage}\n"
    )
    found = judged_here(
        load_mission_text(minimal_text.replace("predictions:", PRIOR + estimators + "predictions:")), 400
    )
    assert found["passed"], found["verdict"]
    schmidt, stages = found["estimators"]
    assert schmidt["claims_formal"]
    assert schmidt["left_out"]
    assert schmidt["judged"]["formal"]["consistent"]
    assert stages["check_sigma"] < 1e-9  # its own method against the batch's factor, in sigmas


@pytest.mark.long
@pytest.mark.parametrize("name", builtin_names())
def test_built_in_missions_at_2000_runs(name: str, tmp_path: Path) -> None:
    """Every estimator of every built-in mission inside its intervals at a family level of 99 %."""
    found = validate(load_mission(name), tmp_path / name, runs=2000, seed=SEED, workers=len(os.sched_getaffinity(0)))
    assert found["passed"], found["verdict"]
    for row in found["estimators"]:
        assert 0.967 < row["judged"]["true"]["nees"]["value"] < 1.034


@pytest.mark.long
def test_full_campaign_of_minimal(tmp_path: Path) -> None:
    found = validate(load_mission("minimal"), tmp_path / "v", runs=400, seed=SEED, workers=2, full=True)
    assert found["passed"], found["verdict"]


def test_chunks_and_results_that_were_changed_are_said_and_made_again(
    four: Path, campaign_of_four: Path, tmp_path: Path
) -> None:
    """Sound files with other contents: a chunk of another number, one with changed numbers, an edited result."""
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    before = {path.name: path.read_bytes() for path in (folder / "chunks").iterdir()}
    result = (folder / "validation.json").read_bytes()
    shutil.copyfile(chunk_path(folder, 0), chunk_path(folder, 1))
    with np.load(chunk_path(folder, 2)) as stored:
        arrays = dict(stored)
    arrays["errors_0"][0, 0] *= 2.0
    np.savez(chunk_path(folder, 2), **arrays)
    (folder / "validation.json").write_bytes(result.replace(b'"passed": true', b'"passed": false', 1))
    said: list[str] = []
    validate(load_mission(str(four)), folder, runs=200, seed=SEED, workers=1, say=said.append)
    assert [Path(line.partition(": ")[0]).name for line in said] == ["000001.npz", "000002.npz", "validation.json"]
    assert {path.name: path.read_bytes() for path in (folder / "chunks").iterdir()} == before
    assert (folder / "validation.json").read_bytes() == result


def test_overwrite_removes_what_the_campaign_wrote_and_nothing_else(
    four: Path, campaign_of_four: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "v"
    shutil.copytree(campaign_of_four, folder)
    (folder / "chunks" / "notes.txt").write_text("mine", "utf-8")
    (folder / "notes.txt").write_text("mine", "utf-8")
    mission = load_mission(str(four))
    other = Campaign.of(mission, SEED + 1, False, 62)
    (folder / "chunks" / "000007.npz").write_bytes(b"a file of mine")
    with (
        pytest.raises(OutputError, match=r"000007\.npz.*nothing was changed"),
        CampaignFolder(folder, other, overwrite=True),
    ):
        pass
    assert (folder / "validation.json").is_file()
    (folder / "chunks" / "000007.npz").unlink()
    with CampaignFolder(folder, other, overwrite=True):
        pass
    assert sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()) == [
        "campaign.json", "chunks/notes.txt", "notes.txt",
    ]  # fmt: skip


@pytest.mark.parametrize("link", ["v", "v/chunks", "v/validation.json", "v/campaign.json", ".v.lock"])
def test_a_campaign_never_writes_through_a_link(link: str, four: Path, campaign_of_four: Path, tmp_path: Path) -> None:
    folder, target = tmp_path / "v", tmp_path / "target"
    shutil.copytree(campaign_of_four, folder)
    place = tmp_path / link
    if link == ".v.lock":
        target.write_text("precious", "utf-8")
    else:
        place.rename(target)
    place.symlink_to(target)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(OutputError):
        validate(load_mission(str(four)), folder, runs=200, seed=SEED, workers=1)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
