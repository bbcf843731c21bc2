"""Who is to blame, and how well a telescope must be known: each answer against a mission that says it outright."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.findings.blame import Worlds, quantity_shares, state_shares
from nebosvod.findings.required import required
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

Setting = tuple[Scene, PriorTable, View]
MakeSetting = Callable[[Mission], Setting]
NOISE = "noise: {sigma: 0.1 arcsec}"
BIAS = "bias: {sigma: 0.05 arcsec, treatment: estimated}"
POSITION = "position: {sigma: 3 km, correlation: white, treatment: estimated}"


def solved(setting: Setting) -> tuple[Scene, Fit, list[Quantity]]:
    """The first estimator on measurements without errors, and its predictions."""
    scene, priors, nominal = setting
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    return scene, one, [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]


def total_sigma(make_setting: MakeSetting, text: str) -> float:
    """Total sigma of the first prediction of a mission."""
    _, one, asked = solved(make_setting(load_mission_text(text)))
    return float(np.linalg.norm(one.estimate.predict(*known_partials(asked[0], one.estimate)).factor))


def changed(text: str, old: str, new: str) -> str:
    """The text with one block changed, for the telescope `ahead` and so for `behind`, which is like it."""
    assert old in text
    return text.replace(old, new)


BEHIND = "{name: behind, like: ahead, orbit: {lead: -10 deg}"


@pytest.mark.parametrize(
    ("source", "remedy", "own"),
    [
        ("measurement noise behind", "if_halved", "noise: {sigma: 0.05 arcsec}"),
        ("bias behind", "if_halved", "bias: {sigma: 0.025 arcsec, treatment: estimated}"),
        ("telescope position behind", "if_halved", "position: {sigma: 1.5 km, correlation: white}"),
        ("telescope position behind", "if_vanished", "position: {sigma: 1e-6 km, correlation: white}"),
        ("bias behind", "if_vanished", "bias: {sigma: 1e-9 arcsec, treatment: estimated}"),
    ],
)
def test_a_remedy_with_a_new_gain_is_the_mission_that_says_it(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str, source: str, remedy: str, own: str
) -> None:
    scene, one, asked = solved(minimal_setting)
    row = next(r for r in quantity_shares(scene, Worlds.of(one), asked[0]) if r.source == source)
    wanted = total_sigma(make_setting, changed(minimal_text, BEHIND, f"{BEHIND}, {own}"))
    assert getattr(row.remedies, remedy).new_gain.total == pytest.approx(wanted, rel=1e-5)
    assert row.telescopes == ("behind",)


PRIOR = "prior: {sigma: {position: SIZE km, velocity: RATE m/s}}\n"


def test_a_prior_known_exactly_and_one_that_is_missing_are_the_missions_that_say_so(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    """Orbit: P0 -> 0 and no prior. Of noise nothing is known beforehand that could be missing."""
    said = PRIOR.replace("SIZE", "30").replace("RATE", "0.01")
    scene, one, asked = solved(make_setting(load_mission_text(minimal_text + said)))
    rows = {row.source: row.remedies for row in quantity_shares(scene, Worlds.of(one), asked[0])}
    exact = total_sigma(make_setting, minimal_text + PRIOR.replace("SIZE", "1e-6").replace("RATE", "1e-9"))
    found = rows["prior orbit"]
    assert found.if_vanished.new_gain.total == pytest.approx(exact, rel=1e-3)
    assert found.if_unknown.new_gain.total == pytest.approx(total_sigma(make_setting, minimal_text), rel=1e-4)
    free = changed(minimal_text, BEHIND, f"{BEHIND}, bias: null, timing: null")
    free = changed(
        free, "predictions:", "shared: [{name: b, telescopes: [behind], bias: {treatment: estimated}}]\npredictions:"
    )
    assert rows["bias behind"].if_unknown.new_gain.total == pytest.approx(
        total_sigma(make_setting, free + said), rel=1e-4
    )
    assert rows["measurement noise ahead"].if_unknown is None
    assert rows["telescope position ahead"].if_unknown is None
    state = {row.source: row.remedies for row in state_shares(scene, one, Worlds.of(one))}
    km = state["prior orbit"].if_unknown.new_gain.position_km
    _, without, _ = solved(make_setting(load_mission_text(minimal_text)))
    assert km == pytest.approx(np.sqrt(np.trace(without.estimate.covariance(("x_km", "y_km", "z_km")))), rel=1e-4)


def test_a_prior_that_only_considered_parameters_have_is_never_missing(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    text = minimal_text.replace("sigma: 2 m, treatment: estimated", "sigma: 2 m, treatment: considered")
    scene, one, asked = solved(make_setting(load_mission_text(text)))
    rows = {row.source: row.remedies for row in quantity_shares(scene, Worlds.of(one), asked[0])}
    assert rows["radius"].if_unknown is None
    assert rows["mass"].if_unknown is not None


def test_a_missing_orbit_costs_the_same_whatever_the_epoch_of_its_prior(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    """Given a month earlier the prior joins orbit and body; without the orbit the body is as uncertain as before."""
    rows = ", ".join(str([v if i == j else 0 for j in range(6)]) for i, v in enumerate([900.0] * 3 + [1e-10] * 3))
    said = f"prior: {{names: [x, y, z, vx, vy, vz], epoch: 2028-02-20 TDB, frame: icrf, covariance: [{rows}]}}\n"
    scene, one, asked = solved(make_setting(load_mission_text(minimal_text + said)))
    shares = {row.source: row.remedies for row in quantity_shares(scene, Worlds.of(one), asked[0])}
    assert shares["prior orbit and parameters"].if_unknown.new_gain.total == pytest.approx(
        total_sigma(make_setting, minimal_text), rel=1e-4
    )


def test_the_run_of_the_source_says_both_of_its_prior_orbit(neb_text: str, tmp_path: Path) -> None:
    """Encounter total: 3.39 km without a prior, 0.267 km with the orbit known exactly (two missions of their own)."""
    path = tmp_path / "neb.yaml"
    path.write_text(neb_text + "prior: {sigma: {position: 1000 km, velocity: 0.2 m/s}}\n", "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    encounter = next(row for row in summary["predictions"] if row["name"] == "enc")
    prior = next(row for row in encounter["budget"] if row["source"] == "prior orbit")
    assert prior["if_unknown"]["sigma_total_km_new_gain"] == pytest.approx(3.39, abs=0.01)
    assert prior["if_vanished"]["sigma_total_km_new_gain"] == pytest.approx(0.267, abs=0.002)
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert "Were prior orbit known exactly" in page
    assert "were nothing known of it beforehand" in page
    assert "prior orbit to vanish" not in page


def test_with_the_gain_as_it_is_a_remedy_takes_its_share_of_the_variance(minimal_setting: Setting) -> None:
    scene, one, asked = solved(minimal_setting)
    worlds = Worlds.of(one)
    found = one.estimate.predict(*known_partials(asked[0], one.estimate))
    rows = quantity_shares(scene, worlds, asked[0])
    assert sum(row.share_total for row in rows) == pytest.approx(1.0, rel=1e-12)
    assert [row.share_total for row in rows] == sorted((row.share_total for row in rows), reverse=True)
    for row in rows:
        part = np.diag(found.shares[row.source])
        for remedy, lost in ((row.remedies.if_vanished, 1.0), (row.remedies.if_halved, 0.75)):
            wanted = np.sqrt(np.diag(found.covariance) - lost * part)
            np.testing.assert_allclose(remedy.same_gain.each, wanted, rtol=1e-9)
            assert remedy.new_gain is not None
            assert remedy.new_gain.total <= remedy.same_gain.total * (1 + 1e-9)


def test_the_budget_of_the_state_adds_up_and_knows_its_telescopes(minimal_setting: Setting) -> None:
    scene, one, _ = solved(minimal_setting)
    rows = state_shares(scene, one, Worlds.of(one))
    assert sum(row.share_position for row in rows) == pytest.approx(1.0, rel=1e-12)
    assert sum(row.share_velocity for row in rows) == pytest.approx(1.0, rel=1e-12)
    for name in rows[0].share_parameters:
        assert sum(row.share_parameters[name] for row in rows) == pytest.approx(1.0, rel=1e-9)
    behind = {row.source: row.telescopes for row in rows}
    assert behind["radius"] == ()
    assert behind["measurement noise ahead"] == ("ahead",)
    total = float(np.sqrt(np.trace(one.estimate.covariance(("x_km", "y_km", "z_km")))))
    for row in rows:
        assert row.remedies.if_vanished.same_gain.position_km <= total


@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_telescope_known_as_well_as_required_costs_just_the_growth_stated(
    make_setting: MakeSetting, minimal_setting: Setting, minimal_text: str, index: int
) -> None:
    scene, one, asked = solved(minimal_setting)
    row = next(r for r in required(scene, one, asked) if r.position.telescope == "behind")
    limit = row.limits[index]
    if limit.new_gain_km is None:
        assert "no size does it" in str(limit.reason)
        return
    own = f"position: {{sigma: {limit.new_gain_km!r} km, correlation: white}}"
    there = total_sigma(make_setting, changed(minimal_text, BEHIND, f"{BEHIND}, {own}"))
    perfect = f"{BEHIND}, position: {{sigma: 1e-7 km, correlation: white, treatment: estimated}}"
    best = total_sigma(make_setting, changed(minimal_text, BEHIND, perfect))
    assert row.sigma_total_perfect == pytest.approx(best, rel=1e-6)
    # the root is found to 1e-3 of the size, so to 2e-3 of the growth of the variance
    assert there / best - 1.0 == pytest.approx(limit.growth_percent / 100.0, rel=3e-3)


def test_with_the_gain_as_it_is_the_required_size_follows_from_the_share(minimal_setting: Setting) -> None:
    scene, one, asked = solved(minimal_setting)
    row = next(r for r in required(scene, one, asked) if r.position.telescope == "ahead")
    found = one.estimate.predict(*known_partials(asked[0], one.estimate))
    own = np.trace(found.shares["telescope position ahead"])
    rest = np.trace(found.covariance) - own
    assert not row.position.assumed
    assert row.position.sigma_km == pytest.approx(3.0, rel=1e-12)
    for limit in row.limits:
        assert limit.same_gain_km is not None
        f = limit.same_gain_km / 3.0
        assert np.sqrt(1.0 + f**2 * own / rest) == pytest.approx(1.0 + limit.growth_percent / 100.0, rel=1e-9)


def test_a_mission_without_position_errors_still_says_how_well_positions_must_be_known(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    bare = changed(minimal_text, f"    {POSITION}\n", "")
    scene, one, asked = solved(make_setting(load_mission_text(bare)))
    row = required(scene, one, asked)[0]
    assert row.position.assumed
    size = row.limits[1].new_gain_km
    own = f"    position: {{sigma: {size!r} km, correlation: white, treatment: estimated}}\n    {BIAS}"
    said = bare.replace(f"    {BIAS}", own).replace(
        BEHIND, f"{BEHIND}, position: {{sigma: 1e-7 km, correlation: white, treatment: estimated}}"
    )
    assert total_sigma(make_setting, said) / total_sigma(make_setting, bare) == pytest.approx(1.1, rel=3e-4)


def test_an_estimator_that_ignores_a_source_gains_nothing_from_a_new_gain(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    text = minimal_text + "estimators: [{name: blind, method: batch_qr, treatment: {bias: ignored}}]\n"
    scene, one, asked = solved(make_setting(load_mission_text(text)))
    row = next(r for r in quantity_shares(scene, Worlds.of(one), asked[0]) if r.source == "bias ahead")
    for remedy in (row.remedies.if_vanished, row.remedies.if_halved):
        assert remedy.new_gain is not None
        assert remedy.new_gain.total == pytest.approx(remedy.same_gain.total, rel=1e-9)
