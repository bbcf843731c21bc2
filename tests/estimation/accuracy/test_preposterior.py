"""Future probabilities against the linear-Gaussian answer, and as odds that are kept."""

import numpy as np
import pytest
from scipy.stats import binom, norm

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.polynomial import Polynomial
from nebosvod.estimation.accuracy.preposterior import Foreseen, foresee
from nebosvod.estimation.accuracy.target_map import TargetMap

SIZE = 6
TARGET = np.array([1.0, 0.1, 0.2, 0.0, 0.0, -0.3])
TARGET = TARGET / np.linalg.norm(TARGET)
MIDDLE, HALF = 0.5, 0.5  # a hit lies between 0 and 1 sigma along TARGET
LEVELS = [0.01, 0.1, 0.5, 0.9]


def hit(u: np.ndarray) -> np.ndarray:
    found: np.ndarray = abs(u @ TARGET - MIDDLE) < HALF
    return found


def measured(noise: float) -> np.ndarray:
    """Partials (2, 6) of two measurements, in units of their noise."""
    first = np.array([1.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    return np.vstack([first, np.roll(first, 2)]) / noise


def quantiles_in_theory(H: np.ndarray) -> np.ndarray:
    """Quantiles of P after y = H u + noise: of the target coordinate the mean moves by what its variance loses."""
    left = float(TARGET @ np.linalg.solve(np.eye(SIZE) + H.T @ H, TARGET))
    mean = np.sqrt(1.0 - left) * norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    P = norm.cdf((MIDDLE + HALF - mean) / np.sqrt(left)) - norm.cdf((MIDDLE - HALF - mean) / np.sqrt(left))
    return np.asarray(np.quantile(P, LEVELS))


def cloud(noise: float, count: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    u = np.random.default_rng(1).standard_normal((count, SIZE))
    return u, u @ measured(noise).T


@pytest.mark.parametrize(("noise", "redrawn"), [(1.0, (0.0, 0.01)), (0.05, (0.2, 1.0)), (0.002, (1.0, 1.0))])
def test_where_all_is_linear_the_distribution_is_the_closed_one(noise: float, redrawn: tuple[float, float]) -> None:
    u, z = cloud(noise)
    found = foresee(u, z, hit(u), np.random.default_rng(2), 2000, hit=hit)
    np.testing.assert_allclose(np.quantile(found.probability, LEVELS), quantiles_in_theory(measured(noise)), atol=0.02)
    assert redrawn[0] <= found.redrawn.mean() <= redrawn[1]
    assert np.median(found.effective) > 200.0


def test_without_new_states_a_sharp_measurement_leaves_too_few_members() -> None:
    u, z = cloud(0.002)
    found = foresee(u, z, hit(u), np.random.default_rng(2), 300)
    assert not found.redrawn.any()
    assert np.median(found.effective) < 2.0


def bent(u: np.ndarray) -> np.ndarray:
    """A target that bends, as the plane of an encounter after a return does."""
    found: np.ndarray = abs(u[:, 0] + 0.4 * u[:, 1] ** 2 - 0.5 * u[:, 0] * u[:, 2] - 0.6) < 0.5
    return found


@pytest.mark.parametrize("noise", [0.5, 0.02])
def test_truths_that_end_at_a_probability_hit_that_often(noise: float) -> None:
    """2,000 truths, none of which had a part in its own answer, inside the 99 % binomial band of each tenth."""
    u = np.random.default_rng(3).standard_normal((20_000, SIZE))
    x = u @ measured(noise).T * noise
    z = (x + 0.2 * x[:, ::-1] ** 2) / noise  # and what is measured bends as well
    found = foresee(u, z, bent(u), np.random.default_rng(4), 2000, hit=bent, draws=500)
    assert calibrated(found, bent(u)) == []


def test_measurements_that_no_polynomial_follows_are_followed_piece_by_piece() -> None:
    """What is measured winds about the whole cloud, and the nearest members tell of each piece."""
    u = np.random.default_rng(11).standard_normal((20_000, 3))
    noise = 0.01
    z = np.stack([np.exp(0.8 * u[:, 0]), np.arctan(2.0 * u[:, 0]) + 0.3 * u[:, 1]], axis=1) / noise

    def beyond(u: np.ndarray) -> np.ndarray:
        found: np.ndarray = u[:, 1] + 0.2 * u[:, 2] > 0.5
        return found

    found = foresee(u, z, beyond(u), np.random.default_rng(12), 600, hit=beyond, draws=500)
    assert found.redrawn.mean() > 0.5
    assert calibrated(found, beyond(u)) == []
    # u_0 is known to 0.01 by the first, u_1 then to 0.05 by the second: what is left is u_2 and a little of u_1
    sure = np.mean((found.probability < 0.01) | (found.probability > 0.99))
    assert sure > 0.6


def calibrated(found: Foreseen, hits: np.ndarray) -> list[str]:
    """Tenths of the future probability whose truths hit too often or too rarely, at a family level of 1 %."""
    wrong = []
    edges = np.quantile(found.probability, np.linspace(0.0, 1.0, 11))
    tenth = np.clip(np.searchsorted(edges, found.probability, side="right") - 1, 0, 9)
    for k in np.unique(tenth):
        mine = tenth == k
        count, P = int(mine.sum()), found.probability[mine]
        seen, tail = int(hits[found.truth[mine]].sum()), 0.005 / 10
        # of independent trials with different probabilities the spread is at most that of equal ones
        low, high = binom.ppf(tail, count, P.mean()) - 1, binom.ppf(1.0 - tail, count, P.mean()) + 1
        if not low <= seen <= high:
            wrong.append(f"P about {P.mean():.3f}: {seen} of {count} hit, {low:.0f} to {high:.0f} expected")
    return wrong


def test_weighted_members_stand_for_the_prior() -> None:
    """A cloud three times as wide along the target, with weights, gives the same distribution."""
    rng = np.random.default_rng(5)
    wide = 1.0 + 0.5 * TARGET**2
    u = rng.standard_normal((40_000, SIZE)) * wide
    weights = np.exp(-0.5 * np.sum(u**2 - (u / wide) ** 2, axis=1)) * np.prod(wide)
    H = measured(1.0)
    found = foresee(u, u @ H.T, hit(u), rng, 3000, weights=weights)
    np.testing.assert_allclose(np.quantile(found.probability, LEVELS), quantiles_in_theory(H), atol=0.02)


def test_a_polynomial_is_found_again_with_its_gradient() -> None:
    rng = np.random.default_rng(6)
    u = 1e3 * rng.standard_normal((200, 3)) + 5e4

    def cubic(u: np.ndarray) -> np.ndarray:
        x, y, z = (u.T - 5e4) / 1e3
        return np.stack([1.0 + x - 2.0 * y * z + x**2 * y, z**3 - x * y * z], axis=1)

    curve = Polynomial.through(u, cubic(u), 3)
    new = 1e3 * rng.standard_normal((50, 3)) + 5e4
    np.testing.assert_allclose(curve(new), cubic(new), atol=1e-9)
    x, y, z = (new.T - 5e4) / 1e3
    by = np.stack([1.0 + 2.0 * x * y, -2.0 * z + x**2, -2.0 * y], axis=1) / 1e3
    np.testing.assert_allclose(curve.gradient(new)[:, 0], by, atol=1e-12)
    assert Polynomial.terms(3, 3) == 20


def plane(u: np.ndarray) -> np.ndarray:
    return np.stack([3e4 * u[:, 0] + 2e3 * u[:, 1] ** 2 + 1e3 * u[:, 0] * u[:, 2], 500.0 * u[:, 3] + 2e3], axis=1)


def test_a_map_of_three_thousand_orbits_tells_hits_of_others() -> None:
    rng = np.random.default_rng(7)
    u, new = rng.standard_normal((3000, SIZE)), rng.standard_normal((20_000, SIZE))
    points = plane(u)
    points[::100] = np.nan  # a few without the encounter
    hits = np.linalg.norm(points, axis=1) < 9e3
    found = TargetMap.of(u, points, hits, 9.1e3)
    assert found is not None
    assert found.error < 0.03
    true = np.linalg.norm(plane(new), axis=1) < 9e3
    assert np.count_nonzero(found.hit(new) != true) < 0.02 * np.count_nonzero(true)


def test_a_map_that_cannot_tell_says_so() -> None:
    rng = np.random.default_rng(8)
    u = rng.standard_normal((3000, SIZE))
    points = plane(u) * np.sign(np.sin(9.0 * u[:, :1])) + 3e4 * np.sin(9.0 * u[:, 4:5])
    found = TargetMap.of(u, points, np.linalg.norm(points, axis=1) < 9e3, 9e3)
    assert found is not None
    assert found.error > 0.3
    assert TargetMap.of(u[:200], points[:200], np.ones(200, dtype=bool), 9e3) is None


def test_what_cannot_be_used_is_refused_in_words() -> None:
    u, z = cloud(1.0, 300)
    rng = np.random.default_rng(9)
    for given, said in [
        ((u, z[:-1], hit(u), rng, 10), "must be of the same members"),
        ((u * np.nan, z, hit(u), rng, 10), "needs finite numbers"),
        ((u[:50], z[:50], hit(u[:50]), rng, 10), "50 members are too few"),
        ((u, z, hit(u), rng, 0), "at least one truth"),
    ]:
        with pytest.raises(InputError, match=said):
            foresee(*given)
    with pytest.raises(InputError, match="not negative"):
        foresee(u, z, hit(u), rng, 10, weights=-np.ones(300))
