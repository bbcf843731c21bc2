"""Telescopes from files, codes and duty windows through whole missions; uncertainties that come with an orbit."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.engine.assembly import linear_problem, nominal_view, view
from nebosvod.engine.fitting import fit
from nebosvod.engine.truth import draw
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.observation import Common, OrbitError
from nebosvod.pipeline import run
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene, build_scene

Setting = tuple[Scene, PriorTable, View]
DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
JWST = DATA / "observers" / "jwst_horizons_20200101_20240101_v01.bsp"
OEM = DATA / "formats" / "ccsds" / "AstroForgeSC_Optical.oem"
AHEAD = "orbit: {kind: heliocentric, lead: 10 deg}"
WHITE = "position: {sigma: 3 km, correlation: white, treatment: estimated}"
CARRIED = "position: {correlation: orbit_error, covariance: orbit, treatment: considered}"
SECOND = "  - {name: behind, like: ahead, orbit: {lead: -10 deg}}\n"


def text_with(minimal: Mission, orbit: str, position: str = WHITE) -> str:
    """The smallest mission with another first telescope; the second is as it was, said in full."""
    text = minimal.text
    first = text[text.index("  - name: ahead") : text.index(SECOND)]
    second = first.replace("name: ahead", "name: behind").replace("lead: 10", "lead: -10")
    return text.replace(AHEAD, orbit).replace(WHITE, position).replace(SECOND, second)


def beside(folder: Path, text: str, **files: str) -> Mission:
    """A mission on disk with files beside it."""
    for name, content in files.items():
        (folder / f"{name}.oem").write_text(content, "utf-8")
    path = folder / "m.yaml"
    path.write_text(text, "utf-8")
    return load_mission(path)


def oem(scene: Scene, frame: str = "RTN", sigmas: tuple[float, ...] = (1.0, 2.0, 3.0, 1e-6, 2e-6, 3e-6)) -> str:
    """The orbit of the first telescope of a scene as an OEM message, with two covariances ten days apart."""
    days = np.arange(-2.0, 43.0)
    carrier = scene.telescopes[0].spacecraft
    states = carrier.state_km_km_s(scene.ephemeris, scene.epoch, days * 86400.0)
    states -= scene.ephemeris.state_km_km_s("sun", scene.epoch, days * 86400.0)
    when = [(scene.epoch + 86400.0 * day).iso().removesuffix(" TDB") for day in days]
    lines = [
        "CCSDS_OEM_VERS = 2.0",
        "META_START",
        "OBJECT_NAME = AHEAD",
        "CENTER_NAME = SUN",
        "REF_FRAME = ICRF",
        "TIME_SYSTEM = TDB",
        f"START_TIME = {when[0]}",
        f"STOP_TIME = {when[-1]}",
        "INTERPOLATION = HERMITE",
        "INTERPOLATION_DEGREE = 15",
        "META_STOP",
        *(f"{t} " + " ".join(f"{x:.9f}" for x in row) for t, row in zip(when, states)),
        "COVARIANCE_START",
    ]
    for day, factor in ((3, 1.0), (13, 10.0)):  # one and eleven days after the reference epoch
        lines += [f"EPOCH = {when[day]}", f"COV_REF_FRAME = {frame}"]
        for i, sigma in enumerate(sigmas):
            lines.append(" ".join(["0.0"] * i + [repr((factor * sigma) ** 2)]))
    return "\n".join([*lines, "COVARIANCE_STOP"]) + "\n"


@pytest.mark.parametrize(("epoch", "day", "factor"), [("", 1.0, 1.0), (", epoch: 2028-04-02T00:00:00 TDB", 11.0, 10.0)])
def test_an_orbit_error_takes_the_covariance_of_the_file_nearest_to_its_epoch(
    tmp_path: Path, minimal: Mission, minimal_setting: Setting, epoch: str, day: float, factor: float
) -> None:
    position = CARRIED.replace("covariance: orbit", f"covariance: orbit{epoch}")
    text = text_with(minimal, "orbit: {kind: oem, file: a.oem}", position)
    scene = build_scene(beside(tmp_path, text, a=oem(minimal_setting[0])))
    found = next(one for one in scene.nuisances if isinstance(one, OrbitError))
    assert found.name == "orbit error ahead"
    assert found.frame == "rtn"
    assert found.at_s == pytest.approx(day * 86400.0, abs=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), factor * np.array([1, 2, 3, 1e-6, 2e-6, 3e-6]))


def test_the_carried_covariance_acts_as_the_same_numbers_in_the_mission(
    tmp_path: Path, minimal: Mission, minimal_setting: Setting, make_setting: Callable[[Mission], Setting]
) -> None:
    """RTN axes at the epoch of the covariance; the orbit interpolated to metres in the file."""
    said = (
        "position: {correlation: orbit_error, sigmas: [1 km, 2 km, 3 km], velocity_sigmas: [1 mm/s, 2 mm/s, 3 mm/s], "
        "frame: rtn, epoch: 2028-03-21T00:00:00 TDB, treatment: considered}"
    )
    sigmas = []
    for position in (CARRIED, said):
        text = text_with(minimal, "orbit: {kind: oem, file: a.oem}", position)
        scene, priors, nominal = make_setting(beside(tmp_path, text, a=oem(minimal_setting[0])))
        estimator = scene.mission.estimators[0]
        problem = linear_problem(scene, estimator, nominal, nominal.observation.psi, priors, nominal.point)
        prior = next(prior for prior in problem.priors if prior.name == "orbit error ahead")
        block = next(block for block in problem.blocks if block.name == "orbit error ahead")
        sigmas.append(np.einsum("npk,kl,npl->np", block.H, prior.covariance, block.H) ** 0.5)
    assert sigmas[0].max() > 0.0
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=1e-9)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda text: text[: text.index("COVARIANCE_START")], "a.oem: has no covariance, and orbit error ahead asks"),
        (lambda text: text.replace("= RTN", "= TNW"), "a.oem: a covariance on the axes TNW cannot be used"),
        (lambda text: text.replace("0.0 0.0 9.0\n", "0.0 0.0 -9.0\n"), "a.oem: the covariance of 2028-03-21"),
    ],
)
def test_a_file_without_a_usable_covariance_says_so(
    tmp_path: Path, minimal: Mission, minimal_setting: Setting, edit: Callable[[str], str], message: str
) -> None:
    text = text_with(minimal, "orbit: {kind: oem, file: a.oem}", CARRIED)
    mission = beside(tmp_path, text, a=edit(oem(minimal_setting[0])))
    with pytest.raises(InputError) as caught:
        build_scene(mission)
    assert message in str(caught.value)


def test_a_carried_covariance_needs_an_orbit_that_carries_one(minimal: Mission) -> None:
    with pytest.raises(
        InputError, match=r"telescopes\[0\]\.position\.covariance: .* only kind oem has one \(got helio"
    ):
        load_mission_text(text_with(minimal, AHEAD, CARRIED))
    framed = CARRIED.replace("covariance: orbit", "covariance: orbit, frame: rtn")
    with pytest.raises(InputError, match=r"position\.frame: is said by the file of the orbit"):
        load_mission_text(text_with(minimal, AHEAD, framed))


@pytest.mark.skipif(not JWST.exists(), reason="the reference data are not beside the project")
def test_a_mission_runs_with_jwst_on_its_real_orbit(tmp_path: Path, minimal: Mission) -> None:
    (tmp_path / "jwst.bsp").symlink_to(JWST)
    text = text_with(minimal, "orbit: {kind: spk, file: jwst.bsp}").replace("2028-", "2022-")
    with pytest.raises(InputError, match="leads out of the folder"):
        beside(tmp_path, text)
    (tmp_path / "jwst.bsp").unlink()
    (tmp_path / "jwst.bsp").write_bytes(JWST.read_bytes())
    found = run(beside(tmp_path, text))
    assert found.summary["estimators"][0]["status"] == "converged"
    assert found.summary["n_observations"] == 62
    scene = build_scene(load_mission(tmp_path / "m.yaml"))
    t_s = scene.visibilities[0].t_s[scene.visibilities[0].visible]
    state = scene.telescopes[0].spacecraft.state_km_km_s(scene.ephemeris, scene.epoch, t_s)
    distance = np.linalg.norm(state[:, :3] - scene.ephemeris.position_km("earth", scene.epoch, t_s), axis=1)
    assert distance.min() > 1.1e6  # its halo about L2
    assert distance.max() < 1.9e6


@pytest.mark.skipif(not OEM.exists(), reason="the reference data are not beside the project")
def test_a_mission_runs_with_a_real_oem_file(tmp_path: Path, minimal: Mission) -> None:
    """AstroForge's probe in the hours after its launch; the object stands where the smallest mission has it."""
    dated = text_with(minimal, "orbit: {kind: oem, file: probe.oem}")
    dated = (
        dated.replace("2028-03-20", "2025-02-28")
        .replace("2028-04-19T00:00:00", "2025-02-28T20:00:00")
        .replace("2028-04-29", "2025-03-12")
    )
    dated = dated.replace("start: 2025-02-28T00:00:00", "start: 2025-02-28T06:00:00").replace(
        "cadence: 1 d", "cadence: 1 h"
    )
    found = run(beside(tmp_path, dated, probe=OEM.read_text("utf-8")))
    assert found.summary["estimators"][0]["status"] == "converged"
    assert [row["visible"] for row in found.summary["visibility"]] == [15, 15]


def test_an_observatory_code_is_a_site(minimal: Mission, capsys: pytest.CaptureFixture[str]) -> None:
    """Pan-STARRS 1: the MPC's parallax constants of F51, 203.744100 deg, 0.936241, +0.351543."""
    by_code = build_scene(load_mission_text(text_with(minimal, "orbit: {kind: ground, code: F51, extrapolate: true}")))
    constants = "longitude: 203.744090 deg, rho_cos_phi: 0.936239, rho_sin_phi: 0.351538, extrapolate: true"
    by_hand = build_scene(load_mission_text(text_with(minimal, f"orbit: {{kind: ground, {constants}}}")))
    states = [s.telescopes[0].spacecraft.state_km_km_s(s.ephemeris, s.epoch, np.zeros(1)) for s in (by_code, by_hand)]
    assert np.abs(states[0] - states[1])[:, :3].max() < 0.1  # km: the constants quoted have a grain of 6 m
    for code, words in (("F5I", "nearest: F51 (Pan-STARRS 1, Haleakala)"), ("C57", "C57 (TESS) has no fixed place")):
        with pytest.raises(InputError, match=r"telescopes\[0\]\.orbit\.code") as caught:
            load_mission_text(text_with(minimal, f"orbit: {{kind: ground, code: {code}}}"))
        assert words in str(caught.value)


def test_row_23_duty_windows_that_leave_nothing_exit_1_with_the_count(
    tmp_path: Path, minimal: Mission, capsys: pytest.CaptureFixture[str]
) -> None:
    duty = "noise: {sigma: 0.1 arcsec}\n    duty: [{start: 2028-05-01 TDB, end: 2028-05-02 TDB}]"
    path = tmp_path / "m.yaml"
    path.write_text(minimal.text.replace("noise: {sigma: 0.1 arcsec}", duty), "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "r")]) == 1
    err = capsys.readouterr().err
    assert "no epoch is visible" in err
    assert "ahead: 0 of 31 epochs visible; removed by duty 31" in err
    assert "behind: 0 of 31 epochs visible; removed by duty 31" in err
    assert not (tmp_path / "r").exists()
    path.write_text(minimal.text.replace("noise: {sigma: 0.1 arcsec}", duty.replace("-05-", "-04-")), "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "r")]) in (
        0,
        1,
    )  # two epochs of each: six unknowns, eight numbers
    assert '"visible": 2' in (tmp_path / "r" / "summary.json").read_text("utf-8")


def test_a_zone_stays_that_of_the_reference_orbit_while_the_orbit_is_improved(
    minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """The prior moves the object by 0.1 deg, zones are 0.06 deg wide: the parameters must not change on the way."""
    bias = "bias: {sigma: 0.05 arcsec, correlation: per_zone, zone: 0.06 deg, treatment: estimated}"
    text = minimal.text.replace("bias: {sigma: 0.05 arcsec, treatment: estimated}", bias)
    text = text.replace("predictions:", "prior: {sigma: {position: 10000 km, velocity: 1 m/s}}\npredictions:")
    scene, priors, nominal = make_setting(load_mission_text(text))
    truth = draw(scene, priors, np.random.default_rng(3))
    moved = view(scene, truth.point)
    wanted = [term.names for term in nominal.terms if isinstance(term, Common)]
    assert [term.names for term in moved.terms if isinstance(term, Common)] == wanted
    shift = np.abs(moved.observation.psi - nominal.observation.psi).max()
    assert shift > np.radians(0.06)  # borders were crossed
    found = fit(scene, scene.mission.estimators[0], nominal, truth.psi, priors)
    assert str(found.status) == "converged"
    error = [found.point.values[name] - truth.point.values[name] for name in found.estimate.names[:3]]
    assert np.abs(error / np.sqrt(np.diag(found.estimate.K_true)[:3])).max() < 4.0
    assert nominal_view(scene).point.nuisances.keys() == found.point.nuisances.keys()
