"""Gauss-Newton on a real orbit from a deliberately bad start."""

import numpy as np
import pytest

from nebosvod.assembly import View, view
from nebosvod.fitting import fit
from nebosvod.prior import STATE_NAMES, PriorTable
from nebosvod.scene import Scene
from nebosvod.truth import draw

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
