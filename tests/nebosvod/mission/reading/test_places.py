"""Errors that only a run can find say file, line, column and key of what asked; an ephemeris is used to its ends."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.commands.check_answer import describe
from nebosvod.dynamics.ephemeris import DATA
from nebosvod.errors import InputError
from nebosvod.mission import list_missions, load_mission, load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.scene import build_scene
from nebosvod.timescale import Epoch

ROOT = Path(__file__).resolve().parents[4]
MINIMAL = (ROOT / "scenarios" / "minimal.yaml").read_text("utf-8")
ENDS = ("1990-01-01T00:00:00 TDB", "2060-01-01T00:00:00 TDB")
KINDS = (
    "{kind: geostationary, longitude: 0 deg}",
    "{kind: heliocentric, lead: 10 deg}",
    "{kind: geocentric, a: 20000 km, i: 30 deg}",
    "{kind: sun_synchronous, altitude: 700 km, local_time: 6 h}",
    "{kind: heliocentric_kepler, a: 0.7 au}",
    "{kind: libration, point: L1}",
    "{kind: libration, point: L2, amplitude: 1e5 km}",
    "{kind: distant_retrograde, size: 1.5e7 km, phase: 90 deg}",
    "{kind: ground, code: F51, extrapolate: true}",
)
PLANES = (
    "plane: sky, from: T, at",
    "plane: position, at",
    "plane: rtn, at",
    "plane: rtn_velocity, at",
    "plane: b_plane, near",
    "plane: mtp, near",
    "plane: perigee_distance, near",
    "plane: entry, altitude: 100 km, near",
)
AT_AN_END = """schema_version: 1
name: ends
reference_epoch: {reference}
object:
  name: x
  orbit: {{kind: keplerian, frame: ecliptic_j2000, epoch: {epoch}, a: 1.5 au, e: 0.2, i: 10 deg, node: 20 deg,
    peri: 30 deg, M: 40 deg}}
telescopes: [{{name: T, orbit: {orbit}, noise: {{sigma: 0.1 arcsec}}, exclusion: {exclusion}}}]
schedule: [{{start: {start}, end: {end}, cadence: {cadence}}}]
predictions: [{predictions}]
"""


def at_an_end(end: int, orbit: str, planes: tuple[str, ...] = ()) -> str:
    """A mission whose every epoch is an end of the ephemeris, or within twenty days of it."""
    epoch = Epoch.parse(ENDS[end])
    start, last = (epoch, epoch + 20 * 86400.0) if end == 0 else (epoch + -20 * 86400.0, epoch)
    rows = ", ".join(f"{{name: p{k}, {plane}: {ENDS[end]}}}" for k, plane in enumerate(planes))
    site = "ground" in orbit
    return AT_AN_END.format(
        reference=ENDS[end], epoch=ENDS[end], orbit=orbit, start=start, end=last, predictions=rows,
        cadence="5 h" if site else "2 d", exclusion="{sun_altitude: 90 deg, altitude: -90 deg}" if site else "{}",
    )  # fmt: skip


@pytest.fixture
def excerpt(monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped ephemeris, whatever is installed."""
    monkeypatch.setenv("NEBOSVOD_EPHEMERIS", str(DATA / "de440_1990_2060.bsp"))


@pytest.mark.usefixtures("excerpt")
@pytest.mark.parametrize("end", [0, 1], ids=["first day", "last day"])
@pytest.mark.parametrize("orbit", KINDS)
def test_every_kind_of_telescope_measures_at_both_ends_of_the_ephemeris(orbit: str, end: int) -> None:
    scene = build_scene(load_mission_text(at_an_end(end, orbit)))
    seen = scene.visibilities[0]
    assert np.isfinite(seen.psi).all()
    assert Epoch.parse(ENDS[end]) in (scene.epoch + float(seen.t_s[0]), scene.epoch + float(seen.t_s[-1]))


@pytest.mark.usefixtures("excerpt")
@pytest.mark.parametrize("end", [0, 1], ids=["first day", "last day"])
def test_every_plane_is_answered_at_both_ends_or_says_why_not(end: int, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(at_an_end(end, KINDS[1], PLANES))
    assert main(["check", str(tmp_path / "m.yaml")]) == 0
    assert main(["run", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "out")]) == 1
    rows = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))["predictions"]
    status = {row["plane"]: row["status"] for row in rows}
    assert [status[plane] for plane in ("sky", "position", "rtn", "rtn_velocity")] == ["answered"] * 4
    assert all(row["status"] == "answered" or row["reason"] for row in rows)
    assert (tmp_path / "out" / "report.html").is_file()


def test_directions_on_the_first_day_are_those_of_an_ephemeris_that_begins_earlier(
    excerpt: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nebosvod.dynamics import Ephemeris

    text = at_an_end(0, KINDS[1]) + "force_model: {asteroids: false}\n"
    ours = build_scene(load_mission_text(text)).visibilities[0].psi
    monkeypatch.delenv("NEBOSVOD_EPHEMERIS")
    if "naif" not in Ephemeris.load().source:
        pytest.skip("the full DE440 is not installed")
    assert ours == pytest.approx(build_scene(load_mission_text(text)).visibilities[0].psi, abs=1e-14)


def found_by_check(folder: Path, text: str, code: int, capsys: pytest.CaptureFixture[str], command: str = "run") -> str:
    """What `check` says of a mission that it refuses as the work itself does."""
    (folder / "m.yaml").write_text(text, "utf-8")
    assert main(["check", str(folder / "m.yaml")]) == code
    said = capsys.readouterr().err
    assert main([command, str(folder / "m.yaml"), "-o", str(folder / "out")]) == code
    assert capsys.readouterr().err == said
    return said


def fails(folder: Path, text: str, code: int, capsys: pytest.CaptureFixture[str], command: str = "run") -> str:
    """What a mission that fails in a run says; `check` lets it pass unless it is wrong, and then says the same."""
    if code == 2:
        return found_by_check(folder, text, code, capsys, command)
    (folder / "m.yaml").write_text(text, "utf-8")
    assert main(["check", str(folder / "m.yaml")]) == 0
    capsys.readouterr()
    assert main([command, str(folder / "m.yaml"), "-o", str(folder / "out")]) == code
    return capsys.readouterr().err


def on_a_table(text: str, keys: str) -> str:
    """The smallest mission with its first telescope on a trajectory from a file."""
    ahead, behind = "orbit: {kind: heliocentric, lead: 10 deg}", "orbit: {lead: -10 deg}"
    return text.replace(ahead, f"orbit: {{kind: table, {keys}}}").replace(behind, ahead)


def place_of(text: str, written: str, key: str) -> str:
    """`:line:col: key:` of where something is written."""
    before = text[: text.index(written)]
    return f"m.yaml:{before.count(chr(10)) + 1}:{len(before) - (before.rfind(chr(10)) + 1) + 1}: {key}: "


def test_an_epoch_outside_the_ephemeris_in_use(
    excerpt: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MINIMAL.replace("2028-04-19T00:00:00 TDB", "2061-04-19T00:00:00 TDB").replace(
        "cadence: 1 d", "cadence: 1000 d"
    )
    said = fails(tmp_path, text, 2, capsys)
    assert place_of(text, "2061-04-19", "schedule[0].end") in said
    assert "epoch 2061-04-19T00:00:00 TDB lies outside the ephemeris" in said
    text = MINIMAL.replace("reference_epoch: 2028-03-20", "reference_epoch: 1989-12-31")
    assert place_of(text, "1989-12-31", "reference_epoch") in fails(tmp_path, text, 2, capsys)


def test_a_table_of_a_telescope_that_ends_too_soon(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ["epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"]
    lines += [f"2028-03-{day} TDB,{150e6 + 1e4 * day},{2.5e6 * day},0,0.1,28,0" for day in range(20, 30)]
    (tmp_path / "short.csv").write_text("\n".join(lines))
    text = on_a_table(MINIMAL, "file: short.csv, origin: sun")
    said = fails(tmp_path, text, 2, capsys)
    assert place_of(text, "{start: 2028", "schedule[0]") in said
    assert "short.csv: no state at 2028-03-30" in said
    (tmp_path / "short.csv").write_text("nothing")
    assert "telescopes[0].orbit: short.csv:1: " in found_by_check(tmp_path, text, 2, capsys)


def test_nothing_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = MINIMAL.replace("    noise: {sigma", "    exclusion: {sun: 179.9 deg}\n    noise: {sigma")
    assert place_of(text, "schedule:", "schedule") + "no epoch is visible" in fails(tmp_path, text, 1, capsys)
    assert main(["check", str(tmp_path / "m.yaml")]) == 0
    said = capsys.readouterr().out
    assert "visible          nothing at all, so a run would end without an answer" in said
    assert re.search(r"ahead: 0 of 31 epochs \(not by sun 31\).*; nearest at 2028-.*deg too near", said)


def test_what_is_seen_is_told_before_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The counts of `check` are those of the run, the magnitudes those of its table."""
    text = MINIMAL.replace("  name: Example", "  name: Example\n  magnitude: {H: 27}")
    V = [seen.apparent_magnitude for seen in build_scene(load_mission_text(text)).visibilities]
    limit = round(float(np.sort(V[1])[15]), 2)  # the half of what the fainter view sees
    text = text.replace("    noise: {sigma", f"    limiting_magnitude: {limit}\n    noise: {{sigma")
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    assert main(["check", str(tmp_path / "m.yaml")]) == 0
    said = capsys.readouterr().out
    scene = build_scene(load_mission_text(text))
    assert 0 < np.count_nonzero(V[1] <= limit) < 31
    for telescope, every in zip(scene.telescopes, V):
        bright = every[every <= limit]
        lost = f" (not by magnitude {31 - bright.size})" if bright.size < 31 else ""
        seen = f"{telescope.name}: {bright.size} of 31 epochs{lost}, V "
        assert seen in said
        assert f"{bright.min():.1f}" in said.partition(seen)[2].partition(f" (limit {limit:.4g})")[0]


def test_how_far_the_nearest_epoch_is_from_its_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The magnitude and its lack are those of the table without the limit."""
    text = MINIMAL.replace("  name: Example", "  name: Example\n  magnitude: {H: 27}")
    V = [seen.apparent_magnitude for seen in build_scene(load_mission_text(text)).visibilities]
    text = text.replace("    noise: {sigma", "    limiting_magnitude: 15\n    noise: {sigma")
    said = fails(tmp_path, text, 1, capsys)
    for one in V:
        assert f"V {one.min():.2f}, {one.min() - 15.0:.2f} mag fainter than 15" in said


def test_an_orbit_that_ends_before_the_reference_epoch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = "{kind: state, frame: icrf, epoch: 2028-03-01T00:00:00 TDB, position: [1e6 km, 0 km, 0 km], velocity: ["
    state += "-10 km/s, 0 km/s, 0 km/s]}"
    text = re.sub(r"orbit: \{kind: keplerian.*?\}", f"orbit: {state}", MINIMAL)
    said = fails(tmp_path, text, 1, capsys)
    assert place_of(text, "orbit: {kind: state", "object.orbit") in said
    assert "sun" in said


def test_a_trajectory_that_leads_through_the_earth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A straight line past the centre: 100 km/s, 1000 km from it on the eleventh day."""
    lines = ["epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"]
    start = Epoch.parse("2028-03-19T00:00:00 TDB")
    for k in range(34):
        lines.append(f"{start + 86400.0 * k},{8.64e5 * (k - 11)},1000,0,10,0,0")
    (tmp_path / "line.csv").write_text("\n".join(lines))
    text = on_a_table(MINIMAL, "file: line.csv, origin: earth")
    said = fails(tmp_path, text, 2, capsys)
    assert place_of(text, "orbit: {kind: table", "telescopes[0].orbit") in said
    assert "ahead is inside the earth: 1000 km from its centre at 2028-03-30T00:00:00 TDB" in said


@pytest.mark.parametrize(
    ("edit", "key", "words"),
    [
        (
            {"kind": "ground", "longitude": "0 deg", "rho_cos_phi": 0.0, "rho_sin_phi": 0.0},
            "rho_cos_phi",
            "centre of the",
        ),
        (
            {"kind": "ground", "longitude": "0 deg", "rho_cos_phi": 0.9, "rho_sin_phi": 0.1},
            "rho_cos_phi",
            "km under the",
        ),
        ({"kind": "geocentric", "a": "6000 km", "i": "0 deg"}, "a", "perigee is inside the Earth"),
        ({"kind": "geocentric", "a": "2e6 km", "i": "0 deg"}, "a", "where the Sun takes it away"),
        ({"kind": "geocentric", "a": "7000 km", "i": "190 deg"}, "i", "allowed 0 deg to 180 deg"),
        ({"kind": "heliocentric_kepler", "a": "1 au", "i": "-1 deg"}, "i", "allowed 0 deg to 180 deg"),
        ({"kind": "heliocentric_kepler", "a": "600000 km"}, "a", "perihelion is inside the Sun"),
        ({"kind": "heliocentric_kepler", "a": "1 au", "e": 0.9999}, "a", "perihelion is inside the Sun"),
        ({"kind": "libration", "point": "L1", "amplitude": "1.6e6 km"}, "amplitude", "allowed 0 km to 1500000 km"),
        ({"kind": "libration", "point": "L2", "amplitude_z": "1.6e6 km"}, "amplitude_z", "allowed 0 km to 1500000 km"),
        ({"kind": "distant_retrograde", "size": "2e6 km"}, "size", "allowed 3e.06 km to 1.5e.07 km"),
        ({"kind": "distant_retrograde", "size": "0.2 au"}, "size", "allowed 3e.06 km to 1.5e.07 km"),
        ({"kind": "sun_synchronous", "altitude": "-5 km", "local_time": "6 h"}, "altitude", "more than 0"),
    ],
)
def test_a_place_where_no_telescope_can_be_is_refused(edit: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError, match=rf":\d+:\d+: telescopes\[0\]\.orbit\.{key}: .*{words}"):
        load_mission("minimal").with_("telescopes.0.orbit", edit)


def test_an_inclination_is_between_0_and_180_deg() -> None:
    for bad in ("-0.1 deg", "180.1 deg", "4 rad"):
        with pytest.raises(InputError, match=r"object\.orbit\.i: is out of range .*allowed 0 deg to 180 deg"):
            load_mission("minimal").with_("object.orbit.i", bad)
    for good in ("0 deg", "180 deg", "90 deg"):
        load_mission("minimal").with_("object.orbit.i", good)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ({"kind": "geocentric", "a": "6450 km", "i": "0 deg"}, "its perigee, 71.86 km, is in the atmosphere"),
        ({"kind": "sun_synchronous", "altitude": "100 km", "local_time": "6 h"}, "its altitude, 100 km, is in the atm"),
        ({"kind": "geocentric", "a": "4e5 km", "i": "0 deg"}, "the Moon would change the ellipse"),
        ({"kind": "libration", "point": "L1", "amplitude": "1e6 km"}, "beyond the linear model of a halo"),
        ({"kind": "libration", "point": "L1", "amplitude_z": "9e5 km"}, "beyond the linear model of a halo"),
        (
            {"kind": "ground", "longitude": "0 deg", "rho_cos_phi": 1.006, "rho_sin_phi": 0.0, "extrapolate": True},
            "38.3 km",
        ),
        ({"kind": "ground", "code": "500", "extrapolate": True}, "is the centre of the Earth"),
    ],
)
def test_a_doubtful_place_is_a_caution_of_check_and_run(edit: dict[str, Any], words: str, tmp_path: Path) -> None:
    mission = load_mission("minimal").with_("telescopes.0.orbit", edit)
    assert any(words in notice for notice in mission.notices)
    assert words in describe(mission)
    mission = mission.with_({"schedule.0.cadence": "3 d", "telescopes.1.orbit.lead": "-20 deg"})
    assert any(words in warning for warning in run(mission).summary["warnings"])


@pytest.mark.parametrize("name", [name for name, _ in list_missions()])
def test_no_built_in_mission_has_a_doubtful_place(name: str) -> None:
    assert not [n for n in load_mission(name).notices if "fixed" not in n]


def made_records(begin: Epoch, code: str = "500") -> str:
    """MPC records from the Earth's centre: three a night, every third day for three weeks, 0.2 arcsec of noise."""
    from nebosvod.dynamics import Ephemeris, ForceModel, propagate
    from nebosvod.observation import GroundSite, Telescope, observe

    rng, ephemeris = np.random.default_rng(3), Ephemeris.load()
    t_s = np.sort(np.concatenate([np.arange(0.0, 21.0, 3.0) + hour / 24.0 for hour in (0.5, 1.0, 1.5)])) * 86400.0
    earth = ephemeris.state_km_km_s("earth", begin, 0.0)[0] - ephemeris.state_km_km_s("sun", begin, 0.0)[0]
    state = 1.2 * earth * np.array([1.0, 1.0, 1.05, 0.9, 0.9, 0.95])
    orbit = propagate(state, begin, t_s, ForceModel(ephemeris=ephemeris))
    centre = Telescope(name=code, spacecraft=GroundSite(itrf_km=np.zeros(3), extrapolate=True), sigma_rad=1e-6)
    psi = observe(orbit, centre, t_s, ephemeris).psi + rng.normal(0.0, 0.2 / 206264.8, (t_s.size, 2))
    rows = []
    for t, (ra, dec) in zip(t_s, np.degrees(psi)):
        date = (begin + float(t)).iso("utc", 6)
        day = int(date[8:10]) + (int(date[11:13]) + (int(date[14:16]) + float(date[17:26]) / 60.0) / 60.0) / 24.0
        hours, size = ra / 15.0, abs(dec)
        rows.append(
            f"     K24A01A  C{date[:4]} {date[5:7]} {day:09.6f}"
            f"{int(hours):02d} {int(hours * 60 % 60):02d} {hours * 3600 % 60:06.3f}"
            f"{'-' if dec < 0 else '+'}{int(size):02d} {int(size * 60 % 60):02d} {size * 3600 % 60:05.2f}"
            f"         20.0 Vd     {code}"
        )
    return "\n".join(rows) + "\n"


FIT = "schema_version: 1\nname: ends\nfit:\n  observations: [made.obs80]\n"


@pytest.mark.usefixtures("excerpt")
@pytest.mark.parametrize("end", [0, 1], ids=["first day", "last day"])
def test_observations_at_both_ends_of_the_ephemeris_are_fitted(end: int, tmp_path: Path) -> None:
    begin = Epoch.parse(ENDS[0]) if end == 0 else Epoch.parse(ENDS[1]) + -(18 * 86400.0 + 2 * 3600.0)
    (tmp_path / "made.obs80").write_text(made_records(begin))
    (tmp_path / "m.yaml").write_text(
        FIT + f"  epochs: [{ENDS[end]}]\npredictions: [{{name: p, plane: position, at: {ENDS[end]}}}]\n"
    )
    assert main(["fit", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "out"), "--export"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert summary["predictions"][0]["status"] == "answered"


@pytest.mark.usefixtures("excerpt")
def test_what_a_fit_asks_outside_the_ephemeris_is_named_by_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "made.obs80").write_text(made_records(Epoch.parse("2024-02-01 TDB")))
    text = FIT + "  epoch: 2061-01-01T00:00:00 TDB\n"
    assert place_of(text, "2061-01-01", "fit.epoch") + "epoch 2061" in found_by_check(tmp_path, text, 2, capsys, "fit")
    text = FIT + "  spacecraft: {C57: {kind: oem, file: none.oem}}\n"
    (tmp_path / "none.oem").write_text("nothing")
    assert place_of(text, "C57", "fit.spacecraft.C57") in found_by_check(tmp_path, text, 3, capsys, "fit")
    text = FIT + "  weights: none.oem\n"
    assert place_of(text, "none.oem", "fit.weights") in found_by_check(tmp_path, text, 2, capsys, "fit")
    late = (tmp_path / "made.obs80").read_text().replace("C2024", "C2061")
    (tmp_path / "made.obs80").write_text(late)
    assert "made.obs80:1: epoch 2061-02" in found_by_check(tmp_path, FIT, 2, capsys, "fit")
