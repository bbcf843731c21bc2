"""The page of a risk: from the folder alone, its answer in words, every fate drawn, hostile text harmless."""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from nebosvod.borders.shape import require_shape, schema_file
from nebosvod.cli import main
from nebosvod.commands.risk_answer import print_risk
from nebosvod.dynamics import Ephemeris
from nebosvod.impacts.risk import risk
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.report.risk.draws import draws_of, is_weighed
from nebosvod.report.risk.figures import by_weight, plane_plates, ways_plate
from nebosvod.report.risk.page import make_risk_page
from nebosvod.report.risk.tables import corridor_table, level_table
from nebosvod.report.risk.words import agreement, chance, headline
from nebosvod.results.folder import SCHEMAS
from nebosvod.results.risk_folder import risk_result
from nebosvod.timescale import Epoch

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def summary(risk_folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((risk_folder / "summary.json").read_text("utf-8"))
    return found


@pytest.fixture(scope="module")
def page(risk_folder: Path) -> str:
    return make_risk_page(risk_folder)


def figure(page: str, key: str) -> str:
    return page[page.index(f'<figure id="{key}"') :].split("</figure>")[0]


def plain(text: str) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", text)).replace("\xa0", " ")


def test_the_summary_has_the_shape_of_its_schema(summary: dict[str, Any]) -> None:
    schema = schema_file(SCHEMAS["risk"])
    jsonschema.validate(summary, schema)
    require_shape("summary", summary, schema)
    jsonschema.Draft202012Validator.check_schema(schema)


def test_the_headline_says_how_probable_when_whether_the_ways_agree_and_who_is_to_blame(
    summary: dict[str, Any],
) -> None:
    said = plain(str(headline(summary)))
    row = summary["virtual_impactors"][0]
    p, low, high = (f"{100.0 * row[key]:.1f}" for key in ("probability", "low", "high"))
    assert said == (
        f"{p} % ({low} to {high}) on 2038-07-10 to hit the Earth; line of variations misleads; "
        "star catalogue Gaia2 is to blame for 60 %"
    )


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ((0.184, 0.181, 0.187, False), "18.4 % (18.1 to 18.7)"),
        ((0.2, 0.1, 0.3, False), "20 % (10 to 30)"),
        ((0.0428, 0.0424, 0.0432, False), "4.28 % (4.24 to 4.32)"),
        ((3.7e-4, 2e-4, 6e-4, False), "3.7 × 10⁻⁴ (2.0 × 10⁻⁴ to 6.0 × 10⁻⁴), one in 2700"),
        ((None, 0.0, 3e-4, True), "below 3.0 × 10⁻⁴ (95 %)"),
        ((None, 0.0, 0.03, True), "below 3.0 % (95 %)"),
        ((1.0, 0.997, 1.0, False), "100.00 % (99.70 to 100.00)"),
        ((0.0035, 0.00141, 0.0072, False), "0.35 % (0.14 to 0.72)"),
        ((0.00118, 0.00118, 0.00118, False), "0.118 %"),
        ((0.185, 0.185, 0.185, False), "18.5 %"),
        ((0.99997, 0.99997, 0.99997, False), "99.9970 %"),
    ],
)
def test_probabilities_have_the_digits_that_their_intervals_leave(row: tuple[Any, ...], said: str) -> None:
    assert plain(str(chance(dict(zip(("probability", "low", "high", "bound"), row))))) == said


@pytest.mark.parametrize(
    ("other", "agrees"),
    [
        ((0.187, 0.187, 0.187, False), True),  # within 5 %
        ((0.21, 0.19, 0.23, False), True),  # 2.5 standard errors
        ((0.88, 0.88, 0.88, False), False),
        ((None, 0.0, 0.01, True), False),  # none of 300 hit
        ((None, 0.0, 0.6, True), True),
    ],
)
def test_ways_agree_when_both_can_be_right(other: tuple[Any, ...], agrees: bool) -> None:
    keys = ("probability", "low", "high", "bound")
    ways = [
        dict(zip(keys, (0.184, 0.181, 0.187, False)), way="sampling"),
        dict(zip(keys, other), way="linear"),
    ]
    agree, apart = agreement({"recommended": "sampling", "ways": ways})
    assert ("linear" in agree) is agrees
    assert len(apart) == (not agrees)


def test_a_way_without_an_answer_is_told_and_not_counted(risk_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "risk"
    shutil.copytree(risk_folder, folder)
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    line = summary["virtual_impactors"][0]["ways"][1]
    line |= {"probability": None, "low": 0.0, "high": 1.0, "bound": True, "draws": 0, "hits": 0, "note": "nothing near"}
    (folder / "summary.json").write_text(json.dumps(summary), "utf-8")
    page = make_risk_page(folder)
    assert "to hit the Earth; linear and sampling agree; star catalogue" in plain(page)
    table = plain(page[page.index('id="table-ways-0"') :].split("</table>")[0].replace("<td", " <td"))
    assert "line of variations no answer — — nothing near" in table
    assert "line of variations" not in figure(page, "ways-0")


def test_what_would_become_of_it_if_the_worst_source_were_halved_is_said(page: str, summary: dict[str, Any]) -> None:
    p = 1.6 * summary["virtual_impactors"][0]["probability"]
    said = f"Were star catalogue Gaia2 halved and the estimate the same, it would be {100.0 * p:.1f} %"
    assert said in plain(page)


def test_a_rare_impactor_is_shown_by_draws_of_its_own_its_places_by_their_weights(risk_folder: Path) -> None:
    with np.load(risk_folder / "arrays.npz") as stored:
        arrays = dict(stored)
    own = {"weights": np.repeat([1e-6, 1e-9], [50, 50]), "hits": np.ones(100, dtype=bool)}
    own |= {"longitude_deg": np.repeat([10.0, 90.0], [50, 50]), "latitude_deg": np.zeros(100)}
    arrays |= {f"weighed_0_{name}": value for name, value in own.items()}
    assert not is_weighed(0, arrays)  # hundreds of plain draws hit
    arrays["hits_0"] = np.zeros(3000, dtype=bool)
    assert is_weighed(0, arrays)
    chosen = by_weight(draws_of(0, arrays), np.ones(100, dtype=bool))
    # a thousandth of the weight: one of the 1500 places at most
    assert np.count_nonzero(own["longitude_deg"][chosen] > 50.0) <= 2
    assert len(chosen) >= 50


def test_the_ellipse_stands_where_the_draws_have_the_estimate(risk_folder: Path, summary: dict[str, Any]) -> None:
    with np.load(risk_folder / "arrays.npz") as stored:
        arrays = dict(stored)
    arrays["line_sigmas"] = np.linspace(-5.0, 5.0, 41)
    arrays["line_xi_zeta_km_0"] = arrays["line_xi_zeta_km_0"] + [700.0, -300.0]
    row = summary["virtual_impactors"][0]
    (ellipse,) = (file for file in plane_plates(row, arrays)[0].data if file.name == "target-0-ellipse.csv")
    points = np.array([line.split(",")[:2] for line in ellipse.text.splitlines()[1:]], dtype=float)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    assert middle == pytest.approx([row["approach"]["xi_km"] + 700.0, row["approach"]["zeta_km"] - 300.0], abs=1.0)


def test_every_hit_is_seen_near_the_earth_and_the_line_of_variations_with_it(risk_folder: Path, page: str) -> None:
    near = figure(page, "target-0").split('<g class="axes">')[2]
    marks = dict(re.findall(r'<(?:path|g) class="s" data-n="([^"]+)"(.+)', near))
    arrays = np.load(risk_folder / "arrays.npz")
    assert marks["drawn, hits"].count("M") == np.count_nonzero(arrays["hits_0"])
    assert "line of variations" in marks
    assert (
        'class="s" data-n="drawn, hits"' in figure(page, "target-1").split('<g class="axes">')[2]
    )  # the Moon has its own


def test_the_corridor_stands_on_a_map_and_in_a_table_from_end_to_end(risk_folder: Path, page: str) -> None:
    arrays = np.load(risk_folder / "arrays.npz")
    hits = arrays["hits_0"]
    dots = figure(page, "map-corridor").split('data-n="drawn orbits"')[1].split("/>")[0]
    assert dots.count("M") == np.count_nonzero(hits)
    first = np.flatnonzero(hits)[np.argmin(arrays["hit_t_s"][hits])]
    table = plain(page[page.index('id="table-corridor-1"') :].split("</table>")[0])
    east = arrays["longitude_deg"][first]
    assert f"{abs(east):.2f}° {'E' if east > 0 else 'W'}, {arrays['latitude_deg'][first]:.2f}° N" in table
    when = datetime(2026, 6, 21) + timedelta(seconds=float(arrays["hit_t_s"][first]) - 69.184)  # TDB - UTC
    assert any(f"{when + timedelta(seconds=k):%Y-%m-%d %H:%M:%S}" in table for k in (0, 1))  # rounded, not cut


def test_a_corridor_that_times_go_to_and_fro_along_is_told_from_end_to_end() -> None:
    """Hits along a line, the middle one first in time, as the Earth's curve has it: places must not jump."""
    s = np.linspace(-1.0, 1.0, 101)
    arrays = {
        "weights": np.ones(101), "hit_body": np.full(101, "earth"), "hit_t_s": 600.0 * (s - 0.2) ** 2,
        "longitude_deg": 60.0 * s, "latitude_deg": 5.0 * s, "speed_km_s": np.full(101, 20.0),
        "elevation_deg": np.full(101, 45.0), "hits_0": np.ones(101, dtype=np.bool_),
        "grazes_0": np.zeros(101, dtype=np.bool_), "xi_zeta_km_0": np.stack([100.0 * s, 5000.0 * s], axis=1),
    }  # fmt: skip
    table = corridor_table({"body": "earth", "number": 0}, arrays, "2030-01-01T00:00:00 TDB")
    assert table is not None
    assert [plain(str(row[2]))[:6] for row in table.rows] in (
        ["60.00°", "54.00°", "30.00°", "0.00° ", "30.00°", "54.00°", "60.00°"],
        ["60.00°", "54.00°", "30.00°", "0.00°", "30.00°", "54.00°", "60.00°"],
    )
    assert [row[0] for row in table.rows][::6] == ["one end", "the other end"]


def test_an_entry_at_100_km_is_told_of_the_earth_alone() -> None:
    one = {
        "epoch_utc": "2032-12-22T15:18:26 UTC", "sigma_time_s": 54.3, "longitude_deg": None, "latitude_deg": None,
        "no_ellipse": "of the Earth alone", "semi_major_km": None, "semi_minor_km": None, "angle_from_east_deg": None,
        "speed_km_s": 14.1, "below_horizon_deg": 40.6,
    }  # fmt: skip
    told = {}
    for body in ("earth", "moon"):
        table = level_table({"body": body, "corridor": {"entry_100_km": one, "ground": one}})
        assert table is not None
        told[body] = [row[0] for row in table.rows]
    assert told == {"earth": ["100 km", "the ground"], "moon": ["the surface"]}


def test_long_lengths_are_written_out_on_a_terminal(
    summary: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    first = summary["virtual_impactors"][0] | {
        "sigmas": 0.5,
        "stretching_km": 98581.7,
        "budget": None,
        "no_budget": "unknown",
    }
    orbit = summary["orbit"] | {"sigma_position_km": 19705.2}
    print_risk(summary | {"orbit": orbit, "virtual_impactors": [first], "history": None}, None)
    said = capsys.readouterr().out
    assert "position known to 19,710 km (1 sigma" in said
    assert "one moves it by 98,580 km" in said
    assert "e+0" not in said


def test_a_budget_of_an_older_folder_has_no_reoptimised_elasticity(
    summary: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    """Its rows do not have the keys; one of today with them unknown says the same."""
    first = summary["virtual_impactors"][0] | {"sigmas": None, "no_budget": None}
    unknown = {"elasticity_reoptimised": None, "elasticity_reoptimised_error": None}
    rows = [row | unknown for row in first["budget"]["rows"]]
    assert not any(unknown.keys() & row.keys() for row in first["budget"]["rows"])
    said = []
    for one in (first, first | {"budget": first["budget"] | {"rows": rows}}):
        print_risk(summary | {"virtual_impactors": [one], "history": None}, None)
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert "star catalogue Gaia2" in said[0]
    assert "-0.30 +- 0.02" in said[0]
    assert "re-optimised" not in said[0]


def test_impactors_that_the_estimate_does_not_come_near_stand_in_the_table_of_the_folder(
    summary: dict[str, Any],
) -> None:
    """Of the first the estimate has no approach and no budget is known, of the second both: neither is a column."""
    unlike = ({"body": "earth", "approach": None, "budget": None, "sigmas": None}, {"body": "moon", "sigmas": 1.5})
    rows = [summary["virtual_impactors"][0] | one for one in unlike]
    assert isinstance(rows[1]["approach"], dict)
    assert isinstance(rows[1]["budget"], dict)
    state = np.array([1.2e8, 8e7, 3e7, -16.0, 22.0, 9.0])
    orbit = UncertainOrbit(
        name="made up", epoch=Epoch.parse("2030-01-01 TDB"), state=state, factor=np.diag([1.0] * 3 + [1e-6] * 3)
    )
    bodies = Ephemeris.load()
    found = risk(orbit, Epoch.parse("2030-01-05 TDB"), bodies, draws=1)
    table = risk_result(summary | {"virtual_impactors": rows}, found, bodies, "made up", 0.0).tables[
        "virtual_impactors"
    ]
    assert not {"approach", "budget", "ways"} & table.columns.keys()
    assert table.columns["body"].tolist() == ["earth", "moon"]
    assert np.isnan(table.columns["sigmas"][0])
    assert table.columns["sigmas"][1] == 1.5


def test_the_budget_the_ways_and_the_history_are_there(page: str, summary: dict[str, Any]) -> None:
    for key in ("budget-0", "ways-0", "ways-1", "chances-by-night"):
        assert figure(page, key)
    table = plain(page[page.index('id="table-budget-0"') :].split("</table>")[0].replace("<td", " <td"))
    p = summary["virtual_impactors"][0]["probability"]
    assert f"star catalogue Gaia2 −0.30 ± 0.02 60 % {100.0 * 1.6 * p:.1f} ± 1.0 %" in " ".join(table.split())
    assert "only a bound" in figure(page, "chances-by-night")


def test_the_page_is_one_file_that_asks_for_nothing_and_the_same_each_time(risk_folder: Path, page: str) -> None:
    assert make_risk_page(risk_folder) == page == (risk_folder / "report.html").read_text("utf-8")
    assert not re.findall(r'(?:src|href)="(?!#|data:)', page)
    assert "default-src 'none'" in html.unescape(page)


def test_hostile_names_are_text(make_risk_folder: Callable[..., Path], tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>\"'&{{7*7}}"
    folder = make_risk_folder(tmp_path / "evil", name=evil, warnings=[evil], ended=evil)
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    summary["virtual_impactors"][0]["budget"]["rows"][0]["source"] = evil
    summary["virtual_impactors"][0]["ways"][0]["way"] = evil
    summary["virtual_impactors"][0]["reason"] = evil
    (folder / "summary.json").write_text(json.dumps(summary), "utf-8")
    page = make_risk_page(folder)
    assert page.count("<script>") == 1  # its own
    assert "alert(1)</script>" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "49" not in plain(page).split("alert(1)")[1][:30]


def test_a_probability_of_nought_stands_at_the_edge_of_a_logarithmic_axis() -> None:
    """Warnings are errors here: the logarithm of nought is never asked for."""
    found = (("linear", 0.0, 0.0), ("line_of_variations", 2.2e-8, 2.2e-8), ("sampling", None, 3e-4))
    ways = [
        {"way": name, "probability": p, "low": p or 0.0, "high": high, "bound": p is None, "draws": 10_000, "hits": 0,
         "effective_hits": 0.0, "note": None}
        for name, p, high in found
    ]  # fmt: skip
    row = {"number": 0, "body": "earth", "epoch_utc": "2046-02-14T21:41:03 UTC", "ways": ways, "reason": "so",
           "recommended": "line_of_variations"}  # fmt: skip
    svg = str(ways_plate(row).svg)
    assert 'data-x="log ' in svg
    assert re.findall(r"<title>([^<]+)</title>", svg) == ["0"]
    assert not re.search(r"(?i)\bnan\b|inf\b", svg)


def test_without_a_hit_the_answer_is_a_bound(make_risk_folder: Callable[..., Path], tmp_path: Path) -> None:
    none = {"way": "sampling", "probability": None, "low": 0.0, "high": 0.001, "bound": True, "draws": 3000, "hits": 0,
            "effective_hits": 0.0, "note": None}  # fmt: skip
    folder = make_risk_folder(
        tmp_path / "none", virtual_impactors=[], n_virtual_impactors=0, sampling=none, history=None,
        palermo_cumulative=None,
    )  # fmt: skip
    page = plain(make_risk_page(folder))
    assert "No impact on the Earth or the Moon found until 2039-01-01: below 0.10 % (95 %)" in page
    assert "None of 3000 drawn orbits hits" in page


def test_report_makes_it_again_and_a_cut_folder_is_wrong_input(
    make_risk_folder: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_risk_folder(tmp_path / "risk")
    before = (folder / "report.html").read_bytes()
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == before
    text = (folder / "summary.json").read_text("utf-8")
    broken = json.loads(text)
    del broken["virtual_impactors"][0]["approach"]["xi_km"]
    for damage in (text[: len(text) // 2], json.dumps(broken)):
        (folder / "summary.json").write_text(damage, "utf-8")
        assert main(["report", str(folder)]) == 2
        assert "summary.json" in capsys.readouterr().err
    (folder / "summary.json").write_text(text, "utf-8")
    arrays = (folder / "arrays.npz").read_bytes()
    (folder / "arrays.npz").write_bytes(arrays[: len(arrays) // 2])
    assert main(["report", str(folder)]) == 2


PROBE = """<!DOCTYPE html><body style="margin:0">
<iframe id="phone" style="width:390px;height:3000px"></iframe>
<iframe id="laptop" style="width:1280px;height:3000px"></iframe>
<pre id="found"></pre><script>
const page = %s, found = {}, names = ["phone", "laptop"];
for (const name of names) {
  const frame = document.getElementById(name);
  frame.onload = () => {
    const d = frame.contentDocument, pictures = [...d.querySelectorAll(".picture > svg")];
    const texts = p => [...p.querySelectorAll("text")];
    found[name] = {
      requests: frame.contentWindow.performance.getEntriesByType("resource").map(e => e.name),
      width: frame.clientWidth, scroll: d.documentElement.scrollWidth,
      smallest: Math.min(...pictures.flatMap(p => texts(p).map(
        t => parseFloat(frame.contentWindow.getComputedStyle(t).fontSize) * p.getScreenCTM().a))),
      cut: pictures.flatMap(p => texts(p).filter(t => {
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
def test_the_page_fits_phone_and_laptop_with_texts_of_10_px(page: str, tmp_path: Path) -> None:
    text = json.dumps(page).replace("</", "<\\/").replace("<!--", "<\\!--")
    (tmp_path / "probe.html").write_text(PROBE % text, "utf-8")
    done = subprocess.run(
        [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--enable-logging=stderr",
         "--disable-background-networking", f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1800,3200",
         "--virtual-time-budget=8000", "--dump-dom", (tmp_path / "probe.html").as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    match = re.search(r'<pre id="found">(.+?)</pre>', done.stdout)
    assert match, done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr
    for found in json.loads(html.unescape(match[1])).values():
        assert found["requests"] == []
        assert found["scroll"] <= found["width"]
        assert found["cut"] == []
        assert found["smallest"] >= 10.0
