"""What if: sliders of the page, moved in a real browser, against runs of missions that say the same."""

import html
import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from nebosvod import load_mission
from nebosvod.cli import main
from nebosvod.pipeline import run
from nebosvod.report.run import what_if
from nebosvod.report.run.page import make_report
from nebosvod.results.result import Result

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-extensions", "--enable-logging=stderr",
)  # fmt: skip

MISSION = """
schema_version: 1
name: asked
reference_epoch: 2028-03-20T00:00:00 TDB
object:
  name: Example
  orbit: {kind: keplerian, frame: ecliptic_j2000, epoch: 2028-03-20T00:00:00 TDB, a: 1.3 au,
          e: 0.2, i: 8 deg, node: 0 deg, peri: 180 deg, M: 0 deg}
  radius: {value: 10 m, sigma: 2 m, treatment: estimated}
  mass: {value: 8e6 kg, sigma: 2e6 kg, treatment: considered}
  albedo: {value: 0.15, sigma: 0.05, treatment: estimated}
prior: {sigma: {position: 40 km, velocity: 0.05 m/s}}
telescopes:
  - name: A
    orbit: {kind: heliocentric, lead: 10 deg}
    noise: {sigma: 0.1 arcsec}
    bias: {sigma: 0.05 arcsec, treatment: estimated}
    position: {sigma: 3 km, correlation: white, treatment: estimated}
  - name: B
    orbit: {kind: heliocentric, lead: -10 deg}
    noise: {sigma: 0.12 arcsec}
    bias: {sigma: 0.06 arcsec, treatment: considered}
    position: {sigma: 4 km, correlation: gauss_markov, time: 5 d, treatment: estimated}
  - {name: C, orbit: {kind: heliocentric, lead: 5 deg}, noise: {sigma: 0.2 arcsec}}
shared:
  - {name: frame, telescopes: [A, B], position: {sigma: 5 km, correlation: constant, treatment: considered}}
  - {name: clock, position: {sigma: 2 km, correlation: gauss_markov, time: 2 d, treatment: considered}}
  - {name: time, timing: {sigma: 0.5 s, treatment: estimated}}
schedule:
  - {start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 1 d}
estimators: [{name: batch, method: batch_qr}]
predictions:
  - {name: ten days later, plane: position, at: 2028-04-29T00:00:00 TDB}
  - {name: sky, plane: sky, from: A, at: 2028-05-09T00:00:00 TDB}
  - {name: far, plane: distance, from: B, at: 2028-05-09T00:00:00 TDB}
"""
# what is written into the fields of the page, chosen in its lists -> the same in the mission
SIZES = {
    "measurement noise A": ("0.04", "noise: {sigma: 0.1 arcsec}", "noise: {sigma: 0.04 arcsec}"),
    "bias A": ("0.15", "bias: {sigma: 0.05 arcsec", "bias: {sigma: 0.15 arcsec"),
    "telescope position A": ("9", "position: {sigma: 3 km", "position: {sigma: 9 km"),
    "telescope position B": ("1", "position: {sigma: 4 km", "position: {sigma: 1 km"),
    "frame": ("2.5", "position: {sigma: 5 km", "position: {sigma: 2.5 km"),
    "clock": ("6", "position: {sigma: 2 km", "position: {sigma: 6 km"),
    "time": ("1.5", "timing: {sigma: 0.5 s", "timing: {sigma: 1.5 s"),
    "radius": ("1", "sigma: 2 m, treatment", "sigma: 1 m, treatment"),
    "prior orbit": ("0.5", "{position: 40 km, velocity: 0.05 m/s}", "{position: 20 km, velocity: 0.025 m/s}"),
}
TREATMENTS = {
    "bias B": ("estimated", "0.06 arcsec, treatment: considered", "0.06 arcsec, treatment: estimated"),
    "telescope position A": ("considered", "white, treatment: estimated", "white, treatment: considered"),
    "frame": ("estimated", "constant, treatment: considered", "constant, treatment: estimated"),
    "clock": ("estimated", "2 d, treatment: considered", "2 d, treatment: estimated"),
    "time": ("ignored", "s, treatment: estimated", "s, treatment: ignored"),
    "mass": ("estimated", "2e6 kg, treatment: considered", "2e6 kg, treatment: estimated"),
    "albedo": ("fixed", "0.05, treatment: estimated", "0.05, treatment: fixed"),
}
# with the gain as it is the truth alone is another: the assumption stays
TRUTHS = {
    "measurement noise A": ("0.04", "noise: {sigma: 0.1 arcsec}", "noise: {sigma: 0.1 arcsec, true: {sigma: 0.04 arcsec}}"),  # noqa: E501
    "bias B": ("0.3", "{sigma: 0.06 arcsec,", "{sigma: 0.06 arcsec, true: {sigma: 0.3 arcsec},"),
    "telescope position B": ("12", "{sigma: 4 km,", "{sigma: 4 km, true: {sigma: 12 km},"),
    "frame": ("1", "{sigma: 5 km,", "{sigma: 5 km, true: {sigma: 1 km},"),
}  # fmt: skip
PROBE = """<!DOCTYPE html><body><iframe id="page" style="width:1200px;height:9000px"></iframe>
<pre id="found"></pre><script>
const page = %s, cases = %s, frame = document.getElementById("page");
const wait = ms => new Promise(done => setTimeout(done, ms));
frame.onload = async () => {
  const d = frame.contentDocument, w = frame.contentWindow, section = d.getElementById("what-if"), found = [];
  const fire = (e, kind) => e.dispatchEvent(new w.Event(kind, { bubbles: true }));
  for (const one of cases) {
    section.querySelector("button").click();
    const way = section.querySelector(`input[value="${one.way}"]`);
    way.checked = true; fire(way, "change");
    for (const [name, text] of Object.entries(one.sizes)) {
      const field = section.querySelector(`input[type=number][data-source="${name}"]`);
      field.value = text; fire(field, "input");
    }
    for (const [name, text] of Object.entries(one.treatments)) {
      const list = section.querySelector(`select[data-of="${name}"]`);
      list.value = text; fire(list, "change");
    }
    await wait(300);
    const rows = Object.fromEntries([...section.querySelectorAll("tr[data-prediction]")].map(row => [
      row.dataset.prediction, [...row.querySelectorAll("data")].map(e => Number(e.value))]));
    section.querySelectorAll("input[name=what-if-shown]")[1].click();  // the one in a plane
    await wait(50);
    found.push({ rows, hidden: section.hidden, drawn: section.querySelectorAll("svg path").length });
  }
  document.getElementById("found").textContent = JSON.stringify({ found,
    requests: w.performance.getEntriesByType("resource").length });
};
frame.srcdoc = page;
</script></body>"""


def nominal(text: str, folder: Path) -> Result:
    """The run of a mission in which no error is drawn."""
    folder.mkdir(exist_ok=True)
    (folder / "asked.yaml").write_text(text, "utf-8")
    return run(load_mission(folder / "asked.yaml"), nominal=True)


def changed(*sets: dict[str, tuple[str, str, str]]) -> str:
    """The mission with other words in some places."""
    text = MISSION
    for one in sets:
        for _, old, new in one.values():
            assert text.count(old) == 1, old
            text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the mission as it stands."""
    scratch = tmp_path_factory.mktemp("asked")
    (scratch / "asked.yaml").write_text(MISSION, "utf-8")
    assert main(["run", str(scratch / "asked.yaml"), "--nominal", "-o", str(scratch / "run")]) == 0
    return scratch / "run"


def moved(folder: Path, cases: list[dict[str, Any]], scratch: Path) -> list[dict[str, Any]]:
    """Move what the cases say in the page of a folder, in a browser; returns what the page then shows."""
    page = json.dumps(make_report(folder)).replace("</", "<\\/").replace("<!--", "<\\!--")
    path = scratch / "probe.html"
    path.write_text(PROBE % (page, json.dumps(cases)), "utf-8")
    done = subprocess.run(
        [str(BROWSER), *QUIET, f"--user-data-dir={scratch / 'profile'}", "--virtual-time-budget=20000", "--dump-dom",
         path.as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout, re.S)
    assert match, done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr
    found: dict[str, Any] = json.loads(html.unescape(match[1]))
    assert found["requests"] == 0
    return list(found["found"])


def totals(result: Result) -> dict[str, tuple[float, list[float]]]:
    """Total sigma and semi-axes of every prediction."""
    told = {}
    for row in result.summary["predictions"]:
        unit = next(key.removeprefix("semi_axes_") for key in row if key.startswith("semi_axes_"))
        told[row["name"]] = (math.hypot(*row[f"sigma_{unit}"]), row[f"semi_axes_{unit}"])
    return told


def parts(sets: dict[str, tuple[str, str, str]]) -> dict[str, str]:
    """What is written into the page."""
    return {name: said for name, (said, _, _) in sets.items()}


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_sliders_say_what_a_run_of_the_changed_mission_says(asked: Path, tmp_path: Path) -> None:
    """Re-optimised: sizes and treatments, of all kinds of sources; as it is: a mission whose truth is another."""
    cases: list[dict[str, Any]] = [
        {"way": "solved", "sizes": {}, "treatments": {}},
        {"way": "solved", "sizes": parts(SIZES), "treatments": {}},
        {"way": "solved", "sizes": parts(SIZES), "treatments": parts(TREATMENTS)},
        {"way": "held", "sizes": parts(TRUTHS), "treatments": {}},
    ]
    texts = [changed(SIZES), changed(SIZES, TREATMENTS), changed(TRUTHS)]
    wanted = [totals(Result.load(asked)), *(totals(nominal(text, tmp_path / str(k))) for k, text in enumerate(texts))]
    for shown, true in zip(moved(asked, cases, tmp_path), wanted):
        assert not shown["hidden"]
        for name, (total, axes) in true.items():
            _, now, *rest = shown["rows"][name]
            assert now == pytest.approx(total, rel=1e-9)
            assert rest[: len(axes)] == pytest.approx(axes, rel=1e-8)
        assert shown["drawn"] >= 4  # axes, two ellipses, a scale
    assert all(abs(wanted[0][name][0] / true[name][0] - 1.0) > 0.01 for true in wanted[1:] for name in true)


def test_the_block_is_hidden_without_its_script_and_asks_for_nothing(asked: Path) -> None:
    page = make_report(asked)
    assert re.search(r'<section id="what-if" hidden>', page)
    assert len(page) < 3_000_000
    data = json.loads(re.search(r'id="what-if-data">(.*?)</script>', page, re.S)[1])  # type: ignore[index]
    assert {source["kind"] for source in data["sources"]} == {"noise", "prior", "white", "markov"}
    assert data["reason"] is None


def test_measurements_that_take_too_much_room_are_left_out_and_that_is_said(
    asked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(what_if, "MOST_BYTES", 1000)
    page = make_report(asked)
    data = json.loads(re.search(r'id="what-if-data">(.*?)</script>', page, re.S)[1])  # type: ignore[index]
    assert "more room than a page has" in data["reason"]
    assert data["reason"] in page.partition('id="what-if-data"')[0]
    assert all(name.startswith("what_if_shares_") for name in data["arrays"])


def test_no_error_is_drawn_where_none_is_asked_for(asked: Path) -> None:
    """The estimate of a nominal run is the reference orbit, and its measurements are those computed there."""
    found = Result.load(asked)
    assert abs(found.arrays["residual"]).max() == 0.0
    reference, state = found.summary["reference"], found.summary["estimators"][0]["state_km_km_s"]
    assert state == pytest.approx(reference["position_km"] + reference["velocity_km_s"], rel=1e-12)
    assert any("no error was drawn" in said for said in found.summary["assumptions"])
