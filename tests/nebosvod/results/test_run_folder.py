"""Run folders: the contract of their files, and that they appear whole or not at all."""

import hashlib
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.report.pages import report_text
from nebosvod.results.result import OwnedFolder, Result

ROOT = Path(__file__).resolve().parents[3]
PROGRAM = [sys.executable, "-m", "nebosvod"]


def files_of(folder: Path) -> dict[str, str]:
    """Hash of every file of a folder."""
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def leftovers(folder: Path) -> list[str]:
    """Hidden files beside a run folder."""
    return [p.name for p in folder.parent.iterdir() if p.name.startswith(".")]


@pytest.mark.smoke
def test_a_run_leaves_the_files_of_the_contract(minimal_folder: Path) -> None:
    assert {p.name for p in minimal_folder.iterdir()} == {
        "manifest.json",
        "summary.json",
        "report.html",
        "arrays.npz",
        "tables",
    }
    assert {p.suffix for p in (minimal_folder / "tables").iterdir()} == {".ecsv"}
    assert leftovers(minimal_folder) == []


def test_summary_obeys_its_schema(minimal_folder: Path) -> None:
    schema = json.loads((ROOT / "nebosvod" / "results" / "summary.schema.json").read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(json.loads((minimal_folder / "summary.json").read_text("utf-8")), schema)


def test_manifest_hashes_are_those_of_the_files(minimal_folder: Path) -> None:
    manifest = json.loads((minimal_folder / "manifest.json").read_text("utf-8"))
    assert manifest["outputs_sha256"] == {k: v for k, v in files_of(minimal_folder).items() if k != "manifest.json"}
    assert manifest["mission"]["sha256"] == hashlib.sha256(manifest["mission"]["text"].encode()).hexdigest()
    assert manifest["seed"] == 3


def test_arrays_have_the_shapes_of_the_contract(minimal_folder: Path) -> None:
    result = Result.load(minimal_folder)
    a, n, m = result.arrays, result.summary["n_observations"], 3
    shapes = {
        "epoch_s": (n,),
        "telescope_index": (n,),
        "state": (n, 6),
        "Phi": (n, 6, 6),
        "zeta": (n, 6, m),
        "parameter_names": (m,),
        "psi": (n, 2),
        "residual": (n, 2),
        "R": (n, 2, 2),
        "H_x": (n, 2, 6),
        "H_z": (n, 2, 3),
        "H_c": (n, 2, m),
        "H_b": (n, 2, 4),
        "bias_names": (4,),
    }
    assert {name: a[name].shape for name in shapes} == shapes
    assert np.all(np.diff(a["epoch_s"]) >= 0.0)
    order = np.lexsort((a["telescope_index"], a["epoch_s"]))
    assert np.array_equal(order, np.arange(n))
    s = len(a["names_batch"])
    assert a["factor_batch"].shape == (s, s)
    found = result.summary["estimators"][0]
    place = [list(a["names_batch"]).index(name) for name in ("x_km", "y_km", "z_km")]
    S = a["factor_batch"][place]
    assert np.sqrt(np.trace(S @ S.T)) == pytest.approx(found["sigma_position_km"], rel=1e-12)


def test_partials_in_the_arrays_are_consistent(minimal_folder: Path) -> None:
    """H_x Phi is the partial by the initial state: rebuilding the information gives the state covariance's scale."""
    a = Result.load(minimal_folder).arrays
    assert np.isfinite(a["H_x"]).all()
    # H_z = -H_x position part, up to the light-time gradient term (1e-8)
    assert np.abs(a["H_z"] + a["H_x"][:, :, :3]).max() < 1e-6 * np.abs(a["H_z"]).max()


def test_same_seed_gives_the_same_bytes_but_for_the_times(tmp_path: Path) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        assert main(["run", "minimal", "-o", str(folder), "--seed", "9"]) == 0
    one, two = (files_of(folder) for folder in folders)
    differing = {name for name in one if one[name] != two[name]}
    assert differing <= {"manifest.json", "report.html"}  # the report prints the manifest's times
    manifests = [json.loads((folder / "manifest.json").read_text("utf-8")) for folder in folders]
    for manifest in manifests:
        del manifest["times"], manifest["outputs_sha256"]
    assert manifests[0] == manifests[1]


def test_json_prints_summary_json_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "minimal", "--json", "-o", str(tmp_path / "run")]) == 0
    out = capsys.readouterr()
    assert out.out == (tmp_path / "run" / "summary.json").read_text("utf-8")
    assert out.err == ""


def test_an_existing_folder_is_refused_and_replaced_only_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["run", "minimal", "-o", str(folder)]) == 0
    before = files_of(folder)
    assert main(["run", "minimal", "-o", str(folder), "--seed", "4"]) == 3
    assert "--overwrite" in capsys.readouterr().err
    assert files_of(folder) == before
    assert main(["run", "minimal", "-o", str(folder), "--seed", "4", "--overwrite"]) == 0
    assert json.loads((folder / "manifest.json").read_text("utf-8"))["seed"] == 4
    assert leftovers(folder) == []


def test_overwrite_never_replaces_what_is_not_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "thesis"
    folder.mkdir()
    (folder / "chapter1.tex").write_text("ten years of work")
    assert main(["run", "minimal", "-o", str(folder), "--overwrite"]) == 3
    assert "not a run folder" in capsys.readouterr().err
    assert (folder / "chapter1.tex").read_text() == "ten years of work"


@pytest.mark.parametrize("name", ["with space", "Аппофис", "x" * 200])
def test_unusual_folder_names_work(tmp_path: Path, name: str) -> None:
    assert main(["run", "minimal", "-o", str(tmp_path / name)]) == 0
    assert (tmp_path / name / "report.html").is_file()


def test_a_place_that_cannot_be_written_is_said_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "minimal", "-o", "/proc/nebosvod/run"]) == 3
    assert "cannot write" in capsys.readouterr().err


def test_a_second_run_in_one_folder_exits_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    with OwnedFolder(folder, report_text):
        assert main(["run", "minimal", "-o", str(folder)]) == 3
        assert "another run" in capsys.readouterr().err
    assert main(["run", "minimal", "-o", str(folder)]) == 0


def _small_files() -> None:
    """In the child: no file may grow beyond 20 kB, and hitting the limit is an error, not a signal."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))


def test_a_full_disk_leaves_the_last_whole_result(tmp_path: Path, minimal_folder: Path) -> None:
    folder = tmp_path / "run"
    assert main(["run", "minimal", "-o", str(folder), "--seed", "3"]) == 0
    before = files_of(folder)
    command = [*PROGRAM, "run", "minimal", "-o", str(folder), "--overwrite", "--seed", "4"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, preexec_fn=_small_files, check=False)
    assert done.returncode == 3, done.stderr
    assert "cannot write the result" in done.stderr
    assert "Traceback" not in done.stderr
    assert files_of(folder) == before
    assert leftovers(folder) == []


def _no_files() -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def test_a_disk_without_room_for_the_lock_leaves_no_lock(tmp_path: Path) -> None:
    for command in (["run", "minimal"], ["validate", "minimal", "--runs", "60"]):
        call = [*PROGRAM, *command, "-o", str(tmp_path / "run")]
        done = subprocess.run(call, capture_output=True, text=True, timeout=60, preexec_fn=_no_files, check=False)
        assert done.returncode == 3, done.stderr
        # scipy 1.15 wants a temporary file when it is imported, before there is a folder to lock
        assert "cannot write here" in done.stderr or "check disk space" in done.stderr
        assert list(tmp_path.iterdir()) == []


def start_long_run(folder: Path, mission: Path) -> "subprocess.Popen[str]":
    """Start a run that takes long (many Monte Carlo runs) and wait until it has begun."""
    mission.write_text((ROOT / "scenarios" / "minimal.yaml").read_text("utf-8") + "monte_carlo: {runs: 50000}\n")
    command = [*PROGRAM, "run", str(mission), "-o", str(folder), "--overwrite"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 30.0
    while not folder.with_name(f".{folder.name}.lock").exists():
        assert time.monotonic() < deadline, "the run did not start"
        assert process.poll() is None, process.stderr.read() if process.stderr else ""
        time.sleep(0.05)
    return process


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_a_killed_run_leaves_the_last_whole_result(tmp_path: Path, number: signal.Signals) -> None:
    folder = tmp_path / "run"
    assert main(["run", "minimal", "-o", str(folder), "--seed", "3"]) == 0
    before = files_of(folder)
    process = start_long_run(folder, tmp_path / "long.yaml")
    time.sleep(1.0)
    process.send_signal(number)
    _, err = process.communicate(timeout=90)
    assert process.returncode == (130 if number != signal.SIGKILL else -signal.SIGKILL)
    # llvmlite says itself that an object it was making is half made
    own = re.sub(r"Exception ignored in: .*?llvmlite.*?AttributeError[^\n]*", "", err, flags=re.DOTALL)
    assert "Traceback" not in own
    assert files_of(folder) == before
    if number != signal.SIGKILL:
        assert leftovers(folder) == []
    # and the next run clears whatever the killed one left
    assert main(["run", "minimal", "-o", str(folder), "--overwrite", "--seed", "3"]) == 0
    assert leftovers(folder) == []


def test_the_report_can_be_made_again_from_the_folder_alone(minimal_folder: Path) -> None:
    before = (minimal_folder / "report.html").read_bytes()
    assert main(["report", str(minimal_folder)]) == 0
    assert (minimal_folder / "report.html").read_bytes() == before
    manifest = json.loads((minimal_folder / "manifest.json").read_text("utf-8"))
    assert manifest["outputs_sha256"]["report.html"] == hashlib.sha256(before).hexdigest()


@pytest.mark.parametrize("argument", ["nowhere", "."])
def test_report_of_something_else_is_wrong_input(argument: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", argument]) == 2
    assert "not a run folder" in capsys.readouterr().err


def test_a_run_does_not_depend_on_environment_and_locale(tmp_path: Path) -> None:
    """No HOME, no TERM, another TZ and locale: the same bytes (the ephemeris of the package, no network)."""
    environments = [
        {"PATH": os.environ["PATH"]},
        {
            "PATH": os.environ["PATH"],
            "HOME": "/nonexistent",
            "TZ": "Asia/Kamchatka",
            "LANG": "de_DE.UTF-8",
            "TERM": "dumb",
        },
    ]
    texts = []
    for number, environment in enumerate(environments):
        folder = tmp_path / str(number)
        command = [*PROGRAM, "run", "minimal", "-o", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        texts.append((folder / "summary.json").read_bytes())
    assert texts[0] == texts[1]
