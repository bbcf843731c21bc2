"""Which of the drawn orbits hit within a time, and with what probability.

An orbit that, by the Sun alone, stays far from the Earth all the time is not flown, nor one that circles it too low to
be disturbed; all others are, with every force. Then more orbits are drawn where it is not clear whether a cell of the
grid hits: at the border of the impacting region; and where none hits, so many that the bound is some thousandths.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betaincinv

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.each import fates_of_each
from nebosvod.first_hour.circling import lowest_perigee
from nebosvod.first_hour.draws import Draws, draw, shares
from nebosvod.first_hour.grid import HEADLINE, Grid
from nebosvod.first_hour.nearest import nearest_by_the_sun
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.impacts.interval import of_count
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
WITHIN_D = 100.0
TOLERANCE = 1e-8
FAR_KM = 0.03 * AU_KM  # from the Earth, by the Sun alone: what it is about wrong by within a hundred days is less
WATCHED_KM = 1e9  # every closest approach is told
TARGET_KM = 3e4  # a cell that misses by as much may hold orbits that hit
FIRST, MORE, ROUNDS = 150, 100, 2
WORTH, POINTS = 1e-3, 200.0  # a probability that has a corridor, and of how many effective points
CLEAR = 1e-6  # of a cell: it need not be looked at again
TAIL = 0.025
FEW_HITS = 5.0
BOUND = 4e-3  # of what may hit where no draw does, or next to none: so many more draws are made where they come near
LEFT_OUT = 1e-6  # of the mass, that no cell or no draw stands for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Falls:
    """What becomes of drawn orbits.

    Attributes
    ----------
    draws : the orbits.
    flown : (m,) whether it was flown with every force.
    body : (m,) what it hits, "" for nothing.
    t_s : (m,) when it comes to the surface, TDB seconds after the reference time; of others nan.
    position_km, velocity_km_s : (m, 3) then, from the centre of the body, ICRF.
    miss_km : (m,) how near those come that do not hit; where not flown by the Sun alone, or the least perigee.
    """

    draws: Draws
    flown: Flags
    body: npt.NDArray[np.str_]
    t_s: Array
    position_km: Array
    velocity_km_s: Array
    miss_km: Array

    def hits(self, body: str = "earth") -> Flags:
        """Which orbits (m,) hit a body."""
        found: Flags = self.body == body
        return found

    def joined(self, other: "Falls") -> "Falls":
        """Both together."""
        rows = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in ROW_FIELDS}
        return Falls(draws=self.draws.joined(other.draws), **rows)


ROW_FIELDS = ("flown", "body", "t_s", "position_km", "velocity_km_s", "miss_km")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chance:
    """A probability of impact with its interval at 95 %.

    `bound` where no orbit hits, or where those that do weigh less than one of as many plain draws and the interval
    begins at 0: then all that is known is that it is below `high`.
    """

    probability: float
    low: float
    high: float
    hits: int
    bound: bool


def fall(grid: Grid, within_d: float, rng: np.random.Generator) -> Falls:
    """Draw orbits of a grid and see what becomes of them within some days of the reference time."""
    tracklet, states = grid.conditional.tracklet, grid.conditional.states(grid.nodes.coordinates)
    near = nearest_by_the_sun(tracklet, states, within_d) < 10.0 * TARGET_KM
    near &= ~np.isfinite(lowest_perigee(tracklet, states, within_d))
    found = flown(tracklet, draw(grid, shares(grid, FIRST, near), rng), within_d)
    for more in (*[_unclear] * ROUNDS, _of_the_bound, _of_the_corridor):
        number = more(grid, found)
        if number.any():
            found = found.joined(flown(tracklet, draw(grid, number, rng), within_d))
    return found


def _of_the_bound(grid: Grid, found: Falls) -> Rows:
    """How many more to draw in each cell that comes near, where a hit is not certain to be possible: each weighs alike.

    Three of N draws of one weight are left open, so that N of them leave 3/N times what all weigh.
    """
    w = np.where(found.flown, found.draws.weight(), 0.0)
    if chance(grid, found).low > 0.0 or not np.sum(w**2) > BOUND / 3.0 * np.sum(w):
        return np.zeros(len(grid.nodes), dtype=np.int64)
    more: Rows = np.rint(3.0 / BOUND * np.bincount(found.draws.cell, w, len(grid.nodes))).astype(np.int64)
    return more


def _of_the_corridor(grid: Grid, found: Falls) -> Rows:
    """How many more to draw in each cell, so that enough of those that hit tell where they come down."""
    w = np.where(found.hits(), found.draws.weight(), 0.0)
    hitting = np.bincount(found.draws.cell, w, len(grid.nodes))
    if not hitting.sum() > WORTH or np.sum(w) ** 2 >= POINTS * np.sum(w**2):
        return np.zeros(len(hitting), dtype=np.int64)
    more: Rows = np.rint(POINTS * hitting / hitting.sum()).astype(np.int64)
    return more


def _unclear(grid: Grid, found: Falls, count: int = MORE) -> Rows:
    """How many more orbits to draw in each cell: as Neyman shares them, by weight and spread of the answer."""
    p = _of_cells(grid, found, found.hits())
    w = np.mean([grid.weight(prior) for prior in grid.priors], axis=0)
    score = np.where(p > CLEAR, w * np.sqrt(p * (1.0 - p)), 0.0)
    total = score.sum()
    return np.rint(count * score / total).astype(np.int64) if total > 0.0 else np.zeros(len(w), dtype=np.int64)


def _of_cells(grid: Grid, found: Falls, hit: Flags) -> Array:
    """How probable a hit is in each cell (m,), never quite 0 or 1 where orbits of it or its neighbours say otherwise.

    A cell without a hit is open to what the nearest miss leaves: the share of the target in as wide a target plane.
    """
    m, cell = len(grid.nodes), found.draws.cell
    drawn, hits = np.bincount(cell, minlength=m), np.bincount(cell, hit, m)
    nearest, farthest = np.full(m, np.inf), np.full(m, -np.inf)
    apart = np.where(found.flown, found.miss_km, np.maximum(found.miss_km, FAR_KM))
    np.minimum.at(nearest, cell, np.where(hit, 0.0, apart))
    np.maximum.at(farthest, cell, np.where(hit, 0.0, 1.0))
    none = np.clip((TARGET_KM / np.maximum(_of_neighbours(grid, nearest), 1.0)) ** 2, 0.0, 0.5)
    some = np.where(-_of_neighbours(grid, -farthest) > 0.0, 0.5, 0.0)  # of a miss, where all hit
    share = np.where(2.0 * hits > drawn, some, none)
    return np.asarray((hits + np.where(2.0 * hits > drawn, 1.0 - share, share)) / (drawn + 1.0))


def _of_neighbours(grid: Grid, values: Array) -> Array:
    """The least value (m,) of a cell and those beside it: on its line, and on the next lines at the nearest rate."""
    found = values.copy()
    same = np.flatnonzero(np.diff(grid.line) == 0)
    np.minimum.at(found, same, values[same + 1])
    np.minimum.at(found, same + 1, values[same])
    rate, middle = grid.nodes.coordinates[:, 1], found.copy()
    for k in range(int(grid.line.max())):
        here, there = np.flatnonzero(grid.line == k), np.flatnonzero(grid.line == k + 1)
        if here.size and there.size:
            gap = np.abs(rate[here][:, None] - rate[there][None])
            a, b = there[gap.argmin(axis=1)], here[gap.argmin(axis=0)]
            np.minimum.at(found, here, middle[a])
            np.minimum.at(found, there, middle[b])
    return found


def flown(tracklet: Tracklet, draws: Draws, within_d: float) -> Falls:
    """Fly those orbits that may come near the Earth."""
    m = len(draws)
    miss = nearest_by_the_sun(tracklet, draws.states, within_d)
    circling = lowest_perigee(tracklet, draws.states, within_d)
    miss = np.where(np.isfinite(circling), circling, miss)
    near = (miss < FAR_KM) & ~np.isfinite(circling) & np.isfinite(draws.log_density[HEADLINE])
    body, t_s = np.full(m, "", dtype="<U16"), np.full(m, np.nan)
    place, velocity = np.full((m, 3), np.nan), np.full((m, 3), np.nan)
    rows = np.flatnonzero(near)
    if rows.size:
        fates = fates_of_each(
            draws.states[rows], tracklet.epoch, within_d * DAY_S, tracklet.forces, "earth", WATCHED_KM, TOLERANCE
        )
        hit = rows[fates.impact]
        body[hit], t_s[hit] = fates.body[fates.impact], fates.t_s[fates.impact]
        place[hit], velocity[hit] = fates.position_km[fates.impact], fates.velocity_km_s[fates.impact]
        known = np.isfinite(fates.distance_km) & ~fates.impact
        miss[rows[known]] = fates.distance_km[known]
    return Falls(draws=draws, flown=near, body=body, t_s=t_s, position_km=place, velocity_km_s=velocity, miss_km=miss)


def chance(grid: Grid, falls: Falls, prior: str = HEADLINE, body: str = "earth") -> Chance:
    """Probability that a body is hit.

    Notes
    -----
    Its error is that of stratified sampling, cell by cell: whether an orbit hits, and what it weighs beside others of
    its cell. The interval is that of as many plain draws as would have the same error. Without a hit the bound is 3/N
    of the orbits that were flown, times what they weigh.
    """
    w, hit, cell, m = falls.draws.weight(prior), falls.hits(body), falls.draws.cell, len(grid.nodes)
    none = _without_a_hit(w[falls.flown])
    if not hit.any():
        return Chance(probability=0.0, low=0.0, high=none, hits=0, bound=True)
    p = min(float(w @ hit), 1.0)
    guess, drawn = _of_cells(grid, falls, hit), np.maximum(np.bincount(cell, minlength=m), 1)
    guess = np.where(np.bincount(cell, falls.flown, m) > 0, guess, 0.0)  # nobody of these comes near
    shares2 = np.bincount(cell, w, m) ** 2 / drawn
    variance = float(shares2 @ (guess * (1.0 - guess)))
    if variance > 0.0:  # where all agree, effective draws decide
        variance += _unevenness(falls.draws, prior) * float(shares2 @ (guess * (1.0 - p) ** 2 + (1.0 - guess) * p**2))
    low, high = interval(p, variance, falls.draws.effective(prior), none)
    return Chance(probability=p, low=low, high=high, hits=int(hit.sum()), bound=low == 0.0 and p * len(w) < 1.0)


def _without_a_hit(w: Array) -> float:
    """What may hit at most (95 %) where none of the flown draws, of these weights, does: no other comes near."""
    mass, square = float(w.sum()), float(np.sum(w**2))
    high = mass * of_count(0, max(int(mass**2 / square), 1))[1] if square > 0.0 else 0.0
    return min(high + LEFT_OUT, 1.0)


def _unevenness(draws: Draws, prior: str) -> float:
    """Variance of the weights of draws of one cell, relative to the square of their mean: that of all cells of two."""
    cell, log = draws.cell, draws.log_density[prior]
    a = np.exp(log - log.max())
    number = np.bincount(cell)
    mean = np.bincount(cell, a) / np.maximum(number, 1)
    squares = np.bincount(cell, (a - mean[cell]) ** 2)
    several = number > 1
    total = float(np.sum(mean[several] ** 2))
    return float(np.sum(squares[several] / (number[several] - 1.0))) / total if total > 0.0 else 0.0


def interval(p: float, variance: float, draws: float, none: float = 1.0) -> tuple[float, float]:
    """95 % of a probability whose error has a variance.

    Parameters
    ----------
    draws : how many draws of equal weight tell as much, where all of them agree.
    none : what may hit at most where no draw does, if that is known to be less than so many draws leave.

    Notes
    -----
    That of as many plain draws as would have the same error, after Clopper and Pearson. Of fewer than five effective
    hits nothing below is excluded, and above it ends four sigmas on: one hit of N draws leaves 5.6/N. Misses are
    counted in the same way where they are rarer: a few of them, or none, leave 1 open.
    """
    if p > 0.5:
        low, high = _of_the_rarer(1.0 - p, variance, draws, 1.0)
        return 1.0 - high, 1.0 - low
    return _of_the_rarer(p, variance, draws, none)


def _of_the_rarer(p: float, variance: float, draws: float, none: float) -> tuple[float, float]:
    """The same of at most one half."""
    sigma, none = float(np.sqrt(variance)), min(of_count(0, max(int(draws), 1))[1], none)
    if p * p < FEW_HITS * variance or not variance > 0.0:
        return 0.0, min(max(p + 4.0 * sigma, none if p * draws < 1.0 else 0.0), 1.0)
    number = min(p * (1.0 - p) / variance, 1e9)
    hits = p * number
    low = float(betaincinv(hits, number - hits + 1.0, TAIL))
    high = float(betaincinv(hits + 1.0, number - hits, 1.0 - TAIL))
    return min(low, p), max(high, p)


def epoch_of(falls: Falls, tracklet: Tracklet) -> tuple[Epoch, float] | None:
    """Median time of the hits on the Earth and half the width of their 68 %, s; None without a hit."""
    hit = falls.hits()
    if not hit.any():
        return None
    order = np.argsort(falls.t_s[hit])
    t, w = falls.t_s[hit][order], falls.draws.weight()[hit][order]
    at = np.interp([0.16, 0.5, 0.84], (np.cumsum(w) - 0.5 * w) / w.sum(), t)
    return tracklet.epoch + float(at[1]), float(0.5 * (at[2] - at[0]))
