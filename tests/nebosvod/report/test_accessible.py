"""Every kind of page by axe-core: names for pictures, contrast AA, reached by keyboard; colours that all can tell."""

import shutil
from collections.abc import Callable, Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, sync_playwright

from nebosvod.cli import main
from nebosvod.mission.reading.builtin import builtin_path
from nebosvod.report.kit.plate import SERIES
from nebosvod.report.pages import report_text
from nebosvod.report.validation_page import make_validation_report
from nebosvod.results.result import OwnedFolder
from tests.accessible import wrong_for_some
from tests.nebosvod.first_hour.test_command import LA
from tests.nebosvod.report.risk.conftest import make
from tests.nebosvod.report.test_validation_page import campaign

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
in_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
EVERYTHING = Path(__file__).parents[1] / "everything"
SPAN = ["--from", "2028-04-01", "--to", "2028-04-05"]
STUDY = """\
schema_version: 1
study: noise and cadence
mission: minimal.yaml
vary:
  noise: {set: telescopes.*.noise.sigma, values: 0.01 arcsec .. 1 arcsec, log: 2}
  cadence: {set: schedule.*.cadence, values: [1 d, 3 d]}
answer: [{name: later, of: predictions.ten days later.semi_axes_km.0}, {name: blame, of: state.budget}]
find: {minimise: cost, where: {later: "< 15 km"}, cost: 1/noise}
"""


def commands(*words: str) -> Callable[[Path, Path], Path]:
    """A page by a command in a folder; of its words the last is the page, RUN is a run."""

    def made(folder: Path, run: Path) -> Path:
        assert main([word.replace("RUN", str(run)) for word in words[:-1]]) in (0, 1)
        return folder / words[-1]

    return made


def risk(folder: Path, run: Path) -> Path:
    with OwnedFolder(folder / "risk", report_text) as target:
        target.publish(make())
    return folder / "risk" / "report.html"


def validation(folder: Path, run: Path) -> Path:
    (folder / "validation.html").write_text(make_validation_report(campaign(1.3)), "utf-8")
    return folder / "validation.html"


def comparison(folder: Path, run: Path) -> Path:
    shutil.copytree(run, folder / "copy")
    return commands("compare", "RUN", "copy", "--page", "compare.html", "compare.html")(folder, run)


def study(folder: Path, run: Path) -> Path:
    shutil.copy(builtin_path("minimal"), folder)
    (folder / "study.yaml").write_text(STUDY, "utf-8")
    return commands("study", "study.yaml", "-o", "study", "--workers", "1", "study/study.html")(folder, run)


def alert(folder: Path, run: Path) -> Path:
    (folder / "la.obs80").write_text(LA)
    return commands("alert", "la.obs80", "-o", "alert", "--hours", "1", "alert/report.html")(folder, run)


PAGES: dict[str, Callable[[Path, Path], Path]] = {
    "run": lambda folder, run: run / "report.html",
    "fit": commands("fit", str(EVERYTHING / "fit.yaml"), "-o", "fit", "fit/report.html"),
    "risk": risk,
    "alert": alert,
    "ephemeris": commands("ephemeris", "RUN", *SPAN, "-o", "sky", "sky/report.html"),
    "approaches": commands("approaches", "RUN", *SPAN, "-o", "near", "near/report.html"),
    "compare": comparison,
    "plan": commands("plan", "minimal", "-k", "2", "--page", "plan.html", "plan.html"),
    "validate": validation,
    "study": study,
}


@pytest.fixture(scope="module")
def shown() -> Iterator[Page]:
    """A tab of a browser that lets axe-core in."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser.new_context(bypass_csp=True, viewport={"width": 1280, "height": 900}).new_page()
        browser.close()


@in_browser
@pytest.mark.parametrize("kind", PAGES)
def test_every_page_is_for_who_cannot_see_it_or_has_no_pointer(
    kind: str, shown: Page, real_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown.goto(PAGES[kind](tmp_path, real_folder).as_uri())
    assert wrong_for_some(shown) == []


@in_browser
def test_what_would_be_wrong_is_found(shown: Page) -> None:
    shown.set_content(
        '<html lang="en"><title>t</title><main><h1>t</h1>'
        '<svg viewBox="0 0 9 9"><text y="9" fill="#aaa">pale</text></svg>'
        '<p style="color: #999">pale</p><input><table><tr><th></th><td>1</td></tr></table>'
        '<i id="one"></i><b id="one"></b></main>'
    )
    said = wrong_for_some(shown)
    for word in (
        "contrast 2.32: rgb(170, 170, 170)",
        "color-contrast: p",
        "label: input",
        "empty-table-header",
        "a picture",
        "an id that stands twice: one",
    ):
        assert any(one.startswith(word) for one in said), (word, said)


# linear sRGB as two kinds of colour-blind eyes see it: Machado, Oliveira, Fernandes 2009, IEEE TVCG 15, 1291
PROTAN = np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]])
DEUTAN = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]])


@pytest.mark.parametrize("eye", [np.eye(3), PROTAN, DEUTAN], ids=["all", "protan", "deutan"])
def test_the_colours_of_series_are_told_apart_by_every_eye_and_their_marks_differ(eye: np.ndarray) -> None:
    """At least 15 in CIELAB between any two (2.3 is just seen); and each has a mark of its own."""
    seen = [lab(eye @ linear(colour)) for colour, _ in SERIES]
    assert min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2)) > 15.0
    assert len({mark for _, mark in SERIES}) == len(SERIES)


def linear(colour: str) -> np.ndarray:
    """`#rrggbb` as linear sRGB."""
    v = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB (D65) of linear sRGB."""
    XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x = XYZ @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])
