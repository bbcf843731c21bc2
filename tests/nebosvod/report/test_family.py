"""Every kind of page in a real browser: one head, nothing cut, texts that can be read on a phone, and on paper."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import sync_playwright

from nebosvod.cli import main
from nebosvod.report.kit import pdf

BROWSER = pdf.browser()
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
KINDS = (
    "run",
    "plan",
    "compare",
    "compare-orbits",
    "validate",
    "study",
    "ephemeris",
    "approaches",
    "risk",
    "alert",
    "fit",
)
SMALLEST_PX = 9.9  # of text in a figure, on a phone
EMPTY = 1.0 / 3.0  # of a sheet, at its foot: more is a hole
PAPER_DPI = 40
FOOT_MM, HEAD_MM, SHEET_MM = 16.0, 18.0, 297.0
LA = """\
     K18L00A tC2018 06 02.34329516 11 10.342-11 19 34.92               V~2i5UG96
     K18L00A tC2018 06 02.34850816 10 59.352-11 20 21.37         18.2 GV~2i5UG96
     K18L00A tC2018 06 02.35372316 10 48.154-11 21 08.95         18.3 GV~2i5UG96
     K18L00A tC2018 06 02.35894416 10 36.604-11 21 57.30         18.0 GV~2i5UG96
"""
STUDY = """schema_version: 1
study: small
mission: minimal
vary: {noise: {set: telescopes.*.noise.sigma, values: [0.1 arcsec, 1 arcsec]}}
answer: [{name: later, of: predictions.ten days later.semi_axes_km.0}]
"""
PROBE = """<!DOCTYPE html><body style="margin:0"><pre id="found"></pre><script>
const pages = %s, found = {}, widths = [390, 1280];
let left = Object.keys(pages).length * widths.length;
for (const [kind, page] of Object.entries(pages)) for (const width of widths) {
  const frame = document.createElement("iframe");
  frame.style = `width:${width}px;height:3000px;border:0`;
  frame.onload = () => {
    const d = frame.contentDocument;
    for (const one of d.querySelectorAll("details")) one.open = true;
    const seen = e => e.getBoundingClientRect().width > 0;
    const texts = [...d.querySelectorAll(".picture > svg text")].filter(seen);
    const boxes = [...d.querySelectorAll(".scroll, .picture")].filter(seen);
    found[`${kind} ${width}`] = {
      requests: frame.contentWindow.performance.getEntriesByType("resource").map(e => e.name),
      beyond: d.documentElement.scrollWidth - frame.clientWidth,
      head: [...d.querySelectorAll("header > *")].map(e => e.className || e.tagName),
      stamp: d.querySelector(".stamp").textContent,
      smallest: Math.min(99, ...texts.map(t => { const m = t.getScreenCTM(); return 10.5 * Math.hypot(m.a, m.b); })),
      cut: texts.filter(t => {
        const a = t.getBoundingClientRect(), b = t.ownerSVGElement.closest(".picture > svg").getBoundingClientRect();
        return a.left < b.left - 1.5 || a.right > b.right + 1.5;
      }).map(t => t.textContent),
      unmarked: boxes.filter(b => b.scrollWidth > b.clientWidth + 1 && (b.tabIndex < 0 ||
        !frame.contentWindow.getComputedStyle(b).backgroundImage.includes("gradient"))).length,
      lines: [...d.querySelectorAll("#verdict > h2, #verdict .answers dd > p, #verdict .warning > p, #verdict > p")]
        .map(e => [e.textContent.trim(), e.getBoundingClientRect().height
          / parseFloat(frame.contentWindow.getComputedStyle(e).lineHeight)]),
      questions: [...d.querySelectorAll("#verdict .answers dt")].map(e => e.textContent),
      numbers: [...d.querySelectorAll(".number")].map(e => e.textContent),
    };
    if (!--left) document.getElementById("found").textContent = JSON.stringify(found);
  };
  frame.srcdoc = page;
  document.body.append(frame);
}
</script></body>"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, minimal_folder: Path) -> dict[str, Path]:
    """A page of each kind, by its command."""
    place = tmp_path_factory.mktemp("family")
    (place / "la.obs80").write_text(LA)
    (place / "study.yaml").write_text(STUDY)
    run, other = str(minimal_folder), str(place / "other")
    shutil.copytree(run, other)
    spans = {"e": ("2028-04-01", "2028-04-03"), "f": ("2028-04-02", "2028-04-04")}
    orbits = [
        ["ephemeris", run, "--from", a, "--to", b, "--step", "12 h", "-o", str(place / k)]
        for k, (a, b) in spans.items()
    ]
    commands = {
        "plan": ["plan", "minimal", "-k", "2", "--page", str(place / "plan.html")],
        "compare": ["compare", run, other, "--page", str(place / "compare.html")],
        "ephemeris": orbits[0],
        "other": orbits[1],
        "compare-orbits": ["compare", orbits[0][-1], orbits[1][-1], "--page", str(place / "orbits.html")],
        "validate": ["validate", "minimal", "-n", "20", "--workers", "1", "-o", str(place / "validate")],
        "study": ["study", str(place / "study.yaml"), "--workers", "1", "-o", str(place / "study")],
        "approaches": ["approaches", run, "--from", "2028-01-01", "--to", "2028-12-01", "--within", "0.5 au",
                       "-o", str(place / "approaches")],
        "risk": ["risk", run, "--until", "2028-12-01", "--draws", "30", "-o", str(place / "risk")],
        "alert": ["alert", str(place / "la.obs80"), "--hours", "1", "-o", str(place / "alert")],
        "fit": ["fit", str(place / "la.obs80"), "-o", str(place / "fit")],
    }  # fmt: skip
    for name, words in commands.items():
        assert main(words) in (0, 1), name
    files = {"plan": place / "plan.html", "compare": place / "compare.html", "compare-orbits": place / "orbits.html"}
    folders = {kind: place / kind for kind in KINDS if kind not in files}
    folders |= {"run": minimal_folder, "ephemeris": place / "e"}
    return files | {kind: next(folder.glob("*.html")) for kind, folder in folders.items()}


@pytest.fixture(scope="module")
def seen(pages: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What one browser finds on all of them, at two widths."""
    scratch = tmp_path_factory.mktemp("browser")
    every = json.dumps({kind: path.read_text("utf-8") for kind, path in pages.items()})
    probe = scratch / "probe.html"
    probe.write_text(PROBE % every.replace("</", "<\\/").replace("<!--", "<\\!--"), "utf-8")
    done = subprocess.run(
        [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--enable-logging=stderr",
         f"--user-data-dir={scratch / 'profile'}", "--window-size=1800,2000", "--virtual-time-budget=20000",
         "--dump-dom", probe.as_uri()],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout)
    assert match, done.stderr[-2000:]
    found: dict[str, dict[str, Any]] = json.loads(html.unescape(match[1]))
    return found


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("kind", KINDS)
def test_a_page_of_each_kind_fits_and_can_be_read(seen: dict[str, dict[str, Any]], kind: str, width: int) -> None:
    one = seen[f"{kind} {width}"]
    assert one["requests"] == []
    assert one["beyond"] <= 0
    assert one["cut"] == []
    assert one["smallest"] >= SMALLEST_PX
    assert one["unmarked"] == 0  # what scrolls is marked, and can be reached by the keyboard
    assert [name for name in one["head"] if name != "contents"] == ["kicker", "H1", "lead", "stamp"]
    assert "nebosvod " in one["stamp"]
    for word in ("Figure", "Table"):
        numbers = [int(text.split()[1].rstrip(".")) for text in one["numbers"] if text.startswith(word)]
        assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize("kind", KINDS)
def test_the_answer_is_told_in_rows_of_two_lines(seen: dict[str, dict[str, Any]], kind: str) -> None:
    """At 1280 px; what else is to be said stands one click behind."""
    lines = seen[f"{kind} 1280"]["lines"]
    assert lines
    assert [text for text, n in lines if n > 2.1] == []
    if kind not in ("ephemeris", "approaches", "compare-orbits"):  # these give places, not how good something is
        assert "Can it be believed" in seen[f"{kind} 1280"]["questions"]


def empty_parts(pdf_file: Path) -> list[float]:
    """Which part of each sheet is empty at its foot, as Poppler draws it."""
    command = ["pdftoppm", "-r", str(PAPER_DPI), "-gray", str(pdf_file), str(pdf_file.with_suffix(""))]
    subprocess.run(command, check=True, capture_output=True)
    parts = []
    for sheet in sorted(pdf_file.parent.glob(f"{pdf_file.stem}-*.pgm")):
        dark = imread(sheet) < 225
        first, last = (round(len(dark) * part) for part in (HEAD_MM / SHEET_MM, 1.0 - FOOT_MM / SHEET_MM))
        inked = np.flatnonzero(dark[first + 1 : last - 1].any(axis=1))
        parts.append(1.0 - (inked[-1] + 1 if len(inked) else 0) / (last - first - 2))
    return parts


@pytest.mark.skipif(not shutil.which("pdftoppm"), reason="needs poppler-utils")
def test_no_sheet_but_the_last_is_a_third_empty(pages: dict[str, Path], tmp_path: Path) -> None:
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab = browser.new_page()
        for kind, path in pages.items():
            tab.goto(path.as_uri())
            tab.pdf(path=tmp_path / f"{kind}.pdf", prefer_css_page_size=True)
        browser.close()
    holes = {kind: empty_parts(tmp_path / f"{kind}.pdf")[:-1] for kind in pages}
    assert {kind: parts for kind, parts in holes.items() if any(part > EMPTY for part in parts)} == {}
    assert sum(len(parts) for parts in holes.values()) > 15  # there were sheets to look at
