"""report.pdf: printed by a browser that is there, refused with advice where none is."""

import re
from pathlib import Path

import pytest

from nebosvod.errors import OutputError
from nebosvod.report import pdf
from nebosvod.report.page import make_report


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
