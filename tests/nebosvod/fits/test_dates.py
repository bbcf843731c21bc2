"""Observations left out by date: what stays, what is said, where a wrong date is told; observations of 2023 DW."""

import json
import re
import shutil
from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.timescale import Epoch

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")


def settings(folder: Path, *lines: str) -> Path:
    shutil.copy(DATA / "2023DW.obs80", folder)
    path = folder / "dw.yaml"
    head = ["schema_version: 1", "name: dw", "fit:", "  observations: [2023DW.obs80]"]
    path.write_text("\n".join([*head, *(f"  {line}" for line in lines), ""]), "utf-8")
    return path


def days_of_the_file() -> list[str]:
    lines = (DATA / "2023DW.obs80").read_text("ascii").splitlines()
    return [line[15:25].replace(" ", "-") for line in lines if len(line) == 80 and line[14] != "s"]


def test_a_fit_between_two_dates_has_those_observations_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = settings(tmp_path, "from: 2023-02-28", "to: 2023-03-10T00:00:00 UTC")
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    fit = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["fit"]
    days = days_of_the_file()
    kept = sum("2023-02-28" <= day < "2023-03-10" for day in days)
    assert fit["n_selected"] + fit["n_rejected"] == kept
    assert fit["left_out"] == {"date": len(days) - kept}
    assert (fit["from_utc"], fit["to_utc"]) == ("2023-02-28T00:00:00 UTC", "2023-03-10T00:00:00 UTC")
    assert fit["first_observation_utc"][:10] >= "2023-02-28"
    assert fit["last_observation_utc"][:10] < "2023-03-10"
    assert f"left out: {len(days) - kept} by date" in said
    assert "left out by date: 27 before 2023-02-28T00:00:00 UTC" in said
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert f"{len(days) - kept} left out by date" in page


def test_options_come_before_the_dates_of_the_file(tmp_path: Path) -> None:
    path = settings(tmp_path, "from: 2023-03-01", "to: 2024-01-01")
    assert main(["fit", str(path), "-o", str(tmp_path / "run"), "--from", "2023-02-27", "--to", "2023-03-04"]) == 0
    fit = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["fit"]
    assert fit["first_observation_utc"][:10] >= "2023-02-27"
    assert fit["last_observation_utc"][:10] < "2023-03-04"


WRONG = {
    ("from: yesterday",): r'5:9: fit\.from: needs a date \(got "yesterday"; allowed such as 2024-07-01',
    ("from: 2024",): r'5:9: fit\.from: needs a date \(got "2024"',
    ("to: 2023-02-30",): r'5:7: fit\.to: epoch "2023-02-30 UTC": no such date',
    ("from: 2023-03-02", "to: 2023-03-02"): r"6:7: fit\.to: must come after from",
    (
        "from: 2025-01-01",
    ): r"5:9: fit\.from: no observation of 2023 DW .* there are 123, from 2023-02-26.* to 2023-03-19",
    ("from: 2023-01-01", "to: '2023-01-02'"): r"5:9: fit\.from, fit\.to: no observation of 2023 DW",
}


@pytest.mark.parametrize("lines", WRONG)
def test_wrong_dates_of_a_file_name_line_and_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: tuple[str, ...]
) -> None:
    path = settings(tmp_path, *lines)
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 2
    assert re.search(re.escape(str(path)) + ":" + WRONG[lines], capsys.readouterr().err)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--from", "soon"], '--from: needs a date (got "soon"'),
        (["--from", "2023-03-05", "--to", "2023-03-01"], "--to: must come after from"),
        (["--to", "2020-01-01"], "--to: no observation of 2023 DW"),
    ],
)
def test_wrong_dates_of_the_command_line_name_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert main(["fit", str(DATA / "2023DW.obs80"), *options, "-o", str(tmp_path / "run")]) == 2
    assert words in capsys.readouterr().err


def test_a_file_whose_dates_leave_nothing_beside_an_option_names_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = settings(tmp_path, "from: 2025-01-01")
    assert main(["fit", str(path), "--to", "2026-01-01", "-o", str(tmp_path / "run")]) == 2
    assert f"{path}:5:9: fit.from, --to: no observation" in capsys.readouterr().err


def test_a_check_says_the_dates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(settings(tmp_path, "to: 2023-03-10 TDB"))]) == 0
    # 37 s of TAI - UTC and 32.184 s of TT - TAI before
    assert f"before {Epoch.parse('2023-03-09T23:58:51 UTC').iso('utc', 0)}" in capsys.readouterr().out
