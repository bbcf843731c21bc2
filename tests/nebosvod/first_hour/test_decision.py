"""What one more observation would do: its errors are those of its station.

Against dense covariances with every nuisance, on orbits by Runge and Kutta.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.candidate import Candidate
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.sight import Flights
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation import Telescope

sys.path.insert(0, str(Path(__file__).resolve().parent))
import hour_oracle as oracle  # type: ignore[import-not-found]
from hour_cases import ARCSEC, CASES, Case, Made, columns_of, made, spacecraft  # type: ignore[import-not-found]

Array = npt.NDArray[np.float64]
CASE = CASES[3]  # one station, a bias of 0.2 arcsec, a clock of 1 s
LATER_S = 7200.0


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="module")
def one(bodies: Ephemeris) -> Made:
    return made(CASE, bodies)


def asked(one: Made, name: str) -> Candidate:
    """A telescope that may look again."""
    return Candidate.of(one.tracklet, Telescope(name=name, spacecraft=spacecraft(name), sigma_rad=1.0))


def dense(longer: Tracklet, case: Case, sigma: Array, bodies: Ephemeris) -> Any:
    """The oracle's problem of a longer tracklet, whose columns it finds itself."""
    exposures = replace(longer.exposures, sigma_rad=np.tile(sigma[:, None], (1, 2)))
    return oracle.Problem(
        bodies=oracle.Bodies.of(bodies, longer.epoch, exposures.t_s, 300.0), exposures=exposures,
        reference=longer.reference, observed=longer.observed, case=case, columns=columns_of(case, exposures),
        sigma=sigma, low=np.log(1e-4), high=np.log(5.0),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["F51", "W84"])
def test_a_station_errs_as_before_and_another_one_has_a_bias_and_a_clock_of_its_own(
    name: str, one: Made, bodies: Ephemeris
) -> None:
    """Directions of a truth with its nuisances, and densities of orbits with the errors marginalised."""
    candidate, tracklet = asked(one, name), one.tracklet
    t_s = np.array([float(tracklet.exposures.t_s.max()) + LATER_S])
    truth = Conditional(tracklet).states(one.truth[None])
    wrong = np.array([[0.1 * ARCSEC, -0.2 * ARCSEC, 1.3]])
    new = np.array([[0.5, -1.0, 2.0]])  # of another station: 0.1 and -0.2 arcsec, 2 s
    seen, psi = candidate.observed(
        t_s, Flights(tracklet, t_s).fly(truth), candidate.errors(wrong, new), np.zeros((1, 2))
    )
    longer = candidate.longer(seen, psi[0, 0])
    case = CASE if name == "F51" else replace(CASE, observers=("F51", "W84"))
    sigma = np.append(np.full(len(tracklet), CASE.sigma_arcsec), CASE.sigma_arcsec if name == "F51" else 0.5) * ARCSEC
    problem = dense(longer, case, sigma, bodies)
    x = Conditional(longer).coordinates(Flights(tracklet, np.array([longer.epoch - tracklet.epoch])).fly(truth)[:, 0])
    clean, rate, _ = oracle.directions(problem.bodies, problem.exposures, longer.reference, problem.frame, x)
    away = ((psi[0, 0] - clean[0, -1] + np.pi) % (2.0 * np.pi) - np.pi) * np.array([np.cos(clean[0, -1, 1]), 1.0])
    bias, clock = (wrong[0, :2], 1.3) if name == "F51" else (np.array([0.1, -0.2]) * ARCSEC, 2.0)
    np.testing.assert_allclose(away, bias + rate[0, -1] * clock, atol=0.01 * ARCSEC)

    near = x + np.linspace(-1.0, 1.0, 7)[:, None] * np.array([0.003, 0.05, 0.0, 0.0, 0.0, 0.0])
    nodes = Conditional(longer).solve(near, 2)
    a, factor = problem.attributable(near[:, :2], nodes.coordinates[:, 2:])
    judge = problem.log_target(np.hstack([near[:, :2], a])) + np.log(np.abs(np.linalg.det(factor))) - near[:, 0]
    ours = nodes.log_spread - 0.5 * nodes.chi2
    assert np.ptp(judge) > 1.0
    np.testing.assert_allclose(ours - ours[3], judge - judge[3], atol=0.05)
