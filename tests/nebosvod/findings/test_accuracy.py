"""Five accuracies side by side: their order, each against a second way, and the sentence when they disagree."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.montecarlo import repeat
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.estimation.accuracy import guaranteed
from nebosvod.estimation.problem.sources import measurement_gain
from nebosvod.findings.comparison import Accuracies, boxed, comparison, statement, thinned, worst_sigmas
from nebosvod.findings.foretold import Foretold
from nebosvod.findings.prediction import existing
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

Setting = tuple[Scene, PriorTable, View]
MakeSetting = Callable[[Mission], Setting]


def solved(setting: Setting) -> tuple[Scene, Fit, list[Quantity]]:
    scene, priors, nominal = setting
    one = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    return scene, one, [quantity(scene, one.trajectory, request) for request in scene.mission.predictions]


def test_the_five_stand_in_order_and_monte_carlo_confirms_the_extended(minimal_setting: Setting) -> None:
    scene, one, asked = solved(minimal_setting)
    _, priors, nominal = minimal_setting
    sample = repeat(scene, one.estimator, nominal, priors, 400, 3)
    name = one.estimator.name
    rows = comparison(scene, [one], {name: asked}, {name: sample})
    assert len(rows) == 3
    for row in rows:
        assert row.formal == pytest.approx(row.extended, rel=1e-9)
        assert row.extended <= row.worst_correlation <= row.worst_any_correlation
        assert row.guaranteed > 3.0 * row.extended  # the box holds every 3-sigma error of each source alone
        low, high = row.monte_carlo_interval_99
        assert low < row.extended < high
        assert high - low < 0.25 * row.extended  # 400 runs: +- 2.58 / sqrt(800) of the sigma
        assert "Monte Carlo confirms" in row.statement


def test_an_ignored_bias_makes_the_estimator_optimistic_and_is_named(
    make_setting: MakeSetting, minimal_text: str
) -> None:
    text = minimal_text + "estimators: [{name: blind, method: batch_qr, treatment: {bias: ignored}}]\n"
    scene, one, asked = solved(make_setting(load_mission_text(text)))
    rows = comparison(scene, [one], {"blind": asked}, {})
    worst = max(rows, key=lambda row: row.extended / row.formal)
    assert worst.extended > 1.5 * worst.formal
    assert "times too small, which leaves bias" in worst.statement
    assert worst.monte_carlo is None
    assert "no monte_carlo" in worst.monte_carlo_reason


def test_no_correlation_of_the_family_is_worse_than_the_worst(minimal_setting: Setting) -> None:
    _, one, asked = solved(minimal_setting)
    W, names = known_partials(asked[0], one.estimate)
    worst, bound, _ = worst_sigmas(one, W, names)
    place = [one.estimate.names.index(name) for name in names]
    gain = measurement_gain(one.problem)[:, :, place] @ W.T
    rest = one.estimate.predict(W, names)
    noise = one.problem.noise_names
    other = sum(np.diag(share) for name, share in rest.shares.items() if name not in noise)
    t, label = one.observation.t_s, one.problem.noise_label
    L = np.linalg.cholesky(one.problem.R)
    weights = np.einsum("npi,npd->nid", L, gain)
    for days in (0.5, 3.0, 30.0, 1e4):
        K = np.exp(-np.abs(t[:, None] - t) / (86400.0 * days)) * (label[:, None] == label)
        variance = np.einsum("nid,nm,mid->d", weights, K, weights) + other
        assert np.all(np.sqrt(variance) <= worst * (1 + 1e-6))
    signs = np.einsum("nid->d", np.abs(weights)) ** 2 + other
    np.testing.assert_allclose(bound, np.sqrt(signs), rtol=1e-9)


def test_leaving_measurements_out_only_widens_a_guaranteed_bound(minimal_setting: Setting) -> None:
    _, one, asked = solved(minimal_setting)
    W, names = known_partials(asked[0], one.estimate)
    every = guaranteed.largest_error(one.problem, W, names)
    few = thinned(one.problem, 32)
    assert few.n <= 32
    fewer = guaranteed.largest_error(few, W, names)
    assert np.all(fewer >= every * (1 - 1e-9))
    assert np.all(fewer < 1.3 * every)


def test_primal_and_dual_of_an_orbit_agree(minimal_setting: Setting) -> None:
    """Partials of an orbit differ by 1e7 and its objective with them: in their units the dual stopped far too early."""
    _, one, asked = solved(minimal_setting)
    few = thinned(replace(one.problem, residual=np.zeros_like(one.problem.residual)), 32)
    W, names = known_partials(asked[0], one.estimate)
    found = guaranteed.bound(few, W, names)
    assert found.duality_gap < 1e-6
    np.testing.assert_allclose(found.half_width, guaranteed.largest_error(few, W, names), rtol=1e-6)


def test_the_box_of_a_slow_error_holds_each_of_its_histories(make_setting: MakeSetting, minimal_text: str) -> None:
    """A bound for free draws at each measurement is above that for a constant error of the same size."""
    slow = minimal_text.replace("correlation: white", "correlation: gauss_markov, time: 1e6 d")
    still = minimal_text.replace("correlation: white", "correlation: constant")
    bounds = []
    for text in (slow, still):
        _, one, asked = solved(make_setting(load_mission_text(text)))
        bounds.append(guaranteed.largest_error(boxed(one.problem), *known_partials(asked[0], one.estimate)))
    assert not boxed(one.problem).markov
    assert np.all(bounds[0] >= bounds[1] * (1 - 1e-6))


@pytest.mark.parametrize("treatment", ["considered", "ignored"])
def test_monte_carlo_holds_the_errors_of_parameters_left_out(
    make_setting: MakeSetting, minimal_text: str, treatment: str
) -> None:
    """A light body, a year ahead: the radius that no estimator sees makes most of the error."""
    text = minimal_text.replace("8e6 kg, sigma: 2e6 kg", "4e4 kg, sigma: 1e3 kg").replace("2028-04-29", "2028-12-29")
    text += f"estimators: [{{name: part, method: batch_qr, treatment: {{radius: {treatment}}}}}]\n"
    setting = make_setting(load_mission_text(text))
    scene, one, asked = solved(setting)
    sample = repeat(scene, one.estimator, setting[2], setting[1], 400, 0)
    W, names = known_partials(asked[0], one.estimate)
    ahead = np.abs(W[:, names.index("radius_m")]) * np.linalg.norm(one.estimate.factor(["radius_m"]))
    rows = comparison(scene, [one], {"part": asked}, {"part": sample})
    assert max(part / row.extended for part, row in zip(ahead, rows)) > 0.5
    for row in rows:
        low, high = row.monte_carlo_interval_99
        assert low < row.extended < high


def test_a_statement_tells_optimism_pessimism_and_contradiction() -> None:
    row = Accuracies(
        estimator="batch", prediction="there", component=0, unit="km", formal=1.0, extended=2.0, mean_error=0.0,
        worst_correlation=2.0, worst_any_correlation=None, guaranteed=None, guaranteed_measurements=0,
        guaranteed_reason=None, monte_carlo=None, monte_carlo_interval_99=None, monte_carlo_reason=None,
    )  # fmt: skip
    assert statement(row, "bias A") == (
        "The estimator's own sigma is 2 times too small, which leaves bias A out of its weights."
    )
    assert "2 times too large" in statement(replace(row, formal=4.0), None)
    drawn = replace(row, formal=2.0, monte_carlo=3.0, monte_carlo_interval_99=(2.5, 3.5))
    assert statement(drawn, None) == "Formal and extended accuracy agree. Monte Carlo contradicts the extended sigma."


def test_a_comparison_of_one_estimator_does_not_depend_on_the_residuals(minimal_setting: Setting) -> None:
    scene, one, asked = solved(minimal_setting)
    name = one.estimator.name
    moved = replace(one, problem=replace(one.problem, residual=one.problem.residual + 1e-6))
    first, second = (comparison(scene, [f], {name: asked}, {}) for f in (one, moved))
    for a, b in zip(first, second):
        assert a.guaranteed == pytest.approx(b.guaranteed, rel=1e-9)


def test_a_large_problem_is_spared_the_searches(minimal_setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    from nebosvod.findings import blame
    from nebosvod.findings.assessment import assess

    monkeypatch.setattr(blame, "LARGE", 10)
    scene, one, asked = solved(minimal_setting)
    found = assess(scene, [one], {one.estimator.name: Foretold(asked, [])}, {})
    assert found.curves == ()
    assert found.required == ()
    row = found.accuracies[0]
    assert row.worst_correlation is None
    assert row.guaranteed > row.extended
    remedy = existing(found.predictions)[0].budget[0].remedies.if_halved
    assert remedy.new_gain is None
    assert remedy.same_gain.total > 0.0


def test_the_ratio_block_has_means_limits_and_critical_sizes_by_telescope(minimal_setting: Setting) -> None:
    """Critical size = distance times sigma, for a telescope position error of any direction (0.1 arcsec here)."""
    from nebosvod.findings.assessment import assess

    scene, one, asked = solved(minimal_setting)
    block = assess(scene, [one], {one.estimator.name: Foretold(asked, [])}, {}).noise_to_nuisance
    critical = one.observation.distance_km * 0.1 * np.pi / 648000.0
    np.testing.assert_allclose(block.critical_km, critical, rtol=1e-4)  # V / c in the partials
    for number, row in enumerate(block.by_telescope):
        mine = critical[one.observation.telescope_index == number]
        assert row.n_observations == mine.size
        assert row.critical_median_km == pytest.approx(np.median(mine), rel=1e-4)
        assert row.means.sigma_z_limits_km[20.0] == pytest.approx(np.median(mine) / 10.0, rel=1e-4)
        assert row.means.effective_db < row.means.eta_db


RHYTHM = """schema_version: 1
name: rhythm
reference_epoch: 2029-03-01T00:00:00 TDB
object:
  name: (99942) Apophis
  orbit: {{kind: cometary, frame: ecliptic_j2000, epoch: 2459215.5 JD TDB, e: 0.1915216893501022,
    q: 0.7458270478466523 au, tp: 2459101.039422462638 JD TDB, node: 204.0389272089208 deg,
    peri: 126.6520518368553 deg, i: 3.336751320066756 deg}}
telescopes:
  - {{name: NEB, orbit: {orbit}, noise: {{sigma: 0.1 arcsec}},
      bias: {{sigma: 0.05 arcsec, treatment: considered}},
      position: {{sigma: 3 km, correlation: constant, treatment: considered}}}}
schedule: [{{start: 2029-03-01T00:00:00 TDB, end: {end} TDB, cadence: {cadence}}}]
predictions:
  - {{name: pos0, plane: rtn, at: 2029-03-10T00:00:00 TDB}}
  - {{name: p2, plane: position, at: 2029-03-01T00:00:00 TDB}}
"""


@pytest.mark.parametrize(
    ("orbit", "end", "cadence", "wanted"),
    [
        # Dense matrices of the family over all frequencies; a coarse grid of frequencies gave 434, 660 and 2787 km.
        ("{kind: geostationary, longitude: 0 deg}", "2029-04-08", "1 h", {("pos0", 0): 757.0, ("p2", 0): 1075.0}),
        ("{kind: geocentric, a: 7000 km, i: 98 deg}", "2029-03-15", "17 min", {("pos0", 0): 16343.0}),
    ],
)
def test_the_worst_correlation_finds_the_rhythm_of_a_day_and_of_an_orbit(
    make_setting: MakeSetting, orbit: str, end: str, cadence: str, wanted: dict[tuple[str, int], float]
) -> None:
    text = RHYTHM.format(orbit=orbit, end=f"{end}T00:00:00", cadence=cadence)
    scene, one, asked = solved(make_setting(load_mission_text(text)))
    rows = comparison(scene, [one], {one.estimator.name: asked}, {})
    found = {(row.prediction, row.component): row.worst_correlation for row in rows}
    for which, sigma_km in wanted.items():
        assert found[which] == pytest.approx(sigma_km, rel=3e-3)
