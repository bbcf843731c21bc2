"""A grid that is refined where a posterior lives."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.estimation.filters.combined import GridBlock
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.refinement import refine


def block_of(log_likelihood, prior):
    def evaluate(nodes):
        away = np.linalg.solve(prior.factor, (nodes - prior.mean).T).T
        rest = np.zeros((len(nodes), 0))
        logs = -0.5 * np.sum(away**2, axis=1) + log_likelihood(nodes)
        return GridBlock(nodes=nodes, log_weight=logs, mean=rest, covariance=np.zeros((0, 0)))

    return evaluate


@pytest.mark.parametrize("width", [10.0, 1.0, 1e-2, 1e-4])
def test_a_normal_posterior_of_any_width_has_its_moments(width):
    """Closed form: product of two normal densities."""
    prior = Belief.of([0.5, -1.0], [[4.0, 1.5], [1.5, 1.0]])
    K = width**2 * np.array([[1.0, -0.4], [-0.4, 0.5]])
    centre = np.array([1.3, -0.6])
    information = np.linalg.solve(K, np.eye(2))

    def log_likelihood(nodes):
        return -0.5 * np.einsum("ni,ij,nj->n", nodes - centre, information, nodes - centre)

    found = refine(block_of(log_likelihood, prior), prior)
    prior_information = np.linalg.solve(prior.covariance, np.eye(2))
    wanted = np.linalg.solve(information + prior_information, np.eye(2))
    mean = wanted @ (information @ centre + prior_information @ prior.mean)
    moments = found.block.moments()
    unit = np.sqrt(np.diag(wanted))
    assert found.resolved
    assert np.max(np.abs(moments.mean - mean) / unit) < 1e-3
    np.testing.assert_allclose(moments.covariance / np.outer(unit, unit), wanted / np.outer(unit, unit), atol=3e-3)


def test_two_far_narrow_bumps_keep_their_shares():
    prior = Belief.of([0.0, 0.0], np.eye(2))
    centres, shares, s = np.array([[1.7, 0.3], [-1.1, -0.9]]), np.array([0.3, 0.7]), 0.01

    def log_likelihood(nodes):
        away = np.sum((nodes[:, None] - centres) ** 2, axis=2) / s**2
        # the prior's density is taken out, so the posterior is the mixture itself
        return np.logaddexp.reduce(np.log(shares) - 0.5 * away, axis=1) + 0.5 * np.sum(nodes**2, axis=1)

    # cells below the bumps are needed to see them at once; tempering needs wide tails only
    found = refine(block_of(log_likelihood, prior), prior, points=41)
    w, left = found.block.weight, found.block.nodes[:, 0] < 0.0
    assert found.resolved
    assert w[left].sum() == pytest.approx(0.7, abs=1e-3)
    moments = found.block.moments()
    np.testing.assert_allclose(moments.mean, shares @ centres, atol=2e-3)
    spread = np.einsum("k,ki,kj->ij", shares, centres - shares @ centres, centres - shares @ centres)
    np.testing.assert_allclose(moments.covariance, spread + s**2 * np.eye(2), atol=5e-3)


def test_a_ridge_250_times_as_long_as_wide_is_followed():
    prior = Belief.of([0.0, 0.0], np.eye(2))
    along, across = np.array([np.cos(0.7), np.sin(0.7)]), np.array([-np.sin(0.7), np.cos(0.7)])

    def log_likelihood(nodes):
        return -0.5 * ((nodes @ across - 0.1) / 0.004) ** 2

    moments = refine(block_of(log_likelihood, prior), prior).block.moments()
    assert np.sqrt(along @ moments.covariance @ along) == pytest.approx(1.0, rel=0.01)
    assert np.sqrt(across @ moments.covariance @ across) == pytest.approx(0.004, rel=0.02)
    assert across @ moments.mean == pytest.approx(0.1, abs=1e-4)


def test_what_cannot_be_resolved_says_so():
    prior = Belief.of([0.0], [[1.0]])
    found = refine(block_of(lambda nodes: -0.5 * (nodes[:, 0] / 1e-6) ** 2, prior), prior, limit=4)
    assert found.stages == 4
    assert not found.resolved
    outside = refine(block_of(lambda nodes: -0.5 * ((nodes[:, 0] - 9.0) / 0.1) ** 2, prior), prior)
    assert outside.rim > 0.1  # the data point beyond the prior's reach


def test_the_first_grid_is_as_fine_as_asked_and_not_without_end():
    prior = Belief.of([0.0], [[4.0]])
    flat = block_of(lambda nodes: np.zeros(len(nodes)), prior)
    assert len(refine(flat, prior, points=5, cell=0.1).block.nodes) >= 241
    plane = Belief.of([0.0, 0.0], 4.0 * np.eye(2))
    assert len(refine(block_of(lambda nodes: np.zeros(len(nodes)), plane), plane).block.nodes) == 21**2
    with pytest.raises(InputError, match="too many"):
        refine(flat, prior, cell=1e-4)
    with pytest.raises(InputError, match="five points"):
        refine(flat, prior, points=3)
