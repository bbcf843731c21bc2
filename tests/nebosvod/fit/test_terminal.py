"""What a fit says on a terminal and on its page: one of a thing is not several, many stations are not all listed."""

import json
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
