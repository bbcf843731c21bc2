"""Importance sampling of a tracklet's posterior in all six dimensions: nothing of the program but places of bodies.

Orbits by Runge and Kutta of fourth order under Sun, Earth, Moon and Jupiter, directions by fixed-point light times, a
dense covariance with every nuisance, proposals that learn in rounds (population Monte Carlo, tempered at first).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
AU, C = 149597870.7, 299792.458
PULLING = ("sun", "earth", "moon", "jupiter")
STEPS_S = (300.0, 3600.0)  # longest step, of what is nearer than 0.05 au and of what is not


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bodies:
    """Places of the bodies from the Sun on the half steps of a grid through t = 0, and that of the Sun at the times."""

    times: Array
    steps: tuple[tuple[Array, Array], ...]
    sun: Array
    gm: Array

    @classmethod
    def of(cls, ephemeris: Ephemeris, epoch: Epoch, t_s: Array, step_s: float) -> "Bodies":
        """Steps from 0 out to every measurement, backward and forward."""
        legs = []
        for sign in (-1.0, 1.0):
            ends = np.unique(sign * t_s[sign * t_s > 0.0])
            knots = [0.0]
            for end in ends:
                count = int(np.ceil((end - knots[-1]) / step_s))
                knots += list(np.linspace(knots[-1], end, count + 1)[1:])
            edges = sign * np.array(knots)
            half = np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]) * sign) * sign
            sun = ephemeris.position_km("sun", epoch, half)
            legs.append((edges, np.stack([ephemeris.position_km(b, epoch, half) - sun for b in PULLING])))
        return cls(
            times=t_s, steps=tuple(legs), sun=ephemeris.state_km_km_s("sun", epoch, t_s),
            gm=np.array([ephemeris.gm_km3_s2[body] for body in PULLING]),
        )  # fmt: skip

    def pull(self, r: Array, places: Array) -> Array:
        """Heliocentric acceleration (m, 3)."""
        total = -self.gm[0] * r / np.linalg.norm(r, axis=1)[:, None] ** 3
        for gm, place in zip(self.gm[1:], places[1:]):
            away = r - place
            total -= gm * (away / np.linalg.norm(away, axis=1)[:, None] ** 3 + place / np.linalg.norm(place) ** 3)
        return total

    def fly(self, states: Array) -> Array:
        """States (m, n, 6) at the times of orbits (m, 6) at 0."""
        found = np.repeat(states[:, None], len(self.times), axis=1)
        for edges, places in self.steps:
            x = states.copy()
            for k in range(len(edges) - 1):
                h = edges[k + 1] - edges[k]
                p = places[:, 2 * k : 2 * k + 3]
                stage = np.zeros_like(x)
                total = np.zeros_like(x)
                for share, weight, at in ((0.0, 1.0, 0), (0.5, 2.0, 1), (0.5, 2.0, 1), (1.0, 1.0, 2)):
                    y = x + share * h * stage
                    stage = np.hstack([y[:, 3:], self.pull(y[:, :3], p[:, at])])
                    total += weight / 6.0 * stage
                x = x + h * total
                found[:, self.times == edges[k + 1]] = x[:, None]
        return found


def frame_of(ra: float, dec: float) -> Array:
    """East, north and line of sight (3, 3)."""
    cr, sr, cd, sd = np.cos(ra), np.sin(ra), np.cos(dec), np.sin(dec)
    return np.array([[-sr, cr, 0.0], [-sd * cr, -sd * sr, cd], [cd * cr, cd * sr, sd]])


def states(exposures: Exposures, reference: int, frame: Array, x: Array) -> Array:
    """Heliocentric states (m, 6) of ln(range / au), rate, offsets and their rates (m, 6)."""
    place = exposures.observer[reference] - exposures.sun[reference]
    line = frame[2] + x[:, 2:3] * frame[0] + x[:, 3:4] * frame[1]
    line /= np.linalg.norm(line, axis=1)[:, None]
    sweep = x[:, 4:5] * frame[0] + x[:, 5:6] * frame[1]
    sweep -= np.sum(sweep * line, axis=1)[:, None] * line
    rho = AU * np.exp(x[:, :1])
    return np.hstack([place[:3] + rho * line, place[3:] + x[:, 1:2] * line + rho * sweep])


def directions(
    bodies: Bodies, exposures: Exposures, reference: int, frame: Array, x: Array
) -> tuple[Array, Array, Array]:
    """RA and Dec (m, n, 2), their rates, RA cos Dec and Dec, and the distances (m, n), km."""
    flown = bodies.fly(states(exposures, reference, frame, x))
    r, v = flown[..., :3], flown[..., 3:]
    fall = -bodies.gm[0] * r / np.linalg.norm(r, axis=-1)[..., None] ** 3
    tau = np.zeros(r.shape[:2])
    for _ in range(6):
        late = tau[..., None]
        line = r + bodies.sun[:, :3] - exposures.observer[:, :3] - late * (v + bodies.sun[:, 3:]) + 0.5 * late**2 * fall
        tau = np.linalg.norm(line, axis=-1) / C
    psi = np.stack(
        [np.arctan2(line[..., 1], line[..., 0]), np.arctan2(line[..., 2], np.hypot(line[..., 0], line[..., 1]))],
        axis=-1,
    )
    motion = v + bodies.sun[:, 3:] - exposures.observer[:, 3:]
    cr, sr, cd, sd = np.cos(psi[..., 0]), np.sin(psi[..., 0]), np.cos(psi[..., 1]), np.sin(psi[..., 1])
    d = np.linalg.norm(line, axis=-1)
    east = (-sr * motion[..., 0] + cr * motion[..., 1]) / d
    north = (-sd * cr * motion[..., 0] - sd * sr * motion[..., 1] + cd * motion[..., 2]) / d
    return psi, np.stack([east, north], axis=-1), d


def covariance(case: Any, columns: Any, far_km: Array, rate: Array, psi: Array, sigma: float | Array) -> Array:
    """Dense covariance (m, 2 n, 2 n) of directions to what is so far (m, n) from each observer, with every nuisance.

    The noise may be another one (n,) for each direction.
    """
    m, n = rate.shape[:2]
    cr, sr, cd, sd = np.cos(psi[..., 0]), np.sin(psi[..., 0]), np.cos(psi[..., 1]), np.sin(psi[..., 1])
    zero = np.zeros_like(cr)
    axes = np.stack([np.stack([-sr, cr, zero], -1), np.stack([-sd * cr, -sd * sr, cd], -1)], axis=-2)
    H = (
        columns.bias[None]
        + rate[..., None] * columns.clock[None, :, None]
        - axes @ columns.place[None] / far_km[..., None, None]
    )
    variance = 1.0 / np.diag(columns.information) ** 2 if columns.names else np.zeros(0)
    H = H.reshape(m, 2 * n, -1)
    noise = np.diag(np.repeat(np.broadcast_to(sigma, (n,)), 2) ** 2)
    found: Array = noise + (H * variance) @ H.transpose(0, 2, 1)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """What the oracle needs of a tracklet."""

    bodies: Bodies
    exposures: Exposures
    reference: int
    observed: Array
    case: Any
    columns: Any
    sigma: float | Array
    low: float
    high: float

    @property
    def frame(self) -> Array:
        """About the direction observed at the reference time."""
        return frame_of(*self.observed[self.reference])

    def residual(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Observed minus computed (m, 2 n), rates, directions, distances."""
        psi, rate, far = directions(self.bodies, self.exposures, self.reference, self.frame, x)
        away = self.observed - psi
        away[..., 0] = (away[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
        away[..., 0] *= np.cos(psi[..., 1])
        return away.reshape(len(x), -1), rate, psi, far

    def log_target(self, x: Array) -> Array:
        """Log posterior density (m,) over ln(range), rate and attributable; prior uniform in range and rate."""
        v, rate, psi, far = self.residual(x)
        L = np.linalg.cholesky(covariance(self.case, self.columns, far, rate, psi, self.sigma))
        white = np.linalg.solve(L, v[..., None])[..., 0]
        log = -0.5 * np.sum(white**2, axis=1) - np.log(np.einsum("mii->mi", L)).sum(axis=1) + x[:, 0]
        return np.where(self.inside(x), log, -np.inf)

    def inside(self, x: Array) -> npt.NDArray[np.bool_]:
        """Bound to the Sun and within the ranges."""
        s = states(self.exposures, self.reference, self.frame, x)
        energy = 0.5 * np.sum(s[:, 3:] ** 2, axis=1) - self.bodies.gm[0] / np.linalg.norm(s[:, :3], axis=1)
        found: npt.NDArray[np.bool_] = (energy < 0.0) & (x[:, 0] > self.low) & (x[:, 0] < self.high)
        return found

    def bounds(self, x: Array) -> tuple[Array, Array]:
        """Least and largest bound range rate at coordinates (m, 6)."""
        s = states(self.exposures, self.reference, self.frame, np.where(np.arange(6) == 1, 0.0, x))
        place = self.exposures.observer[self.reference, :3] - self.exposures.sun[self.reference, :3]
        line = (s[:, :3] - place) / np.linalg.norm(s[:, :3] - place, axis=1)[:, None]
        b = np.sum(s[:, 3:] * line, axis=1)
        room = b**2 - np.sum(s[:, 3:] ** 2, axis=1) + 2.0 * self.bodies.gm[0] / np.linalg.norm(s[:, :3], axis=1)
        half = np.sqrt(np.maximum(room, 0.0))
        return -b - half, -b + half

    def attributable(self, xy: Array, start: Array) -> tuple[Array, Array]:
        """Best attributables (m, 4) and factors (m, 4, 4) of their covariance at ranges and rates (m, 2), from near."""
        span = max(np.ptp(self.exposures.t_s), 60.0)
        steps = np.array([1e-5, 1e-5, 1e-5 / span, 1e-5 / span])
        a = start.copy()
        for _ in range(3):
            x = np.hstack([xy, a])
            moved = np.repeat(x[:, None], 5, axis=1)
            for j in range(4):
                moved[:, j + 1, 2 + j] += steps[j]
            v, rate, psi, far = self.residual(moved.reshape(-1, 6))
            v = v.reshape(len(x), 5, -1)
            J = ((v[:, :1] - v[:, 1:]) / steps[:, None]).transpose(0, 2, 1)
            own = slice(None, None, 5)
            L = np.linalg.cholesky(covariance(self.case, self.columns, far[own], rate[own], psi[own], self.sigma))
            scale = np.linalg.norm(J, axis=1)
            white, right = np.linalg.solve(L, J / scale[:, None]), np.linalg.solve(L, v[:, 0, :, None])
            Q, R = np.linalg.qr(white)
            a = a + np.linalg.solve(R, Q.transpose(0, 2, 1) @ right)[..., 0] / scale
        factor = np.linalg.solve(R, np.broadcast_to(np.eye(4), R.shape)) / scale[:, :, None]
        return a, factor


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled:
    """Draws (m, 6) of the posterior with normalised weights (m,)."""

    x: Array
    w: Array

    @property
    def effective(self) -> float:
        """1 / sum w^2."""
        return float(1.0 / np.sum(self.w**2))

    def moments(self) -> tuple[Array, Array]:
        """Mean and covariance of ln(range) and rate."""
        mean = self.w @ self.x[:, :2]
        away = self.x[:, :2] - mean
        return mean, (self.w[:, None] * away).T @ away


def sample(problem: Problem, count: int, rng: np.random.Generator, first: int = 4000, rounds: int = 30) -> Sampled:
    """Draw until the proposal has learnt, then `count` draws that are weighed as they are."""
    x = np.zeros((first, 6))
    x[:, 0] = problem.low + (problem.high - problem.low) * rng.random(first)
    a, _ = problem.attributable(x[:, :2], x[:, 2:])
    x[:, 2:] = a
    low, high = problem.bounds(x)
    x[:, 1] = low + (high - low) * rng.random(first)
    x[:, 2:], _ = problem.attributable(x[:, :2], a)
    log, log_q = _profile(problem, x), -np.log(np.maximum(high - low, 1e-9))
    for _ in range(rounds):
        beta, w = _tempered(log, log_q)
        learnt = _Learnt(problem, x, w)
        if beta >= 1.0:
            break
        x, log_q = learnt.draw(first, rng)
        log = _profile(problem, x)
    xs, ws = [], []
    for part in np.array_split(np.arange(count), max(count // 4000, 1)):
        x, log_q = learnt.draw(len(part), rng)
        a, factor = x[:, 2:].copy(), learnt.factor
        z = rng.standard_normal((len(x), 4))
        x[:, 2:] = a + 1.1 * np.einsum("mij,mj->mi", factor, z)
        log_a = -0.5 * np.sum(z**2, axis=1) - np.log(np.abs(np.linalg.det(factor)))
        ws.append(problem.log_target(x) - log_q - log_a)
        xs.append(x)
    log_w = np.concatenate(ws)
    w = np.exp(log_w - log_w.max())
    return Sampled(x=np.concatenate(xs), w=w / w.sum())


def _profile(problem: Problem, x: Array) -> Array:
    """Log density at the best attributables: the shape of the posterior, for learning only."""
    return problem.log_target(x)


def _tempered(log: Array, log_q: Array) -> tuple[float, Array]:
    """The largest power of the target, up to 1, that leaves 150 effective draws; the weights."""
    beta = 1.0
    while True:
        raw = np.where(np.isfinite(log), beta * log - log_q, -np.inf)
        w = np.exp(raw - raw.max())
        w /= w.sum()
        if 1.0 / np.sum(w**2) > 150.0 or beta < 1e-9:
            return beta, w
        beta *= 0.7


FLAT = 0.2  # of the draws have any bound range rate


class _Learnt:
    """A proposal: normal kernels about 500 draws, each tilted as its neighbours lie; or any bound rate at a range."""

    def __init__(self, problem: Problem, x: Array, w: Array) -> None:
        self.problem = problem
        rng = np.random.default_rng(1)
        # half of the parents by the square root of the weight: the tails are what importance sampling lives on
        soft = np.sqrt(w) / np.sqrt(w).sum()
        far = w**0.2 / np.sum(w**0.2)
        chosen = np.concatenate([rng.choice(len(x), n, p=p) for n, p in ((200, w), (200, soft), (500, far))])
        self.parents = x[chosen]
        order = np.argsort(x[:, 0])
        nodes, weight = x[order], far[order] + 1e-12
        self.h, self.slope, self.s = np.empty((3, len(chosen)))
        for k, parent in enumerate(self.parents):
            gap = np.abs(nodes[:, 0] - parent[0])
            near = np.argsort(gap)[:300]
            near = near[weight[near] > 1e-9]
            h = max(2.0 * float(np.sqrt(np.average(gap[near] ** 2, weights=weight[near]))), 1e-7)
            V = np.stack([np.ones(len(near)), nodes[near, 0] - parent[0]], axis=1) * np.sqrt(weight[near])[:, None]
            line = np.linalg.lstsq(V, nodes[near, 1] * np.sqrt(weight[near]), rcond=1e-9)[0]
            rest = nodes[near, 1] - line[0] - line[1] * (nodes[near, 0] - parent[0])
            self.h[k], self.slope[k] = h, line[1]
            self.s[k] = max(1.2 * float(np.sqrt(np.average(rest**2, weights=weight[near]))), 1e-7)
        self.factor = np.empty((0, 4, 4))

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Coordinates (m, 6) with the best attributables, log density of range and rate."""
        k = rng.integers(len(self.parents), size=count)
        step = self.h[k] * rng.standard_normal(count)
        ln_range = self.parents[k, 0] + step
        bent = self.parents[k, 1] + self.slope[k] * step + self.s[k] * rng.standard_normal(count)
        near = self.parents[k, 2:]
        xy = np.stack([np.clip(ln_range, self.problem.low, self.problem.high), np.zeros(count)], axis=1)
        low, high = self.problem.bounds(np.hstack([xy, near]))
        xy[:, 1] = np.where(rng.random(count) < FLAT, low + (high - low) * rng.random(count), bent)
        xy[:, 0] = ln_range
        inside = (xy[:, 1] > low) & (xy[:, 1] < high)
        flat = np.where(inside, 1.0 / np.maximum(high - low, 1e-9), 0.0)
        density = np.empty(count)
        for part in np.array_split(np.arange(count), max(count // 1000, 1)):
            gap = xy[part, 0, None] - self.parents[:, 0]
            along = np.exp(-0.5 * (gap / self.h) ** 2) / self.h
            away = (xy[part, 1, None] - self.parents[:, 1] - self.slope * gap) / self.s
            both = along * np.exp(-0.5 * away**2) / self.s / (2.0 * np.pi)
            density[part] = (1.0 - FLAT) * both.mean(axis=1) + FLAT * flat[part] * along.mean(axis=1) / np.sqrt(
                2.0 * np.pi
            )
        a, self.factor = self.problem.attributable(xy, near)
        return np.hstack([xy, a]), np.log(np.maximum(density, 1e-300))


INFLATED = 1.15  # sigmas of the attributable, beyond those that the grid found
SOFT = 0.2  # of the draws go to cells by the root of their weight


def sample_about(problem: Problem, grid: Any, count: int, rng: np.random.Generator) -> Sampled:
    """Draw about the nodes of a grid: cells by its weights, uniform in each, attributables of wider normal laws.

    The grid is the proposal and no more: what a draw weighs is `log_target` over the density it was drawn with.
    """
    from nebosvod.first_hour.grid import interval_of

    w = grid.weight()
    p = (1.0 - SOFT) * w + SOFT * np.sqrt(w) / np.sqrt(w).sum()
    cell = rng.choice(len(p), count, p=p / p.sum())
    line = grid.line[cell]
    x = grid.low[line] + grid.width[line] * rng.random(count)
    begin, end = interval_of(grid.region, grid.conditional, grid.lines, x - grid.lines.coordinates[line, 0], line)
    low, high = grid.share[cell].T
    y = begin + (end - begin) * (low + (high - low) * rng.random(count))
    log_q = np.log(p[cell] / p.sum() / (grid.width[line] * (high - low) * (end - begin)))
    kept = np.flatnonzero(np.isfinite(y) & np.isfinite(log_q))
    start = grid.nodes.coordinates[cell[kept]].copy()
    start[:, 2:] += (y[kept] - start[:, 1])[:, None] * grid.lines.drift[line[kept], -4:]
    start[:, 0], start[:, 1] = x[kept], y[kept]
    found, log_w = np.empty((len(kept), 6)), np.empty(len(kept))
    for part in np.array_split(np.arange(len(kept)), max(len(kept) // 4000, 1)):
        solved = grid.conditional.solve(start[part], 2)
        z = rng.standard_normal((len(part), solved.factor.shape[1]))
        moved = np.linalg.solve(solved.factor, z[:, :, None])[:, -4:, 0]
        # the attributable alone: its covariance is the last block of the inverse of the information
        inverse = np.linalg.solve(solved.factor, np.broadcast_to(np.eye(z.shape[1]), solved.factor.shape))[:, -4:]
        scale = np.linalg.norm(inverse, axis=2)
        P = np.einsum("mij,mkj->mik", inverse / scale[:, :, None], inverse / scale[:, :, None])
        away = (moved / scale)[:, :, None]
        chi2 = np.sum(away * np.linalg.solve(P, away), axis=(1, 2))
        log_a = -0.5 * chi2 - 0.5 * np.linalg.slogdet(P)[1] - np.log(scale).sum(axis=1)
        found[part] = solved.coordinates
        found[part, 2:] += INFLATED * moved
        log_w[part] = problem.log_target(found[part]) - log_q[kept[part]] - log_a
    w = np.exp(log_w - log_w.max())
    return Sampled(x=found, w=w / w.sum())


RADII_KM = (6378.137, 6356.752)  # of the Earth, at the equator and at the pole
SHARE, SPEED_KM_S, LONGEST_S = 0.1, 10.0, 43200.0  # a step is so much of the time to the nearest body, and no longer


def falls(problem: Problem, x: Array, epoch: Epoch, ephemeris: Ephemeris, days: float) -> npt.NDArray[np.bool_]:
    """Which orbits (m, 6) come down on the Earth within some days: Runge and Kutta, a step of its own for each."""
    state = states(problem.exposures, problem.reference, problem.frame, x)
    table = _Table.of(ephemeris, epoch, days)
    t, end = np.zeros(len(x)), 86400.0 * days
    hit, flying = np.zeros(len(x), dtype=np.bool_), np.arange(len(x))
    while flying.size:
        y, now = state[flying], t[flying]
        places = table.at(now)
        gap = np.linalg.norm(y[:, None, :3] - places, axis=2).min(axis=1)
        h = np.minimum(SHARE * gap / SPEED_KM_S, np.minimum(LONGEST_S, end - now))
        h = np.maximum(h, 5.0)
        k = np.zeros_like(y)
        total = np.zeros_like(y)
        for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            z = y + (share * h)[:, None] * k
            k = np.hstack([z[:, 3:], table.pull(z[:, :3], now + share * h)])
            total += weight / 6.0 * k
        y = y + h[:, None] * total
        state[flying], t[flying] = y, now + h
        away = y[:, :3] - table.at(t[flying])[:, 0]
        under = (away[:, 0] ** 2 + away[:, 1] ** 2) / RADII_KM[0] ** 2 + away[:, 2] ** 2 / RADII_KM[1] ** 2 < 1.0
        hit[flying[under]] = True
        flying = flying[~under & (t[flying] < end - 1e-3)]
    return hit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """Heliocentric places of Earth, Moon and Jupiter every half an hour, km, with their velocities between."""

    step_s: float
    nodes: Array
    gm: Array

    @classmethod
    def of(cls, ephemeris: Ephemeris, epoch: Epoch, days: float) -> "_Table":
        step_s = 1800.0
        t_s = np.arange(0.0, 86400.0 * days + 2.0 * step_s, step_s)
        sun = ephemeris.state_km_km_s("sun", epoch, t_s)
        nodes = np.stack([ephemeris.state_km_km_s(body, epoch, t_s) - sun for body in PULLING[1:]], axis=1)
        return cls(step_s=step_s, nodes=nodes, gm=np.array([ephemeris.gm_km3_s2[body] for body in PULLING]))

    def at(self, t_s: Array) -> Array:
        """Places (m, 3, 3) at times (m,), cubic between the nodes."""
        k = np.minimum((t_s / self.step_s).astype(int), len(self.nodes) - 2)
        s = (t_s / self.step_s - k)[:, None, None]
        a, b = self.nodes[k], self.nodes[k + 1]
        d, rest = self.step_s, 1.0 - s
        found: Array = (
            (1.0 + 2.0 * s) * rest**2 * a[..., :3] + s * rest**2 * d * a[..., 3:]
            + s**2 * (3.0 - 2.0 * s) * b[..., :3] - s**2 * rest * d * b[..., 3:]
        )  # fmt: skip
        return found

    def pull(self, r: Array, t_s: Array) -> Array:
        """Heliocentric acceleration (m, 3)."""
        places = self.at(t_s)
        away = r[:, None] - places
        pulls = away / np.linalg.norm(away, axis=2)[..., None] ** 3
        pulls += places / np.linalg.norm(places, axis=2)[..., None] ** 3
        sun = self.gm[0] * r / np.linalg.norm(r, axis=1)[:, None] ** 3
        return np.asarray(-sun - np.einsum("b,mbi->mi", self.gm[1:], pulls))
