"""The posterior of range and range rate against one that shares nothing with it but the places of bodies."""

import sys
from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import GeometryError
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.falls import chance, fall
from nebosvod.first_hour.grid import ENOUGH, FINER, Grid, _Search, grid_of
from nebosvod.first_hour.region import Region

sys.path.insert(0, str(Path(__file__).resolve().parent))
import hour_oracle as oracle  # type: ignore[import-not-found]
from hour_cases import CASES, Case, Made, aimed, made  # type: ignore[import-not-found]

DENSE = (CASES[1], CASES[3], CASES[4], CASES[6], CASES[8], CASES[9])


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


def laid(case: Case, bodies: Ephemeris) -> tuple[Made, Grid]:
    """A case and its grid."""
    one = made(case, bodies)
    return one, grid_of(Conditional(one.tracklet), one.region)


@pytest.mark.parametrize("case", DENSE, ids=lambda case: case.name)
def test_the_density_at_the_nodes_is_that_of_a_dense_covariance_on_orbits_by_runge_and_kutta(
    case: Case, bodies: Ephemeris
) -> None:
    """Weights of nodes, with the determinants of attributable and nuisances, and their a by iterated least squares."""
    one, grid = laid(case, bodies)
    assert grid.effective() >= ENOUGH
    heavy = np.argsort(-grid.weight())[:20]
    x = grid.nodes.coordinates[heavy]
    a, factor = one.problem.attributable(x[:, :2], x[:, 2:])
    dense = one.problem.log_target(np.hstack([x[:, :2], a])) + np.log(np.abs(np.linalg.det(factor)))
    ours = -0.5 * grid.nodes.chi2[heavy] + grid.nodes.log_spread[heavy] + x[:, 0]
    inside = np.isfinite(dense)  # a node may lie a hair beyond the parabola of its line
    assert inside.mean() > 0.9
    away = (ours - dense)[inside]
    assert np.ptp(away) < 0.15  # two spacecraft know the range to 2e-5: a kilometre is a third of that
    sigma = np.linalg.norm(factor, axis=2)
    assert np.all(np.abs(x[inside, 2:] - a[inside]) < 0.1 * sigma[inside])


@pytest.mark.parametrize("case", CASES[::3], ids=lambda case: case.name)
def test_moments_are_those_of_importance_sampling_in_six_dimensions(case: Case, bodies: Ephemeris) -> None:
    """Draws about the nodes, weighed by the oracle; all ten cases are in the long test."""
    one, grid = laid(case, bodies)
    drawn = oracle.sample_about(one.problem, grid, 1500, np.random.default_rng(3))
    compare(grid, drawn, mean=0.12, sigma=0.08, least=800.0)


def test_a_sampler_that_knows_nothing_of_the_grid_finds_the_same(bodies: Ephemeris) -> None:
    """Population Monte Carlo from the whole region: no mass lies where the grid has no nodes."""
    one, grid = laid(CASES[0], bodies)
    drawn = oracle.sample(one.problem, 3000, np.random.default_rng(3), first=1500)
    compare(grid, drawn, mean=0.15, sigma=0.12, least=800.0)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_ten_cases_agree_with_importance_sampling(case: Case, bodies: Ephemeris) -> None:
    """Effective draws, means within 0.05 sigma, sigmas within 2 %."""
    one, grid = laid(case, bodies)
    drawn = oracle.sample_about(one.problem, grid, 30_000, np.random.default_rng(5))
    compare(grid, drawn, mean=0.05, sigma=0.02, least=20_000.0)


@pytest.mark.long
@pytest.mark.parametrize("k", [0, 3, 4])
def test_the_probability_is_that_of_weighed_draws_flown_by_runge_and_kutta(k: int, bodies: Ephemeris) -> None:
    """Impactors: 0.04, 0.998 and 0.87, within three errors of both."""
    one, grid = laid(aimed(CASES[k], bodies), bodies)
    drawn = oracle.sample_about(one.problem, grid, 3000, np.random.default_rng(5))
    heavy = drawn.w > 1e-7  # the others circle the Earth for a hundred days, and weigh 1e-4 together
    hit = np.zeros(len(heavy), dtype=np.bool_)
    hit[heavy] = oracle.falls(one.problem, drawn.x[heavy], one.tracklet.epoch, bodies, 100.0)
    p = float(drawn.w @ hit)
    error = float(np.sqrt(np.sum(drawn.w**2 * (hit - p) ** 2)))
    ours = chance(grid, fall(grid, 100.0, np.random.default_rng(1)))
    assert p > 0.02
    assert ours.low - 3.0 * error < p < ours.high + 3.0 * error


def compare(grid: Grid, drawn: oracle.Sampled, *, mean: float, sigma: float, least: float) -> None:
    """Means of ln(range) and rate within so many sigmas, sigmas within a share."""
    assert drawn.effective > least
    ours, P = grid.moments()
    theirs, Q = drawn.moments()
    spread = np.sqrt(np.diag(Q))
    assert np.all(np.abs(ours - theirs) < mean * spread), (ours, theirs, spread)
    np.testing.assert_allclose(np.sqrt(np.diag(P)), spread, rtol=sigma)


def test_coordinates_and_states_are_each_others_inverse(bodies: Ephemeris) -> None:
    conditional = Conditional(made(CASES[4], bodies).tracklet)
    x = np.array([[-6.0, 3.0, 1e-4, -2e-4, 3e-7, 1e-7], [0.5, -20.0, -1e-3, 1e-3, -1e-8, 2e-8]])
    np.testing.assert_allclose(conditional.coordinates(conditional.states(x)), x, rtol=1e-9, atol=1e-12)


def test_a_region_without_orbits_is_said(bodies: Ephemeris) -> None:
    one = made(CASES[8], bodies)
    with pytest.raises(GeometryError, match="no orbit bound to the Sun"):
        grid_of(Conditional(one.tracklet), Region(nearest_au=30.0, farthest_au=40.0))


def test_a_grid_too_coarse_is_known_without_being_laid(bodies: Ephemeris) -> None:
    """Lines say how many nodes will carry the weight: of a normal distribution as of a ridge, to some percent."""
    for case in CASES[:2]:
        search = _Search(Conditional(made(case, bodies).tracklet), Region(), None)
        search.scan()
        for most in FINER[:2]:
            plan = search._planned(most)
            assert search._laid(plan).effective() == pytest.approx(plan.expected(), rel=0.03)
