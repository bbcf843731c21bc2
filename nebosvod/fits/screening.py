"""Which groups of records are worth a full score test: the sums of all stations and visits in one pass.

An orbit of nine thousand records has eight hundred stations and visits, of which a few dozen could have a shared error
of 5 sigma. The statistic that decides is found for all of them at once, without what makes the full test slow: trimming
that is repeated, and scatter by night.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from nebosvod.estimation.accuracy.score import CLUSTERS, FEW, FEW_FREE, TRIMMED
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
PROMISING = 12.0  # of the statistic, 3 sigma, below which no full test finds 5
RIDGE = 1e-10  # of its own information, left to what the orbit takes up
LEVEL = 1.0 / np.sqrt(chdtri(2, 0.5))  # sigma of a number from the median length of two


class Groups:
    """Groups of records one after another: sums over each, and values of each for all its records.

    Parameters
    ----------
    rows : (g) arrays, of each group in the order of time; groups may share records.
    """

    def __init__(self, rows: Sequence[Rows]) -> None:
        self.length = np.array([len(one) for one in rows])
        self.rows = np.concatenate(rows)
        self.start = np.concatenate([[0], np.cumsum(self.length)[:-1]])

    def sums(self, values: npt.NDArray[np.generic]) -> Array:
        """Sums (g, ...) of values (n, ...) of the records of all groups."""
        return np.asarray(np.add.reduceat(values.astype(np.float64), self.start, axis=0))

    def spread(self, values: Array) -> Array:
        """The value of its group for each record."""
        return np.repeat(values, self.length)

    def middle(self, size: Array, kept: Flags) -> Array:
        """Median (g,) of the sizes of those kept."""
        count = self.sums(kept).astype(np.int64)
        order = np.lexsort((size, ~kept, np.repeat(np.arange(len(self.length)), self.length)))
        return np.asarray(size[order[self.start + np.maximum(count - 1, 0) // 2]])


def promising(
    groups: Groups,
    t_s: Array,
    night: Rows,
    kept: Flags,
    q: Array,
    B: Array,
    W: Array,
    rate: Array,
    information: Array,
    least: float = PROMISING,
) -> Flags:
    """Whether a bias, a drift or a clock may be significant in each of the groups (g,).

    Parameters
    ----------
    t_s, night, q, B, W, rate : of the records in the order of the groups, as in a footing.
    kept : the records that made the estimate.
    information : (s, s) of the estimate.
    least : of the statistic.
    """
    size = np.linalg.norm(q, axis=1)
    bound = np.where(groups.sums(kept) >= FEW, TRIMMED * LEVEL * groups.middle(size, kept), np.inf)
    used = kept & (size <= groups.spread(bound))
    count = groups.sums(used)
    centre = groups.sums(np.where(used, t_s, 0.0)) / np.maximum(count, 1.0)
    day = (t_s - groups.spread(centre)) / SECONDS_PER_DAY
    weighed = np.where(used[:, None, None], W, 0.0)
    G = np.concatenate([weighed, day[:, None, None] * weighed, weighed @ rate[:, :, None]], axis=2)
    turned = G.transpose(0, 2, 1)
    N_cc, N_cx, slope = groups.sums(turned @ G), groups.sums(turned @ B), groups.sums(turned @ q[:, :, None])[:, :, 0]
    own = np.sqrt(np.maximum(np.diagonal(N_cc, axis1=1, axis2=2), 1e-300))
    N_cc, N_cx, slope = N_cc / (own[:, :, None] * own[:, None, :]), N_cx / own[:, :, None], slope / own
    half = N_cx @ _whitening(information)
    M = N_cc - half @ half.transpose(0, 2, 1) + RIDGE * np.eye(5)
    left = groups.sums(np.where(used, size**2, 0.0)) - _explained(M, slope, slice(0, 5))
    nights = groups.sums(np.concatenate([[True], night[1:] != night[:-1]]))
    bias, clock, both = (_explained(M, slope, kind) for kind in (slice(0, 2), slice(4, 5), slice(0, 4)))
    best = np.maximum(np.maximum(bias, clock), both - np.where(np.isfinite(bias), bias, 0.0))
    return np.asarray(best > least * _scatter(left, count, nights))


def _whitening(information: Array) -> Array:
    """U (s, r) with U U^T the inverse of an information, of least length where it is singular."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    size, V = np.linalg.eigh(information / np.outer(scale, scale))
    known = size > 1e-13 * size[-1]
    return np.asarray(V[:, known] / np.sqrt(size[known]) / scale[:, None])


def _explained(M: Array, slope: Array, kind: slice) -> Array:
    """By how much chi squared would drop (g,); infinite where the orbit takes the parameters up."""
    part, own = M[:, kind, kind], slope[:, kind, None]
    clear = np.linalg.eigvalsh(part)[:, 0] > 0.1 * RIDGE
    whole = np.where(clear[:, None, None], part, np.eye(part.shape[1]))
    return np.where(clear, np.sum(own * np.linalg.solve(whole, own), axis=(1, 2)), np.inf)


def _scatter(left: Array, count: Array, nights: Array) -> Array:
    """Variance (g,) of what is left of whitened residuals; as in the full test at least one where few tell it."""
    freedom = np.maximum(2.0 * count - 5.0, 1.0)
    scatter = np.where(np.isfinite(left), np.maximum(left, 0.0), 0.0) / freedom
    return np.where((2.0 * count - 1.0 >= FEW_FREE) & (nights >= CLUSTERS), scatter, np.maximum(scatter, 1.0))
