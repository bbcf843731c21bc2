"""The page of a plan: the advice of the command, a mark for every possible visit, both schedules."""

import json
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main
from nebosvod.planning.advice import advice
from nebosvod.report.plan_page import gain_plate, make_plan_page, schedule_plate


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    """A plan by the command, and its page."""
    folder = tmp_path_factory.mktemp("plan")
    options = ["plan", "minimal", "-k", "3", "-o", str(folder / "plan.json"), "--page", str(folder / "plan.html")]
    assert main(options) == 0
    assert main([*options[:4], "--page", str(folder / "plan.html")]) == 3  # it is there already
    found: dict[str, Any] = json.loads((folder / "plan.json").read_text("utf-8"))
    return found, Path(folder / "plan.html").read_text("utf-8")


def test_the_page_gives_the_advice_of_the_command(planned: tuple[dict[str, Any], str]) -> None:
    found, page = planned
    said = advice(found)
    assert said[0].upper() + said[1:].replace("T00:00:00", " 00:00") + "." in page
    assert page == make_plan_page(found)
    assert "://" not in page.replace("http://www.w3.org/2000/svg", "")
    lost = make_plan_page(found | {"never_visible": ["far", "off"]})
    assert "Far and off never see the object" in lost


def test_every_possible_visit_stands_in_the_figure_and_its_file(planned: tuple[dict[str, Any], str]) -> None:
    found, _ = planned
    plate = gain_plate(found)
    rows = plate.data[0].text.strip().split("\n")[1:]
    assert (
        len(rows) == found["n_candidates"] == 20
    )  # ten days from the last measurement to the prediction, two telescopes
    best = min(float(row.split(",")[2]) for row in rows)
    assert best == pytest.approx(found["best_next"]["a"]["sigma_after"]["a"], rel=1e-6)
    assert f"{found['windows'][0]['telescope']} at" in plate.caption


def test_both_schedules_begin_where_the_mission_stands(planned: tuple[dict[str, Any], str]) -> None:
    found, _ = planned
    rows = [line.split(",") for line in schedule_plate(found).data[0].text.strip().split("\n")]
    assert rows[0] == ["visits", "chosen_km", "even_km"]
    assert float(rows[1][1]) == float(rows[1][2]) == pytest.approx(found["sigma_now"]["a"], rel=1e-6)
    assert float(rows[-1][1]) == pytest.approx(found["greedy"]["a"][-1]["sigma_after"]["a"], rel=1e-6)
    assert float(rows[-1][2]) == pytest.approx(found["uniform"][-1]["sigma_after"]["a"], rel=1e-6)
