"""Every built-in mission: rows of two lines at 1280 px, and no sheet but the last a third empty."""

from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

from nebosvod.cli import main
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.report.kit import pdf
from tests.nebosvod.report.test_family import EMPTY, empty_parts

BROWSER = pdf.browser()
TALL = """[...document.querySelectorAll("#verdict > h2, #verdict .answers dd > p, #verdict .warning > p")]
  .filter(e => e.getBoundingClientRect().height > 2.1 * parseFloat(getComputedStyle(e).lineHeight))
  .map(e => e.textContent)"""
SCROLLING = """[...document.querySelectorAll(".scroll")]
  .filter(e => e.checkVisibility({contentVisibilityAuto: true}) && e.scrollWidth > e.clientWidth + 1)
  .map(e => e.getAttribute("aria-labelledby"))"""


@pytest.mark.long
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
@pytest.mark.parametrize("mission", builtin_names())
def test_the_page_of_a_built_in_mission_is_short_on_screen_and_full_on_paper(mission: str, tmp_path: Path) -> None:
    assert main(["run", mission, "-o", str(tmp_path / "run")]) in (0, 1)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1280, "height": 900})
        tab.goto((tmp_path / "run" / "report.html").as_uri())
        tall, scrolling = tab.evaluate(TALL), tab.evaluate(SCROLLING)
        tab.pdf(path=tmp_path / "page.pdf", prefer_css_page_size=True)
        browser.close()
    assert tall == []
    assert scrolling == []  # of what is seen without a click
    assert [part for part in empty_parts(tmp_path / "page.pdf")[:-1] if part > EMPTY] == []
