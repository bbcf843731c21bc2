"""The screen before the score tests, against dense least squares of each group by itself."""

import numpy as np
import pytest

from nebosvod.fits.screening import PROMISING, Groups, promising

DAY = 86400.0


def dense(rows, used, t_s, q, B, W, rate, information):
    """Chi squared that a bias, a clock, a drift beside a bias explain, and the residual variance with all of them."""
    rows = rows[used[rows]]
    day = (t_s[rows] - t_s[rows].mean()) / DAY
    pairs = zip(W[rows], day, rate[rows])
    G = np.array([np.hstack([w, d * w, (w @ motion)[:, None]]) for w, d, motion in pairs]).reshape(-1, 5)
    flat = B[rows].reshape(-1, B.shape[2])
    M = G.T @ G - G.T @ flat @ np.linalg.solve(information, flat.T @ G)
    g = G.T @ q[rows].ravel()
    drop = {
        k: g[list(k)] @ np.linalg.solve(M[np.ix_(k, k)], g[list(k)])
        for k in ((0, 1), (4,), (0, 1, 2, 3), tuple(range(5)))
    }
    left = (np.sum(q[rows] ** 2) - drop[tuple(range(5))]) / (2 * len(rows) - 5)
    return max(drop[0, 1], drop[(4,)], drop[0, 1, 2, 3] - drop[0, 1]), left


@pytest.mark.parametrize("seed", range(4))
def test_the_screen_is_the_statistic_of_dense_algebra(seed):
    """Sixty groups with biases from none to large, scatter a third of the stated or as stated."""
    rng = np.random.default_rng(seed)
    n, s = 1800, 6
    t_s = np.sort(rng.uniform(-400.0, 400.0, n)) * DAY
    night = np.floor(t_s / DAY).astype(np.int64)
    B = rng.standard_normal((n, 2, s)) / 30.0
    W = np.tile(np.eye(2), (n, 1, 1)) * rng.uniform(0.5, 2.0, n)[:, None, None]
    rate = rng.standard_normal((n, 2))
    q = rng.standard_normal((n, 2)) * (0.3, 1.0)[seed % 2]
    kept = rng.uniform(size=n) > 0.05
    group = rng.integers(0, 60, n)
    q += W[:, 0, :1] * (rng.uniform(0.0, 1.0, 60)[group] * (group % 2))[:, None]
    rows = [np.flatnonzero(group == k) for k in range(60)]
    every, information = Groups(rows), 3.0 * np.eye(s)
    at = every.rows
    found = promising(every, t_s[at], night[at], kept[at], q[at], B[at], W[at], rate[at], information)
    size = np.linalg.norm(q, axis=1)
    expected, clear = [], []
    for one in rows:
        bound = 4.0 * np.sort(size[one[kept[one]]])[(kept[one].sum() - 1) // 2] / np.sqrt(2.0 * np.log(2.0))
        best, left = dense(one, kept & (size <= bound), t_s, q, B, W, rate, information)
        expected.append(best > PROMISING * left)
        clear.append(abs(best / (PROMISING * left) - 1.0) > 1e-6)
    assert all(clear)
    np.testing.assert_array_equal(found, expected)
    assert 10 < np.sum(found) < 50
