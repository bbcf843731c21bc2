"""Objects of catalogues: three forms of one orbit are one orbit, and what is seen of them is counted."""

import json
from pathlib import Path
from typing import Any

import pytest
from astropy import units as u
from astropy.table import Table
from scipy import stats

from nebosvod.cli import main
from nebosvod.errors import InputError
from nebosvod.mission import load_mission
from nebosvod.mission.reading.reader import Editable
from nebosvod.mission.state import orbit_state
from nebosvod.studies.catalogue import read_catalogue
from nebosvod.studies.stored import load_table

ELEMENTS = {"e": 0.0789126, "a": 2.7672542, "i": 10.58688, "node": 80.25496, "peri": 73.42937, "M": 60.07966}
JD = 2460200.5  # 2023-09-13, packed K239D
SBDB = """\
full_name,epoch,e,a,q,i,om,w,ma,H,G
1 Ceres,2460200.5,.0789126,2.7672542,2.54,10.58688,80.25496,73.42937,60.07966,3.34,0.12
"""


def mpcorb() -> str:
    """Columns of the MPC's own description, counted from 1: H 9-13, G 15-19, epoch 21-25, M 27-35, ... a 93-103."""
    line = [" "] * 202
    for start, text in (
        (1, "00001"), (9, " 3.34"), (15, " 0.12"), (21, "K239D"), (27, f"{ELEMENTS['M']:9.5f}"),
        (38, f"{ELEMENTS['peri']:9.5f}"), (49, f"{ELEMENTS['node']:9.5f}"), (60, f"{ELEMENTS['i']:9.5f}"),
        (71, f"{ELEMENTS['e']:9.7f}"), (81, " 0.21406009"), (93, f"{ELEMENTS['a']:11.7f}"), (167, "     (1) Ceres"),
    ):  # fmt: skip
        line[start - 1 : start - 1 + len(text)] = text
    return "MPCORB\nwhat it is\n" + "-" * 160 + "\n" + "".join(line) + "\n"


def state_of(found: dict[str, Any]) -> list[float]:
    mission = Editable(load_mission("minimal")).edited({"object.orbit": found["orbit"]})
    return orbit_state(mission.object.orbit, 1.327124400e11).tolist()


def test_three_forms_of_one_orbit_are_one_orbit(tmp_path: Path) -> None:
    (tmp_path / "sbdb.csv").write_text(SBDB, "utf-8")
    (tmp_path / "MPCORB.DAT").write_text(mpcorb(), "utf-8")
    table = Table({"name": ["Ceres"], "epoch": [JD], **{name: [value] for name, value in ELEMENTS.items()}})
    table["a"] = [ELEMENTS["a"] * 149597870.7] * u.km
    table.write(tmp_path / "own.ecsv")
    found = [read_catalogue(tmp_path / name)[0] for name in ("sbdb.csv", "MPCORB.DAT", "own.ecsv")]
    assert [one["name"] for one in found] == ["1 Ceres", "(1) Ceres", "Ceres"]
    assert found[0]["magnitude"] == found[1]["magnitude"] == {"H": 3.34, "G": 0.12}
    states = [state_of(one) for one in found]
    assert states[1] == pytest.approx(states[0], rel=1e-12)
    assert states[2] == pytest.approx(states[0], rel=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "has no columns of orbits .*missing"),
        (SBDB.replace("epoch", "epok"), r'missing epoch.*is it "epok"'),
        (SBDB.replace("2.7672542", "two"), r'x\.csv:2: a: is no number \(got "two"\)'),
        (SBDB.replace("2460200.5", "yesterday"), r'x\.csv:2: epoch: is no date \(got "yesterday"'),
        ("# %ECSV 1.0\n# nonsense\n", "is no ECSV table"),
        (mpcorb().replace("K239D", "K23ZZ"), "no columns of orbits|no packed date"),
    ],
)
def test_what_is_no_catalogue_is_said(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "x.csv").write_text(text, "utf-8")
    with pytest.raises(InputError, match=said):
        read_catalogue(tmp_path / "x.csv")


def test_objects_take_the_place_of_the_missions_and_those_not_seen_are_counted(tmp_path: Path) -> None:
    """`minimal` seen with three limits; the intervals are Clopper and Pearson's of scipy's own test."""
    rows = [
        "full_name,epoch,e,a,i,om,w,ma,H",
        "near,2461850.5,0.2,1.3,8,0,180,0,22",
        "far,2461850.5,0.1,2.8,8,40,180,100,14",
    ]
    (tmp_path / "objects.csv").write_text("\n".join([*rows, "other,2461850.5,0.25,1.35,5,10,175,2,21\n"]), "utf-8")
    (tmp_path / "s.yaml").write_text(
        "schema_version: 1\nstudy: seen\nmission: minimal\nobjects: {from: objects.csv}\n"
        "vary: {limit: {set: telescopes.*.limiting_magnitude, values: [19, 24]}}\n"
        "answer:\n  - {name: later, of: predictions.ten days later.semi_axes_km.0}\n", "utf-8",
    )  # fmt: skip
    assert main(["study", str(tmp_path / "s.yaml"), "-o", str(tmp_path / "o"), "--workers", "1"]) == 0
    table = load_table(tmp_path / "o")
    assert table["object"].tolist() == ["near", "near", "far", "far", "other", "other"]
    assert table["status"].tolist() == ["not_seen", "ok", "not_seen", "ok", "ok", "ok"]
    found = json.loads((tmp_path / "o" / "study.json").read_text("utf-8"))
    assert [(row["n_seen"], row["n"]) for row in found["seen"]] == [(1, 3), (3, 3)]
    for row in found["seen"]:
        interval = stats.binomtest(row["n_seen"], row["n"]).proportion_ci(0.95, method="exact")
        assert row["interval_95"] == pytest.approx([interval.low, interval.high], abs=1e-9)
    assert "minimal.yaml:" not in table["message"][0]


def test_a_catalogue_that_is_not_there_is_said_at_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.yaml").write_text(
        "schema_version: 1\nstudy: seen\nmission: minimal\nobjects: {from: none.csv}\n"
        "answer:\n  - {name: number, of: n_observations}\n", "utf-8",
    )  # fmt: skip
    assert main(["study", str(tmp_path / "s.yaml")]) == 2
    assert "s.yaml:4:17: objects.from: " in capsys.readouterr().err
