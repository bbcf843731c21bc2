"""`nebosvod study`: one table, whoever computes it and however often it is interrupted."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
import nebosvod.scenarios
from nebosvod.cli import main
from nebosvod.errors import InputError, OutputError
from nebosvod.report.study_figures import _shade
from nebosvod.report.study_page import make_study_page
from nebosvod.studies.file import study_schema
from nebosvod.studies.question import Study
from nebosvod.studies.reading import load_study, load_study_text
from nebosvod.studies.stored import RECORD, load_table
from nebosvod.studies.study import plan, run_study
from nebosvod.tasks.engine import Workers

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "studies" / "study.schema.json").read_text("utf-8"))
TEXT = """\
schema_version: 1
study: noise and cadence
mission: bare.yaml
vary:
  noise: {set: telescopes.*.noise.sigma, values: 0.01 arcsec .. 1 arcsec, log: 3}
  cadence: {set: schedule.*.cadence, values: [1 d, 3 d]}
answer:
  - {name: later, of: predictions.ten days later.semi_axes_km.0}
  - {name: position, of: state.sigma_position_km}
  - {name: blame, of: state.budget}
  - {name: number, of: n_observations}
find: {minimise: cost, where: {later: "< 15 km"}, cost: 1/noise}
"""


@pytest.fixture(scope="module")
def place(minimal_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a study, of a mission in which noise is all that is uncertain."""
    folder = tmp_path_factory.mktemp("study")
    bare = minimal_text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "")
    bare = bare.replace("    position: {sigma: 3 km, correlation: white, treatment: estimated}\n", "")
    bare = "\n".join(line.replace("treatment: estimated", "treatment: fixed") for line in bare.split("\n"))
    (folder / "bare.yaml").write_text(bare, "utf-8")
    (folder / "study.yaml").write_text(TEXT, "utf-8")
    return folder


@pytest.fixture(scope="module")
def done(place: Path) -> Path:
    """The folder of that study, by one worker."""
    run_study(
        load_study(place / "study.yaml"),
        place / "done",
        workers=Workers(count=1),
        page=lambda found, table: make_study_page(found, table.columns),
    )
    return place / "done"


def read(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "study.json").read_text("utf-8"))
    return found


def test_the_result_follows_its_schema_and_the_file_its_own(done: Path) -> None:
    jsonschema.Draft202012Validator(SCHEMA).validate(read(done))
    from nebosvod.mission.yaml.yamlfile import parse_yaml

    jsonschema.Draft202012Validator(study_schema()).validate(parse_yaml(TEXT, "study").tree)


def test_the_schema_beside_the_missions_is_that_of_the_program() -> None:
    stored = Path(nebosvod.scenarios.__file__).with_name("study.schema.json").read_text("utf-8")
    assert json.loads(stored) == study_schema()


def test_sigmas_of_noise_alone_are_proportional_to_it(done: Path) -> None:
    """The covariance of weighted least squares is (H^T W H)^-1: of noise alone its square."""
    table = Study.load(done)
    assert str(table["later"].unit) == "km"
    assert str(table["noise"].unit) == "arcsec"
    later = np.asarray(table["later"]).reshape(3, 2)
    assert later[1] == pytest.approx(10.0 * later[0], rel=1e-9)
    assert later[2] == pytest.approx(100.0 * later[0], rel=1e-9)
    shares = [np.asarray(table[f"blame: measurement noise {name}"]) for name in ("ahead", "behind")]
    assert shares[0] + shares[1] == pytest.approx(1.0, rel=1e-12)
    assert np.asarray(table["number"]).reshape(3, 2)[0].tolist() == [62.0, 22.0]


def test_the_point_that_is_found_is_the_cheapest_that_keeps_the_condition(done: Path) -> None:
    table, find = Study.load(done), read(done)["find"]
    will_do = np.flatnonzero(np.asarray(table["later"]) < 15.0)
    best = will_do[np.argmin(np.asarray(table["cost"])[will_do])]
    assert (find["found"], find["row"], find["n_feasible"]) == (True, best, len(will_do))
    assert find["values"]["noise"] == table["noise"][best]
    assert 0 < len(will_do) < len(table)


def test_bytes_do_not_depend_on_workers_or_interruptions(place: Path, done: Path, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    command = [sys.executable, "-m", "nebosvod", "study", str(place / "study.yaml"), "-o", str(folder)]
    process = subprocess.Popen([*command, "--workers", "2"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while not list(folder.glob("chunks/*.npz")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=30)
    assert main([*command[3:], "--resume", "--workers", "1"]) == 0
    for name in ("study.json", "results.ecsv", "chunks/000000.npz", "chunks/000005.npz"):
        assert (folder / name).read_bytes() == (done / name).read_bytes(), name
    assert not list(folder.rglob("*.partial"))


def test_bytes_do_not_depend_on_the_number_of_workers(place: Path, done: Path, tmp_path: Path) -> None:
    for count in (2, 3):
        run_study(load_study(place / "study.yaml"), tmp_path / f"{count}", workers=Workers(count=count))
        for name in ("study.json", "results.ecsv", "chunks/000003.npz"):
            assert (tmp_path / f"{count}" / name).read_bytes() == (done / name).read_bytes(), (count, name)


@pytest.mark.long
def test_kill_at_twenty_random_times_and_resume(place: Path, done: Path, tmp_path: Path) -> None:
    """Killed at a random part of the time that a whole run takes, again and again, until it comes to its end."""
    command = [sys.executable, "-m", "nebosvod", "study", str(place / "study.yaml"), "--workers", "2", "-o"]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    began = time.monotonic()
    subprocess.run([*command, str(tmp_path / "whole")], check=True, **quiet)
    whole_s, rng, folder = time.monotonic() - began, np.random.default_rng(7), tmp_path / "0"
    for number in range(20):
        process = subprocess.Popen([*command, str(folder)], **quiet)
        try:
            process.wait(timeout=float(rng.uniform(0.1, 1.1)) * whole_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait(timeout=30)
            continue
        assert process.returncode == 0
        folder = tmp_path / f"{number + 1}"
    subprocess.run([*command, str(folder)], check=True, **quiet)
    for other in sorted(tmp_path.iterdir()):
        for name in ("results.ecsv", "study.json"):
            assert (other / name).read_bytes() == (done / name).read_bytes(), (other.name, name)


def test_a_point_that_fails_is_a_row_with_its_message_and_the_study_goes_on(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = TEXT.replace("[1 d, 3 d]", "[3 d, 40 d]").replace("log: 3", "log: 2")
    text = text.replace("bare.yaml", str(place / "bare.yaml"))
    (tmp_path / "s.yaml").write_text(text, "utf-8")
    assert main(["study", str(tmp_path / "s.yaml"), "-o", str(tmp_path / "o"), "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "2 points of 4 failed" in said.err
    table = load_table(tmp_path / "o")
    assert table["status"].tolist() == ["ok", "failed", "ok", "failed"]
    assert "determine" in table["message"][1]
    assert np.isnan(table["later"][1])
    jsonschema.Draft202012Validator(SCHEMA).validate(read(tmp_path / "o"))


def test_drawn_rows_scatter_about_the_reference_and_have_seeds(place: Path, tmp_path: Path) -> None:
    text = TEXT.replace("answer:", "repeat: {draws: 2, seed: 4}\nanswer:").replace("log: 3", "log: 2")
    study = load_study_text(text.replace("[1 d, 3 d]", "[1 d]"), path=place / "s.yaml")
    run_study(study, tmp_path / "o", workers=Workers(count=1))
    table = load_table(tmp_path / "o")
    assert table["draw"].tolist() == [0, 1, 0, 1]
    later = np.asarray(table["later"])
    assert len(set(later.tolist())) == 4
    assert later[:2] == pytest.approx(later[0], rel=1e-3)  # of the second order


def test_parquet_holds_the_same_table(place: Path, done: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    study = load_study(place / "study.yaml")
    run_study(study, tmp_path / "o", workers=Workers(count=1), parquet=True)
    one, other = load_table(done), load_table(tmp_path / "o")
    assert one.colnames == other.colnames
    for name in one.colnames:
        assert one[name].tolist() == other[name].tolist(), name
        assert one[name].unit == other[name].unit
    assert other.meta["description"] == study.text


def test_check_says_what_it_means_and_what_it_costs(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["check", str(place / "study.yaml")], [str(place / "study.yaml"), "--check"]):
        assert main(["study", *words]) == 0
        said = capsys.readouterr().out
        assert "grid of 6 points" in said
        assert "0.01 to 1 arcsec, 3 values in the logarithm" in said
        assert "cost: 6 rows at" in said
    assert not (place / "noise-and-cadence-study").exists()


def test_one_row_is_no_faster_on_many_workers(place: Path) -> None:
    text = TEXT.replace("0.01 arcsec .. 1 arcsec, log: 3", "[0.1 arcsec]").replace("[1 d, 3 d]", "[1 d]")
    found = plan(load_study_text(text, path=place / "one.yaml"), 8)
    assert found.time_s == pytest.approx(found.point_s)
    assert found.words().startswith("1 row at ")


def test_too_many_points_are_refused_with_what_they_would_cost(place: Path, tmp_path: Path) -> None:
    axis = "{set: telescopes.*.noise.sigma, values: 1 mas .. 1 arcsec, log: 10000}"
    values = ", ".join(f"x{k}: {axis}" for k in range(3))
    text = f"{TEXT.split('vary:')[0]}vary: {{{values}}}\nanswer:{TEXT.split('answer:')[1].split('find:')[0]}"
    study = load_study_text(text, path=place / "s.yaml")
    assert study.rows == 10**12
    with pytest.raises(InputError, match=r"1,000,000,000,000 rows at .* ms each: about [\d.,e+]+ years, .* TB on disk"):
        run_study(study, tmp_path / "o", workers=Workers(count=2))
    assert not (tmp_path / "o").exists()


def test_folders_of_others_and_other_studies_stay(place: Path, done: Path, tmp_path: Path) -> None:
    study = load_study(place / "study.yaml")
    (tmp_path / "thesis.tex").write_text("x", "utf-8")
    with pytest.raises(OutputError, match="is not a study folder"):
        run_study(study, tmp_path, workers=Workers())
    with pytest.raises(OutputError, match="holds no study that could be resumed"):
        run_study(study, tmp_path / "new", workers=Workers(), resume=True)
    other = load_study_text(TEXT.replace("log: 3", "log: 2"), path=place / "s.yaml")
    with pytest.raises(OutputError, match="use --overwrite"):
        run_study(other, done, workers=Workers())
    assert json.loads((done / RECORD).read_text("utf-8"))["rows"] == 6


def test_a_plan_tells_time_and_disk(place: Path) -> None:
    found = plan(load_study(place / "study.yaml"), 2)
    assert found.rows == 6
    assert 0.0 < found.point_s < 2.0
    assert found.time_s == pytest.approx(3.0 * found.point_s)


@pytest.mark.parametrize("words", [[], ["a.yaml", "b.yaml"], ["no-such.yaml"]])
def test_wrong_words_are_exit_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", *words]) == 2
    assert "error:" in capsys.readouterr().err


def test_the_page_shows_the_trade_the_front_and_the_blame_with_their_numbers(done: Path) -> None:
    page, table = (done / "study.html").read_text("utf-8"), Study.load(done)
    for key in ("map-later", "map-position", "front", "blame-blame"):
        assert f'<figure id="{key}">' in page
        assert f'download="{key}.csv"' in page
    assert "The least cost that keeps every condition" in page
    assert "<script src" not in page
    assert f'data-value="{table["later"].min()!r}"' in page or repr(float(table["later"].min())) in page


def test_a_page_without_a_search_says_first_between_what_the_answer_lies(place: Path, tmp_path: Path) -> None:
    text = f"{TEXT.split('find:')[0]}".replace("[1 d, 3 d]", "[3 d]")
    found = run_study(
        load_study_text(text, path=place / "s.yaml"), tmp_path / "o", workers=Workers(count=1),
        page=lambda result, table: make_study_page(result, table.columns),
    )  # fmt: skip
    page = (tmp_path / "o" / "study.html").read_text("utf-8")
    verdict = page[page.index('id="verdict"') :][:1500]
    for key in ("least", "largest"):
        assert f'<data value="{found["answers"][0][key]!r}"' in verdict
    assert " at 3 points." in verdict.replace("\xa0", " ")


def test_maps_read_in_grey(done: Path) -> None:
    """Luminance (BT.709) falls evenly from the least to the largest value."""
    colours = [_shade(part) for part in np.linspace(0.0, 1.0, 9)]
    grey = [0.2126 * int(c[1:3], 16) + 0.7152 * int(c[3:5], 16) + 0.0722 * int(c[5:7], 16) for c in colours]
    steps = np.diff(grey)
    assert (steps < -15.0).all()
    assert np.ptp(steps) < 2.0


def test_report_makes_the_page_again_and_says_what_was_changed(
    done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(done, folder)
    (folder / "study.html").unlink()
    assert main(["report", str(folder)]) == 0
    assert (folder / "study.html").read_bytes() == (done / "study.html").read_bytes()
    text = (folder / "study.json").read_text("utf-8")
    (folder / "study.json").write_text(text.replace('"title": "noise', '"title": "Noise'), "utf-8")
    assert main(["report", str(folder)]) == 0
    assert "study.json: changed since the program wrote it" in capsys.readouterr().err
    (folder / "study.json").write_text(text.replace('"n_rows": 6', '"n_rows": 7'), "utf-8")
    assert main(["report", str(folder)]) == 2
    (folder / "study.json").write_text(text.replace('"n_rows": 6', '"n_rows": "six"'), "utf-8")
    assert main(["report", str(folder)]) == 2
    assert "n_rows: needs integer" in capsys.readouterr().err
    (folder / "results.ecsv").write_text("%ECSV 1.0\n", "utf-8")
    (folder / "study.json").write_text(text, "utf-8")
    assert main(["report", str(folder)]) == 2


def test_studies_side_by_side(place: Path, done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points that both have are compared: with noise alone ten times the noise is ten times the sigma."""
    other = TEXT.replace("0.01 arcsec .. 1 arcsec, log: 3", "0.1 arcsec .. 10 arcsec, log: 3")
    run_study(load_study_text(other, path=place / "s.yaml"), tmp_path / "o", workers=Workers())
    assert main(["compare", str(done), str(tmp_path / "o"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (later,) = [row["studies"] for row in found["answers"] if row["name"] == "later"]
    assert later[1]["to_first"] == pytest.approx({"n": 4, "median": 1.0, "least": 1.0, "largest": 1.0}, rel=1e-9)
    assert main(["compare", str(done), str(place)]) == 2
    assert "is no study" in capsys.readouterr().err


def test_a_study_where_a_mission_is_wanted_is_told_what_it_is_for(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("run", "check", "validate"):
        assert main([verb, str(place / "study.yaml")]) == 2
        assert "study.yaml:2:1: study: this file is a study" in capsys.readouterr().err


@pytest.mark.long
def test_a_full_disk_is_a_sentence_and_what_is_finished_is_kept(
    place: Path, done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file system of its own, too small for the chunks and then large enough."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=20k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.decode().strip()}")
    try:
        words = ["study", str(place / "study.yaml"), "-o", str(disk / "o"), "--workers", "1"]
        assert main(words) == 3
        assert "the disk is full; finished chunks are kept" in capsys.readouterr().err
        kept = {path.name: path.stat().st_mtime_ns for path in (disk / "o" / "chunks").iterdir()}
        subprocess.run(["mount", "-o", "remount,size=10m", str(disk)], check=True)
        assert main([*words, "--resume"]) == 0
        assert (disk / "o" / "results.ecsv").read_bytes() == (done / "results.ecsv").read_bytes()
        assert kept
        assert {name: (disk / "o" / "chunks" / name).stat().st_mtime_ns for name in kept} == kept
    finally:
        subprocess.run(["umount", str(disk)], check=False)
