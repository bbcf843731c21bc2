"""The built-in missions: that they are what they claim, and that the numbers are those of their sources."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from nebosvod.mission import (
    Geostationary,
    Heliocentric,
    Mission,
    estimate_cost,
    list_missions,
    load_mission,
    load_mission_text,
    template_text,
)
from nebosvod.pipeline import run
from nebosvod.results.result import Result
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM

ROOT = Path(__file__).resolve().parents[3]
SBDB = ROOT.parent / "shared" / "data" / "orbits" / "sbdb" / "99942_phys.json"
NAMES = [name for name, _ in list_missions()]
ARCSEC = math.pi / 648000.0


@pytest.fixture(scope="module", params=["apophis-2029", "apophis-heliocentric"])
def apophis(request: pytest.FixtureRequest) -> Mission:
    """Either Apophis mission."""
    return load_mission(request.param)


def test_the_promised_missions_are_built_in_with_titles() -> None:
    missions = dict(list_missions())
    assert {"apophis-2029", "apophis-heliocentric", "minimal"} <= set(missions)
    assert {"neomir-like", "soda-like", "surveyor-venus"} <= set(missions)
    assert all(missions.values())


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_mission_loads_and_bears_its_own_name(name: str) -> None:
    mission = load_mission(name)
    assert mission.name == name
    assert estimate_cost(mission).time_s < 60.0  # seconds: `make demo` promises a minute


@pytest.mark.parametrize("name", NAMES)
def test_every_number_of_a_telescope_is_said_to_be_an_assumption(name: str) -> None:
    text = (ROOT / "scenarios" / f"{name}.yaml").read_text("utf-8")
    if "Every number is an assumption" in text:
        return
    block = text[text.index("telescopes:") : text.index("schedule:")]
    for line in block.splitlines()[1:]:
        assert not line or "#" in line or "name:" in line or "like:" in line, line


@pytest.mark.skipif(not SBDB.exists(), reason="the reference data are not beside the project")
def test_apophis_has_the_numbers_of_jpl_solution_220(apophis: Mission) -> None:
    answer = json.loads(SBDB.read_text("utf-8"))
    elements = {item["label"]: float(item["value"]) for item in answer["orbit"]["covariance"]["elements"]}
    physical = {item["name"]: item for item in answer["phys_par"]}
    orbit = apophis.object.orbit
    epoch = Epoch.from_jd(float(answer["orbit"]["covariance"]["epoch"]))
    assert orbit.epoch == epoch
    e, q, tp, node, peri, i = orbit.elements
    assert e == elements["e"]
    assert q == pytest.approx(elements["q"] * AU_KM, rel=1e-15)
    assert tp == pytest.approx((elements["tp"] - 2459215.5) * 86400.0, abs=1e-4)  # s: a float64 Julian date
    for got, label in ((node, "node"), (peri, "peri"), (i, "i")):
        assert math.degrees(got) == pytest.approx(elements[label], rel=1e-15)
    (a2,) = apophis.object.nongrav_parameters
    assert a2.name == "a2_au_d2"
    assert a2.value == float(next(p["value"] for p in answer["orbit"]["model_pars"] if p["name"] == "A2"))
    assert apophis.object.magnitude is not None
    assert float(physical["H"]["value"]) == apophis.object.magnitude.H
    assert float(physical["G"]["value"]) == apophis.object.magnitude.G
    radius, mass, albedo, heat = apophis.object.radiation_parameters
    assert radius.value == pytest.approx(500.0 * float(physical["diameter"]["value"]))
    assert radius.sigma == pytest.approx(500.0 * float(physical["diameter"]["sigma"]))
    bond = apophis.object.magnitude.phase_integral * float(physical["albedo"]["value"])
    assert albedo.value == pytest.approx(bond, abs=5e-4)  # rounded to three digits in the file
    assert (mass.value, mass.sigma, heat.value) == (6.1e10, 1.5e10, 0.0)


def test_apophis_is_watched_as_promised(apophis: Mission) -> None:
    for telescope in apophis.telescopes:
        assert telescope.noise.sigma_rad == pytest.approx((0.1 * ARCSEC, 0.1 * ARCSEC))
        assert telescope.bias is not None
        assert telescope.bias.sigma_rad == pytest.approx((0.05 * ARCSEC, 0.05 * ARCSEC))
        assert telescope.bias.treatment == "estimated"
        assert telescope.position is not None
        assert telescope.position.sigma_km == (3.0, 3.0, 3.0)
        assert (telescope.position.correlation, telescope.position.treatment) == ("white", "estimated")
        assert telescope.exclusion.sun == pytest.approx(math.radians(45.0))
        assert telescope.exclusion.earth == pytest.approx(math.radians(10.0))
    times = apophis.times_s("NEB-1")
    assert len(times) == 289  # 144 days at 12 h, both ends
    assert times[0] == 0.0
    assert times[-1] == 144.0 * 86400.0
    assert apophis.prior == "none"
    assert {e.method for e in apophis.estimators} == {"batch_qr", "batch_blocks", "batch_identity", "recursive"}
    assert {p.plane for p in apophis.predictions} == {"sky", "position", "b_plane", "perigee_distance"}


def test_the_two_apophis_missions_differ_in_the_orbits_of_the_telescopes_alone() -> None:
    geo, sun = load_mission("apophis-2029"), load_mission("apophis-heliocentric")
    assert [t.orbit.longitude for t in geo.telescopes if isinstance(t.orbit, Geostationary)] == [0.0, math.pi]
    leads = [t.orbit.lead for t in sun.telescopes if isinstance(t.orbit, Heliocentric)]
    assert leads == pytest.approx([math.radians(10.0), -math.radians(10.0)])
    for key in ("object", "schedule", "estimators", "predictions", "prior", "reference_epoch", "force_model"):
        assert getattr(geo, key) == getattr(sun, key)


def test_minimal_is_about_twenty_lines() -> None:
    lines = (ROOT / "scenarios" / "minimal.yaml").read_text("utf-8").splitlines()
    assert len([line for line in lines if line and not line.startswith("#")]) <= 22


@pytest.mark.parametrize("name", ["mine", "null", "моя миссия", 'a"b', "x: y", "-", "a\\b"])
def test_the_template_is_a_mission_of_the_name_asked_for(name: str) -> None:
    assert load_mission_text(template_text(name)).name == name


@pytest.fixture(scope="module", params=["neomir-like", "soda-like", "surveyor-venus"])
def published(request: pytest.FixtureRequest) -> Result:
    """The result of a mission modelled on a published concept."""
    return run(load_mission(request.param))


def test_a_mission_after_a_published_concept_runs_and_its_estimators_agree(published: Result) -> None:
    rows = published.summary["estimators"]
    assert [row["status"] for row in rows] == ["converged"] * len(rows)
    assert rows[0]["sigma_position_km"] == pytest.approx(rows[1]["sigma_position_km"], rel=1e-6)
    visible = published.tables["visibility"].columns["visible"]
    assert np.count_nonzero(visible) == published.summary["n_observations"]


# km, semi-axes at 1 sigma of the first estimator: what docs/missions.md quotes
QUOTED = {
    "neomir-like": ("entry point", (89.7, 9.93)),
    "soda-like": ("entry point", (6.82, 1.58)),
    "surveyor-venus": ("encounter", (45.5, 22.0)),
}


def test_the_accuracies_that_the_documentation_quotes_are_those_of_a_run(published: Result) -> None:
    name, quoted = QUOTED[published.summary["mission"]]
    row = next(row for row in published.summary["predictions"] if row["name"] == name)
    assert row["semi_axes_km"] == pytest.approx(quoted, rel=0.02)  # of the orbit fitted to seed 0
    page = (ROOT / "docs" / "missions.md").read_text("utf-8")
    assert all(f"{size:.3g} km" in page or f"{size:g}" in page for size in quoted)


def test_one_spacecraft_at_l1_alone_does_not_tell_where() -> None:
    text = load_mission("soda-like").text.replace("  - {start:", "  - {telescopes: [SODA-1], start:")
    second = text[text.index("  - name: SODA-2") : text.index("schedule:")]
    alone = run(load_mission_text(text.replace(second, "\n")))
    row = next(row for row in alone.summary["predictions"] if row["name"] == "entry point")
    assert row["status"] == "too_uncertain"
    assert "would be 8875 x 2.999 km" in row["reason"]
