"""The page of `nebosvod open` in a real browser: text, form and answer; tabs; save and run; nothing asked of others."""

import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Error, Page, Request, expect, sync_playwright

from nebosvod.mission.yaml.yamlfile import parse_yaml
from tests.accessible import wrong_for_some
from tests.nebosvod.workbench.conftest import BROWSER, MISSION, Served, ended, opened

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
ANSWERED = re.compile(r"^in \d")
SIGMA = "#sigma-position data"
PATIENCE_MS = 60_000  # of the first answer: processes load
WITHIN_S = 2.0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield one
        one.close()


class Tab:
    """One tab, whatever it said or asked for."""

    def __init__(self, page: Page, served: Served) -> None:
        self.page = page
        self.said: list[str] = []
        self.asked: list[str] = []
        page.on("console", self._console)
        page.on("pageerror", self._error)
        page.on("request", self._request)
        page.goto(served.address)
        self.answered()

    def _console(self, message: ConsoleMessage) -> None:
        self.said.append(message.text)

    def _error(self, error: Error) -> None:
        self.said.append(str(error))

    def _request(self, request: Request) -> None:
        self.asked.append(request.url)

    def answered(self) -> None:
        expect(self.page.locator("#speed")).to_have_text(ANSWERED, timeout=PATIENCE_MS)
        expect(self.page.locator("#speed")).to_have_attribute("data-looks", re.compile(r"\d"), timeout=PATIENCE_MS)

    def write(self, text: str) -> float:
        """Other text; returns the seconds until the page has its answer, or says what is wrong."""
        looks = str(int(self.page.locator("#speed").get_attribute("data-looks") or 0) + 1)
        started = time.monotonic()
        self.page.locator("#text").fill(text)
        expect(self.page.locator("#speed")).to_have_attribute("data-looks", looks, timeout=PATIENCE_MS)
        return time.monotonic() - started

    @property
    def text(self) -> str:
        return self.page.locator("#text").input_value()

    @property
    def sigma_km(self) -> float:
        return float(str(self.page.locator(SIGMA).get_attribute("value")))


@pytest.fixture
def tab(browser: Browser, served: Served) -> Iterator[Tab]:
    served.file.write_text(MISSION, "utf-8")
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    one = Tab(page, served)
    yield one
    page.close()
    assert one.said == []
    assert [url for url in one.asked if not url.startswith(served.address)] == []


def test_a_letter_in_the_text_changes_the_answer_within_two_seconds(tab: Tab) -> None:
    before = tab.sigma_km
    took = tab.write(MISSION.replace("0.1 arcsec", "0.2 arcsec"))
    assert tab.sigma_km == pytest.approx(2.0 * before, rel=1e-9)  # noise is all there is: sigmas are proportional to it
    tab.write(MISSION.replace("0.1 arcsec", "0.3 arcsec"))
    assert tab.sigma_km == pytest.approx(3.0 * before, rel=1e-9)
    assert took < WITHIN_S
    assert tab.page.locator("#target svg[role=img]").count() >= 1
    expect(tab.page.locator("#visibility")).to_contain_text("77 of 77")


def test_text_and_form_are_two_views_of_one_thing(tab: Tab) -> None:
    box = tab.page.get_by_label("sigma", exact=True)
    for name in ("NEB", "noise"):
        tab.page.locator("summary", has_text=re.compile(f"^{name}")).first.click()
    assert box.input_value() == "0.1 arcsec"
    before = tab.sigma_km
    box.fill("0.40 arcsec")
    box.press("Tab")
    expect(tab.page.locator("#text")).to_have_value(MISSION.replace("0.1 arcsec", "0.40 arcsec"))  # its comment, too
    tab.answered()
    expect(tab.page.locator(SIGMA)).not_to_have_attribute("value", repr(before))
    assert tab.sigma_km == pytest.approx(4.0 * before, rel=1e-9)
    tab.write(MISSION.replace("0.1 arcsec", "0.7 arcsec"))
    expect(box).to_have_value("0.7 arcsec")


def test_what_the_form_adds_and_takes_away_is_a_mission_again(tab: Tab) -> None:
    tab.page.get_by_role("button", name="Add to telescopes").click()
    tab.answered()
    expect(tab.page.locator("#visibility")).to_contain_text("NEB-2")
    tab.page.get_by_label("Add to telescopes 1", exact=True).select_option("bias")
    tab.page.get_by_label("Add to telescopes 1", exact=True).locator("..").get_by_role("button").click()
    expect(tab.page.locator("#text")).to_have_value(re.compile("bias: "))
    tab.page.get_by_role("button", name="Take bias away", exact=True).click()
    expect(tab.page.locator("#text")).not_to_have_value(re.compile("bias: "))
    tree: Any = parse_yaml(tab.text, "x").tree
    assert [one["name"] for one in tree["telescopes"]] == ["NEB", "NEB-2"]
    assert "# what the camera does" in tab.text


@pytest.mark.parametrize(
    ("wrong", "at", "word"),
    [
        (("sigma: 0.1 arcsec", "sigma: 0.1 arcsecs"), "0.1 arcsecs", "allowed units"),
        (("cadence: 12 h", "cadance: 12 h"), "cadance", 'did you mean "cadence"'),
        (("telescopes:", "telescopes: ["), None, "not YAML"),
        (("end: 2029-04-08", "end: 2029-02-08"), "2029-02-08", "before"),
    ],
)
def test_what_is_wrong_stands_at_its_line_and_column(
    tab: Tab, wrong: tuple[str, str], at: str | None, word: str
) -> None:
    text = MISSION.replace(*wrong)
    tab.write(text)
    said = tab.page.locator("#problems button").first.inner_text()
    assert word in said
    where = re.match(r"line (\d+), column (\d+)", said)
    assert where
    if at is not None:
        before = text[: text.index(at)]
        assert (int(where[1]), int(where[2])) == (before.count("\n") + 1, len(before) - before.rfind("\n"))
    mark = tab.page.locator("#waves i").first
    assert (mark.get_attribute("data-line"), mark.get_attribute("data-column")) == where.groups()
    expect(tab.page.locator("#run")).to_be_disabled()
    tab.page.locator("#problems button").first.click()
    chosen = tab.page.evaluate("[document.activeElement.id, document.getElementById('text').selectionStart]")
    lines = text.split("\n")
    assert chosen == ["text", sum(len(one) + 1 for one in lines[: int(where[1]) - 1]) + int(where[2]) - 1]
    tab.write(MISSION)
    expect(tab.page.locator("#verdict-line")).to_have_text("Valid.")


def test_no_text_kills_the_server(tab: Tab) -> None:
    tab.write("x: " + "[" * 100_000)
    expect(tab.page.locator("#problems")).to_contain_text("nested deeper than 32")
    tab.write("# " + "x" * 1_100_000)
    expect(tab.page.locator("#problems")).to_contain_text("larger than 1000000 bytes")
    tab.write("")
    expect(tab.page.locator("#problems")).to_contain_text("the file is empty")
    tab.write(MISSION.replace("longitude: 0 deg}", "longitude: 0 deg}\n    exclusion: {sun: 179 deg}"))
    expect(tab.page.locator("#problems")).to_contain_text("no epoch is visible")
    tab.write(MISSION.replace("cadence: 12 h", "cadence: 10 s"))
    expect(tab.page.locator("#answer")).to_contain_text("too many to follow every change")
    tab.write(MISSION)
    assert tab.sigma_km > 0.0


def test_a_long_computation_does_not_hold_up_the_next_text(tab: Tab) -> None:
    before = tab.sigma_km
    tab.page.locator("#text").fill(MISSION.replace("cadence: 12 h", "cadence: 34 s"))  # 96 000 measurements: seconds
    expect(tab.page.locator("#speed")).to_have_text("computing")  # a second on a quiet machine: no time to lose here
    started = time.monotonic()
    tab.page.locator("#text").fill(MISSION.replace("0.1 arcsec", "0.2 arcsec"))
    wanted = pytest.approx(2.0 * before, rel=1e-9)  # the long one may just have ended and be seen first
    while tab.sigma_km != wanted and time.monotonic() < started + WITHIN_S:
        tab.page.wait_for_timeout(20.0)
    assert tab.sigma_km == wanted


def test_two_tabs_do_not_mix(tab: Tab, browser: Browser, served: Served) -> None:
    other = Tab(browser.new_page(), served)
    one = tab.sigma_km
    other.page.locator("#text").fill(MISSION.replace("0.1 arcsec", "0.2 arcsec"))
    tab.page.locator("#text").fill(MISSION.replace("0.1 arcsec", "0.3 arcsec"))
    expect(other.page.locator(SIGMA)).not_to_have_attribute("value", repr(one))
    expect(tab.page.locator(SIGMA)).not_to_have_attribute("value", repr(one))
    assert other.sigma_km == pytest.approx(2.0 * one, rel=1e-9)
    assert tab.sigma_km == pytest.approx(3.0 * one, rel=1e-9)
    other.page.keyboard.press("Control+s")
    expect(other.page.locator("#state")).to_have_text("(saved)")
    tab.page.locator("#save").click()  # what this tab has read is no longer what is there
    expect(tab.page.locator("#ask")).to_contain_text("has changed on disk since it was read here; nothing was written")
    tab.page.keyboard.press("Escape")
    assert served.file.read_text("utf-8") == MISSION.replace("0.1 arcsec", "0.2 arcsec")
    tab.page.locator("#save").click()
    tab.page.get_by_role("button", name="Write mine over it").click()
    expect(tab.page.locator("#state")).to_have_text("(saved)")
    assert served.file.read_text("utf-8") == MISSION.replace("0.1 arcsec", "0.3 arcsec")
    other.page.close()
    assert other.said in ([], ["Failed to load resource: the server responded with a status of 409 (Conflict)"])
    tab.said[:] = [one for one in tab.said if "409 (Conflict)" not in one]


def test_a_file_that_is_gone_takes_no_text_with_it(tab: Tab, browser: Browser, served: Served) -> None:
    mine = MISSION.replace("0.1 arcsec", "0.2 arcsec")
    tab.write(mine)
    served.file.unlink()
    late = browser.new_page()
    late.goto(served.address)
    expect(late.locator("#verdict-line")).to_contain_text("no such file")
    late.close()
    tab.page.locator("#save").click()
    expect(tab.page.locator("#ask")).to_contain_text("is gone from disk since it was read here; nothing was written")
    tab.page.get_by_role("button", name="Cancel").click()
    assert tab.text == mine
    tab.page.locator("#save").click()
    tab.page.get_by_role("button", name="Write it again").click()
    expect(tab.page.locator("#state")).to_have_text("(saved)")
    assert served.file.read_text("utf-8") == mine
    served.file.unlink()  # nothing is changed in the page, and yet there is something to save
    tab.page.locator("#run").click()
    expect(tab.page.locator("#running")).to_contain_text("is gone from disk; Save writes it again; nothing was run")
    tab.page.keyboard.press("Control+s")
    tab.page.get_by_role("button", name="Write it again").click()
    expect(tab.page.locator("#ask")).to_be_hidden()
    expect(tab.page.locator("#state")).to_have_text("(saved)")
    for _ in range(500):  # it said so before as well
        if served.file.exists():
            break
        tab.page.wait_for_timeout(20.0)
    assert served.file.read_text("utf-8") == mine
    assert len(tab.said) == 4  # three refusals to save, one to run; nothing else went wrong
    tab.said.clear()


def test_the_browser_is_given_no_token_that_others_could_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, browser: Browser
) -> None:
    """Command lines are open to all users of a machine."""
    (tmp_path / "desk.yaml").write_text(MISSION, "utf-8")
    (tmp_path / "browser").write_text(
        f'#!/bin/sh\necho "$@" > {tmp_path}/part && mv {tmp_path}/part {tmp_path}/given\n'
    )
    (tmp_path / "browser").chmod(0o755)
    monkeypatch.setenv("BROWSER", str(tmp_path / "browser"))
    monkeypatch.setenv("DISPLAY", ":0")
    served = opened(tmp_path, "desk.yaml", show=True)
    for _ in range(300):
        if (tmp_path / "given").exists():
            break
        time.sleep(0.1)
    given = (tmp_path / "given").read_text("utf-8").strip()
    token = served.address.split("/")[3]
    assert token not in given
    page = Path(given.removeprefix("file://"))
    assert token in page.read_text("utf-8")
    assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
    tab = browser.new_page()
    tab.goto(given)
    expect(tab.locator("#name")).to_have_text("desk.yaml")  # the way from the file to the page is open
    tab.close()
    ended(served)
    assert not page.parent.exists()


def test_the_page_is_for_who_cannot_see_it_or_has_no_pointer(browser: Browser, served: Served) -> None:
    served.file.write_text(MISSION, "utf-8")
    tab = Tab(browser.new_context(bypass_csp=True, viewport={"width": 1280, "height": 900}).new_page(), served)
    assert wrong_for_some(tab.page) == []
    tab.write(MISSION.replace("0.1 arcsec", "0.1 arcsecs"))
    assert wrong_for_some(tab.page) == []
    field = tab.page.locator("#form [aria-invalid=true]")  # the fault is told at its field, too
    said = tab.page.locator(f"#{field.get_attribute('aria-describedby')}")
    assert "allowed units" in said.inner_text()
    served.file.write_text(MISSION + "# theirs\n", "utf-8")
    tab.page.locator("#text").focus()
    tab.page.keyboard.press("Control+s")
    expect(tab.page.locator("#ask")).to_contain_text("has changed on disk")
    assert wrong_for_some(tab.page) == []
    tab.page.keyboard.press("Tab")  # Cancel, then the two that do something
    tab.page.keyboard.press("Tab")
    tab.page.keyboard.press("Enter")
    expect(tab.page.locator("#text")).to_have_value(MISSION + "# theirs\n")
    tab.page.context.close()


def test_run_writes_the_folder_of_the_command_and_nothing_else(tab: Tab, served: Served) -> None:
    short = MISSION.replace("cadence: 12 h", "cadence: 4 d")
    tab.write(short)
    tab.page.get_by_role("button", name="Save and run").click()
    expect(tab.page.locator("#running")).to_have_text("done; see the report", timeout=PATIENCE_MS)
    assert sorted(path.name for path in served.folder.iterdir()) == ["desk-run", "desk.yaml"]
    assert served.file.read_text("utf-8") == short
    assert "report: desk-run/report.html" in tab.page.locator("#said").inner_text()
    tab.page.get_by_role("button", name="Run", exact=True).click()
    expect(tab.page.locator("#ask")).to_contain_text("desk-run: exists already", timeout=PATIENCE_MS)
    tab.page.get_by_role("button", name="Cancel").click()
    with tab.page.context.expect_page() as shown:
        tab.page.locator("#report").click()
    expect(shown.value.locator("h1")).to_have_text("desk")
    assert shown.value.evaluate("origin") == "null"  # it reaches nothing of this server
    shown.value.close()
