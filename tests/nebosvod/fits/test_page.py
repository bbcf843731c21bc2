"""The page of a fit: green only where the orbit and every ellipse can be used as they stand."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.report.fit.page import doubt, make_fit_report
from nebosvod.report.fit.tables import weights

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")


def test_an_ellipse_is_doubted_where_it_misleads_or_nobody_can_tell() -> None:
    def said(**bent: Any) -> str:
        return str(doubt({"nonlinearity": bent}))

    assert doubt({"nonlinearity": {"misleads": False, "measure": 0.01, "reason": None}}) is None
    assert "Do not believe this ellipse" in said(misleads=True, measure=0.5, reason=None)
    assert "may not hold.</strong> No such encounter." in said(misleads=None, measure=None, reason="no such encounter")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three weeks of observations: next week's place is known, and in 2046 the orbit lies on an arc of 10^6 km."""
    folder = tmp_path_factory.mktemp("page")
    shutil.copy(DATA / "2023DW.obs80", folder)
    (folder / "dw.yaml").write_text(
        "schema_version: 1\nname: dw\nfit: {observations: [2023DW.obs80]}\npredictions:\n"
        "  - {name: far, plane: b_plane, body: earth, near: 2046-02-14 TDB}\n"
        "  - {name: soon, plane: sky, from: X05, at: 2023-03-25 TDB}\n"
        "  - {name: there, plane: rtn, at: 2023-03-25 TDB}\n",
        "utf-8",
    )
    assert main(["fit", str(folder / "dw.yaml"), "-o", str(folder / "run")]) == 0
    return folder / "run"


@needs_data
def test_the_page_is_amber_and_marks_the_ellipse_that_misleads(run: Path) -> None:
    page = (run / "report.html").read_text("utf-8")
    assert '<section id="verdict" class="caution"' in page
    doubted = re.findall(r'<div class="doubt">(.*?)<figure id="([^"]+)"', page, re.DOTALL)
    assert [key for _, key in doubted] == ["ellipse-far-b-plane"]
    assert "Do not believe this ellipse" in doubted[0][0]
    assert "The linear ellipse of far misleads" in page
    # every prediction is in the table, those without a figure too
    table = page.split('<table aria-labelledby="table-predictions"')[1].split("</table>")[0]
    assert all(f"<b>{name}</b>" in table for name in ("far", "soon", "there"))


@needs_data
def test_without_the_doubtful_ellipse_it_is_green(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    summary = json.loads((copy / "summary.json").read_text("utf-8"))
    summary["predictions"] = [row for row in summary["predictions"] if row["name"] != "far"]
    summary["fit"]["chi2"] = float(summary["fit"]["dof"])  # residuals as large as their weights say
    (copy / "summary.json").write_text(json.dumps(summary), "utf-8")
    page = make_fit_report(copy)
    assert '<section id="verdict" class="good"' in page
    assert 'class="doubt"' not in page
    summary["fit"]["cautions"] = ["chi squared is large"]
    (copy / "summary.json").write_text(json.dumps(summary), "utf-8")
    assert '<section id="verdict" class="caution"' in make_fit_report(copy)


@needs_data
def test_the_terminal_says_it_beside_the_number(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from nebosvod.commands.fit_answer import print_fit

    print_fit(json.loads((run / "summary.json").read_text("utf-8")), None)
    lines = {name: line for line in capsys.readouterr().out.splitlines() if (name := line.strip().partition(" ")[0])}
    assert "not to be believed" in lines["far"]
    assert "not to be believed" not in lines["soon"]
    assert "not to be believed" not in lines["there"]


def test_rules_of_the_weights_take_one_row_each_however_full_the_nights() -> None:
    told = weights({"weights": {"V17: VID": 3, "V17: CCD, sqrt(16/4)": 16, "V17: CCD": 10, "V17: CCD, sqrt(9/4)": 45}})
    assert told.rows == (("V17: CCD", "71", "1 to 2"), ("V17: VID", "3", "1"))
    assert told.head == ("rule", "observations", "sigmas times")
    plain = weights({"weights": {"V17: VID": 3, "given": 5}})  # nothing is widened: nothing is said of it
    assert plain.rows == (("given", "5"), ("V17: VID", "3"))
    assert "night" not in str(plain.caption)


@needs_data
def test_the_answer_names_the_stations_that_weigh_most(run: Path) -> None:
    budget = json.loads((run / "summary.json").read_text("utf-8"))["budget"]
    first = max(budget, key=lambda row: row["share_position"])
    said = re.search(
        r"variance of the position: .+?; the largest: (.+?) and ", (run / "report.html").read_text("utf-8")
    )
    assert said is not None
    assert re.sub(r"<[^>]*>", "", said[1]).startswith(f"{first['source']} {100 * first['share_position']:.0f}\u00a0%")


@needs_data
def test_a_fit_shows_where_everything_was(run: Path) -> None:
    """Distances from the places are those of the observations; the picture is the first figure."""
    arrays = np.load(run / "arrays.npz")
    apart = np.linalg.norm(arrays["object_position_km"] - arrays["telescope_position_km"], axis=1)
    # at emission and at reception, about the Sun of each moment, which moves 13 m/s: 0.1 au are 50 s
    np.testing.assert_allclose(apart, arrays["distance_km"], atol=5.0)
    au = np.linalg.norm(arrays["earth_position_km"], axis=1) / 1.495978707e8
    assert np.all((au > 0.983) & (au < 1.017))
    page = (run / "report.html").read_text("utf-8")
    assert page.index("Geometry from above and from the side") < page.index("Residuals in right ascension")
