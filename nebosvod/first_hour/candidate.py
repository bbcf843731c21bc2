"""One more observation of a tracklet that somebody may make: what would be wrong with it, and what it would show.

A station that has observed errs anew as it did: its bias, clock and place act on the new observation as on the last
one. Of errors that are drawn anew for each record the new one has none. A station that has not observed has a bias, and
on the ground a clock, of its own, as in what is recorded.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.first_hour.observed import BIAS_RAD
from nebosvod.first_hour.sight import lines
from nebosvod.first_hour.tangent import angles
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import GroundSite, Telescope
from nebosvod.observation.earth import obscodes
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
SIGMA_RAD = 0.5 * ARCSEC  # of a station that has not observed
CLOCK_S = 1.0  # likewise, on the ground; `fit.clock` is of stations with records
NOISE = ("sigma_rad", "correlation", "timing_sigma_s")
NEW = 3  # errors of a station that has not observed: two of bias, and its clock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """Who may make one more observation, and what would be wrong with it.

    Attributes
    ----------
    columns : (n + 1) measurements: the last row is how the nuisances act on the new one.
    like : the last measurement of the same station, whose noise the new one has; None where it has made none.
    """

    tracklet: Tracklet
    telescope: Telescope
    columns: Columns
    like: int | None

    @classmethod
    def of(cls, tracklet: Tracklet, telescope: Telescope) -> "Candidate":
        """A telescope that has observed, by its name or code, or another."""
        exposures = tracklet.exposures
        own = [k for k, one in enumerate(exposures.telescopes) if telescope.name in (one.name, _described(one.name))]
        rows = np.flatnonzero(np.isin(exposures.telescope_index, own))
        if rows.size:
            like = int(rows[np.argmax(exposures.t_s[rows])])
            columns = _as_before(tracklet.columns, rows, like)
            return cls(tracklet=tracklet, telescope=telescope, columns=columns, like=like)
        columns = _of_its_own(tracklet.columns, telescope)
        return cls(tracklet=tracklet, telescope=telescope, columns=columns, like=None)

    @property
    def sigma_rad(self) -> float:
        """Noise of the observation, root mean square of both axes."""
        if self.like is None:
            return SIGMA_RAD
        return float(np.sqrt(np.mean(self.tracklet.exposures.sigma_rad[self.like] ** 2)))

    def errors(self, nuisance: Array, normal: Array) -> Array:
        """Nuisances (m, k) of truths: those drawn of the posterior, and new ones by normal numbers (m, NEW)."""
        more = len(self.columns.mean) - nuisance.shape[1]
        sigma = 1.0 / np.diag(self.columns.information[-more:, -more:]) if more else np.empty(0)
        return np.hstack([nuisance, sigma * normal[:, :more]])

    def observed(self, t_s: Array, flown: Array, u: Array, normal: Array) -> tuple[Exposures, Array]:
        """Exposures at times (n,), and RA and Dec (m, n, 2) in them of flown orbits (m, n, 6); nan after a fall."""
        tracklet, new = self.tracklet, self.columns.select(np.array([-1]))
        ephemeris, old = tracklet.forces.ephemeris, tracklet.exposures
        noise = {} if self.like is None else {name: getattr(old, name)[self.like] for name in NOISE}
        observer = self.telescope.spacecraft.state_km_km_s(ephemeris, tracklet.epoch, t_s)
        seen = Exposures.at(
            tracklet.epoch, t_s, observer, ephemeris, telescopes=(self.telescope,), **{"sigma_rad": SIGMA_RAD, **noise}
        )
        m, n = flown.shape[:2]
        late, place = np.tile(u @ new.clock[0], (n, 1)).T, u @ new.place[0].T
        line, motion = lines(seen, flown, late, np.repeat(place[:, None], n, axis=1))
        psi = angles((line / np.linalg.norm(line, axis=2)[..., None]).reshape(-1, 3)).reshape(m, n, 2)
        S = np.linalg.cholesky(_noise(seen, line, motion))
        away = (u @ new.bias[0].T)[:, None] + np.einsum("mnij,mj->mni", S, normal)
        psi = psi + away / np.stack([np.maximum(np.cos(psi[..., 1]), 1e-6), np.ones((m, n))], axis=2)
        psi[..., 0] %= 2.0 * np.pi
        return seen, psi

    def longer(self, seen: Exposures, psi: Array) -> Tracklet:
        """The tracklet with one more measurement, RA and Dec (2,)."""
        tracklet, old = self.tracklet, self.tracklet.exposures
        rows: dict[str, Any] = {
            name: np.concatenate([getattr(old, name), getattr(seen, name)])
            for name in ("t_s", "observer", "sun", "sun_pull", *NOISE)
        }
        known = self.like is not None
        index = old.telescope_index[self.like] if known else len(old.telescopes)
        exposures = replace(
            old, telescopes=old.telescopes if known else (*old.telescopes, *seen.telescopes),
            telescope_index=np.append(old.telescope_index, index), **rows,
        )  # fmt: skip
        return Tracklet.of(
            tracklet.name, exposures, np.vstack([tracklet.observed, psi]), tracklet.forces, self.columns,
            tracklet.magnitude,
        )  # fmt: skip


def _described(name: str) -> str:
    """How a candidate of this code is called."""
    return obscodes.described(name) if obscodes.known(name) else name


def _noise(seen: Exposures, line: Array, motion: Array) -> Array:
    """Covariance (m, n, 2, 2) of the noise in RA cos Dec and Dec of directions along lines that move (m, n, 3)."""
    far = np.linalg.norm(line, axis=2)[..., None]
    u = line / far
    east = np.stack([-u[..., 1], u[..., 0], np.zeros_like(u[..., 0])], axis=-1)
    east = east / np.maximum(np.linalg.norm(east, axis=-1), 1e-12)[..., None]
    rate = np.stack([np.sum(east * motion, axis=-1), np.sum(np.cross(u, east) * motion, axis=-1)], axis=-1) / far
    timing = seen.timing_sigma_s[:, None, None] ** 2 * rate[..., :, None] * rate[..., None, :]
    return np.asarray(seen.noise() + timing)


def _as_before(columns: Columns, own: Rows, like: int) -> Columns:
    """With one more row: what acts on all records of its station acts on it as on the last one."""
    every = [np.any(part[own] != 0.0, axis=tuple(range(1, part.ndim - 1))) for part in (columns.bias, columns.place)]
    acting = every[0] | every[1] | (columns.clock[own] != 0.0)
    shared = acting.all(axis=0)
    return replace(
        columns,
        bias=np.concatenate([columns.bias, columns.bias[[like]] * shared]),
        clock=np.concatenate([columns.clock, columns.clock[[like]] * shared]),
        place=np.concatenate([columns.place, columns.place[[like]] * shared]),
    )


def _of_its_own(columns: Columns, telescope: Telescope) -> Columns:
    """With one more row, and nuisances that act on it alone."""
    new = NEW if isinstance(telescope.spacecraft, GroundSite) else NEW - 1
    bias, clock = np.zeros((1, 2, new)), np.zeros((1, new))
    bias[0, 0, 0] = bias[0, 1, 1] = 1.0
    clock[0, 2:] = 1.0
    names = tuple(f"{what} {telescope.name}" for what in ("bias RA*", "bias Dec", "timing")[:new])
    sigma = np.array([BIAS_RAD, BIAS_RAD, CLOCK_S])[:new]
    return Columns(
        names=(*columns.names, *names),
        bias=_beside(columns.bias, bias),
        clock=_beside(columns.clock, clock),
        place=_beside(columns.place, np.zeros((1, 3, new))),
        mean=np.append(columns.mean, np.zeros(new)),
        information=_beside(columns.information, np.diag(1.0 / sigma)),
    )


def _beside(old: Array, new: Array) -> Array:
    """Joined at the first and the last axis, 0 elsewhere."""
    r, k = old.shape[0], old.shape[-1]
    found = np.zeros((r + new.shape[0], *old.shape[1:-1], k + new.shape[-1]))
    found[:r, ..., :k], found[r:, ..., k:] = old, new
    return found
