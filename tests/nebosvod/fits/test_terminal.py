"""What a fit says on a terminal and on its page: one of a thing is not several, many stations are not all listed."""

import json
import shutil
from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.errors import counted

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")


def test_one_of_a_thing_is_not_several() -> None:
    assert [counted(n, "station") for n in (0, 1, 2)] == ["0 stations", "1 station", "2 stations"]


@needs_data
def test_a_fit_of_one_station_says_station(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["fit", str(DATA / "2005TM173.obs80"), "-o", str(tmp_path / "run")])
    assert "6 observations by 1 station, 2005-10-09" in capsys.readouterr().out
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert len(summary["fit"]["stations"]) == 1
    # the blanks of the page do not break
    page = (tmp_path / "run" / "report.html").read_text("utf-8").replace("\N{NO-BREAK SPACE}", " ")
    assert "6 observations by 1 station " in page


@needs_data
def test_an_uncertainty_of_all_stations_is_told_by_its_largest_few(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of 28 stations of 2023 DW with a bias and a time each: the list is short, the sum whole, the tables complete."""
    shutil.copy(DATA / "2023DW.obs80", tmp_path)
    path = tmp_path / "dw.yaml"
    path.write_text(
        "schema_version: 1\nname: dw\nfit:\n  observations: [2023DW.obs80]\n  uncertainty:\n"
        "    - {stations: all, bias: {sigma: 0.3 arcsec, treatment: considered}}\n"
        "    - {stations: all, timing: {sigma: 1 s, treatment: estimated}}\n",
        "utf-8",
    )
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    blame = said.split("What is to blame")[1].split("km\n")[:-1]
    assert len(blame) < 12
    assert sum(float(line.split(" %")[0].split()[-1]) for line in blame) == pytest.approx(100.0, abs=0.5)
    assert "other stations together" in said
    assert "other numbers of stations" in said
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    # noise, bias and timing of each
    assert len(summary["budget"]) == 3 * 28
    for name, rows in (("budget", 3 * 28), ("parameters", 3 * 28)):
        lines = (tmp_path / "run" / "tables" / f"{name}.ecsv").read_text("utf-8").splitlines()
        assert len([line for line in lines if not line.startswith("#")]) == 1 + rows
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    section = page.split('<section id="budget">')[1].split("</section>")[0]
    assert section.count("<tr>") < 18
    assert "other stations together" in section
