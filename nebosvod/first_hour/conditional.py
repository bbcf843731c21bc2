"""What is linear once range and range rate are known: the attributable and every nuisance, by iterated least squares.

The four numbers of an attributable are offsets from the direction observed at the reference time, east and north, and
their rates, all of the observer at that time. Range is that of the same moment, without light time.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.first_hour.sight import Seen, Sight
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.measurement.exposures import whiteners
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
LOG_RANGE, RATE, ATTRIBUTABLE = 0, 1, slice(2, 6)  # of the six numbers of an orbit
STEPS = 12  # of Gauss and Newton
SETTLED = 0.02  # sigmas of the last step
WORSE = 1e-3  # of chi squared, by which a step may go up: differences stand for partials
ANGLE_STEP = 1e-5  # rad, by which partials are differences
RANGE_STEP = 1e-3  # of ln(range)
FARTHEST_STEP = 0.5  # of ln(range)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nodes:
    """m orbits, each the best at what was held.

    Attributes
    ----------
    coordinates : (m, 6) ln(range / au), range rate, km/s, and the attributable: offsets, rad, and rates, rad/s.
    nuisance : (m, k).
    chi2 : (m,) at the minimum, priors of nuisances counted; infinite where the orbit runs into a body.
    factor : (m, p, p) upper triangular R of the free parameters, R^T R = information: the held ones are not in it.
    held : how many of the six are held: 2 (range and rate), 1 (range), 0.
    log_spread : (m,) log of [det P_a / det R_zu]^(1/2), P_a the covariance of the attributable and R_zu that of the
        measurements with all nuisances marginalised.
    log_fisher : (m,) half the log determinant of the information of all six, nuisances marginalised.
    above_km : (m,) the least distance from the Earth's centre at a measurement.
    rate_centre, rate_sigma, rate_slope : (m,) what the measurements alone say of the range rate at this range, km/s,
        and how its centre moves with ln(range). range_sigma : (m,) of ln(range), likewise.
    drift : (m, k + 4) how the best nuisances and attributable move with the range rate.
    """

    coordinates: Array
    nuisance: Array
    chi2: Array
    factor: Array
    held: int
    log_spread: Array
    log_fisher: Array
    above_km: Array
    rate_centre: Array
    rate_sigma: Array
    rate_slope: Array
    range_sigma: Array
    drift: Array

    def __len__(self) -> int:
        """Number of orbits."""
        return len(self.chi2)


class Conditional:
    """Least squares of a tracklet with range, or range and its rate, held."""

    def __init__(self, tracklet: Tracklet) -> None:
        self.tracklet = tracklet
        self.sight = Sight(tracklet)
        self.span_s = max(tracklet.arc_s, 60.0)
        self.east, self.north, self.u = tracklet.axes[tracklet.reference]

    def states(self, coordinates: Array) -> Array:
        """Heliocentric ICRF states (m, 6) at the reference time of coordinates (m, 6)."""
        rho = np.exp(coordinates[:, 0])[:, None] * AU_KM
        offset = coordinates[:, 2, None] * self.east + coordinates[:, 3, None] * self.north
        line = self.u + offset
        line = line / np.linalg.norm(line, axis=1)[:, None]
        sweep = coordinates[:, 4, None] * self.east + coordinates[:, 5, None] * self.north
        sweep = sweep - np.sum(sweep * line, axis=1)[:, None] * line
        place = self.tracklet.place
        v = place[3:] + coordinates[:, 1, None] * line + rho * sweep
        return np.hstack([place[:3] + rho * line, v])

    def coordinates(self, states: Array) -> Array:
        """The inverse of `states`."""
        away = states - self.tracklet.place
        rho = np.linalg.norm(away[:, :3], axis=1)
        line = away[:, :3] / rho[:, None]
        depth = line @ self.u
        found = np.empty((len(states), 6))
        found[:, 0], found[:, 1] = np.log(rho / AU_KM), np.sum(away[:, 3:] * line, axis=1)
        found[:, 2], found[:, 3] = line @ self.east / depth, line @ self.north / depth
        sweep = (away[:, 3:] - found[:, 1, None] * line) / rho[:, None]
        # sweep = s - (s.line) line with s in the plane of east and north: s.u = 0 gives s.line
        along = -(sweep @ self.u) / depth
        s = sweep + along[:, None] * line
        found[:, 4], found[:, 5] = s @ self.east, s @ self.north
        return found

    def first(self, ranges: Array, rates: Array) -> Array:
        """Coordinates (m, 6) near the best: a curved line through the places on the lines of sight."""
        tracklet, t = self.tracklet, self.tracklet.exposures.t_s / self.span_s
        rho = np.exp(ranges)[:, None] * AU_KM + rates[:, None] * self.tracklet.exposures.t_s
        rho = np.maximum(rho, 0.05 * np.exp(ranges)[:, None] * AU_KM)
        places = tracklet.exposures.observer[:, :3] - tracklet.exposures.sun[:, :3]
        r = places + rho[..., None] * tracklet.axes[:, 2]
        fall = self._fall(np.exp(ranges) * AU_KM)
        r = r - 0.5 * fall[:, None] * tracklet.exposures.t_s[:, None] ** 2
        U = np.stack([np.ones_like(t), t], axis=1)
        weight = np.linalg.pinv(U)
        line = np.einsum("pn,mni->mpi", weight, r)
        found = self.coordinates(np.hstack([line[:, 0], line[:, 1] / self.span_s]))
        found[:, 0], found[:, 1] = ranges, rates
        found[:, 2:4] = 0.0
        return found

    def _fall(self, rho_km: Array) -> Array:
        """The pull (m, 3) of the Sun and the Earth at the reference time, km/s^2, on the observed line of sight."""
        tracklet, row = self.tracklet, self.tracklet.reference
        r = tracklet.place[:3] + rho_km[:, None] * self.u
        from_earth = r - self.sight.earth[row]
        gm = tracklet.forces.ephemeris.gm_km3_s2["earth"]
        near = np.maximum(np.linalg.norm(from_earth, axis=1), 2e4)[:, None]
        sun = -self.sight.gm * r / np.linalg.norm(r, axis=1)[:, None] ** 3
        return np.asarray(sun - gm * from_earth / near**3)

    def solve(self, start: Array, held: int, known: tuple[Array, Array] | None = None) -> Nodes:
        """Find the best orbits.

        Parameters
        ----------
        start : (m, 6) coordinates; the first `held` stay.
        held : 2, 1 or 0.
        known : for `held` below 2, centre and sigma (m,) of what is said beforehand of the range rate, lest a rate
            nobody can tell goes anywhere.
        """
        x = start.copy()
        u = np.tile(self.tracklet.columns.mean, (len(x), 1))
        came = _Came.nowhere(x, u)
        active = np.arange(len(x))
        parts: list[tuple[Rows, dict[str, Array]]] = []
        for step in range(STEPS):
            prior = None if known is None else (known[0][active], known[1][active])
            found = self._linear(x[active], u[active], held, prior)
            worse = came.worse(active, found["whole"])
            settled = ((found["step"] < SETTLED) | ~np.isfinite(found["chi2"])) & ~worse
            if step == STEPS - 1:
                _stay(found, ~settled)
                settled[:] = True
            if settled.any():
                parts.append((active[settled], {name: values[settled] for name, values in found.items()}))
            came.halve(active[worse & ~settled], x, u)
            onward = ~settled & ~worse
            came.go(active[onward], x, u, held, {name: values[onward] for name, values in found.items()})
            active = active[~settled]
            if not active.size:
                break
        order = np.concatenate([rows for rows, _ in parts])
        place = np.argsort(order)
        joined = {name: np.concatenate([part[name] for _, part in parts])[place] for name in parts[0][1]}
        centre = x[:, RATE] + joined["to_centre"]
        x[:, held:] += joined["dx"]
        return Nodes(
            coordinates=x, nuisance=u + joined["du"], chi2=joined["chi2"], factor=joined["factor"], held=held,
            log_spread=joined["log_spread"], log_fisher=joined["log_fisher"], above_km=joined["above"],
            rate_centre=centre, rate_sigma=joined["rate_sigma"], rate_slope=joined["rate_slope"],
            range_sigma=joined["range_sigma"], drift=joined["drift"],
        )  # fmt: skip

    def misses(self, x: Array) -> Array:
        """Sums of squares (m,) of what orbits at coordinates (m, 6) miss the records by, rad^2; inf after a fall."""
        seen = self.sight.see(self.sight.fly(self.states(x)))
        found: Array = np.nan_to_num(np.sum(seen.residual**2, axis=(1, 2)), nan=np.inf)
        return found

    def whitened(self, x: Array, u: Array) -> Array:
        """Residuals (m, n, 2) at coordinates (m, 6) and nuisances (m, k), in sigmas of the noise."""
        base, _, _ = self._partials(x, u)
        W = whiteners(self._noise(base.rate).reshape(-1, 2, 2)).reshape(*base.rate.shape, 2)
        return np.asarray(np.einsum("mnij,mnj->mni", W, base.residual))

    def _noise(self, rate: Array) -> Array:
        """Covariance (m, n, 2, 2) of each measurement by itself, at apparent rates (m, n, 2)."""
        exposures = self.tracklet.exposures
        timing = exposures.timing_sigma_s[:, None, None] ** 2 * rate[..., :, None] * rate[..., None, :]
        return np.asarray(exposures.noise()[None] + timing)

    def _linear(self, x: Array, u: Array, held: int, prior: tuple[Array, Array] | None) -> dict[str, Array]:
        """One step of Gauss and Newton at x (m, 6) and u (m, k), and everything that is read off its factor."""
        columns, m, n = self.tracklet.columns, len(x), len(self.tracklet)
        base, J, H = self._partials(x, u)
        R = self._noise(base.rate)
        finite = np.asarray(np.isfinite(base.residual).all(axis=(1, 2)) & np.isfinite(J).all(axis=(1, 2, 3)))
        W = whiteners(np.where(finite[:, None, None, None], R, np.eye(2)).reshape(-1, 2, 2)).reshape(m, n, 2, 2)
        log_noise = -np.log(np.einsum("mnii->mni", W)).sum(axis=(1, 2))  # half the log determinant of R
        white = np.where(finite[:, None, None], np.einsum("mnij,mnj->mni", W, base.residual), 0.0).reshape(m, -1)
        rows = np.concatenate([np.where(finite[:, None, None, None], part, 0.0) for part in (H, J)], axis=3)
        A = (W @ rows).reshape(m, 2 * n, -1)
        k, r = len(columns.mean), len(columns.information)
        known = np.zeros((m, r, A.shape[2]))
        known[:, :, :k] = columns.information
        v_known = np.einsum("rk,mk->mr", columns.information, columns.mean - u)
        A, white = np.concatenate([A, known], axis=1), np.concatenate([white, v_known], axis=1)
        # the six columns stand last and in the order a, rate, range, so that leading triangles hold what is free
        order = np.concatenate([np.arange(k), k + np.array([2, 3, 4, 5, 1, 0])])
        A = A[:, :, order]
        scale = np.linalg.norm(A, axis=1)
        scale = np.where(scale > 0.0, scale, 1.0)
        full = _triangle(np.concatenate([A / scale[:, None], white[:, :, None]], axis=2))
        free = k + 6 - held
        T, z = full[:, :free, :free], full[:, :free, -1]
        rest = np.sum(full[:, free:, -1] ** 2, axis=1)
        of_rate = _rates(full, scale, k + 4)
        known_rate = (T, z) if prior is None else _with_prior(T, z, k + 4, scale[:, k + 4], x[:, RATE], prior)
        d = _solved(*known_rate)
        log_T = np.log(np.maximum(np.abs(np.einsum("mii->mi", full[:, : k + 6, : k + 6])), 1e-300)) + np.log(scale)
        log_a = log_T[:, : k + 4].sum(axis=1)
        dx = d[:, k:] / scale[:, k:free]
        dx = np.concatenate([dx[:, 4:][:, ::-1], dx[:, :4]], axis=1)
        if held == 0:
            dx *= np.minimum(1.0, FARTHEST_STEP / np.maximum(np.abs(dx[:, :1]), 1e-12))
        return {
            "dx": dx,
            "du": d[:, :k] / scale[:, :k],
            "chi2": np.where(finite, rest + self.tracklet.left, np.inf),
            "whole": np.where(finite, _whole(white, x[:, RATE], prior) + self.tracklet.left, np.inf),
            "step": np.linalg.norm(np.einsum("mij,mj->mi", T, d), axis=1) / np.sqrt(free),
            "factor": T * scale[:, None, :free],
            "log_spread": -log_a - log_noise + 0.5 * columns.log_det,
            # det of the Schur complement of the nuisances, whose own triangle is the leading one
            "log_fisher": log_T[:, k:].sum(axis=1),
            "above": np.where(finite, base.from_earth_km.min(axis=1), 0.0),
            **of_rate,
        }

    def _flown(self, states: Array) -> Array:
        """States (7 m, n, 6) at the measurements of orbits and their neighbours (m, 7, 6): these only of who flies."""
        found = np.full((len(states), 7, len(self.tracklet), 6), np.nan)
        found[:, 0] = self.sight.fly(states[:, 0])
        up = np.isfinite(found[:, 0]).all(axis=(1, 2))
        if up.any():
            found[up, 1:] = self.sight.fly(states[up, 1:].reshape(-1, 6)).reshape(-1, 6, len(self.tracklet), 6)
        return found.reshape(-1, len(self.tracklet), 6)

    def _partials(self, x: Array, u: Array) -> tuple[Seen, Array, Array]:
        """What is seen, and how it moves with the six coordinates (m, n, 2, 6) and the nuisances (m, n, 2, k)."""
        columns, m, k = self.tracklet.columns, len(x), u.shape[1]
        rho = np.exp(x[:, 0]) * AU_KM
        steps = np.empty((m, 6))
        steps[:, 0], steps[:, 1] = RANGE_STEP, np.maximum(1e-4 * rho / self.span_s, 1e-4)
        steps[:, 2:4], steps[:, 4:] = ANGLE_STEP, ANGLE_STEP / self.span_s
        moved = np.repeat(x[:, None], 7, axis=1)
        for j in range(6):
            moved[:, j + 1, j] += steps[:, j]
        flown = self._flown(self.states(moved.reshape(-1, 6)).reshape(m, 7, 6))
        late = displaced = None
        if k and columns.clock.any():
            late = np.repeat(np.einsum("nk,mk->mn", columns.clock, u), 7, axis=0)
        if k and columns.place.any():
            displaced = np.repeat(np.einsum("nik,mk->mni", columns.place, u), 7, axis=0)
        seen = self.sight.see(flown, late, displaced, every=7)
        residual = seen.residual.reshape(m, 7, -1, 2)
        J = ((residual[:, :1] - residual[:, 1:]) / steps[:, :, None, None]).transpose(0, 2, 3, 1)
        base = replace(seen, residual=residual[:, 0] - np.einsum("nik,mk->mni", columns.bias, u))
        H = (
            columns.bias[None]
            + base.rate[..., None] * columns.clock[None, :, None, :]
            + base.across @ columns.place[None]
        )
        return base, J, H


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Came:
    """From where m orbits made their last step, what it was, and what they had before: a step that is worse is halved.

    Near the Earth a rate that the measurements hardly tell goes far astray by a whole step of Gauss and Newton.
    """

    dx: Array
    du: Array
    whole: Array

    @classmethod
    def nowhere(cls, x: Array, u: Array) -> "_Came":
        """Before the first step."""
        return cls(dx=np.zeros_like(x), du=np.zeros_like(u), whole=np.full(len(x), np.inf))

    def worse(self, active: Rows, whole: Array) -> npt.NDArray[np.bool_]:
        """Which of the active orbits stand worse than before their last step."""
        before = self.whole[active]
        found: npt.NDArray[np.bool_] = ~(whole <= before * (1.0 + WORSE) + WORSE) & np.isfinite(before)
        return found

    def halve(self, rows: Rows, x: Array, u: Array) -> None:
        """Take half of the last step back."""
        self.dx[rows] *= 0.5
        self.du[rows] *= 0.5
        x[rows] -= self.dx[rows]
        u[rows] -= self.du[rows]

    def go(self, rows: Rows, x: Array, u: Array, held: int, found: dict[str, Array]) -> None:
        """Make a step."""
        self.dx[rows, held:], self.du[rows], self.whole[rows] = found["dx"], found["du"], found["whole"]
        x[rows] += self.dx[rows]
        u[rows] += self.du[rows]


def _stay(found: dict[str, Array], rows: npt.NDArray[np.bool_]) -> None:
    """Orbits that have not settled stay where they are: what the next step promises is no chi squared of an orbit."""
    found["chi2"] = np.where(rows, found["whole"], found["chi2"])
    found["dx"] = np.where(rows[:, None], 0.0, found["dx"])
    found["du"] = np.where(rows[:, None], 0.0, found["du"])


def _whole(white: Array, rate: Array, prior: tuple[Array, Array] | None) -> Array:
    """Chi squared (m,) where the orbits stand, with what is said beforehand of nuisances and range rate."""
    said = 0.0 if prior is None else ((prior[0] - rate) / prior[1]) ** 2
    return np.asarray(np.sum(white**2, axis=1) + said)


def _triangle(rows: Array) -> Array:
    """The square triangle (m, p, p) of systems (m, r, p); with fewer rows than columns it is filled up with zeros."""
    found = np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
    return np.pad(found, ((0, 0), (0, rows.shape[2] - found.shape[1]), (0, 0)))


def _solved(T: Array, z: Array) -> Array:
    """T d = z for upper triangles (m, p, p); a column nothing is known of stays."""
    p, d = T.shape[1], np.zeros_like(z)
    for i in range(p - 1, -1, -1):
        pivot = T[:, i, i]
        left = z[:, i] - np.sum(T[:, i, i + 1 :] * d[:, i + 1 :], axis=1)
        known = np.abs(pivot) > 1e-12
        d[:, i] = np.where(known, left / np.where(known, pivot, 1.0), 0.0)
    return d


def _rates(full: Array, scale: Array, column: int) -> dict[str, Array]:
    """What a triangle (m, p + 1, p + 1) says of the range rate, its column, and of all that stands before it."""
    pivot = full[:, column, column]
    pivot = np.where(np.abs(pivot) > 1e-12, pivot, 1e-12)
    drift = -_solved(full[:, :column, :column], full[:, :column, column] * 1.0)
    return {
        "to_centre": full[:, column, -1] / pivot / scale[:, column],
        "rate_sigma": 1.0 / (np.abs(pivot) * scale[:, column]),
        "rate_slope": -full[:, column, column + 1] / pivot * scale[:, column + 1] / scale[:, column],
        "range_sigma": 1.0 / np.maximum(np.abs(full[:, column + 1, column + 1]) * scale[:, column + 1], 1e-6),
        "drift": drift * scale[:, column, None] / scale[:, :column],
    }


def _with_prior(
    T: Array, z: Array, column: int, scale: Array, rate: Array, prior: tuple[Array, Array]
) -> tuple[Array, Array]:
    """The triangle with one more row: what is said beforehand of the range rate."""
    centre, sigma = prior
    m, p = z.shape
    row, right = np.zeros((m, 1, p)), ((centre - rate) / sigma)[:, None, None]
    row[:, 0, column] = 1.0 / (sigma * scale)
    joint = np.concatenate([np.concatenate([T, z[:, :, None]], axis=2), np.concatenate([row, right], axis=2)], axis=1)
    full = _triangle(joint)
    return full[:, :p, :p], full[:, :p, -1]
