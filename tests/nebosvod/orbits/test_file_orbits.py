"""A mission whose orbit, or prior, is a file: what it means, what a run makes of it, and errors at their line."""

import json
from pathlib import Path

import numpy as np
import pytest

from nebosvod import load_mission, read_orbit
from nebosvod.cli import main
from nebosvod.errors import InputError
from nebosvod.mission import load_fit
from nebosvod.scene.orbit import mission_orbit
from nebosvod.scene.scene import build_scene

MISSION = """schema_version: 1
name: again
reference_epoch: {epoch}
object: {{name: X, orbit: {{kind: file, file: {file}}}}}
prior: {prior}
telescopes:
  - {{name: T, orbit: {{kind: geostationary, longitude: 0 deg}}, noise: {{sigma: 0.1 arcsec}}}}
schedule: [{{start: {epoch}, end: {end}, cadence: 3 d}}]
predictions: [{{name: where, plane: position, at: {end}}}]
"""
AT = "2025-03-20T00:00:00 TDB"


def written(
    folder: Path, file: str, prior: str = "orbit", epoch: str = AT, end: str = "2025-04-20T00:00:00 TDB"
) -> Path:
    path = folder / "again.yaml"
    path.write_text(MISSION.format(epoch=epoch, end=end, file=file, prior=prior))
    return path


def test_an_orbit_file_is_the_mission_s_orbit_and_its_covariance_the_prior(yr4: Path) -> None:
    """Carried to the reference epoch by our own propagation of the orbit that the file gives."""
    path = written(yr4.parent, yr4.name)
    mission, orbit = load_mission(path), read_orbit(yr4)
    assert mission.object.orbit.epoch == orbit.epoch
    assert mission.object.magnitude is not None
    assert orbit.magnitude == (mission.object.magnitude.H, mission.object.magnitude.G)
    known = mission_orbit(mission)
    scene = build_scene(mission)
    from nebosvod.dynamics import propagate

    along = propagate(orbit.state, orbit.epoch, [mission.reference_epoch - orbit.epoch], scene.forces)
    np.testing.assert_allclose(known.state, along.state[0], rtol=1e-13)
    np.testing.assert_allclose(known.sigma, np.linalg.norm(along.Phi[0] @ orbit.factor, axis=1), rtol=1e-7)


def test_a_run_becomes_a_mission_in_one_line(minimal_folder: Path, tmp_path: Path) -> None:
    """Estimated radius, mass and albedo come along, joint with the orbit."""
    real = tmp_path / "minimal"
    real.mkdir()
    for name in ("manifest.json", "summary.json", "arrays.npz"):
        (real / name).write_bytes((minimal_folder / name).read_bytes())
    orbit = read_orbit(real)
    at, later = orbit.epoch.iso(), (orbit.epoch + 30 * 86400.0).iso()
    mission = load_mission(written(tmp_path, "minimal", epoch=at, end=later))
    known = mission_orbit(mission)
    assert known.parameter_names == orbit.parameter_names == ("radius_m", "mass_kg", "albedo")
    np.testing.assert_allclose(known.covariance, orbit.covariance, rtol=1e-9)
    assert known.radiation is not None
    assert orbit.radiation is not None
    assert known.radiation.radius_m == orbit.radiation.radius_m
    assert main(["run", str(tmp_path / "again.yaml"), "-o", str(tmp_path / "run")]) == 0
    row = json.loads((tmp_path / "run" / "summary.json").read_text())["estimators"][0]
    assert row["parameters"]["radius_m"]["prior_sigma"] == pytest.approx(orbit.sigma[6], rel=1e-9)
    assert row["sigma_position_km"] < orbit.sigma_position_km


def test_parameters_that_came_with_sbdb_are_estimated_jointly(sbdb: Path) -> None:
    path = written(sbdb.parent, sbdb.name, epoch="2003-01-16T00:00:00 TDB", end="2003-02-16T00:00:00 TDB")
    orbit, known = read_orbit(sbdb), mission_orbit(load_mission(path))
    assert known.parameter_names == ("a2_au_d2",)
    np.testing.assert_allclose(known.sigma, orbit.sigma, rtol=1e-9)
    assert known.nongrav is not None
    assert known.nongrav.a2_au_d2 == -8.72e-14


def test_kind_file_and_kind_sbdb_are_one_mission(sbdb: Path) -> None:
    path = written(sbdb.parent, sbdb.name, epoch="2003-01-16T00:00:00 TDB", end="2003-02-16T00:00:00 TDB")
    by_file = mission_orbit(load_mission(path))
    path.write_text(path.read_text().replace("kind: file", "kind: sbdb"))
    by_sbdb = mission_orbit(load_mission(path))
    np.testing.assert_allclose(by_file.state, by_sbdb.state, rtol=1e-12)
    np.testing.assert_allclose(by_file.sigma, by_sbdb.sigma, rtol=1e-8)


def test_a_prior_may_be_a_file_too(yr4: Path) -> None:
    path = written(yr4.parent, yr4.name, prior=f"{{file: {yr4.name}}}")
    by_prior = mission_orbit(load_mission(path))
    path = written(yr4.parent, yr4.name)
    np.testing.assert_array_equal(by_prior.covariance, mission_orbit(load_mission(path)).covariance)
    path = written(yr4.parent, yr4.name, prior="none")
    with pytest.raises(InputError, match="no prior orbit"):
        mission_orbit(load_mission(path))


def test_an_edited_mission_keeps_what_was_read(yr4: Path) -> None:
    mission = load_mission(written(yr4.parent, yr4.name))
    moved = mission.with_("predictions.where.at", "2025-04-10T00:00:00 TDB")
    assert moved.object.orbit.epoch == mission.object.orbit.epoch
    copied = mission.model_copy(update={"title": "another"})
    assert copied.object.orbit.elements == mission.object.orbit.elements
    assert mission.input_files == (yr4.resolve(),)


def test_check_names_the_orbit_and_tells_what_is_to_be_known_of_it(
    sbdb: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = json.loads(sbdb.read_text())
    answer["orbit"]["model_pars"].append({"name": "DT", "value": "35."})
    sbdb.write_text(json.dumps(answer))
    path = written(sbdb.parent, sbdb.name, epoch="2003-01-16T00:00:00 TDB", end="2003-02-16T00:00:00 TDB")
    assert main(["check", str(path)]) == 0
    text = capsys.readouterr().out
    assert "orbit: file at 2003-01-16" in text
    assert "the outgassing lags by DT = 35 d" in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("file: 2024YR4.ke0", "file: nothing.ke0", "4:45: object.orbit.file: no such file"),
        (", file: 2024YR4.ke0", "", "object.orbit.file: is missing"),
        ("file: 2024YR4.ke0", "file: 2024YR4.ke0, e: 0.3", "object.orbit.e: unknown key (allowed here: kind, file)"),
        ("file: 2024YR4.ke0", "file: ../2024YR4.ke0", "leads out of the folder of the mission"),
        ("file: 2024YR4.ke0", "file: again.yaml", "4:45: object.orbit.file: holds no orbit that is read"),
        ("file: 2024YR4.ke0", "file: .", "object.orbit.file: .: is a folder without a run or a fit"),
        ("prior: orbit", "prior: {file: gone}", "5:15: prior.file: no such file"),
        ("prior: orbit", "prior: {file: 2024YR4.ke0, epoch: 2025-01-01 TDB}", "prior.epoch: stands beside file"),
        ("prior: orbit", "prior: {}", "prior: needs sigma"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_at_its_line(
    old: str, new: str, said: str, yr4: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(yr4.parent, yr4.name)
    path.write_text(path.read_text().replace(old, new))
    assert main(["check", str(path)]) == 2
    assert said.replace(": .:", f": {yr4.parent}:") in capsys.readouterr().err


def test_an_orbit_file_without_covariance_is_refused_at_the_line_that_names_it(
    yr4: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(yr4.parent, yr4.name)
    yr4.write_text("\n".join(line for line in yr4.read_text().splitlines() if " COV " not in line))
    assert main(["check", str(path)]) == 2
    assert "again.yaml:4:45: object.orbit.file: 2024YR4.ke0:5: 2024YR4 has no covariance" in capsys.readouterr().err


def test_a_fit_starts_from_a_file_compares_with_one_and_takes_its_covariance(yr4: Path) -> None:
    """As a start, a prior and a reference: three places of one file for nebosvod fit."""
    (yr4.parent / "x.obs80").write_text("")
    path = yr4.parent / "fit.yaml"
    path.write_text(
        "schema_version: 1\nname: f\nobject: {orbit: {kind: file, file: 2024YR4.ke0}}\nprior: orbit\n"
        "fit: {observations: [x.obs80], reference: {name: ESA, orbit: {kind: file, file: 2024YR4.ke0}}}\n"
    )
    fit, orbit = load_fit(path), read_orbit(yr4)
    assert fit.fit.reference is not None
    joint, prior = fit.fit.reference.joint, fit.covariance_prior
    assert joint is not None
    assert prior is not None
    np.testing.assert_allclose(np.sqrt(np.diag(joint.covariance)), orbit.sigma, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(prior.covariance)), orbit.sigma, rtol=1e-12)
    assert list(fit.input_files).count(yr4.resolve()) == 1
