"""`nebosvod fit` on real observations of 2023 DW: the answer, the folder, the settings, the exit codes.

The start and the reference are JPL's orbit (Horizons, heliocentric ICRF, 2023-03-01 TDB).
"""

import json
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import nebosvod.results
import nebosvod.scenarios
from nebosvod.cli import main
from nebosvod.mission import load_fit
from nebosvod.mission.reading.schema import fit_schema
from nebosvod.observation import read_oem

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")
ORBIT = """{kind: state, frame: icrf, epoch: 2023-03-01 TDB,
    position: ["-1.0012665637585543 au", "0.35197428548625015 au", "0.12506097785119563 au"],
    velocity: ["-0.0080972510629439640 au/d", "-0.0097124784443662956 au/d", "-0.0057416561285374102 au/d"]}"""
HEAD = f"""schema_version: 1
name: dw
object:
  name: 2023 DW
  orbit: {ORBIT}
fit:
  observations: [2023DW.obs80]
"""


def settings(folder, more="", head=HEAD):
    shutil.copy(DATA / "2023DW.obs80", folder)
    path = folder / "dw.yaml"
    path.write_text(head + more, "utf-8")
    return path


def fitted(folder, more="", head=HEAD, code=0):
    path = settings(folder, more, head)
    assert main(["fit", str(path), "-o", str(folder / "run"), "--debug"]) == code
    return json.loads((folder / "run" / "summary.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dw")
    return fitted(folder, f"  reference:\n    name: JPL\n    orbit: {ORBIT}\n"), folder


def test_the_orbit_is_jpls_within_its_covariance(compared):
    summary, _ = compared
    row = summary["reference_orbit"]
    # 99.9 % of a chi-square with 6 degrees of freedom; both orbits rest on the same observations
    assert row["chi2"] < 22.5
    assert summary["fit"]["status"] == "converged"
    assert summary["fit"]["rms_arcsec"] == pytest.approx(0.31, abs=0.03)
    # the value of an independent computation
    assert summary["orbit"]["sigma_position_km"] == pytest.approx(5715.0, rel=1e-3)
    assert summary["orbit"]["elements"]["a_au"]["value"] == pytest.approx(0.8198, abs=4e-4)


@pytest.mark.parametrize("which", ["whole", "vague"])
def test_the_summary_is_what_its_schema_says(compared, tmp_path, which):
    found = compared[0]
    if which == "vague":
        lines = (DATA / "2023DW.obs80").read_text("ascii").splitlines()[:3]
        path = settings(tmp_path)
        (tmp_path / "2023DW.obs80").write_text("\n".join(lines) + "\n", "ascii")
        assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 1
        found = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    schema = json.loads((Path(nebosvod.results.__file__).with_name("fit_summary.schema.json")).read_text("utf-8"))
    jsonschema.validate(found, schema, cls=jsonschema.Draft202012Validator)


def test_state_covariance_and_factor_agree(compared):
    orbit = compared[0]["orbit"]
    K, S = np.array(orbit["covariance_km_km_s"]), np.array(orbit["factor_km_km_s"])
    np.testing.assert_allclose(S @ S.T, K, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(K)), orbit["sigma_km_km_s"], rtol=1e-12)
    assert np.linalg.matrix_rank(S / np.linalg.norm(S, axis=1)[:, None]) == 6


def test_the_budget_adds_up(compared):
    assert sum(row["share_position"] for row in compared[0]["budget"]) == pytest.approx(1.0, abs=1e-9)


def test_the_folder_is_whole_and_its_table_has_every_record(compared):
    run = compared[1] / "run"
    for name in ("report.html", "manifest.json", "arrays.npz", "tables/residuals.ecsv", "tables/orbit.ecsv"):
        assert (run / name).is_file()
    lines = [line for line in (run / "tables" / "residuals.ecsv").read_text("utf-8").splitlines() if line[:1] != "#"]
    assert len(lines) == 1 + 123
    page = (run / "report.html").read_text("utf-8")
    assert all(word in page for word in ("2023 DW", "Residuals", "http-equiv"))
    manifest = json.loads((run / "manifest.json").read_text("utf-8"))
    assert len(manifest["inputs_sha256"]) == 1


def test_residuals_of_the_stations_are_those_of_the_table(compared):
    summary, folder = compared
    with np.load(folder / "run" / "arrays.npz") as arrays:
        rms = np.sqrt(np.mean((arrays["residual"][arrays["selected"]] * 648000.0 / np.pi) ** 2))
    assert summary["fit"]["rms_arcsec"] == pytest.approx(rms, rel=1e-9)
    assert sum(row["n_observations"] for row in summary["fit"]["stations"]) == 123


def test_a_considered_bias_makes_the_sigma_larger_and_is_named(compared, tmp_path):
    more = "  uncertainty:\n    - {stations: all, bias: {sigma: 0.3 arcsec, treatment: considered}}\n  night_limit: 4\n"
    found = fitted(tmp_path, more)
    orbit = found["orbit"]
    # dense algebra on the arrays of the run
    assert orbit["sigma_position_km"] == pytest.approx(12745.16, rel=1e-6)
    assert orbit["sigma_formal_position_km"] == pytest.approx(compared[0]["orbit"]["sigma_position_km"], rel=1e-3)
    assert any(row["source"].startswith("bias ") and row["share_position"] > 0.01 for row in found["budget"])


def test_an_estimated_bias_is_found_again(tmp_path):
    """One station's records are moved by 3 arcsec in Dec; its estimated bias finds them."""
    path = settings(
        tmp_path, "  uncertainty:\n    - {stations: [L87], bias: {sigma: 5 arcsec, treatment: estimated}}\n"
    )
    lines = (tmp_path / "2023DW.obs80").read_text("ascii").splitlines()
    moved = [_north(line) if line[77:80] == "L87" else line for line in lines]
    (tmp_path / "2023DW.obs80").write_text("\n".join(moved) + "\n", "ascii")
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    found = summary["estimators"][0]["parameters"]["bias L87 Dec_arcsec"]
    assert found["estimate"] == pytest.approx(3.0, abs=4.0 * found["sigma"])
    assert found["sigma"] < 1.0
    assert summary["fit"]["n_rejected"] == 0


def _north(line):
    """A record with 3 arcsec more in Dec."""
    degrees, minutes, seconds = line[44:47], int(line[48:50]), float(line[51:56])
    total = 60.0 * minutes + seconds + (3.0 if degrees[0] != "-" else -3.0)
    return f"{line[:44]}{degrees} {int(total // 60):02d} {total % 60:05.2f}{line[56:]}"


def test_an_estimated_acceleration_with_a_prior_keeps_it(tmp_path):
    head = HEAD.replace("fit:", "  nongrav: {A2: {value: 0 au/d^2, sigma: 1e-13 au/d^2, treatment: estimated}}\nfit:")
    found = fitted(tmp_path, head=head)["estimators"][0]["parameters"]["a2_au_d2"]
    assert found["sigma"] == pytest.approx(1e-13, rel=1e-3)  # three weeks say nothing of A2


def test_predictions_and_other_epochs_are_answered(tmp_path):
    more = """  epoch: 2023-06-01 TDB
  epochs: [2023-04-01 TDB]
predictions:
  - {name: seen, plane: sky, from: X05, at: 2023-04-01 UTC}
  - {name: there, plane: rtn, at: 2023-04-01 TDB}
"""
    found = fitted(tmp_path, more)
    assert found["orbit"]["epoch_tdb"].startswith("2023-06-01")
    assert found["further"][0]["epoch_tdb"].startswith("2023-04-01")
    sky, rtn = found["predictions"]
    assert sky["semi_axes_arcsec"][0] == pytest.approx(0.5, abs=0.2)
    assert np.linalg.norm(rtn["sigma_km"]) == pytest.approx(found["further"][0]["sigma_position_km"], rel=1e-6)


def test_the_orbit_is_exported_with_its_covariance(tmp_path):
    path = settings(tmp_path)
    assert main(["fit", str(path), "-o", str(tmp_path / "run"), "--export"]) == 0
    read = read_oem(tmp_path / "run" / "orbit.oem")
    assert read.covariances
    assert (tmp_path / "run" / "orbit.bsp").stat().st_size > 1000


def test_rejection_off_keeps_everything(tmp_path):
    """Of 21 records of 2007 VV7 two are rejected, and come back."""
    shutil.copy(DATA / "2007VV7.obs80", tmp_path)
    path = tmp_path / "vv.yaml"
    for more, rejected in (("", 2), ("  rejection: {enabled: false}\n", 0)):
        path.write_text(f"schema_version: 1\nname: vv\nfit:\n  observations: [2007VV7.obs80]\n{more}", "utf-8")
        main(["fit", str(path), "-o", str(tmp_path / "run"), "--overwrite"])
        found = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["fit"]
        assert (found["n_rejected"], found["n_selected"]) == (rejected, 21 - rejected)


def test_the_settings_are_described_by_the_schema(tmp_path):
    schema = fit_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert "telescopes" not in schema["properties"]
    assert load_fit(settings(tmp_path)).fit.observations == ("2023DW.obs80",)
    stored = Path(nebosvod.scenarios.__file__).with_name("fit.schema.json").read_text("utf-8")
    assert json.loads(stored) == json.loads(json.dumps(schema)), "make schema writes it anew"


WRONG = {
    "rejction: {}": "fit.rejction: unknown key",
    "observations: [nowhere.obs80]": "no such file",
    "clock: 1 arcsec": "needs a duration",
    "uncertainty: [{stations: [W9X], bias: {sigma: 1 arcsec, treatment: considered}}]": "W9X",
    "uncertainty: [{stations: all, bias: {treatment: considered}}]": "sigma",
    "rejection: {reject: 5, recover: 7}": "must not exceed reject",
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_settings_name_line_and_field(tmp_path, capsys, line):
    head = HEAD.replace("  observations: [2023DW.obs80]\n", "") if line.startswith("observations") else HEAD
    path = settings(tmp_path, f"  {line}\n", head)
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert f"{path}:" in said
    assert WRONG[line] in said
    assert not (tmp_path / "run").exists()


def test_keys_of_a_simulated_mission_are_refused(tmp_path, capsys):
    path = settings(tmp_path, "monte_carlo: {runs: 10}\n")
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 2
    assert "belongs to a mission that is simulated" in capsys.readouterr().err


def test_a_mission_without_fit_is_not_for_this_command(tmp_path, capsys):
    path = tmp_path / "m.yaml"
    assert main(["init", str(path)]) == 0
    assert main(["fit", str(path)]) == 2
    assert "nebosvod run" in capsys.readouterr().err


def test_two_objects_in_one_fit_are_refused_by_name(tmp_path, capsys):
    both = tmp_path / "both.obs80"
    both.write_text("".join((DATA / name).read_text("ascii") for name in ("2023DW.obs80", "2005TM173.obs80")), "ascii")
    assert main(["fit", str(both), "-o", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ("2023 DW", "2005 TM173", "--split"))


def test_an_arc_of_an_hour_is_status_1(tmp_path, capsys):
    """2008 EK68 in 58 minutes: the distance is not determined, and that is no success."""
    shutil.copy(DATA / "2008EK68.obs80", tmp_path)
    # JPL Horizons, heliocentric ICRF, 2008-03-05T11:00 TDB
    orbit = """{kind: state, frame: icrf, epoch: 2008-03-05T11:00:00 TDB,
    position: ["-0.96945064435304829 au", "0.23597418581181515 au", "0.10107372755464061 au"],
    velocity: ["-0.0095098056999568231 au/d", "-0.015324464384241837 au/d", "-0.0080943379433338954 au/d"]}"""
    path = tmp_path / "ek.yaml"
    text = f"schema_version: 1\nname: ek\nobject:\n  orbit: {orbit}\nfit:\n  observations: [2008EK68.obs80]\n"
    path.write_text(text, "utf-8")
    assert main(["fit", str(path), "-o", str(tmp_path / "run")]) == 1
    assert "58 minutes" in capsys.readouterr().out
    assert json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["fit"]["status"] == "not_observable"


def test_a_vague_orbit_that_hits_the_earth_before_its_arc_is_answered_by_a_probability(tmp_path, capsys):
    """Of 18 minutes in the early morning: at 0h, where others have their epoch, that orbit is inside the Earth."""
    lines = (DATA / "2023DW.obs80").read_text("ascii").splitlines()[:3]
    (tmp_path / "three.obs80").write_text("\n".join(lines) + "\n", "ascii")
    assert main(["fit", str(tmp_path / "three.obs80"), "-o", str(tmp_path / "run")]) == 0  # a probability is an answer
    assert "does not tell how far the object is" in capsys.readouterr().out
    assert (tmp_path / "run" / "report.html").exists()


def test_two_observations_say_what_is_known_of_them(tmp_path, capsys):
    lines = (DATA / "2024MK.obs80").read_text("ascii").splitlines()[:2]
    (tmp_path / "two.obs80").write_text("\n".join(lines) + "\n", "ascii")
    assert main(["fit", str(tmp_path / "two.obs80"), "-o", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err
    assert all(word in said for word in ("no starting orbit", "3 minutes", "arcsec a day", "straight line"))


def test_without_an_orbit_one_is_found(tmp_path, capsys):
    """The same orbit as from JPL's start, and the sentence about where it came from."""
    path = settings(tmp_path, head="schema_version: 1\nname: dw\nfit:\n  observations: [2023DW.obs80]\n")
    assert main(["fit", str(path), "-o", str(tmp_path / "run"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["fit"]["start"].startswith(("Gauss's method", "a search over distances"))
    assert summary["orbit"]["elements"]["a_au"]["value"] == pytest.approx(0.8199, abs=1e-4)


def test_a_file_for_fits_is_checked_and_not_simulated(tmp_path, capsys):
    path = settings(tmp_path, "  uncertainty:\n    - {stations: all, timing: {sigma: 1 s, treatment: considered}}\n")
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("2023DW.obs80", "timing of every station", "considered", "nothing was fitted"))
    assert main(["run", str(path)]) == 2
    assert f"nebosvod fit {path}" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["2023 DW", "K23D00W", "2023dw"])
def test_the_object_to_fit_may_be_named_in_any_form(tmp_path, name):
    both = tmp_path / "both.obs80"
    both.write_text("".join((DATA / name).read_text("ascii") for name in ("2023DW.obs80", "2005TM173.obs80")), "ascii")
    assert main(["fit", str(both), "--object", name, "--to", "2023-03-04", "-o", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert summary["object"] == "2023 DW"


def test_what_would_remain_without_a_source_stands_in_summary_table_and_page(compared):
    summary, folder = compared
    total = summary["orbit"]["sigma_position_km"]
    for row in summary["budget"]:
        remains = row["if_vanished"]["sigma_position_km_same_gain"]
        assert remains == pytest.approx(total * np.sqrt(max(1.0 - row["share_position"], 0.0)), rel=1e-9)
    table = [line for line in (folder / "run/tables/budget.ecsv").read_text("utf-8").splitlines() if line[:1] != "#"]
    assert table[0].split()[-2:] == ["sigma_position_km_if_vanished", "sigma_position_km_if_halved"]
    assert float(table[1].split()[-2]) == summary["budget"][0]["if_vanished"]["sigma_position_km_same_gain"]
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert "position if no error" in page
    shown = float(page.split('<section id="budget">')[1].split('<data value="')[4].split('"')[0])
    assert shown == pytest.approx(summary["budget"][0]["if_vanished"]["sigma_position_km_same_gain"], rel=1e-9)
