"""What axe-core and a look of our own find wrong with a page in a browser, for who cannot see it, or has no pointer."""

import re
from pathlib import Path
from typing import Any

import axe_playwright_python
from playwright.sync_api import Page

AXE = (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text("utf-8")
LOOK = """async () => {
  for (const box of document.querySelectorAll("details")) box.open = true;
  const found = await axe.run(document, {resultTypes: ["violations", "incomplete"]});
  const told = found.violations.flatMap(one =>
    one.nodes.map(n => `${one.id}: ${n.target.join(" ")} ${n.html.slice(0, 120)}`));
  // where axe cannot tell what lies behind a text (figures, tables with a shadow), it is held against the paper
  const light = colour => {
    const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const [r, g, b] = colour.match(/[\\d.]+/g).map(v => linear(v / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = e => {
    for (; e; e = e.parentElement) {
      const colour = getComputedStyle(e).backgroundColor;
      if (!/, 0\\)$/.test(colour) && colour !== "transparent") return colour;
    }
    return "rgb(255, 255, 255)";
  };
  for (const one of found.incomplete.filter(one => one.id === "color-contrast")) for (const node of one.nodes) {
    const e = document.querySelector(node.target[0]);
    if (!e || !e.getClientRects().length) continue;
    const style = getComputedStyle(e), paper = behind(e), ink = e instanceof SVGElement ? style.fill : style.color;
    const [a, b] = [light(ink), light(paper)], ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) told.push(`contrast ${ratio.toFixed(2)}: ${ink} on ${paper}: ${node.html.slice(0, 120)}`);
  }
  for (const e of document.querySelectorAll("svg")) {
    const named = e.getAttribute("role") === "img" && (e.getAttribute("aria-label") || "").trim();
    if (e.getClientRects().length && !named && !e.closest("[aria-hidden=true]") && !e.parentElement.closest("svg"))
      told.push(`a picture without words: ${e.outerHTML.slice(0, 120)}`);
  }
  const ids = [...document.querySelectorAll("[id]")].map(e => e.id);  // a link to one of two leads to the first
  for (const id of new Set(ids.filter((one, k) => ids.indexOf(one) !== k))) told.push(`an id that stands twice: ${id}`);
  return told;
}"""


def wrong_for_some(page: Page) -> list[str]:
    """What is wrong with the page as it stands in a browser whose context bypasses its policy; details are opened."""
    page.evaluate(AXE)
    found: Any = page.evaluate(LOOK)
    return sorted({re.sub(r"\s+", " ", one) for one in found})
