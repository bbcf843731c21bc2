"""The page of a run of the program itself: all blocks of the summary are on it, and its files hold what it shows."""

import csv
import html
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from nebosvod.report.kit.wording import number, scale_of
from nebosvod.report.run.advice import mean_limit_km
from nebosvod.report.run.ledger import best_remedy, ledgers, remedies_plate
from nebosvod.report.run.page import make_report
from nebosvod.report.run.visibility import read_visibility
from nebosvod.results.folder import read_folder

DATA = re.compile(r'<data value="([^"]+)" data-unit="([^"]*)">')
FILE = re.compile(r'download="([^"]+)" href="data:text/csv;charset=utf-8,([^"]*)"')


@pytest.fixture(scope="module")
def summary(real_folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((real_folder / "summary.json").read_text("utf-8"))
    return found


@pytest.fixture(scope="module")
def page(real_folder: Path) -> str:
    return make_report(real_folder)


@pytest.fixture(scope="module")
def files(page: str) -> dict[str, list[dict[str, str]]]:
    """Every CSV file of the page, read back."""
    texts = {html.unescape(name): unquote(html.unescape(body)) for name, body in FILE.findall(page)}
    return {name: list(csv.DictReader(text.splitlines())) for name, text in texts.items()}


def numbers_of_new_blocks(summary: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
    """Where it stands, and every number that trust, blame and advice must show."""
    for p in (p for p in summary["predictions"] if p["estimator"] == "batch"):
        unit = next(k.removeprefix("semi_axes_") for k in p if k.startswith("semi_axes_"))
        for row in p["budget"]:
            yield f"{p['name']}: {row['source']}", row["share_total"]
            yield f"{p['name']}: {row['source']}", row[f"sigma_total_{unit}"]
            for remedy in ("if_vanished", "if_halved"):
                for gain in ("same", "new"):
                    yield f"{p['name']}: {row['source']} {remedy}", row[remedy][f"sigma_total_{unit}_{gain}_gain"]
        yield f"{p['name']}: nonlinearity", p["nonlinearity"]["measure"]
        for key in ("mean_shift", "sigma"):
            for value in p["monte_carlo"][f"{key}_{unit}"]:
                yield f"{p['name']}: monte carlo {key}", value
    for row in summary["accuracy_comparison"]["rows"]:
        for kind in ("formal", "extended", "worst_correlation", "worst_any_correlation", "guaranteed", "monte_carlo"):
            yield f"{row['prediction']} {row['component']} {kind}", row[kind]
    for one in summary["consistency"]["by_estimator"]:
        yield "nees", one["nees_mean"]
        for value in (*one["nees_interval_99"], *one["coverage"].values()):
            yield "consistency", value
    for row in summary["noise_to_nuisance"]["required_position"]:
        for limit in row["limits"]:
            for gain in ("same", "new"):
                yield f"required {row['telescope']}", limit[f"sigma_position_{gain}_gain_km"]
    for one in summary["noise_to_nuisance"]["by_telescope"]:
        yield "eta", one["eta_db_mean"]
        for value in one["sigma_z_limit_km"].values():
            yield "limit", value
    for block in summary["curves"]:
        for value in (*block["measurements"]["slope"].values(), block["cadence"]["slope"]):
            yield f"slope {block['prediction']}", value


def test_every_number_of_blame_trust_and_advice_is_on_the_page(page: str, summary: dict[str, Any]) -> None:
    shown = {float(value) for value, _ in DATA.findall(page)}
    asked = list(numbers_of_new_blocks(summary))
    assert len(asked) > 150
    assert [one for one in asked if one[1] is not None and one[1] not in shown] == []


def test_every_figure_has_a_caption_with_a_number_and_its_data(page: str, files: dict[str, Any]) -> None:
    figures = re.findall(r"<figure id=\"([^\"]+)\"[^>]*>(.*?)</figure>", page, flags=re.DOTALL)
    keys = {key for key, _ in figures}
    wanted = {"budget-shares", "budget-remedies", "accuracies", "required", "nuisance", "timeline", "geometry"}
    assert wanted <= keys
    for key, text in figures:
        caption = text[text.index("<figcaption>") :]
        assert re.search(r"\d", re.sub(r"<span class=\"data\">.*", "", caption)), key
        assert "download=" in caption, key
    assert all(rows for rows in files.values())


def test_files_hold_the_numbers_of_the_summary(files: dict[str, Any], summary: dict[str, Any]) -> None:
    block = next(b for b in summary["curves"] if b["prediction"] == "ten days later")
    noise = files["curves-ten-days-later-noise.csv"]
    assert [float(r["sigma_total_km"]) for r in noise] == pytest.approx(
        block["telescope_noise"]["sigma_total_km"], rel=1e-6
    )
    number = files["curves-ten-days-later-number.csv"]
    assert number[0]["sigma_all_km"] == ""  # one measurement does not determine an orbit
    shares = [r for r in files["budget-shares.csv"] if r["quantity"] == "ten days later"]
    assert sum(float(r["share_of_variance"]) for r in shares) == pytest.approx(1.0, abs=1e-6)
    assert len(files["visibility.csv"]) == sum(v["candidates"] for v in summary["visibility"])
    assert len(files["ellipse-seen-from-ahead-sky-drawn.csv"]) == 40


def test_budget_rows_are_sorted_and_carry_what_the_switches_need(page: str, real_folder: Path) -> None:
    run = read_folder(real_folder)
    books = ledgers(run, run.estimators[0])
    tables = re.findall(r'<table class="budget".*?</table>', page, flags=re.DOTALL)
    assert len(tables) == len(books) == 4
    for table, book in zip(tables, books):
        shares = [float(s) for s in re.findall(r'<tr data-share="([^"]+)"', table)]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) == pytest.approx(1.0, abs=1e-9)
        total = float(re.findall(r'data-total="([^"]+)"', table)[0])
        assert total == book.total
        same = [e.then["if_vanished", "same"] for e in book.entries]
        assert same == pytest.approx([total * max(0.0, 1.0 - s) ** 0.5 for s in shares], rel=1e-6)


def test_blind_estimator_is_called_too_small_and_the_honest_one_leads(page: str, summary: dict[str, Any]) -> None:
    text = re.sub(r"<[^>]+>", "", page)
    blind = summary["estimators"][1]
    ratio = blind["sigma_position_km"] / blind["sigma_formal_position_km"]
    assert ratio > 1.1
    assert f"its formal sigma is {ratio:.3g}" in text
    assert "“batch” reports can be believed" in text


def test_best_remedy_is_the_smallest_remaining_sigma(real_folder: Path) -> None:
    run = read_folder(real_folder)
    book = ledgers(run, run.estimators[0])[0]
    best = best_remedy(book)
    assert best is not None
    assert best.then["if_vanished", "new"] == min(e.then["if_vanished", "new"] or 9e9 for e in book.entries)


def test_a_remedy_that_makes_it_much_worse_is_an_arrowhead_at_the_edge_with_its_value(real_folder: Path) -> None:
    run = read_folder(real_folder)
    book = ledgers(run, run.estimators[0])[0]
    plain = remedies_plate(run, book)
    first, *others = book.entries
    worse = replace(first, then={**first.then, ("if_vanished", "new"): 7777.0 * book.total})
    drawn = remedies_plate(run, replace(book, entries=(worse, *others)))
    assert plain is not None
    assert drawn is not None
    factor, unit = scale_of(book.total, book.unit)
    said = f"{number(7777.0 * factor * book.total)} {unit}"
    assert said in drawn.svg
    assert said not in plain.svg


def test_every_word_of_the_visibility_table_is_read(real_folder: Path, summary: dict[str, Any]) -> None:
    columns = read_visibility(real_folder)
    assert columns is not None
    assert set(columns["telescope"]) == set(summary["telescopes"])
    assert columns["reason"].count("-") == summary["n_observations"]


def test_page_stays_light_and_quick(page: str, real_folder: Path) -> None:
    import time

    start = time.process_time()
    make_report(real_folder)
    assert time.process_time() - start < 0.6  # 0.1 s on the machine it was written on
    assert len(page.encode()) < 600_000


def test_the_position_limit_by_the_mean_gives_that_mean_and_the_median_another(real_folder: Path, page: str) -> None:
    """By the measurements' own noise and partials (numpy): both stand in the table, and what each is for."""
    run = read_folder(real_folder)
    block, R, H_z = run.summary["noise_to_nuisance"], run.arrays["R"], run.arrays["H_z"]
    noise, moved = np.einsum("nii->n", R), np.sum(H_z**2, axis=(1, 2))
    for limit in (0.0, 20.0):
        z_km = mean_limit_km(block, limit)
        assert z_km is not None
        assert 10.0 * np.log10(noise.sum() / (z_km**2 * moved.sum())) == pytest.approx(limit, abs=1e-3)
        median_km = block["sigma_z_limit_km"][f"{limit:g}_dB"]
        assert np.median(10.0 * np.log10(noise / (median_km**2 * moved))) == pytest.approx(limit, abs=1e-3)
    table = page[page.index('id="table-limits"') :].split("</table>")[0]
    assert "above for the median" in table
    assert f'value="{mean_limit_km(block, 20.0)!r}"' in table
