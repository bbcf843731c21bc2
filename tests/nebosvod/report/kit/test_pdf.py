"""report.pdf: printed by a browser that is there, refused with advice where none is."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from matplotlib.image import imread
from scipy import ndimage

from nebosvod.errors import OutputError
from nebosvod.report.kit import pdf
from nebosvod.report.kit.chart import MARKERS, Chart
from nebosvod.report.run.page import make_report


@pytest.fixture
def page(run_folder: Path, tmp_path: Path) -> Path:
    path = tmp_path / "report.html"
    path.write_text(make_report(run_folder), "utf-8")
    return path


@pytest.mark.skipif(pdf.browser() is None, reason="no Chromium is installed")
def test_page_is_printed_on_several_a4_sheets_with_text_that_stays_text(page: Path) -> None:
    target = page.with_suffix(".pdf")
    pdf.print_pdf(page, target)
    found = target.read_bytes()
    assert found.startswith(b"%PDF-")
    boxes = re.findall(rb"/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)\s*\]", found)
    assert 4 <= len(boxes) <= 30
    assert {(round(float(w) / 72 * 25.4), round(float(h) / 72 * 25.4)) for w, h in boxes} == {(210, 297)}
    assert b"/ToUnicode" in found
    assert sorted(path.name for path in page.parent.iterdir()) == ["report.html", "report.pdf"]


@pytest.mark.skipif(pdf.browser() is None or not shutil.which("pdftotext"), reason="needs Chromium and poppler-utils")
def test_every_sheet_has_its_number_and_from_the_second_on_the_title(page: Path) -> None:
    """Read by Poppler; date, version and hash stand along the foot, and no script of the page stands in the way."""
    pdf.print_pdf(page, page.with_suffix(".pdf"))
    done = subprocess.run(
        ["pdftotext", "-layout", str(page.with_suffix(".pdf")), "-"], capture_output=True, text=True, check=True
    )
    sheets = done.stdout.split("\f")[:-1]
    for k, sheet in enumerate(sheets, start=1):
        lines = [" ".join(line.split()) for line in sheet.splitlines() if line.strip()]
        assert lines[-1].endswith(f"{k} / {len(sheets)}"), k
        assert lines[-1].startswith("2026-11-22 17:00 UTC · nebosvod 0.1.0 · mission sha256 abababababab"), k
        running = "Apophis before the 2029 encounter, seen by two geostationary telescopes · Accuracy report"
        assert (lines[0] == running) is (k > 1)
    assert "Figure 1." in sheets[0]  # the story begins on the first sheet


@pytest.mark.skipif(pdf.browser() is None or not shutil.which("pdftoppm"), reason="needs Chromium and poppler-utils")
def test_marks_of_every_shape_are_seen_by_another_reader_of_pdf(tmp_path: Path) -> None:
    """Poppler draws what Chromium printed: 12 marks of each shape are 12 spots. Square dots had been missing there."""
    chart = Chart("marks", height=40.0 + 25.0 * len(MARKERS))
    for row, marker in enumerate(MARKERS):
        chart.markers(np.arange(12) * 30.0 + 20.0, np.full(12, 20.0 + 25.0 * row), marker, {"color": "#d00000"})
    page, sheet = tmp_path / "marks.html", chart.plate("marks", Markup(""))
    page.write_text(f"<!doctype html><body>{sheet.svg}", "utf-8")
    pdf.print_pdf(page, tmp_path / "marks.pdf")
    command = ["pdftoppm", "-r", "150", "-png", "-singlefile", str(tmp_path / "marks.pdf"), str(tmp_path / "marks")]
    subprocess.run(command, check=True, capture_output=True)
    picture = imread(tmp_path / "marks.png")
    red = (picture[..., 0] > 0.6) & (picture[..., 1] < 0.6) & (picture[..., 2] < 0.6)
    assert ndimage.label(red, np.ones((3, 3)))[1] == 12 * len(MARKERS)


def test_without_a_browser_the_message_says_what_to_do(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(page.parent))
    monkeypatch.delenv(pdf.VARIABLE, raising=False)
    with pytest.raises(OutputError, match=r"no Chromium found.*install Chromium.*NEBOSVOD_BROWSER") as caught:
        pdf.print_pdf(page, page.with_suffix(".pdf"))
    assert caught.value.exit_code == 3
    assert not page.with_suffix(".pdf").exists()


def test_a_browser_that_prints_nothing_is_said_to_and_leaves_no_file(
    page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = page.parent / "broken-browser"
    fake.write_text("#!/bin/sh\necho 'cannot open display' >&2\nexit 1\n", "ascii")
    fake.chmod(0o755)
    monkeypatch.setenv(pdf.VARIABLE, str(fake))
    with pytest.raises(OutputError, match="cannot open display"):
        pdf.print_pdf(page, page.with_suffix(".pdf"))
    assert not page.with_suffix(".pdf").exists()
