"""The page in a real browser, where one is installed: silent, asks for nothing, fits."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from nebosvod.report.page import make_report

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


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_page_is_quiet_asks_for_nothing_and_fits_phone_and_laptop(run_folder: Path, tmp_path: Path) -> None:
    text = json.dumps(make_report(run_folder)).replace("</", "<\\/").replace("<!--", "<\\!--")
    probe = tmp_path / "probe.html"
    probe.write_text(PROBE % text, "utf-8")
    done = subprocess.run(
        [str(BROWSER), *QUIET, f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1800,3200",
         "--virtual-time-budget=8000", "--dump-dom", probe.as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout)
    assert match, done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr
    found: dict[str, dict[str, Any]] = json.loads(html.unescape(match[1]))
    for name in ("phone", "laptop"):
        assert found[name]["requests"] == []
        assert found[name]["scroll"] <= found[name]["width"]
        assert len(found[name]["pictures"]) == 8
        assert min(found[name]["pictures"]) > 100
        assert found[name]["cut"] == []
