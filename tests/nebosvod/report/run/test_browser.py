"""The page in a real browser, where one is installed: silent, asks for nothing, fits."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from nebosvod.report.kit.wording import scale_of
from nebosvod.report.run.ledger import ledgers
from nebosvod.report.run.page import make_report
from nebosvod.results.folder import read_folder

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-extensions", "--enable-logging=stderr",
)  # fmt: skip
PROBE = """<!DOCTYPE html><body style="margin:0">
<iframe id="phone" style="width:390px;height:3000px"></iframe>
<iframe id="laptop" style="width:1280px;height:3000px"></iframe>
<pre id="found"></pre><script>
const page = %s, found = {}, names = ["phone", "laptop"];
for (const name of names) {
  const frame = document.getElementById(name);
  frame.onload = () => {
    const d = frame.contentDocument, pictures = [...d.querySelectorAll(".picture > svg")];
    found[name] = {
      requests: frame.contentWindow.performance.getEntriesByType("resource").map(e => e.name),
      width: frame.clientWidth, scroll: d.documentElement.scrollWidth,
      pictures: pictures.map(p => Math.round(p.getBoundingClientRect().height)),
      cut: pictures.flatMap(p => [...p.querySelectorAll("text")].filter(t => {
        const a = t.getBoundingClientRect(), b = p.getBoundingClientRect();
        return a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1;
      }).map(t => t.textContent)),
    };
    if (Object.keys(found).length == names.length) document.getElementById("found").textContent = JSON.stringify(found);
  };
  frame.srcdoc = page;
}
</script></body>"""


def browse(probe: str, folder: Path, scratch: Path) -> subprocess.CompletedProcess[str]:
    """Open a page of ours inside a probe page; returns what the browser printed, the probe's document among it."""
    text = json.dumps(make_report(folder)).replace("</", "<\\/").replace("<!--", "<\\!--")
    path = scratch / "probe.html"
    path.write_text(probe % text, "utf-8")
    return subprocess.run(
        [str(BROWSER), *QUIET, f"--user-data-dir={scratch / 'profile'}", "--window-size=1800,3200",
         "--virtual-time-budget=8000", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_page_is_quiet_asks_for_nothing_and_fits_phone_and_laptop(real_folder: Path, tmp_path: Path) -> None:
    done = browse(PROBE, real_folder, tmp_path)
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout)
    assert match, done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr
    found: dict[str, dict[str, Any]] = json.loads(html.unescape(match[1]))
    for name in ("phone", "laptop"):
        assert found[name]["requests"] == []
        assert found[name]["scroll"] <= found[name]["width"]
        seen = [height for height in found[name]["pictures"] if height]
        assert len(seen) == 14  # of geometry, timeline and each target plane the one for this width
        assert min(seen) > 80
        assert found[name]["cut"] == []


TOUCH = """<!DOCTYPE html><body style="margin:0">
<iframe id="page" style="width:1200px;height:9000px"></iframe>
<pre id="found"></pre><script>
const page = %s, found = {}, frame = document.getElementById("page");
frame.onload = () => {
  const d = frame.contentDocument, w = frame.contentWindow, tip = d.querySelector(".tip");
  const move = (e, x, y) => {
    e.dispatchEvent(new w.PointerEvent("pointermove", {clientX: x, clientY: y, bubbles: true}));
    return tip.hidden ? null : tip.textContent;
  };
  const view = d.querySelector("svg.view"), box = view.getBoundingClientRect(), home = view.getAttribute("viewBox");
  found.centre = move(view, box.left + box.width / 2, box.top + box.height / 2);
  const tools = view.ownerSVGElement.parentNode.previousElementSibling.querySelectorAll("button");
  tools[0].click();
  found.zoomed = view.getAttribute("viewBox");
  found.ticks = view.ownerSVGElement.querySelectorAll(".axes text").length;
  tools[2].click();
  found.home = view.getAttribute("viewBox") === home;
  const path = d.querySelector("#nuisance g.panel .s"), svg = path.ownerSVGElement;
  const [a, b] = path.getAttribute("d").match(/M(-?[\\d.]+) (-?[\\d.]+)/).slice(1).map(Number);
  const p = new w.DOMPoint(a, b).matrixTransform(svg.getScreenCTM());
  found.point = move(svg, p.x, p.y);
  const bar = d.querySelector("#budget-shares g.panel g path"), r = bar.getBoundingClientRect();
  found.bar = move(bar, r.left + 2, r.top + 2);
  const table = d.querySelector("table.budget"), live = table.querySelector(".live");
  const boxes = table.querySelectorAll("input");
  found.before = live.textContent;
  boxes[0].click();
  found.one = live.textContent;
  boxes[1].click();
  found.two = live.textContent;
  document.getElementById("found").textContent = JSON.stringify(found);
};
frame.srcdoc = page;
</script></body>"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_pointer_zoom_and_switches_tell_the_numbers_of_the_page(real_folder: Path, tmp_path: Path) -> None:
    done = browse(TOUCH, real_folder, tmp_path)
    assert "CONSOLE" not in done.stderr
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout)
    assert match, done.stderr[-2000:]
    found: dict[str, Any] = json.loads(html.unescape(match[1]))
    run = read_folder(real_folder)
    book = ledgers(run, run.estimators[0])[0]
    eta = run.summary["noise_to_nuisance"]["eta_db"][0]
    assert re.match(r"Δ RA cos Dec .*: on the .*σ ellipse, which holds 0.0 %", found["centre"])
    assert float(found["zoomed"].split()[2]) < 170
    assert found["ticks"] >= 4
    assert found["home"]
    assert found["point"].startswith("ahead: 2028-03-20 00:00 TDB, noise to nuisance")
    assert float(found["point"].split()[-2]) == pytest.approx(eta, abs=0.02)
    assert found["bar"].startswith(f"{book.title}: {book.entries[0].source.split()[0]}")
    first, second = book.entries[:2]
    factor = scale_of(book.total, book.unit)[0]
    left = [book.total * factor * (1 - s) ** 0.5 for s in (first.share, first.share + second.share)]
    assert "untick" in found["before"]
    assert f"without: {left[0]:.3g}" in found["one"]
    assert f"re-optimised {factor * (first.then['if_vanished', 'new'] or 0):.3g}" in found["one"]
    assert f"without: {left[1]:.3g}" in found["two"]
    assert "re-optimised" not in found["two"]
