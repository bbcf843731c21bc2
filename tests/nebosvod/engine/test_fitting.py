"""Gauss-Newton on a real orbit from a deliberately bad start."""

import numpy as np
import pytest

from nebosvod.engine.assembly import nominal_view, view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.truth import draw
from nebosvod.mission import load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import Scene, build_scene

AU_KM = 149597870.7


@pytest.mark.parametrize("offset_au", [(0.05, 0.0, 0.0), (0.0, 0.05, 0.0), (0.0, 0.0, -0.05), (0.03, -0.03, 0.03)])
def test_a_start_five_hundredths_of_an_au_off_converges_to_the_same_orbit(
    minimal_setting: tuple[Scene, PriorTable, View], offset_au: tuple[float, float, float]
) -> None:
    scene, priors, nominal = minimal_setting
    estimator = scene.mission.estimators[0]
    psi = draw(scene, priors, np.random.default_rng(1)).psi
    good = fit(scene, estimator, nominal, psi, priors)
    moved = nominal.point.moved(dict(zip(STATE_NAMES, np.array(offset_au) * AU_KM)))
    bad = fit(scene, estimator, view(scene, moved), psi, priors)
    assert str(bad.status) == "converged"
    assert bad.iterations > good.iterations
    assert all(later < earlier for earlier, later in zip(bad.cost, bad.cost[1:]))
    sigma = np.sqrt(np.diag(good.estimate.covariance(STATE_NAMES)))
    assert np.abs((bad.point.state - good.point.state) / sigma).max() < 1e-3


METHODS = """prior: {sigma: {position: 1000 km, velocity: 1 m/s}}
estimators:
  - {name: batch, method: batch_qr}
  - {name: stages, method: two_stage}
  - {name: considered, method: batch_qr, treatment: {bias: considered}}
  - {name: schmidt, method: schmidt, treatment: {bias: considered}}
  - {name: printed, method: as_printed}
"""


@pytest.fixture(scope="module")
def fits(minimal_text: str) -> dict[str, Fit]:
    """The smallest mission with a prior orbit, by every kind of gain."""
    mission = load_mission_text(minimal_text.replace("predictions:", METHODS + "predictions:"))
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    nominal, psi = nominal_view(scene), draw(scene, priors, np.random.default_rng(1)).psi
    return {one.name: fit(scene, one, nominal, psi, priors) for one in mission.estimators}


def test_two_stages_end_where_the_batch_does(fits: dict[str, Fit]) -> None:
    found, wanted = fits["stages"], fits["batch"]
    assert str(found.status) == "converged"
    assert found.iterations == wanted.iterations
    names = wanted.estimate.names
    sigma = np.array([wanted.estimate.sigma(name) for name in names])
    difference = np.array([found.point.values[name] - wanted.point.values[name] for name in names])
    assert np.abs(difference / sigma).max() < 1e-9
    for one, other in (
        (found.estimate.K_formal, wanted.estimate.K_formal),
        (found.estimate.K_true, wanted.estimate.K_true),
    ):
        assert np.abs((one - other) / np.outer(sigma, sigma)).max() < 1e-9
    assert found.estimate.chi2 == pytest.approx(wanted.estimate.chi2, rel=1e-9)


def test_a_schmidt_gain_claims_what_is_true_and_beats_not_knowing_the_bias(fits: dict[str, Fit]) -> None:
    found, blind, knowing = fits["schmidt"], fits["considered"], fits["batch"]
    assert str(found.status) == "converged"
    assert found.history is None  # the pass of least squares is not its own
    K, claim = found.estimate.K_true, found.estimate.K_formal
    sigma = np.sqrt(np.diag(K))
    assert np.abs((claim - K) / np.outer(sigma, sigma)).max() < 1e-9
    size = [np.trace(one.estimate.covariance(STATE_NAMES[:3])) for one in (knowing, found, blind)]
    assert size[0] < size[1] < size[2]


def test_the_filter_as_printed_leaves_out_all_but_the_state_and_says_so(fits: dict[str, Fit]) -> None:
    found = fits["printed"]
    assert str(found.status) == "converged"
    assert found.estimate.names == STATE_NAMES
    assert set(found.estimate.left_out) == set(fits["batch"].estimate.names) - set(STATE_NAMES)
    assert any("as fresh noise at each measurement" in note for note in found.estimate.notes)
    ratio = [found.estimate.sigma(name) / found.estimate.sigma_formal(name) for name in STATE_NAMES]
    assert max(ratio) > 1.5
    np.testing.assert_array_equal([b.treatment for b in found.problem.blocks[1:]], "considered")
    assert {white.treatment for white in found.problem.white} == {"estimated"}
