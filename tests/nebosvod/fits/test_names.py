"""One object under several names, and several objects under one number, from the command line."""

import json
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="the folder of reference observations is not here")


def summary(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def two_names(tmp_path_factory):
    """2023 DW with its first forty records under a name of their own, and the orbit of the file as it is."""
    folder = tmp_path_factory.mktemp("names")
    lines = (SHARED / "data" / "observations" / "2023DW.obs80").read_text("ascii").splitlines()
    (folder / "one.obs80").write_text("\n".join(lines) + "\n", "ascii")
    old = [line.replace("     K23D00W", "     precov1") for line in lines[:40]]
    (folder / "two.obs80").write_text("\n".join([*old, *lines[40:]]) + "\n", "ascii")
    assert main(["fit", str(folder / "one.obs80"), "-o", str(folder / "one")]) == 0
    return folder, summary(folder / "one")


def test_two_names_of_one_object_are_joined_by_repeated_options(two_names, capsys):
    folder, alone = two_names
    assert main(["fit", str(folder / "two.obs80"), "-o", str(folder / "no")]) == 2
    assert "give --object once for each of its names" in capsys.readouterr().err
    names = ["--object", "2023 DW", "--object", "precov1"]
    assert main(["fit", str(folder / "two.obs80"), *names, "-o", str(folder / "by-option")]) == 0
    assert "2023 DW and precov1 were joined as those of one object" in capsys.readouterr().out
    found = summary(folder / "by-option")
    assert (found["object"], found["n_observations"]) == ("2023 DW", alone["n_observations"])
    assert found["orbit"]["state_km_km_s"] == pytest.approx(alone["orbit"]["state_km_km_s"], rel=1e-12)


def test_two_names_of_one_object_are_joined_by_the_settings(two_names):
    folder, alone = two_names
    text = "schema_version: 1\nname: both\nfit:\n  observations: [two.obs80]\n  designation: [2023 DW, precov1]\n"
    (folder / "both.yaml").write_text(text, "utf-8")
    assert main(["fit", str(folder / "both.yaml"), "-o", str(folder / "by-settings")]) == 0
    assert summary(folder / "by-settings")["n_observations"] == alone["n_observations"]


@pytest.mark.parametrize("case", ["73P_two_fragments.obs", "73P_close_fragments.obs"])
def test_fragments_of_a_comet_are_objects_of_their_own(tmp_path, case, capsys):
    """Two pieces of 73P, as ADES names them; together they would be an orbit of neither."""
    path = SHARED / "cases" / case
    assert main(["fit", str(path), "-o", str(tmp_path / "no")]) == 2
    assert "2 objects (73P-B, 73P-C)" in capsys.readouterr().err
    assert main(["fit", str(path), "--split", "-o", str(tmp_path / "run")]) == 0
    for piece in ("73P-B", "73P-C"):
        found = summary(tmp_path / "run" / piece)
        assert (found["object"], found["n_observations"]) == (piece, 12)
        # noise of 0.1" was put on them
        assert found["fit"]["rms_arcsec"] < 0.12


def test_a_number_needs_no_quotes_in_the_settings(tmp_path, capsys):
    text = "schema_version: 1\nname: n\nfit:\n  observations: [n.psv]\n  designation: {}\n"
    row = "# version=2022\npermID|stn|obsTime|ra|dec\n433|703|2010-01-05T20:00:00Z|20.0|6.0\n"
    (tmp_path / "n.psv").write_text(row, "ascii")
    (tmp_path / "n.yaml").write_text(text.format("433"), "utf-8")
    assert main(["check", str(tmp_path / "n.yaml")]) == 0
    assert "n.psv; 433" in capsys.readouterr().out
    for wrong, words in (("[]", "needs a designation"), ("[1.5]", "needs text"), ("{a: b}", "needs text")):
        (tmp_path / "n.yaml").write_text(text.format(wrong), "utf-8")
        assert main(["check", str(tmp_path / "n.yaml")]) == 2
        said = capsys.readouterr().err
        assert "n.yaml:5:" in said
        assert words in said


@pytest.mark.parametrize(
    ("designation", "place", "said"),
    [
        ("  designation: 2024 MK\n", ":5:16: ", "no observation of 2024 MK here"),
        ("", ":3:1: ", "observations of 2 objects"),
    ],
)
def test_an_object_that_is_not_told_is_asked_for_at_its_place_in_the_settings(
    two_names, capsys, designation, place, said
):
    folder, _ = two_names
    text = f"schema_version: 1\nname: both\nfit:\n  observations: [two.obs80]\n{designation}"
    (folder / "untold.yaml").write_text(text, "utf-8")
    assert main(["fit", str(folder / "untold.yaml"), "-o", str(folder / "untold")]) == 2
    assert f"untold.yaml{place}fit.designation: {said}" in capsys.readouterr().err


def test_an_object_of_many_without_an_orbit_is_named_once(two_names, tmp_path, capsys):
    folder, _ = two_names
    lines = (folder / "one.obs80").read_text("ascii").splitlines()
    few = [line.replace("     K23D00W", "     lone001") for line in lines[:1]]
    (tmp_path / "few.obs80").write_text("\n".join([*few, *lines]) + "\n", "ascii")
    assert main(["fit", str(tmp_path / "few.obs80"), "--split", "-o", str(tmp_path / "run")]) == 1
    assert any(line.startswith("lone001: no starting orbit") for line in capsys.readouterr().err.splitlines())
