"""The posterior of range and range rate on a grid that follows it.

Lines of constant ln(range) stand where the mass is; on each the nodes lie about the best range rate of that range, as
far as the measurements and the region let it go. So the grid is straight on a ridge however tilted and bent: an
axis-aligned one of 41 x 41 gave sigma ratios of 0.4 to 0.7. Both ways the nodes are those of Gauss and Legendre.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr, logsumexp

from nebosvod.errors import GeometryError
from nebosvod.first_hour.conditional import RATE, Conditional, Nodes
from nebosvod.first_hour.region import Region

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
PRIORS = ("uniform", "cartesian", "jeffreys")
HEADLINE = "uniform"
ENOUGH = 30.0  # effective nodes, without which moments are not to be trusted
COARSE = 0.35  # of ln(range), between the first lines
SMOOTH = 1.0  # change of the log of the mass from one border to the next
ROUNDS = 40
DEEP = 16.0  # below the largest mass, in logs, where no line is set
THIN = 1e-4  # of the mass, below which one line stands for an interval
REACH = 5.5  # sigmas of the range rate
OUTSIDE = 4.0  # sigmas from what is allowed, where a best range rate is far from it
PER_SIGMA = 1.4  # nodes of a line
FEWEST, MOST = 5, 16
FINER = (2, 3, 5)  # lines to an interval
SURELY = 0.95  # of enough nodes, below which their number is not counted where lines say so
CLOSELY = np.linspace(-6.0, 6.0, 25)  # the same where no others are: so many that enough nodes carry the weight
ABOUT = np.linspace(-6.0, 6.0, 13)  # sigmas of ln(range) from the best orbit, where lines are set if it is sharp


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Nodes with their weights.

    Attributes
    ----------
    nodes : the best orbits at m pairs of range and range rate.
    log_mass : by prior, (m,) log of the mass of each cell; -inf where the region excludes it.
    line : (m,) which line each stands on.
    lines : the best orbits at g ranges, with the range rate free.
    width : (g,) of ln(range) that a line stands for; low : (g,) where that begins.
    share : (m, 2) the part of the interval of range rates, from 0 to 1, that a node stands for.
    best : the orbit of the smallest chi2.
    """

    nodes: Nodes
    log_mass: Mapping[str, Array]
    line: Rows
    lines: Nodes
    low: Array
    width: Array
    share: Array
    conditional: Conditional
    region: Region

    def weight(self, prior: str = HEADLINE) -> Array:
        """Normalised weights (m,)."""
        log = self.log_mass[prior]
        found: Array = np.exp(log - logsumexp(log))
        return found

    def effective(self, prior: str = HEADLINE) -> float:
        """Effective number of nodes, 1 / sum w^2."""
        return float(1.0 / np.sum(self.weight(prior) ** 2))

    def moments(self, prior: str = HEADLINE) -> tuple[Array, Array]:
        """Mean (2,) and covariance (2, 2) of ln(range / au) and range rate."""
        w, x = self.weight(prior), self.nodes.coordinates[:, :2]
        mean = w @ x
        away = x - mean
        return mean, (w[:, None] * away).T @ away

    @property
    def best_chi2(self) -> float:
        """The smallest chi2 of a node."""
        return float(self.nodes.chi2.min())

    @property
    def priors(self) -> tuple[str, ...]:
        """Those there are: Jeffreys' needs three directions."""
        return tuple(self.log_mass)


def grid_of(conditional: Conditional, region: Region, known: Nodes | None = None) -> Grid:
    """Lay the grid.

    Parameters
    ----------
    conditional : least squares of the tracklet.
    region : which orbits count.
    known : one orbit that fits, with nothing held: lines are begun there and stand about it alone.

    Raises
    ------
    GeometryError
        If no orbit of the region can be followed over the measurements.
    """
    search = _Search(conditional, region, known)
    search.scan()
    return search.grid()


class _Search:
    """Borders of intervals of ln(range), halved until the mass changes little from one to the next."""

    def __init__(self, conditional: Conditional, region: Region, known: Nodes | None) -> None:
        self.conditional, self.region, self.known = conditional, region, known
        low, high = region.ranges(conditional.tracklet)
        self.x = np.linspace(low, high, max(int(np.ceil((high - low) / COARSE)) + 1, 5))
        if known is not None:
            self.x = np.unique(np.clip(known.coordinates[0, 0] + known.range_sigma[0] * CLOSELY, low, high))
        self.priors = PRIORS if len(conditional.tracklet) > 2 else PRIORS[:2]
        self.L = self.masses(self.lines(self.x))

    def lines(self, x: Array, start: Array | None = None) -> Nodes:
        """The best orbits at some ranges, rates of range free within twice what the region holds."""
        if self.known is not None:
            start = _begun(self.known, x)
        first = self.conditional.first(x, np.zeros_like(x)) if start is None else start
        low, high = self.region.rates(self.conditional, first)
        middle = np.where(np.isfinite(low), 0.5 * (low + high), 0.0)
        half = np.where(np.isfinite(low), np.maximum(high - low, 1.0), 30.0)
        if start is None:
            first = self.conditional.first(x, middle)
        return self.conditional.solve(first, 1, (middle, half))

    def masses(self, lines: Nodes) -> Array:
        """Log of the mass of lines for each unit of ln(range), by prior (priors, g), by Laplace's formula."""
        low, high = self.region.rates(self.conditional, lines.coordinates)
        a, b = ((end - lines.rate_centre) / lines.rate_sigma for end in (low, high))
        with np.errstate(all="ignore"):
            inside = np.where(a + b > 0.0, _log_between(-b, -a), _log_between(a, b))
            log = -0.5 * lines.chi2 + lines.log_spread + np.log(lines.rate_sigma) + inside
        log = np.where(np.isfinite(log) & self.region.allows(lines.above_km), log, -np.inf)
        return np.stack([log + log_prior(prior, lines) for prior in self.priors])

    def scan(self) -> None:
        """Halve intervals until neighbours differ by little wherever there is mass."""
        self._sharpen()
        for _ in range(ROUNDS):
            coarse = self._coarse()
            if not coarse.size:
                return
            self._insert(0.5 * (self.x[coarse] + self.x[coarse + 1]))

    def _coarse(self) -> Rows:
        """Intervals to be halved."""
        with np.errstate(invalid="ignore"):
            top = self.L.max(axis=1, keepdims=True)
            level = np.where(np.isfinite(top), self.L - top, -np.inf)
            pairs = np.maximum(level[:, :-1], level[:, 1:])
            change = np.abs(np.diff(np.maximum(level, -2.0 * DEEP), axis=1))
        wide = np.diff(self.x)
        # far down the slope a step may be larger: what is lost there is a share of next to nothing
        allowed = SMOOTH * np.maximum(1.0, -0.35 * pairs)
        rough = (pairs > -DEEP) & (change > allowed)
        found: Rows = np.flatnonzero(rough.any(axis=0) & (wide > 1e-7))
        return found

    def _sharpen(self) -> None:
        """Set lines about the best orbit of all, whose range may be known to a ten thousandth."""
        if self.known is not None:
            return
        best = int(np.argmax(self.L[0]))
        if not np.isfinite(self.L[0, best]):
            return
        near = self.lines(self.x[best : best + 1])
        if near.range_sigma[0] > COARSE:
            return
        full = self.conditional.solve(near.coordinates, 0)
        sigma, peak = float(full.range_sigma[0]), float(full.coordinates[0, 0])
        inside = self.x[0] < peak < self.x[-1]
        if np.isfinite(full.chi2[0]) and inside and sigma < COARSE and full.chi2[0] <= near.chi2[0] + 1.0:
            more = peak + sigma * ABOUT
            self._insert(more[(more > self.x[0]) & (more < self.x[-1])])

    def _insert(self, x: Array) -> None:
        """More borders."""
        masses = self.masses(self.lines(x))
        order = np.argsort(np.concatenate([self.x, x]), kind="stable")
        self.x = np.concatenate([self.x, x])[order]
        self.L = np.concatenate([self.L, masses], axis=1)[:, order]

    def grid(self) -> Grid:
        """The grid, with more lines to an interval until enough nodes carry the weight."""
        for most in FINER:
            plan = self._planned(most)
            if most < FINER[-1] and plan.expected() < SURELY * ENOUGH:
                continue
            found = self._laid(plan)
            if found.effective() >= ENOUGH:
                break
        return found

    def _planned(self, most: int) -> "_Plan":
        """Lines at Gauss and Legendre's points of every interval with mass, nodes likewise on every line."""
        x, low, width = self._intervals(most)
        lines = self.lines(x)
        first, share, line, weight, interval = self._nodes(lines)
        size = weight * interval * width[line]
        return _Plan(lines=lines, low=low, width=width, first=first, share=share, line=line, size=size)

    def _laid(self, plan: "_Plan") -> Grid:
        """The best orbits at the nodes."""
        lines, line, first = plan.lines, plan.line, plan.first
        start = lines.coordinates[line].copy()
        shift = first - start[:, RATE]
        start[:, RATE] = first
        start[:, 2:] += shift[:, None] * lines.drift[line, -4:]
        nodes = self.conditional.solve(start, 2)
        log = -0.5 * nodes.chi2 + nodes.log_spread + np.log(plan.size)
        allowed = self.region.allows(nodes.above_km) & np.isfinite(log)
        log = np.where(allowed, log, -np.inf)
        if not allowed.any():
            raise self._nothing()
        return Grid(
            nodes=nodes,
            log_mass={prior: log + log_prior(prior, nodes) for prior in self.priors},
            line=line,
            lines=lines,
            low=plan.low,
            width=plan.width,
            share=plan.share,
            conditional=self.conditional,
            region=self.region,
        )

    def _nothing(self) -> GeometryError:
        name, which = self.conditional.tracklet.name, "bound to the Sun, " if self.region.bound else ""
        return GeometryError(
            f"{name}: no orbit {which}above the ground and of a size between {self.region.smallest_m:g} m and "
            f"{self.region.largest_km:g} km fits the observations; widen --smallest, allow --unbound, "
            "or see whether they are all of one object"
        )

    def _intervals(self, most: int) -> tuple[Array, Array, Array]:
        """Places of lines, and beginnings and widths (g,) of what each stands for; one where there is little mass."""
        wide = np.diff(self.x)
        top = self.L.max(axis=1, keepdims=True)
        level = np.maximum(self.L[:, :-1], self.L[:, 1:]) - np.where(np.isfinite(top), top, 0.0)
        mass = np.exp(level) * wide
        part = (mass / np.maximum(mass.sum(axis=1, keepdims=True), 1e-300)).max(axis=0)
        kept = np.flatnonzero((level > -DEEP).any(axis=0))
        if not kept.size:
            raise self._nothing()
        places, lows, widths = [], [], []
        for k in kept:
            point, weight = np.polynomial.legendre.leggauss(most if part[k] > THIN else 1)
            edges = np.concatenate([[0.0], np.cumsum(0.5 * weight)])
            places.append(self.x[k] + 0.5 * (point + 1.0) * wide[k])
            lows.append(self.x[k] + edges[:-1] * wide[k])
            widths.append(0.5 * weight * wide[k])
        return np.concatenate(places), np.concatenate(lows), np.concatenate(widths)

    def _nodes(self, lines: Nodes) -> tuple[Array, Array, Rows, Array, Array]:
        """Range rates of all nodes, shares of the interval, lines, weights, and lengths of the intervals."""
        begin, end = interval_of(self.region, self.conditional, lines, np.zeros(len(lines)))
        rates, shares, line, weights, lengths = [], [], [], [], []
        for k in range(len(lines)):
            length = float(end[k] - begin[k])
            if not length > 0.0:
                continue
            count = int(np.clip(np.ceil(PER_SIGMA * length / lines.rate_sigma[k]), FEWEST, MOST))
            point, weight = np.polynomial.legendre.leggauss(count)
            rates.append(begin[k] + 0.5 * (point + 1.0) * length)
            edges = np.concatenate([[0.0], np.cumsum(0.5 * weight)])
            shares.append(np.stack([edges[:-1], edges[1:]], axis=1))
            line.append(np.full(count, k))
            weights.append(0.5 * weight)
            lengths.append(np.full(count, length))
        if not rates:
            raise self._nothing()
        return (
            np.concatenate(rates), np.concatenate(shares), np.concatenate(line), np.concatenate(weights),
            np.concatenate(lengths),
        )  # fmt: skip


def _begun(known: Nodes, x: Array) -> Array:
    """Coordinates (g, 6) at some ranges: those of a known orbit, carried on along its ridge."""
    found = np.repeat(known.coordinates, len(x), axis=0)
    found[:, 0] = x
    found[:, RATE] += known.rate_slope[0] * (x - known.coordinates[0, 0])
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Plan:
    """Where the nodes of a grid are to be, before an orbit is sought in any.

    Attributes
    ----------
    lines, low, width, share, line : as of a grid. first : (m,) range rates, km/s.
    size : (m,) of the cells.
    """

    lines: Nodes
    low: Array
    width: Array
    first: Array
    share: Array
    line: Rows
    size: Array

    def expected(self) -> float:
        """How many nodes will carry the weight, by the normal distribution of the rate on each line."""
        lines, line = self.lines, self.line
        away = (self.first - lines.rate_centre[line]) / lines.rate_sigma[line]
        on_line = -0.5 * lines.chi2 + lines.log_spread + log_prior(HEADLINE, lines)
        log = on_line[line] - 0.5 * away**2 + np.log(self.size)
        log = np.where(np.isfinite(log), log, -np.inf)
        return float(np.exp(2.0 * logsumexp(log) - logsumexp(2.0 * log))) if np.isfinite(log).any() else ENOUGH


def interval_of(
    region: Region, conditional: Conditional, lines: Nodes, shift: Array, which: Rows | None = None
) -> tuple[Array, Array]:
    """From which to which range rate (g,) the nodes of lines lie, a `shift` (g,) of ln(range) away from them.

    Where the rate that fits best is far from what is allowed, they reach from the limit as far as chi squared rises by
    REACH^2: a prior that favours what is far may outweigh what is lost up to the limit.
    """
    chosen = np.arange(len(lines)) if which is None else which
    x = lines.coordinates[chosen].copy()
    x[:, 0] += shift
    low, high = region.rates(conditional, x)
    centre = lines.rate_centre[chosen] + shift * lines.rate_slope[chosen]
    sigma = lines.rate_sigma[chosen]
    below, above = (np.maximum(gap / sigma, 0.0) for gap in (low - centre, centre - high))
    from_limit = [sigma * (np.sqrt(out**2 + REACH**2) - out) for out in (below, above)]
    begin = np.where(above > OUTSIDE, high - from_limit[1], centre - REACH * sigma)
    end = np.where(below > OUTSIDE, low + from_limit[0], centre + REACH * sigma)
    return np.maximum(low, begin), np.minimum(high, end)


def log_prior(prior: str, nodes: Nodes) -> Array:
    """Log of a prior's density over ln(range), range rate and attributable.

    Uniform in range and rate: the factor is the Jacobian of the logarithm. Uniform in Cartesian phase space: d3r d3v =
    rho^4 d rho d rho_dot d(attributable). Jeffreys': the root of the determinant of the information.
    """
    x = nodes.coordinates[:, 0]
    if prior == "jeffreys":
        return nodes.log_fisher
    return x if prior == "uniform" else 5.0 * x


def _log_between(a: Array, b: Array) -> Array:
    """Log of the normal mass between a and b, both below or about 0."""
    upper, lower = log_ndtr(b), log_ndtr(a)
    found: Array = upper + np.log1p(-np.exp(lower - upper))
    return found
