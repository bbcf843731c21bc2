"""Predictions that do not exist for an orbit are rows with a reason; impacts are told first; every command copes."""

import json
import shutil
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import nebosvod
from nebosvod.cli import main
from nebosvod.mission import load_mission

SHARED = Path(__file__).resolve().parents[4] / "shared"
# 50 m across, seen from about L1 a month before; right probability 0.908: the normal distribution on the b-plane by
# numerical integration over the disc, and 4000 orbits integrated through the encounter (0.908 +- 0.005)
IMPACTOR = """schema_version: 1
name: l1
reference_epoch: 2031-05-10T00:00:00 UTC
object:
  name: Impactor 50 m
  orbit:
    kind: state
    frame: icrf
    epoch: 2031-06-10T12:00:00 UTC
    position: [-28978813.425092 km, -136783526.678902 km, -59294102.749933 km]
    velocity: [46.952332715 km/s, -2.664461812 km/s, -8.685194438 km/s]
  magnitude: {H: 24.2}
telescopes:
  - name: T1
    orbit: {kind: libration, point: L1, amplitude: 600000 km}
    noise: {sigma: 0.3 arcsec}
    bias: {sigma: 0.1 arcsec, treatment: considered}
    position: {sigma: 2 km, correlation: gauss_markov, time: 3 d, treatment: considered}
    limiting_magnitude: 26
    exclusion: {sun: 60 deg, earth: 5 deg, moon: 5 deg}
SECOND
schedule:
  - {telescopes: all, start: 2031-05-10 UTC, end: 2031-05-17 UTC, cadence: 4 h}
predictions:
"""
SECOND = "  - {name: T2, like: T1, orbit: {phase: 180 deg}}"
NEAR = "near: 2031-06-10T12:00:00 UTC"
FALL = f"  - {{name: where it falls, plane: entry, altitude: 100 km, {NEAR}}}\n"
CENTRE = f"  - {{name: centre distance, plane: perigee_distance, {NEAR}}}\n"
TARGET = f"  - {{name: target, plane: b_plane, {NEAR}}}\n"
WITHOUT = {
    f"{{name: a, plane: mtp, {NEAR}}}": ("no_closest_approach", "has no closest approach for mtp"),
    "{name: b, plane: b_plane, near: 2031-06-14T12:00:00 UTC}": ("no_encounter", "the nearest: 2031-06-10T1"),
    f"{{name: c, plane: b_plane, body: neptune, {NEAR}}}": ("no_encounter", "within 3 d of 2031-06-10T12:00:00 UTC"),
    "{name: d, plane: position, at: 2031-06-12 UTC}": ("after_impact", "the orbit hits earth on 2031-06-10T1"),
    "{name: e, plane: sky, from: T1, at: 2031-06-12 TDB}": ("after_impact", "TDB and ends there"),
    "{name: f, plane: rtn, at: 2031-06-11 TT}": ("after_impact", "TT and ends there"),
    "{name: g, plane: b_plane, near: 2700-01-01 UTC}": ("not_covered", "outside the ephemeris"),
    f"{{name: h, plane: entry, altitude: 10 km, body: moon, {NEAR}}}": ("no_encounter", "to moon within 3 d"),
}


def written(folder: Path, text: str) -> Path:
    path = folder / "mission.yaml"
    path.write_text(text, "utf-8")
    return path


def summary_of(folder: Path) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    schema = Path(nebosvod.__file__).parent / "results"
    name = "fit_summary.schema.json" if summary.get("kind") == "fit" else "summary.schema.json"
    jsonschema.validate(summary, json.loads((schema / name).read_text("utf-8")))
    return summary


@pytest.fixture(scope="module")
def impactor(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, int]:
    """The impactor with every kind of question, those without an answer among them: folder, terminal, exit code."""
    folder = tmp_path_factory.mktemp("impactor")
    asked = FALL + CENTRE + "".join(f"  - {one}\n" for one in WITHOUT)
    path = written(folder, IMPACTOR.replace("SECOND", SECOND) + asked + "monte_carlo: {runs: 60}\n")
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("rich.console.Console.print", lambda _, what="", **__: lines.append(str(what)))
        code = main(["run", str(path), "-o", str(folder / "run")])
    return folder, "\n".join(lines), code


def test_the_probability_of_impact_is_told_first(impactor: tuple[Path, str, int]) -> None:
    folder, terminal, _ = impactor
    line = next(line for line in terminal.splitlines()[:4] if line.startswith("Impact on the Earth: probability"))
    assert float(line.split("probability ")[1].split()[0]) == pytest.approx(0.908, abs=2e-3)
    assert " UTC +- " in line
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert "Impact on the Earth: probability 0.908" in page[page.index('id="verdict"') :][:2500]
    (found,) = summary_of(folder / "run")["impacts"]
    assert found["nominal_impact"]
    low, high = found["impact_probability_monte_carlo"]["interval_95"]
    assert low < 0.908 < high


def test_an_entry_has_place_time_and_their_sigmas_and_its_departure_from_linear(
    impactor: tuple[Path, str, int],
) -> None:
    folder, terminal, _ = impactor
    row = next(row for row in summary_of(folder / "run")["predictions"] if row["plane"] == "entry")
    assert row["epoch_utc"].startswith("2031-06-10T1")
    assert 300.0 < row["sigma_time_s"] < 3600.0
    # the point moves by R d(latitude) and R cos(latitude) d(longitude)
    along = np.radians([row["sigma_latitude_deg"], row["sigma_longitude_deg"]]) * 6478.0
    along[1] *= np.cos(np.radians(row["latitude_deg"]))
    assert np.hypot(*along) == pytest.approx(np.hypot(*row["sigma_km"]), rel=0.01)
    assert row["nonlinearity"]["measure"] > 0.3
    assert row["nonlinearity"]["misleads"]
    drawn = row["monte_carlo"]
    # those that do not come down are the ones that miss
    assert drawn["undefined"] == pytest.approx(60 - row["impact_probability_monte_carlo"]["hits"], abs=2)
    assert "geodetic (1 sigma" in terminal


def test_the_page_shows_the_earth_to_scale_with_the_fate_of_each_drawn_orbit_and_a_map(
    impactor: tuple[Path, str, int],
) -> None:
    folder, _, _ = impactor
    page = (folder / "run" / "report.html").read_text("utf-8")
    arrays = np.load(folder / "run" / "arrays.npz")
    row = next(row for row in summary_of(folder / "run")["predictions"] if row["plane"] == "entry")
    drawn = row["impact_probability_monte_carlo"]
    fates = arrays["hits_where_it_falls"]
    assert (len(fates), np.nansum(fates)) == (drawn["runs"], drawn["hits"])
    figure = page[page.index('<figure id="map-where-it-falls"') :].split("</figure>")[0]
    shown = np.isfinite(arrays["clones_where_it_falls_km"]).all(axis=1).sum()
    dots = figure.split('data-n="drawn orbits"')[1].split("/>")[0]
    assert dots.count("M") == shown
    assert f"Of 60\N{NO-BREAK SPACE}drawn orbits {shown} come down there" in figure
    assert "the linear ellipse misleads" in figure.lower()


def test_what_does_not_exist_is_a_row_with_status_and_reason_and_the_others_stand(
    impactor: tuple[Path, str, int],
) -> None:
    folder, terminal, code = impactor
    rows = summary_of(folder / "run")["predictions"]
    assert code == 1
    assert [row["status"] for row in rows[:2]] == ["answered", "answered"]
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert [row["name"] for row in rows[2:]] == list("abcdefgh")  # in the order of the mission
    for row, (status, words) in zip(rows[2:], WITHOUT.values()):
        assert row["status"] == status
        assert words in row["reason"]
        assert "semi_axes_km" not in row
        assert f"{row['name']} ({row['plane']}): no answer: " in terminal
        assert f"{row['name']} ({row['plane']}): no answer: " in page


def test_the_other_commands_cope_with_such_rows(
    impactor: tuple[Path, str, int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, _, _ = impactor
    mission = str(folder / "mission.yaml")
    assert main(["report", str(folder / "run")]) == 0
    shutil.copytree(folder / "run", tmp_path / "again")
    assert main(["compare", str(folder / "run"), str(tmp_path / "again")]) == 0
    assert "no answer: the orbit hits earth" in capsys.readouterr().out
    assert main(["validate", mission, "-n", "20", "--workers", "1", "-o", str(tmp_path / "validation")]) in (0, 1)
    capsys.readouterr()
    assert main(["plan", mission, "-p", "where it falls", "-k", "1", "--step", "2 d"]) == 0
    capsys.readouterr()
    assert main(["plan", mission, "-p", "d", "-k", "1", "--step", "2 d"]) == 1
    assert "the orbit hits earth on 2031-06-10T1" in capsys.readouterr().err
    assert main(["check", mission]) == 0


def test_an_ellipse_larger_than_the_earth_is_no_answer_on_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One telescope does not tell the distance: 84728 x 297 km on the ground was printed as an answer."""
    path = written(tmp_path, IMPACTOR.replace("SECOND\n", "") + FALL + TARGET)
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 1
    text = capsys.readouterr().out
    assert "larger than earth at that altitude" in text
    assert "probability of impact 0.0294 (linear)" in text
    row, target = summary_of(tmp_path / "run")["predictions"]
    assert row["status"] == "too_uncertain"
    # on the b-plane the error is a line: its density at the Earth, times the chord of the disc
    along, across = target["semi_axes_km"]
    angle, (xi, zeta) = np.radians(target["angle_deg"]), target["mean_km"]
    far, beside = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ [xi, zeta]
    chord = 2.0 * np.sqrt(target["capture_radius_km"] ** 2 - beside**2)
    expected = chord * np.exp(-0.5 * (far / along) ** 2) / (np.sqrt(2.0 * np.pi) * along)
    assert across < 0.05 * target["capture_radius_km"]
    assert row["impact_probability_linear"] == pytest.approx(expected, rel=0.02)


def test_a_run_of_nothing_but_unanswered_predictions_gives_the_orbit(tmp_path: Path) -> None:
    text = load_mission("minimal").text
    start = text.index("predictions:")
    asked = "predictions:\n  - {name: never, plane: b_plane, body: jupiter, near: 2029-01-01 TDB}\n"
    rest = text[start:].partition("\n\n")[2]
    path = written(tmp_path, text[:start] + asked + rest)
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 1
    summary = summary_of(tmp_path / "run")
    assert summary["estimators"][0]["sigma_position_km"] > 0.0
    assert summary["predictions"][0]["status"] == "no_encounter"


def test_a_collision_twelve_years_ahead_is_not_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """2026 PDC27, an exercise: published about 19 % for 2038-07-10, by 20,000 independent draws 0.184 +- 0.003."""
    records = SHARED / "cases" / "2026pdc27.epoch1.psv"
    if not records.is_file():
        pytest.skip(f"reference data not found at {records}")
    (tmp_path / "pdc.psv").write_text(records.read_text("utf-8").replace("2026 PDC27", "2026 PC27"), "utf-8")
    text = "schema_version: 1\nname: pdc27\nfit: {observations: [pdc.psv], epoch: 2026-08-01 TDB}\npredictions:\n"
    text += "  - {name: impact2038, plane: b_plane, body: earth, near: 2038-07-10T05:30:00 TDB}\n"
    text += "  - {name: too early, plane: b_plane, body: earth, near: 2038-07-01T05:30:00 TDB}\n"
    assert main(["fit", str(written(tmp_path, text)), "-o", str(tmp_path / "fit")]) == 1
    assert "Impact on the Earth: probability 0.185 (linear); the nominal orbit hits on 2038-07-10T05:29:2" in (
        capsys.readouterr().out
    )
    row, early = summary_of(tmp_path / "fit")["predictions"]
    assert row["epoch_tdb"].startswith("2038-07-10T05:30:3")
    assert row["semi_axes_km"] == pytest.approx([29003.0, 4.0], rel=0.01)
    assert 0.18 < row["impact_probability_linear"] < 0.19
    assert early["status"] == "no_encounter"
    assert "2038-07-10T05:30:3" in early["reason"]
    page = (tmp_path / "fit" / "report.html").read_text("utf-8")
    assert "Impact on the Earth: probability 0.185" in page[page.index('id="verdict"') :][:2500]


@pytest.mark.parametrize(
    ("name", "near", "axes_km"),
    [("2024BX1.obs80", "2024-01-21T00:33:00", (0.0769, 0.0365)), ("2018LA.txt", "2018-06-02T16:44:00", (10.4, 1.25))],
)
def test_the_ellipse_of_an_observed_impactor_is_believed(
    name: str, near: str, axes_km: tuple[float, float], tmp_path: Path
) -> None:
    """All of 200 drawn orbits come down; displaced orbits were cut where the nominal one ended. Axes at the altitude
    of the fireball, by drawn orbits."""
    records = SHARED / "data" / ("impact" if name.endswith("txt") else "observations") / name
    if not records.is_file():
        pytest.skip(f"reference data not found at {records}")
    shutil.copy(records, tmp_path / name)
    text = f"schema_version: 1\nname: fallen\nfit:\n  observations: [{name}]\nEPOCHSpredictions:\n"
    text += f"  - {{name: fall, plane: entry, altitude: 50 km, near: {near} UTC}}\n"
    text += f"  - {{name: target, plane: b_plane, near: {near} UTC}}\n"
    late = text.replace("EPOCHS", f"  epochs: [{near[:10]} TDB, 2030-01-01 TDB]\n")
    assert main(["fit", str(written(tmp_path, late)), "-o", str(tmp_path / "late")]) == 1
    there, ended = summary_of(tmp_path / "late")["further"]
    assert there["sigma_position_km"] > 0.0
    assert ended["status"] == "after_impact"
    assert main(["fit", str(written(tmp_path, text.replace("EPOCHS", ""))), "-o", str(tmp_path / "fit")]) == 0
    for row in summary_of(tmp_path / "fit")["predictions"]:
        assert row["nonlinearity"]["misleads"] is False
        assert row["impact_probability_linear"] == pytest.approx(1.0, abs=1e-6)
        if row["plane"] == "entry":
            assert row["semi_axes_km"] == pytest.approx(axes_km, rel=0.05)


def test_a_fit_with_an_encounter_it_does_not_have_is_a_fit(tmp_path: Path) -> None:
    case = SHARED / "cases" / "2024mk-june.yaml"
    if not case.is_file():
        pytest.skip(f"reference data not found at {case}")
    assert main(["fit", str(case), "-o", str(tmp_path / "fit")]) == 0  # of an arc too short: a probability
    summary = summary_of(tmp_path / "fit")
    assert summary["fit"]["n_selected"] == 4
    (row,) = summary["predictions"]
    assert row["status"] in ("no_encounter", "orbit_unknown")
    assert row["reason"]


@pytest.mark.long
def test_the_probability_of_a_fit_is_that_of_orbits_drawn_from_it(tmp_path: Path) -> None:
    """2000 orbits through an encounter in twelve years: 0.184 +- 0.009; 20,000 drawn elsewhere: 0.184 +- 0.003."""
    from nebosvod.dynamics import Ephemeris, ForceModel, propagate_many
    from nebosvod.timescale import Epoch

    records = SHARED / "cases" / "2026pdc27.epoch1.psv"
    if not records.is_file():
        pytest.skip(f"reference data not found at {records}")
    (tmp_path / "pdc.psv").write_text(records.read_text("utf-8").replace("2026 PDC27", "2026 PC27"), "utf-8")
    text = "schema_version: 1\nname: pdc27\nfit: {observations: [pdc.psv]}\n"
    assert main(["fit", str(written(tmp_path, text)), "-o", str(tmp_path / "fit")]) == 0
    summary = summary_of(tmp_path / "fit")
    row, epoch = summary["estimators"][0], Epoch.parse(summary["reference_epoch_tdb"])
    S = np.array(row["factor_km_km_s"])
    starts = row["state_km_km_s"] + np.random.default_rng(5).standard_normal((2000, S.shape[1])) @ S.T
    forces = ForceModel(ephemeris=Ephemeris.load())
    end = Epoch.parse("2038-07-12 TDB") - epoch
    fates = propagate_many(starts, epoch, [end], forces, body="earth").fates
    assert set(fates.body.tolist()) == {"earth"}
    assert fates.impact.mean() == pytest.approx(0.184, abs=0.027)
    assert np.median(fates.t_s[fates.impact]) == pytest.approx(
        Epoch.parse("2038-07-10T05:30:32 TDB") - epoch, abs=300.0
    )
