"""The page of a comparison: what it says is what the comparison holds, and its figure is one ellipse a run."""

from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main
from nebosvod.report.comparison_page import ellipse_plate, make_comparison_page, sentence


def numbers(sigma: float) -> dict[str, Any]:
    """A prediction in a plane with a circle of a sigma."""
    return {
        "sigma_total": sigma,
        "unit": "km",
        "mean": [0.0, 0.0],
        "covariance": [[sigma**2 / 2, 0.0], [0.0, sigma**2 / 2]],
        "semi_axes": [sigma / 2**0.5] * 2,
        "angle_deg": 0.0,
    }


@pytest.fixture
def comparison() -> dict[str, Any]:
    """Two runs with one prediction in common and one that only the first has."""
    common = {"name": "<pass>", "plane": "b_plane", "unit": "km", "comparable": True, "warning": ""}
    common |= {"by_run": [numbers(2.0), numbers(5.0)], "ratio": [1.0, 2.5], "dimension": 2}
    common["budget"] = [{"source": "noise & bias", "share": [0.25, 1.0]}, {"source": "small", "share": [1e-4, 0.0]}]
    alone = {**common, "name": "alone", "comparable": False, "by_run": [numbers(3.0), None], "ratio": [1.0, None]}
    run = {"object": "Example", "n_observations": 62, "telescopes": ["A", "B"], "estimator": "batch", "nebosvod": "1"}
    orbit = {"sigma_position_km": 16.9, "sigma_velocity_m_s": 0.007}
    return {
        "runs": [{"label": "two", **run}, {"label": "one", **run, "telescopes": ["A"]}],
        "warnings": [],
        "estimators": [{"name": "batch", "by_run": [orbit, None], "ratio_position": [1.0, None]}],
        "predictions": [common, alone],
        "budget": common["budget"],
        "ellipses": [{"name": "<pass>", "plane": "b_plane", "unit": "km", "by_run": common["by_run"]}],
    }


def test_the_page_says_what_the_comparison_holds(comparison: dict[str, Any]) -> None:
    page = make_comparison_page(comparison)
    assert "All runs answer the same questions." in page
    assert "&lt;pass&gt;" in page
    assert "<pass>" not in page
    assert "noise &amp; bias" in page
    assert ">small<" not in page
    assert "://" not in page.replace("http://www.w3.org/2000/svg", "")
    assert page == make_comparison_page(comparison)
    warned = make_comparison_page(comparison | {"warnings": ["the objects differ"]})
    assert "Not everything compares: " in warned
    assert "The objects differ." in warned


def test_the_best_and_the_worst_run_are_named(comparison: dict[str, Any]) -> None:
    row = comparison["predictions"][0]
    said = sentence(row, ["two", "one"]).striptags()
    assert said.startswith("<pass>: best by two, 2.00")
    assert "worst by one, 5.00" in said
    assert "2.50" in said
    equal = row | {"by_run": [numbers(2.0), numbers(2.001)]}
    assert "known equally well" in sentence(equal, ["two", "one"])


def test_one_outline_a_run_of_three_sigma(comparison: dict[str, Any]) -> None:
    """A circle of 1 sigma = sqrt 2 km reaches 3 sqrt 2 km on each axis."""
    plate = ellipse_plate(comparison["ellipses"][0], ["two", "one"])
    assert plate.svg.count('data-n="two"') == 1
    assert plate.svg.count('data-n="one"') == 1
    lines = [line.split(",") for line in plate.data[0].text.strip().split("\n")]
    assert len(lines[0]) == 4
    assert max(float(line[0]) for line in lines[1:]) == pytest.approx(3.0 * 2.0**0.5, rel=1e-3)
    assert max(float(line[2]) for line in lines[1:]) == pytest.approx(7.5 * 2.0**0.5, rel=1e-3)


def test_the_command_writes_a_new_page(minimal_folder: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(minimal_folder, tmp_path / "again")
    options = ["compare", str(minimal_folder), str(tmp_path / "again"), "--page", str(tmp_path / "page.html")]
    assert main(options) == 0
    page = (tmp_path / "page.html").read_text("utf-8")
    assert "ten days later" in page
    assert "known equally well" in page
    assert main(options) == 3
