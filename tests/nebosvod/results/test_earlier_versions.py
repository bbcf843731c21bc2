"""What version 0.1.0 left behind is read still: run folders, fits, missions; what is too old says so.

tests/data/version_0_1_0 holds what that version wrote, at the commit that its documentation belongs to.
"""

import json
import re
import shutil
import tarfile
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from nebosvod import Result, load_mission
from nebosvod.cli import main
from nebosvod.mission import load_fit
from nebosvod.pipeline import run
from nebosvod.results.folder import SCHEMAS, read_folder
from nebosvod.version import __version__

DATA = Path(__file__).resolve().parents[2] / "data" / "version_0_1_0"
MISSIONS = ("apophis-2029", "apophis-heliocentric", "minimal", "neomir-like", "small", "soda-like", "surveyor-venus")


def unpacked(name: str, place: Path) -> Path:
    """A folder of version 0.1.0, in `place`."""
    with tarfile.open(DATA / f"{name}.tar.xz") as archive:
        archive.extractall(place, filter="data")
    return place / name


@pytest.fixture
def old_run(tmp_path: Path) -> Path:
    """A run folder: two estimators, three predictions each, Monte Carlo."""
    return unpacked("run", tmp_path)


@pytest.fixture
def old_fit(tmp_path: Path) -> Path:
    """The folder of a fit: two stations, A2, biases, a clock, four predictions, a reference orbit."""
    return unpacked("fit", tmp_path)


def summary_of(folder: Path) -> dict[str, Any]:
    """summary.json, read by nothing of this program."""
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    return found


@pytest.mark.parametrize(("name", "tables"), [("run", 8), ("fit", 5)])
def test_a_folder_of_0_1_is_read_with_its_numbers_unchanged(name: str, tables: int, tmp_path: Path) -> None:
    folder = unpacked(name, tmp_path)
    assert json.loads((folder / "manifest.json").read_text("utf-8"))["versions"]["nebosvod"] == "0.1.0"
    result = Result.load(folder)
    assert result.summary == summary_of(folder)
    assert len(result.tables) == tables
    assert not result.failed
    assert read_folder(folder).main is not None


def test_the_schemas_of_today_describe_what_0_1_wrote(old_run: Path, old_fit: Path) -> None:
    for schema, folder in ((SCHEMAS[None], old_run), (SCHEMAS["fit"], old_fit)):
        jsonschema.validate(summary_of(folder), json.loads(schema.read_text("utf-8")))


def test_the_page_of_an_old_run_is_made_again(old_run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (old_run / "report.html").write_text("emptied", "utf-8")
    assert main(["report", str(old_run)]) == 0
    assert "report.html: changed since the program wrote it" in capsys.readouterr().err
    assert "bias ignored" in (old_run / "report.html").read_text("utf-8")


def test_the_page_of_an_old_fit_is_made_again(old_fit: Path) -> None:
    assert main(["report", str(old_fit)]) == 0
    page = (old_fit / "report.html").read_text("utf-8")
    assert "2024 AA1" in page
    assert "A2" in page


def test_an_old_run_is_compared_with_one_of_today(
    old_run: Path, minimal_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(old_run), str(minimal_folder), "--json", "--page", str(tmp_path / "both.html")]) == 0
    assert {"0.1.0", __version__} <= set(re.findall(r"\d+\.\d+\.\d+", capsys.readouterr().out))
    assert (tmp_path / "both.html").stat().st_size > 10_000


def test_old_fits_are_compared_with_each_other(old_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = shutil.copytree(old_fit, old_fit.with_name("twin"))
    assert main(["compare", str(old_fit), str(other)]) == 0, capsys.readouterr().err


def test_an_old_run_is_replaced_when_it_is_asked_for_and_only_then(old_run: Path) -> None:
    before = summary_of(old_run)
    assert main(["run", "minimal", "-o", str(old_run)]) == 3
    assert summary_of(old_run) == before
    assert main(["run", "minimal", "-o", str(old_run), "--overwrite"]) == 0
    assert summary_of(old_run)["mission"] == "minimal"
    assert not (old_run / "tables" / "sigma_history_bias_ignored.ecsv").exists()


def test_a_campaign_of_0_1_is_never_continued_with_other_arithmetic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, mission = unpacked("validation", tmp_path), unpacked("missions", tmp_path) / "small.yaml"
    kept = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(["validate", str(mission), "--runs", "60", "--workers", "1", "-o", str(folder)]) == 3
    assert "another mission, seed, mode or program version" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == kept
    anew = ["validate", str(mission), "--runs", "20", "--workers", "1", "-o", str(folder), "--overwrite"]
    assert main(anew) == 3  # its chunks bear no seal: what nobody can prove to be ours is not deleted
    assert "chunks/000000.npz: not as this program wrote it; nothing was changed" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == kept


@pytest.mark.parametrize("name", MISSIONS)
def test_a_mission_of_0_1_is_read_still(name: str, tmp_path: Path) -> None:
    """The built-in missions as they were, and one of a user."""
    path = unpacked("missions", tmp_path) / f"{name}.yaml"
    assert load_mission(path).name == name


def test_the_run_of_an_old_mission_gives_the_numbers_it_gave(old_run: Path, tmp_path: Path) -> None:
    """The truth and the noise of the same seed, the orbit, its sigmas, its predictions: 1e-6 for arithmetic."""
    was = summary_of(old_run)
    now = run(load_mission(unpacked("missions", tmp_path) / "small.yaml")).summary
    for old, new in zip(was["estimators"], now["estimators"], strict=True):
        assert new["name"] == old["name"]
        for key in ("sigma_position_km", "sigma_formal_velocity_m_s", "chi2", "state_km_km_s"):
            assert new[key] == pytest.approx(old[key], rel=1e-6), key
    for old, new in zip(was["predictions"], now["predictions"], strict=True):
        key = "semi_axes_arcsec" if old["plane"] == "sky" else "semi_axes_km"
        assert new[key] == pytest.approx(old[key], rel=1e-6)


def test_the_settings_of_an_old_fit_mean_what_they_meant(old_fit: Path, tmp_path: Path) -> None:
    """Read and fitted; the orbit agrees to a tenth of its sigma (weights of single nights have changed since)."""
    mission = load_fit(unpacked("missions", tmp_path) / "fit.yaml")
    assert mission.name == "everything-fit"
    assert main(["fit", str(tmp_path / "missions" / "fit.yaml"), "-o", str(tmp_path / "now")]) == 0
    old, new = summary_of(old_fit), summary_of(tmp_path / "now")
    gap = np.subtract(new["orbit"]["state_km_km_s"], old["orbit"]["state_km_km_s"])
    S = np.array(old["orbit"]["factor_km_km_s"])
    assert float(np.linalg.norm(np.linalg.solve(S, gap))) < 0.1
    assert new["n_observations"] == old["n_observations"]


def test_a_fit_of_today_has_every_key_that_the_schema_knows(tmp_path: Path) -> None:
    """Keys younger than 0.1 are optional in the schema, for old folders alone: nothing written today lacks one."""
    assert main(["fit", str(unpacked("missions", tmp_path) / "fit.yaml"), "-o", str(tmp_path / "now")]) in (0, 1)
    fit, schema = summary_of(tmp_path / "now")["fit"], json.loads(SCHEMAS["fit"].read_text("utf-8"))
    assert fit.keys() == schema["$defs"]["fit"]["properties"].keys()
    assert fit["rejected"], "needs a rejected record to look at"
    assert {*schema["$defs"]["rejected"]["properties"]} == {*fit["rejected"][0]}
