"""Only what the program wrote is replaced or removed; nothing is written through a link; a kill loses nothing."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.report.pages import report_text
from nebosvod.results.ownership import sha256_of
from nebosvod.results.result import OwnedFolder, _write_manifest

KILLED = """
import hashlib, os, signal, sys
from pathlib import Path
import nebosvod.results.publication as publication
from nebosvod.results.ownership import marked
from nebosvod.results.result import OwnedFolder, _write_manifest

folder, step, without_exchange = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "renames"
done = 0

def counted(function):
    def call(*args, **words):
        global done
        done += 1
        if done == step:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*args, **words)
    return call

def fill(stage, result, page):
    files = {"summary.json": b"new", "arrays.npz": b"new", "tables/a.ecsv": b"new", "tables/new.ecsv": b"new"}
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    _write_manifest(stage, {}, hashes)
    (stage / "tables").mkdir()
    for name, data in files.items():
        (stage / name).write_bytes(data)
    (stage / "report.html").write_bytes(b"new")
    _write_manifest(stage, {}, {**hashes, "report.html": hashlib.sha256(b"new").hexdigest()})

import nebosvod.results.result as result
result.write_files = fill
for name in ("rename", "replace", "link", "unlink", "mkdir", "rmdir", "open"):
    setattr(os, name, counted(getattr(os, name)))
publication.exchange = counted(publication.exchange) if not without_exchange else lambda one, two: False
with OwnedFolder(folder, lambda stage: "", overwrite=True) as target:
    target.publish(None)
"""


def tree(folder: Path) -> dict[str, bytes | str]:
    """Everything below a folder: contents, targets of links, empty folders."""
    found: dict[str, bytes | str] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"-> {os.readlink(path)}"
        elif path.is_dir():
            found[name] = "folder"
        else:
            found[name] = path.read_bytes()
    return found


@pytest.fixture
def run(minimal_folder: Path, tmp_path: Path) -> Path:
    """A run folder of the test's own."""
    shutil.copytree(minimal_folder, tmp_path / "run")
    return tmp_path / "run"


def again(folder: Path) -> int:
    return main(["run", "minimal", "-o", str(folder), "--seed", "4", "--overwrite"])


def foreign_manifest(folder: Path) -> None:
    """Somebody else's folder: a browser extension has a manifest.json, too."""
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / "manifest.json").write_text('{"manifest_version": 3, "name": "x", "versions": {"chrome": "1"}}', "utf-8")
    (folder / "photo.jpg").write_bytes(b"x")


def listed_by_hand(folder: Path) -> None:
    """A manifest that looks like one of 0.1.0, over files with other contents."""
    foreign_manifest(folder)
    hashes = dict.fromkeys(("summary.json", "arrays.npz", "photo.jpg"), "0" * 64)
    text = json.dumps({"versions": {"nebosvod": "0.1.0"}, "outputs_sha256": hashes})
    (folder / "manifest.json").write_text(text, "utf-8")
    for name in ("summary.json", "arrays.npz"):
        (folder / name).write_bytes(b"mine")


def changed_table(folder: Path) -> None:
    with (folder / "tables" / "budget.ecsv").open("a") as file:
        file.write("# my remark\n")


def changed_manifest(folder: Path) -> None:
    record = json.loads((folder / "manifest.json").read_text("utf-8"))
    (folder / "manifest.json").write_text(json.dumps(record | {"remark": "mine"}), "utf-8")


def table_of_the_user(folder: Path) -> None:
    (folder / "tables" / "mine.ecsv").write_text("1", "utf-8")


def linked_table(folder: Path) -> None:
    (folder / "tables" / "budget.ecsv").rename(folder.parent / "budget.ecsv")
    (folder / "tables" / "budget.ecsv").symlink_to(folder.parent / "budget.ecsv")


def linked_tables(folder: Path) -> None:
    (folder / "tables").rename(folder.parent / "tables")
    (folder / "tables").symlink_to(folder.parent / "tables")


def linked_folder(folder: Path) -> None:
    folder.rename(folder.parent / "elsewhere")
    folder.symlink_to(folder.parent / "elsewhere")


def dangling(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.symlink_to(folder.parent / "nowhere")


def linked_lock(folder: Path) -> None:
    victim = folder.parent / "victim.txt"
    victim.write_text("precious", "utf-8")
    folder.with_name(f".{folder.name}.lock").symlink_to(victim)


def lock_of_the_user(folder: Path) -> None:
    folder.with_name(f".{folder.name}.lock").write_text("my notes on locks", "utf-8")


REFUSED: tuple[Callable[[Path], None], ...] = (
    foreign_manifest, listed_by_hand, changed_table, changed_manifest, table_of_the_user, linked_table, linked_tables,
    linked_folder, dangling, linked_lock, lock_of_the_user,
)  # fmt: skip


@pytest.mark.parametrize("prepare", REFUSED)
def test_what_the_program_did_not_write_is_refused_before_computing_and_stays(
    prepare: Callable[[Path], None], run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare(run)
    before = tree(run.parent)
    monkeypatch.setattr("nebosvod.pipeline.run", lambda *args, **words: pytest.fail("computed first"))
    assert again(run) == 3
    assert capsys.readouterr().err.startswith("error: ")
    assert tree(run.parent) == before


def test_files_of_the_user_in_and_beside_a_run_folder_stay(run: Path) -> None:
    notes = {
        "notes.txt": b"ten years", ".DS_Store": b"finder", "figures/one.png": b"png", "figures/old/two.png": b"png",
        "report.html.old": b"x", "manifest.json.bak": b"x", "tables/mine.csv": b"1,2",
    }  # fmt: skip
    beside = ["run.old", "run.partial", ".run.old", ".run.partial", "run.lock"]
    for name, data in notes.items():
        (run / name).parent.mkdir(parents=True, exist_ok=True)
        (run / name).write_bytes(data)
    (run / "empty").mkdir()
    (run / "link").symlink_to("notes.txt")
    for name in beside:
        (run.parent / name).mkdir()
        (run.parent / name / "manifest.json").write_text("{}", "utf-8")
    before = tree(run)
    assert again(run) == 0
    after = tree(run)
    assert json.loads((run / "manifest.json").read_text("utf-8"))["seed"] == 4
    kept = {**notes, "empty": "folder", "link": before["link"]}
    assert {name: after.get(name) for name in kept} == kept
    assert sorted(path.name for path in run.parent.iterdir()) == sorted(["run", *beside])
    assert all(tree(run.parent / name) == {"manifest.json": b"{}"} for name in beside)
    listed = json.loads((run / "manifest.json").read_text("utf-8"))["outputs_sha256"]
    assert not set(listed) & set(notes)


def as_010_wrote_it(folder: Path) -> None:
    """Without a mark, and with every file that lay there in the list."""
    record = json.loads((folder / "manifest.json").read_text("utf-8"))
    del record["nebosvod_folder"]
    record["outputs_sha256"]["notes.txt"] = "0" * 64
    (folder / "manifest.json").write_text(json.dumps(record), "utf-8")


def test_a_folder_of_the_first_version_is_replaced_and_files_its_list_claims_stay(run: Path) -> None:
    (run / "notes.txt").write_bytes(b"ten years")
    as_010_wrote_it(run)
    assert again(run) == 0
    assert (run / "notes.txt").read_bytes() == b"ten years"
    record = json.loads((run / "manifest.json").read_text("utf-8"))
    assert record["seed"] == 4
    assert record["nebosvod_folder"]["format"] == 1


@pytest.mark.parametrize("way", ["exchange", "renames"])
def test_a_kill_at_any_step_leaves_a_whole_result_and_the_next_command_the_rest(way: str, tmp_path: Path) -> None:
    """SIGKILL before each system call that changes the disk, one after the other, then a whole run."""
    script = tmp_path / "killed.py"
    script.write_text(KILLED, "utf-8")
    place = tmp_path / "place"
    place.mkdir()
    seen = set()
    for step in range(1, 400):
        for path in place.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        earlier(place / "run")
        before = tree(place / "run")
        code = killed(script, place / "run", step, way)
        if code == 0:
            break
        assert code == -9
        if way == "exchange" or (place / "run").exists():
            left = tree(place / "run")
            whole = {name: data for name, data in left.items() if name not in ("notes.txt", "tables/notes.txt")}
            news = {data for name, data in whole.items() if name not in ("tables", "manifest.json")}
            assert news in ({b"old"}, {b"new"}), step
            assert left["notes.txt"] == before["notes.txt"]
            seen |= news
        with OwnedFolder(place / "run", report_text, overwrite=True):  # the next command at this place
            assert (place / "run" / "summary.json").read_bytes() in (b"old", b"new")
        assert os.listdir(place) == ["run"]
        assert tree(place / "run")["tables/notes.txt"] == b"mine", step
    else:
        pytest.fail("it never came to its end")
    assert step > 20
    assert seen == {b"old", b"new"}
    assert os.listdir(place) == ["run"]
    assert tree(place / "run")["notes.txt"] == b"mine"


def earlier(folder: Path) -> None:
    """A result of the program, in small, with two notes of the user."""
    (folder / "tables").mkdir(parents=True)
    names = ("summary.json", "arrays.npz", "report.html", "tables/a.ecsv", "tables/old.ecsv")
    for name in names:
        (folder / name).write_bytes(b"old")
    _write_manifest(folder, {}, {name: sha256_of(folder / name) for name in names})
    (folder / "notes.txt").write_bytes(b"mine")
    (folder / "tables" / "notes.txt").write_bytes(b"mine")


def killed(script: Path, folder: Path, step: int, way: str) -> int:
    command = [sys.executable, str(script), str(folder), str(step), way]
    return subprocess.run(command, capture_output=True, timeout=60, check=False).returncode


RECEIVED = ("report.html", "manifest.json", "summary.json", ".run.lock", "tables/visibility.ecsv", "report.pdf")


@pytest.mark.parametrize("name", RECEIVED)
def test_report_of_a_received_folder_follows_no_link(name: str, run: Path, tmp_path: Path) -> None:
    """The link leads to a file of the same contents outside: nothing there may change, and nothing be read from it."""
    place = run.parent / name if name == ".run.lock" else run / name
    victim = tmp_path / "victim"
    victim.write_bytes(place.read_bytes() if place.exists() else b"precious")
    place.unlink(missing_ok=True)
    place.symlink_to(victim)
    before = victim.read_bytes()
    assert main(["report", str(run), *(["--pdf"] if name == "report.pdf" else [])]) in (2, 3)
    assert victim.read_bytes() == before
    assert place.is_symlink()


@pytest.mark.parametrize(
    "name", [".report.html.partial", ".manifest.json.partial", ".nebosvod-0123456789abcdef.partial"]
)
def test_report_writes_to_no_name_that_could_be_prepared(name: str, run: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    (run / name).symlink_to(victim)
    assert main(["report", str(run)]) == 0
    assert victim.read_bytes() == b"precious"
    assert (run / name).is_symlink()


def test_report_says_what_was_changed_and_goes_on_saying_it(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary = json.loads((run / "summary.json").read_text("utf-8"))
    summary["estimators"][0]["sigma_position_km"] *= 0.5
    (run / "summary.json").write_text(json.dumps(summary), "utf-8")
    for _ in range(2):
        assert main(["report", str(run)]) == 0
        assert "summary.json: changed since the program wrote it" in capsys.readouterr().err
    assert main(["compare", str(run), str(run.parent / "run")]) == 2
    summary["estimators"][0]["sigma_position_km"] = "small"
    (run / "summary.json").write_text(json.dumps(summary), "utf-8")
    assert main(["report", str(run)]) == 2
    assert "summary.json: estimators[0].sigma_position_km: needs number" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["file", "link", "missing folder", "twice"])
def test_pages_are_refused_before_computing(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "p.html"
    if kind == "file":
        page.write_text("mine", "utf-8")
    elif kind == "link":
        page.symlink_to(tmp_path / "nowhere")
    elif kind == "missing folder":
        page = tmp_path / "no" / "p.html"
    monkeypatch.setattr("nebosvod.planning.planner.plan", lambda *args, **words: pytest.fail("computed first"))
    more = ["-o", str(page)] if kind == "twice" else []
    before = tree(tmp_path)
    assert main(["plan", "minimal", "--page", str(page), *more]) == 3
    assert str(page) in capsys.readouterr().err
    assert tree(tmp_path) == before


def test_a_report_is_not_written_through_a_link_to_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "minimal", "-o", str(tmp_path / "run")]) == 0
    before = (tmp_path / "run" / "report.html").stat().st_mtime_ns
    (tmp_path / "link").symlink_to(tmp_path / "run", target_is_directory=True)
    assert main(["report", str(tmp_path / "link")]) == 3
    assert "symbolic link" in capsys.readouterr().err
    assert (tmp_path / "run" / "report.html").stat().st_mtime_ns == before
