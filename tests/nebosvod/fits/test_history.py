"""`nebosvod risk FIT --history`: the probability after each night, by refits of the records cut there."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
from nebosvod.cli import main
from nebosvod.fits.history import nights

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
PDC27 = SHARED / "data" / "impact" / "2026pdc27.epoch1.psv"
needs_data = pytest.mark.skipif(not PDC27.is_file(), reason="the folder of reference data is not here")
SCHEMA = json.loads((Path(nebosvod.__file__).parent / "results" / "risk.schema.json").read_text("utf-8"))
DAYS = ("2026-05-11", "2026-06-10", "2026-07-08", "2026-07-31")


def test_a_night_ends_with_a_pause_or_after_a_day() -> None:
    hour = 3600.0
    scattered = np.array([30.0, 0.0, 1.0, 26.0, 2.0]) * hour
    assert nights(scattered).tolist() == [2.0 * hour, 30.0 * hour]
    assert nights(np.arange(0.0, 72.0) * hour).tolist() == [24.0 * hour, 49.0 * hour, 71.0 * hour]
    assert nights(np.array([5.0])).tolist() == [5.0]


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of four nights of 2026 PDC27."""
    home = tmp_path_factory.mktemp("history")
    lines = PDC27.read_text("utf-8").split("\n")
    kept = [line for line in lines if "T" not in line or "2026-0" not in line or any(day in line for day in DAYS)]
    (home / "four.psv").write_text("\n".join(kept), encoding="utf-8")
    assert main(["fit", str(home / "four.psv"), "-o", str(home / "fit")]) == 0
    return home / "fit"


@pytest.fixture(scope="module")
def told(fit: Path) -> dict[str, Any]:
    folder = fit.parent / "risk"
    asked = ["risk", str(fit), "--until", "2038-08-01", "--bodies", "earth", "--draws", "300", "-o", str(folder)]
    assert main([*asked, "--history"]) == 0
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    return found


@needs_data
def test_each_night_has_its_probability_and_the_ellipse(told: dict[str, Any]) -> None:
    jsonschema.validate(told, SCHEMA)
    rows = told["history"]
    assert [row["until_utc"][:10] for row in rows] == list(DAYS[1:])
    assert [row["n_observations"] for row in rows] == [4, 6, 8]
    last, whole = rows[-1], told["virtual_impactors"][0]
    assert last["low"] < whole["probability"] < last["high"]
    sigma = [row["semi_major_km"] for row in rows]
    assert sigma == sorted(sigma, reverse=True)
    assert sigma[-1] == pytest.approx(whole["approach"]["semi_major_km"], rel=1e-3)
    assert "no orbit was known after 1 of 4 nights (the first, 2026-05-11, 2 observations" in told["warnings"][-1]


@needs_data
def test_a_night_is_the_fit_of_the_records_until_then(fit: Path, told: dict[str, Any], tmp_path: Path) -> None:
    asked = ["fit", str(fit.parent / "four.psv"), "--to", "2026-07-09", "-o", str(tmp_path / "cut")]
    assert main(asked) == 0
    asked = [
        "approaches",
        str(tmp_path / "cut"),
        "--from",
        "2038-07-01",
        "--to",
        "2038-07-20",
        "-o",
        str(tmp_path / "a"),
    ]
    assert main(asked) == 0
    near = json.loads((tmp_path / "a" / "summary.json").read_text("utf-8"))["approaches"]
    one = next(row for row in near if row["body"] == "earth")
    assert told["history"][-2]["semi_major_km"] == pytest.approx(one["semi_major_km"], rel=1e-6)


@needs_data
def test_the_page_shows_how_it_came(fit: Path, told: dict[str, Any]) -> None:
    page = (fit.parent / "risk" / "report.html").read_text("utf-8")
    assert "Probability after each night of observations" in page


@needs_data
def test_what_a_history_needs_is_said(fit: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ke0 = SHARED / "data" / "orbits" / "neocc" / "2024YR4.ke0"
    assert main(["risk", str(ke0), "--until", "2033-01-01", "--history"]) == 2
    assert "2024YR4.ke0 is no folder of nebosvod fit" in capsys.readouterr().err
    four = fit.parent / "four.psv"
    text = four.read_text("utf-8")
    try:
        four.write_text(text + "\n", encoding="utf-8")
        assert main(["risk", str(fit), "--until", "2033-01-01", "--history"]) == 2
        assert "four.psv, which has changed since" in capsys.readouterr().err
        four.unlink()
        assert main(["risk", str(fit), "--until", "2033-01-01", "--history"]) == 2
        assert "four.psv, which is not there" in capsys.readouterr().err
    finally:
        four.write_text(text, encoding="utf-8")


@pytest.mark.long
@needs_data
def test_the_exercise_has_the_published_history(tmp_path: Path) -> None:
    """16 % on 12 July with 42 observations, 19 % on 31 July: drawn 0.154 and 0.184, to 0.01."""
    settings = SHARED / "cases" / "pdc27.yaml"
    assert main(["fit", str(settings), "-o", str(tmp_path / "fit")]) == 0
    asked = ["risk", str(tmp_path / "fit"), "--until", "2038-08-01", "--bodies", "earth", "-o", str(tmp_path / "risk")]
    assert main([*asked, "--draws", "10000", "--history"]) == 0
    rows = json.loads((tmp_path / "risk" / "summary.json").read_text("utf-8"))["history"]
    found = {row["n_observations"]: row["probability"] for row in rows}
    assert found[42] == pytest.approx(0.154, abs=0.01)
    assert found[52] == pytest.approx(0.184, abs=0.01)
