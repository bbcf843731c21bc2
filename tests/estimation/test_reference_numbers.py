"""Printed numbers of the literature."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from nebosvod.estimation import Block, LinearProblem, Prior, gauss_newton
from nebosvod.estimation.solvers import batch

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "filters" / "tapley_schutz_born_spring_mass.json"


def test_spring_mass_of_tapley_schutz_and_born_to_all_printed_digits():
    """Statistical Orbit Determination (2004), section 4.8.2: range and range rate of a mass on two springs."""
    if not DATA.exists():
        pytest.skip(f"reference data not found at {DATA}")
    t, rho, rho_dot = np.array(json.loads(DATA.read_text())).T
    omega2, h = (2.5 + 3.7) / 1.5, 5.4
    Phi = np.stack([expm(np.array([[0.0, 1.0], [-omega2, 0.0]]) * time) for time in t])
    prior = Prior(name="a priori", names=("x0", "v0"), covariance=np.diag([1000.0, 100.0]))

    def linearise(deviation):
        start = np.array([4.0 + deviation.get("x0", 0.0), 0.2 + deviation.get("v0", 0.0)])
        x, v = (Phi @ start).T
        r = np.hypot(x, h)
        H = np.zeros((len(t), 2, 2))
        H[:, 0, 0] = x / r
        H[:, 1, 0] = v / r - x**2 * v / r**3
        H[:, 1, 1] = x / r
        return LinearProblem(
            residual=np.stack([rho - r, rho_dot - x * v / r], axis=1),
            R=np.eye(2),
            blocks=(Block(name="state", names=("x0", "v0"), H=H @ Phi),),
            priors=(prior,),
        )

    found = gauss_newton(linearise, tolerance=1e-9)
    assert 4.0 + found.deviation["x0"] == pytest.approx(3.00019, abs=5e-6)
    assert 0.2 + found.deviation["v0"] == pytest.approx(1.18181e-3, abs=5e-9)
    estimate = found.estimate
    assert 0.411 <= estimate.sigma("x0") < 0.412  # printed cut, not rounded: 0.41152
    assert estimate.sigma("v0") == pytest.approx(0.7645, abs=5e-5)
    K = estimate.K_true
    assert K[0, 1] / np.sqrt(K[0, 0] * K[1, 1]) == pytest.approx(0.0406, abs=5e-5)


@pytest.mark.parametrize(("distance_km", "wanted", "tolerance"), [(3.5e6, 100.0, 0.5), (1e8, 81305.0, 1.0)])
def test_range_from_one_simultaneous_pair_of_geostationary_telescopes(distance_km, wanted, tolerance):
    """sigma_rho = sqrt2 s rho^2 / B for two telescopes 180 deg apart, 0.1 arcsec."""
    radius, sigma = 42164.17, 0.1 * np.pi / 648000.0
    target = np.array([distance_km, 0.0, 0.0])
    rows = []
    for telescope in (np.array([0.0, radius, 0.0]), np.array([0.0, -radius, 0.0])):
        away = target - telescope
        rho = np.linalg.norm(away)
        across = np.array([-away[1], away[0], 0.0]) / np.hypot(away[0], away[1])
        rows.append(np.stack([across, [0.0, 0.0, 1.0]]) / rho)
    problem = LinearProblem(
        residual=np.zeros((2, 2)),
        R=sigma**2 * np.eye(2),
        blocks=(Block(name="position", names=("x", "y", "z"), H=np.stack(rows)),),
    )
    assert batch.solve(problem).sigma("x") == pytest.approx(wanted, abs=tolerance)
