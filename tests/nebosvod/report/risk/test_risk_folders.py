"""Folders of risks side by side; cut, changed and hostile ones get a page or a sentence."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from nebosvod.borders.shape import schema_file
from nebosvod.cli import main
from nebosvod.commands.risk_answer import print_risk
from nebosvod.results.folder import HERE

MUTANTS = Path(__file__).resolve().parents[2] / "results" / "folder_mutants.py"
CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "500"))


@pytest.fixture(scope="module")
def pair(make_risk_folder: Callable[..., Path], risk_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The risk, and a later one that excludes it."""
    none = {"way": "sampling", "probability": None, "low": 0.0, "high": 0.001, "bound": True, "draws": 3000, "hits": 0,
            "effective_hits": 0.0, "note": None}  # fmt: skip
    later = make_risk_folder(
        tmp_path_factory.mktemp("later") / "later", virtual_impactors=[], n_virtual_impactors=0, sampling=none,
        until_utc="2040-01-01T00:00:00 UTC", bodies=["earth"],
    )  # fmt: skip
    return risk_folder, later


def test_risks_compare_impact_by_impact(pair: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, later = map(str, pair)
    page = tmp_path / "both.html"
    assert main(["compare", first, later, "--json", "--page", str(page)]) == 0
    found = json.loads(capsys.readouterr().out)
    jsonschema.validate(found, schema_file(HERE / "orbit_comparison.schema.json"))
    assert found["warnings"] == [
        "the bodies that may be hit differ: risk: earth, moon; later: earth",
        "the last dates differ: risk: 2039-01-01T00:00:00 UTC; later: 2040-01-01T00:00:00 UTC",
    ]
    assert [row["body"] for row in found["rows"]] == ["earth", "moon"]
    p = json.loads((pair[0] / "summary.json").read_text("utf-8"))["virtual_impactors"][0]["probability"]
    assert found["rows"][0]["by_run"][0]["probability"] == p
    assert found["rows"][0]["by_run"][1] is None
    text = page.read_text("utf-8")
    assert "The Earth, 2038-07-10: risk and later cannot both be right." in text
    assert "not found: all together below" in text
    assert 'id="chances-0"' in text
    assert main(["compare", first, later]) == 0
    said = capsys.readouterr().out
    assert "not found, P of all < 0.001" in said
    assert "not asked about" in said
    assert ": only risk was asked." in text
    assert f"P {p:.3g} (" in said


def test_an_impact_after_the_last_date_of_a_risk_is_not_called_missed(
    pair: Any, make_risk_folder: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A risk until 2031 knows nothing of 2038: neither a bound nor a contradiction."""
    summary = json.loads((pair[1] / "summary.json").read_text("utf-8"))
    short = make_risk_folder(
        tmp_path / "short", virtual_impactors=[], n_virtual_impactors=0, sampling=summary["sampling"],
        until_utc="2031-01-01T00:00:00 UTC",
    )  # fmt: skip
    page = tmp_path / "both.html"
    assert main(["compare", str(pair[0]), str(short), "--page", str(page)]) == 0
    said = capsys.readouterr().out
    assert "after its last date, 2031-01-01" in said
    assert "not found" not in said
    text = page.read_text("utf-8")
    assert "cannot both be right" not in text
    assert "The Earth, 2038-07-10: only risk was asked." in text


def test_an_impactor_of_unknown_size_says_what_gives_its_energy(
    risk_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No line about energy and scales would look as if they were forgotten; of the Moon there are none."""
    summary = json.loads((risk_folder / "summary.json").read_text("utf-8"))
    row = summary["virtual_impactors"][0] | {"energy_mt": None, "palermo": None, "torino": None}
    for body, said in (("earth", 1), ("moon", 0)):
        print_risk(summary | {"virtual_impactors": [row | {"body": body}]}, None)
        assert capsys.readouterr().out.count("no magnitude; --diameter gives them") == said


def test_a_page_or_a_comparison_by_itself_is_named(
    pair: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *map(str, pair), "--json"]) == 0
    (tmp_path / "both.json").write_text(capsys.readouterr().out, "utf-8")
    (tmp_path / "page.html").write_bytes((pair[0] / "report.html").read_bytes())
    for name, said in (("both.json", "is a comparison: its page is made by"), ("page.html", "page of nebosvod risk")):
        assert main(["report", str(tmp_path / name)]) == 2
        assert said in capsys.readouterr().err


def test_two_kinds_do_not_compare(pair: Any, minimal_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(pair[0]), str(minimal_folder)]) == 2
    assert "folders of one kind compare with each other" in capsys.readouterr().err


@pytest.mark.parametrize(("kind", "cases"), [("summary", CASES // 8), ("arrays", CASES // 8)])
def test_damaged_folders_get_a_page_or_a_sentence(kind: str, cases: int, risk_folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(MUTANTS), kind, str(risk_folder), str(tmp_path), "0", str(cases)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert sum(found["codes"].values()) >= cases
