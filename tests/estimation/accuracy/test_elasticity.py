"""The budget of a probability: elasticities by source against closed forms and differences of drawn probabilities."""

import numpy as np
import pytest
from scipy.stats import norm

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.elasticity import ENOUGH_HITS, probability_budget

# three sources of errors of four quantities in units as different as km and rad; the last is singular twice over
SCALE = np.array([1e6, 3.0, 1e-6, 1.0])
RNG = np.random.default_rng(20)
SOURCES = {
    "noise": SCALE[:, None] * RNG.normal(size=(4, 4)),
    "catalogue": SCALE[:, None] * RNG.normal(size=(4, 2)),
    "clock": SCALE[:, None] * RNG.normal(size=(4, 1)),
}
NORMAL = np.array([0.8, -0.5, 0.3, 0.1]) / SCALE  # of the target plane: a hit is a value of NORMAL @ d
SIGMA = float(np.linalg.norm(NORMAL @ np.hstack(list(SOURCES.values()))))
SHARES = {name: float(np.sum((NORMAL @ G) ** 2)) / SIGMA**2 for name, G in SOURCES.items()}


def draws(count: int, seed: int = 1, sizes: dict[str, float] | None = None) -> np.ndarray:
    """Deviations (count, 4) with each source's own draws, at its size."""
    rng, total = np.random.default_rng(seed), np.zeros((count, 4))
    for name, G in SOURCES.items():
        total += (sizes or {}).get(name, 1.0) * rng.normal(size=(count, G.shape[1])) @ G.T
    return total


def along(d: np.ndarray) -> np.ndarray:
    return d @ NORMAL / SIGMA


@pytest.mark.parametrize("nu", [-0.8, 0.3, 1.2])
def test_a_half_plane_has_its_closed_form(nu: float) -> None:
    d = draws(60_000)
    found = probability_budget(d, along(d) > nu, SOURCES)
    P = norm.sf(nu)
    assert found.rank == 4
    assert found.probability == pytest.approx(P, abs=3.0 * np.sqrt(P * (1 - P) / len(d)))
    assert {row.source for row in found.rows} == set(SOURCES)
    for row in found.rows:
        wanted = SHARES[row.source] * nu * norm.pdf(nu) / P
        assert abs(row.value - wanted) < 3.0 * row.error
        assert row.error < 0.05
        halved = norm.sf(nu / np.sqrt(1.0 - 0.75 * SHARES[row.source]))
        assert abs(row.halved - halved) < 3.0 * row.halved_error
        assert row.halved_error < 0.004
        if P > 0.5:
            assert abs(row.log_odds - wanted / (1.0 - P)) < 3.0 * row.log_odds_error
            assert row.log_odds_error < row.error / (1.0 - P)  # the misses tell more
        else:
            assert row.log_odds is None


@pytest.mark.parametrize("nu", [0.0, 1.0, 2.0, 2.6])
def test_a_narrow_target_at_nu_sigmas(nu: float) -> None:
    d, half = draws(200_000, seed=2), 0.05
    found = probability_budget(d, abs(along(d) - nu) < half, SOURCES)
    assert found.sigmas is not None
    assert found.line is not None
    assert abs(found.sigmas - nu) < 0.01
    line = np.hstack(list(SOURCES.values())) @ np.hstack(list(SOURCES.values())).T @ NORMAL / SIGMA
    side = 1.0 if nu else np.sign(found.line @ NORMAL)  # at the middle neither side is nearer
    np.testing.assert_allclose(found.line / SCALE, side * line / SCALE, atol=float(0.03 * np.linalg.norm(line / SCALE)))
    for row in found.rows:
        assert row.share == pytest.approx(SHARES[row.source], abs=0.01)
        assert abs(row.value - SHARES[row.source] * (nu**2 - 1.0)) < 3.0 * row.error + 0.01
        low, high = (np.array([-half, half]) + nu) / np.sqrt(1.0 - 0.75 * SHARES[row.source])
        assert abs(row.halved - (norm.cdf(high) - norm.cdf(low))) < 3.0 * row.halved_error
    if nu == 1.0:  # the elasticities vanish, and halving still changes P
        least = max(found.rows, key=lambda row: row.share)
        assert abs(least.halved / found.probability - 1.0) > 0.05


def test_weighted_draws_of_a_target_far_out() -> None:
    """At 5 sigmas no plain draw hits: draws about the target, weighed by the densities, have the closed form."""
    S = np.linalg.cholesky(sum(G @ G.T for G in SOURCES.values()) / np.outer(SCALE, SCALE)) * SCALE[:, None]
    n = S.T @ NORMAL / SIGMA
    u = np.random.default_rng(3).normal(size=(40_000, 4)) + 5.2 * n
    weights = np.exp(-5.2 * (u @ n) + 0.5 * 5.2**2)
    d = u @ S.T
    found = probability_budget(d, along(d) > 5.0, SOURCES, weights, total=len(d))
    P = norm.sf(5.0)
    assert found.probability == pytest.approx(P, rel=0.05)
    assert found.enough
    assert found.effective_hits < np.count_nonzero(along(d) > 5.0)
    for row in found.rows:
        assert abs(row.value - SHARES[row.source] * 5.0 * norm.pdf(5.0) / P) < 3.0 * row.error
        assert row.error < 0.5
        halved = norm.sf(5.0 / np.sqrt(1.0 - 0.75 * SHARES[row.source]))
        assert abs(row.halved - halved) < 3.0 * row.halved_error
        assert row.halved_error < 0.05 * P


def curved(d: np.ndarray) -> np.ndarray:
    x = d / SCALE
    value = 0.6 * x[:, 0] - 0.4 * x[:, 1] + 0.15 * x[:, 2] ** 2
    hit: np.ndarray = (value > 0.7) & (value < 1.5)
    return hit


def test_a_bent_target_agrees_with_central_differences_of_common_draws() -> None:
    d = draws(20_000, seed=4)
    found = probability_budget(d, curved(d), SOURCES)
    assert found.effective_hits == np.count_nonzero(curved(d)) > ENOUGH_HITS
    for row in found.rows:
        up, down = (curved(draws(20_000, 4, {row.source: size})).astype(float) for size in (1.2, 0.8))
        step = np.log(1.2 / 0.8)
        difference = np.log(up.mean() / down.mean()) / step
        noise = np.std(up / up.mean() - down / down.mean()) / np.sqrt(len(up)) / step
        assert abs(row.value - difference) < 3.0 * np.hypot(row.error, noise)
        half = curved(draws(200_000, 5, {row.source: 0.5})).mean()
        assert abs(row.halved - half) < 3.0 * np.hypot(row.halved_error, np.sqrt(half / 200_000))


def test_directions_without_an_error_are_dropped() -> None:
    two = {name: np.vstack([G[:2], G[:1] * 2.0 - G[1:2] * 5.0, 0.0 * G[:1]]) for name, G in SOURCES.items()}
    rng = np.random.default_rng(6)
    d = np.sum([rng.normal(size=(40_000, G.shape[1])) @ G.T for G in two.values()], axis=0)
    plain = {name: G[:2] for name, G in two.items()}
    hits = d[:, 0] > 1.5e6
    found, wanted = probability_budget(d, hits, two), probability_budget(d[:, :2], hits, plain)
    assert (found.rank, wanted.rank) == (2, 2)
    for one, other in zip(found.rows, wanted.rows, strict=True):
        assert one.source == other.source
        assert one.value == pytest.approx(other.value)
        assert one.halved == pytest.approx(other.halved)


def test_a_source_that_is_everything_may_be_halved() -> None:
    """One dimension, one source: P(|x| > 1) of a sigma halved is P(|x| > 2), and nothing is divided by zero."""
    x = np.random.default_rng(7).normal(size=(100_000, 1))
    found = probability_budget(x, abs(x[:, 0]) > 1.0, {"only": np.eye(1)})
    (row,) = found.rows
    assert row.halved == pytest.approx(2.0 * norm.sf(2.0), abs=3.0 * row.halved_error)
    assert row.value == pytest.approx(2.0 * norm.pdf(1.0) / (2.0 * norm.sf(1.0)), abs=3.0 * row.error)


def test_what_cannot_be_used_is_refused_in_words() -> None:
    d = draws(100)
    hits = along(d) > 0.0
    for given, said in [
        ((d, np.zeros(100, dtype=bool), SOURCES), "0 of 100 draws hit"),
        ((d, hits[:-1], SOURCES), "hits: need 100 booleans"),
        ((d, hits, {"noise": SOURCES["noise"][:3]}), "noise: needs a finite factor"),
        ((d, hits, {"nothing": np.zeros((4, 2))}), "no source has an error"),
        ((d, hits, {}), "no source has an error"),
        ((d * np.nan, hits, SOURCES), "deviations: need finite numbers"),
        ((d, hits, SOURCES, -np.ones(100)), "none negative"),
        ((d, hits, SOURCES, np.ones(100), 0.0), "total: needs a positive number"),
    ]:
        with pytest.raises(InputError, match=said):
            probability_budget(*given)
