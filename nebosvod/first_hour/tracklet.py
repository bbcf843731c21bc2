"""A tracklet: a few directions, and what is uncertain about those who measured them, ready for any orbit.

Every unknown but range and range rate has a column here: biases act the same whatever the orbit, a clock moves the
object and its observer, an error of place moves the observer alone, so that it counts as 1/range.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.observation import Nuisance, Observation, TimingOffset
from nebosvod.observation.contracts import Rows
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.observation.uncertainty.term import Common, Markov, Term, White, root
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
KNOWN = ("fixed", "ignored")  # treatments of what no estimate counts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """How k nuisances act on n measurements.

    Attributes
    ----------
    names : (k,).
    bias : (n, 2, k) partials that are the same for every orbit.
    clock : (n, k) seconds by which a measurement is later, of one unit of each.
    place : (n, 3, k) km, ICRF, by which the observer is displaced, of one unit of each.
    mean : (k,).
    information : (r, k) rows with information^T information = inverse prior covariance; fewer than k where nothing is
        known of some.
    """

    names: tuple[str, ...]
    bias: Array
    clock: Array
    place: Array
    mean: Array
    information: Array

    @property
    def log_det(self) -> float:
        """Log of the determinant of the prior information; what has no prior is left out."""
        values = np.linalg.svd(self.information, compute_uv=False) if self.information.size else np.empty(0)
        return float(2.0 * np.log(values[values > 0.0]).sum())

    @classmethod
    def none(cls, n: int) -> "Columns":
        """No nuisance at all."""
        return cls(
            names=(), bias=np.empty((n, 2, 0)), clock=np.empty((n, 0)), place=np.empty((n, 3, 0)),
            mean=np.empty(0), information=np.empty((0, 0)),
        )  # fmt: skip

    @classmethod
    def of(cls, nuisances: Sequence[Nuisance], seen: Observation, ephemeris: Ephemeris) -> "Columns":
        """The columns of some sources of uncertainty.

        Parameters
        ----------
        seen : the measurements of any orbit in the same exposures: for biases and axes of places, which do not depend
            on it.
        """
        counted = [source for source in nuisances if source.treatment not in KNOWN]
        parts = [_columns(source, source.term(seen, ephemeris), seen) for source in counted]
        if not parts:
            return cls.none(seen.t_s.size)
        information = np.zeros((sum(len(p.information) for p in parts), sum(len(p.mean) for p in parts)))
        row = column = 0
        for part in parts:
            r, k = part.information.shape
            information[row : row + r, column : column + k] = part.information
            row, column = row + r, column + k
        return cls(
            names=tuple(name for part in parts for name in part.names),
            bias=np.concatenate([part.bias for part in parts], axis=2),
            clock=np.concatenate([part.clock for part in parts], axis=1),
            place=np.concatenate([part.place for part in parts], axis=2),
            mean=np.concatenate([part.mean for part in parts]),
            information=information,
        )

    def select(self, rows: Rows) -> "Columns":
        """The same for some of the measurements."""
        return replace(self, bias=self.bias[rows], clock=self.clock[rows], place=self.place[rows])


def _columns(source: Nuisance, term: Term, seen: Observation) -> Columns:
    """The columns of one source."""
    n = seen.t_s.size
    if isinstance(term, Common):
        H, displacement, covariance, mean, names = term.H, term.displacement, term.covariance, term.mean, term.names
    else:
        H, displacement, covariance, names = _spread(term, n)
        mean = np.zeros(len(covariance))
    k = len(mean)
    if isinstance(source, TimingOffset):
        on_rows = np.zeros((n, 1))
        on_rows[seen.rows(source.telescopes)] = 1.0
        bias, clock, place = np.zeros((n, 2, k)), on_rows, np.zeros((n, 3, k))
    elif displacement is not None:
        bias, clock, place = np.zeros((n, 2, k)), np.zeros((n, k)), displacement
    else:
        bias, clock, place = H, np.zeros((n, k)), np.zeros((n, 3, k))
    return Columns(names=names, bias=bias, clock=clock, place=place, mean=mean, information=_information(covariance))


def _information(covariance: Array) -> Array:
    """Rows (r, k) whose square is the inverse of a covariance (k, k); a variance of 0 is one of a trillionth."""
    sigma = np.sqrt(np.diag(covariance))
    known = (sigma > 0.0) & np.isfinite(sigma)
    if not known.any():
        return np.empty((0, len(sigma)))
    S = root(covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known]))
    U, value, _ = np.linalg.svd(S)
    rows = np.zeros((int(known.sum()), len(sigma)))
    rows[:, known] = (U / np.maximum(value, 1e-6)).T / sigma[known]
    return rows


def _spread(term: White | Markov, n: int) -> tuple[Array, Array | None, Array, tuple[str, ...]]:
    """A draw of each measurement as parameters: partials, displacement, covariance and names, q for each of its r rows.

    Of a chain, cov(z_i, z_j) = F_i ... F_(j+1) P_j for i > j.
    """
    r, _, q = term.H.shape
    H, covariance = np.zeros((n, 2, r * q)), np.zeros((r, q, r, q))
    displacement = None if term.displacement is None else np.zeros((n, 3, r * q))
    for i, row in enumerate(term.rows.tolist()):
        own = slice(i * q, (i + 1) * q)
        H[row, :, own] = term.H[i]
        if displacement is not None and term.displacement is not None:
            displacement[row, :, own] = term.displacement[i]
    for j, P in enumerate(term.marginals):
        carried = P
        covariance[j, :, j] = P
        if isinstance(term, Markov):
            for i in range(j + 1, r):
                carried = term.F[i] @ carried
                covariance[i, :, j], covariance[j, :, i] = carried, carried.T
    names = tuple(f"{name} {row}" for row in term.rows.tolist() for name in term.names)
    return H, displacement, covariance.reshape(r * q, r * q), names


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracklet:
    """Directions of one object over a short time.

    Attributes
    ----------
    name : of the object.
    exposures : when, from where and how well; they count from the reference time, which is that of row `reference`.
    observed : (n, 2) RA and Dec, rad.
    columns : what is uncertain beside the noise.
    forces : by which it moves; without asteroids.
    magnitude : V as it was seen at the reference time; None where no record says.
    left : chi squared that is there whatever the orbit, of records that few stand for.
    """

    name: str
    exposures: Exposures
    observed: Array
    columns: Columns
    forces: ForceModel
    magnitude: float | None
    reference: int
    left: float = 0.0

    @classmethod
    def of(
        cls, name: str, exposures: Exposures, observed: Array, forces: ForceModel, columns: Columns,
        magnitude: float | None = None,
    ) -> "Tracklet":  # fmt: skip
        """A tracklet about the measurement nearest to the middle of its time."""
        reference = middle_of(exposures.t_s)
        # within months asteroids move nothing that is seen or hit by as much as the attributable leaves open
        forces = replace(forces, asteroids=False, parameters=())
        return cls(
            name=name,
            exposures=exposures.counted_from(exposures.epoch + float(exposures.t_s[reference])),
            observed=observed,
            columns=columns,
            forces=forces,
            magnitude=magnitude,
            reference=reference,
        )

    @property
    def epoch(self) -> Epoch:
        """The reference time, at which range, range rate and states are meant."""
        return self.exposures.epoch

    @property
    def arc_s(self) -> float:
        """From the first to the last measurement."""
        return float(np.ptp(self.exposures.t_s))

    @property
    def axes(self) -> Array:
        """(n, 3, 3) east, north and line of sight of the observed directions, ICRF."""
        ra, dec = self.observed[:, 0], self.observed[:, 1]
        cr, sr, cd, sd = np.cos(ra), np.sin(ra), np.cos(dec), np.sin(dec)
        zero = np.zeros_like(ra)
        return np.stack(
            [np.stack([-sr, cr, zero], 1), np.stack([-sd * cr, -sd * sr, cd], 1), np.stack([cd * cr, cd * sr, sd], 1)],
            axis=1,
        )

    @property
    def place(self) -> Array:
        """Heliocentric ICRF state (6,) of the observer at the reference time, km and km/s."""
        exposures = self.exposures
        state: Array = exposures.observer[self.reference] - exposures.sun[self.reference]
        return state

    def __len__(self) -> int:
        """Number of measurements."""
        return len(self.exposures)

    def select(self, rows: Rows) -> "Tracklet":
        """Some of the measurements, with their own reference time."""
        return Tracklet.of(
            self.name, self.exposures.select(rows), self.observed[rows], self.forces, self.columns.select(rows),
            self.magnitude,
        )  # fmt: skip


def middle_of(t_s: Array) -> int:
    """The row nearest to the middle of the time."""
    return int(np.argmin(np.abs(t_s - 0.5 * (t_s.min() + t_s.max()))))
