"""Biases of the astrometry in RA cos Dec and Dec: constant, drifting, correlated, per arc, per zone of the sky."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.uncertainty.nuisance import diagonal, piecewise, sigmas
from nebosvod.observation.uncertainty.term import Common, Markov, check_treatment


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConstantBias:
    """A constant bias of the astrometry, RA cos Dec and Dec.

    Parameters
    ----------
    sigma_rad : standard deviations (2,) or one for both; mean_rad : assumed mean (2,).
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_rad: Array | float
    mean_rad: Array | float = 0.0
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_rad, 2)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H = I on the rows of the telescopes."""
        H = np.zeros((observation.t_s.size, 2, 2))
        H[observation.rows(self.telescopes)] = np.eye(2)
        return Common(
            name=self.name,
            names=(f"{self.name} RA*", f"{self.name} Dec"),
            H=H,
            displacement=None,
            covariance=np.diag(sigmas(self.name, self.sigma_rad, 2) ** 2),
            mean=np.array(np.broadcast_to(self.mean_rad, (2,)), dtype=np.float64),
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BiasDrift:
    """A bias that grows linearly with time: b + d (t - t0), both unknown.

    Parameters
    ----------
    sigma_rad : of the bias at `at_s`, (2,) or one for both axes; drift_sigma_rad_s : of its rate, likewise.
    at_s : TDB seconds after the epoch at which bias and drift are independent.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_rad: Array | float
    drift_sigma_rad_s: Array | float
    at_s: float = 0.0
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_rad, 2)
        sigmas(f"{self.name}: drift", self.drift_sigma_rad_s, 2)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H = [I, (t - t0) I] on the rows of the telescopes."""
        rows = observation.rows(self.telescopes)
        H = np.zeros((observation.t_s.size, 2, 4))
        H[rows, :, :2] = np.eye(2)
        H[rows, :, 2:] = (observation.t_s[rows] - self.at_s)[:, None, None] * np.eye(2)
        sigma = np.concatenate([sigmas(self.name, self.sigma_rad, 2), sigmas(self.name, self.drift_sigma_rad_s, 2)])
        return Common(
            name=self.name,
            names=tuple(f"{self.name} {part}" for part in ("RA*", "Dec", "RA* drift", "Dec drift")),
            H=H,
            displacement=None,
            covariance=np.diag(sigma**2),
            mean=np.zeros(4),
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GaussMarkovBias:
    """A bias correlated as sigma^2 exp(-|dt| / time), stationary.

    Parameters
    ----------
    sigma_rad : (2,) or one for both axes; time_s : correlation times, likewise.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_rad: Array | float
    time_s: Array | float
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_rad, 2)
        if not np.all(sigmas(f"{self.name}: correlation time", self.time_s, 2) > 0.0):
            raise InputError(f"{self.name}: correlation time must be positive (got {self.time_s} s)")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Markov:
        """H = I, F = exp(-dt / time), Q = sigma^2 (1 - F^2)."""
        rows = observation.rows(self.telescopes)
        variance = sigmas(self.name, self.sigma_rad, 2) ** 2
        steps = np.diff(observation.t_s[rows], prepend=observation.t_s[rows[:1]])
        age = steps[:, None] / sigmas(self.name, self.time_s, 2)
        return Markov(
            name=self.name,
            names=(f"{self.name} RA*", f"{self.name} Dec"),
            rows=rows,
            H=np.broadcast_to(np.eye(2), (rows.size, 2, 2)),
            displacement=None,
            F=diagonal(np.exp(-age)),
            Q=diagonal(variance * -np.expm1(-2.0 * age)),
            P0=np.diag(variance),
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArcBias:
    """A bias that is constant within an arc and drawn anew for the next one.

    Parameters
    ----------
    sigma_rad : (2,) or one for both axes.
    gap_s : a pause longer than this between two exposures begins a new arc.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_rad: Array | float
    gap_s: float
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_rad, 2)
        if not self.gap_s > 0.0:
            raise InputError(f"{self.name}: the gap between arcs must be positive (got {self.gap_s} s)")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Markov:
        """H = I; within an arc F = I, Q = 0, at its beginning F = 0, Q = sigma^2."""
        rows = observation.rows(self.telescopes)
        arc = np.concatenate([[0], np.cumsum(np.diff(observation.t_s[rows]) > self.gap_s)])
        same = piecewise(arc)[:, None, None]
        P0 = np.diag(sigmas(self.name, self.sigma_rad, 2) ** 2)
        return Markov(
            name=self.name,
            names=(f"{self.name} RA*", f"{self.name} Dec"),
            rows=rows,
            H=np.broadcast_to(np.eye(2), (rows.size, 2, 2)),
            displacement=None,
            F=same * np.eye(2),
            Q=(1.0 - same) * P0,
            P0=P0,
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZoneBias:
    """A bias of the star catalogue, constant within a zone of the sky and independent between zones.

    Parameters
    ----------
    sigma_rad : (2,) or one for both axes.
    zone_rad : side of a zone: declination bands of this height, cut into cells of about this width.
    sky : (r, 2) directions, rad, by which the r measurements of these telescopes are given to zones. Fixed, as the
        star catalogue of a measurement is: directions computed anew on an orbit that is being improved could cross a
        border, and the parameters would change. By default those of the observation.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_rad: Array | float
    zone_rad: float
    treatment: Treatment = "estimated"
    sky: Array | None = None

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_rad, 2)
        if not 1e-3 <= self.zone_rad <= np.pi:
            raise InputError(f"{self.name}: the side of a zone must lie in [0.001, pi] rad (got {self.zone_rad})")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H = I in the two columns of the row's zone; only zones that were visited have columns."""
        rows = observation.rows(self.telescopes)
        sky = observation.psi[rows] if self.sky is None else self.sky
        if len(sky) != rows.size:
            raise InputError(f"{self.name}: {rows.size} measurements, and directions of {len(sky)}")
        band = np.floor((sky[:, 1] + np.pi / 2) / self.zone_rad)
        middle = np.minimum((band + 0.5) * self.zone_rad, np.pi) - np.pi / 2
        cells = np.maximum(np.floor(2.0 * np.pi * np.cos(middle) / self.zone_rad), 1.0)
        cell = np.floor(sky[:, 0] / (2.0 * np.pi) * cells)
        zones, column = np.unique(np.stack([band, cell], axis=1), axis=0, return_inverse=True)
        H = np.zeros((observation.t_s.size, 2, 2 * len(zones)))
        for axis in range(2):
            H[rows, axis, 2 * column.ravel() + axis] = 1.0
        sigma = np.tile(sigmas(self.name, self.sigma_rad, 2), len(zones))
        labels = [f"{self.name} zone {int(b)}.{int(c)}" for b, c in zones]
        return Common(
            name=self.name,
            names=tuple(f"{label} {axis}" for label in labels for axis in ("RA*", "Dec")),
            H=H,
            displacement=None,
            covariance=np.diag(sigma**2),
            mean=np.zeros(sigma.size),
            treatment=self.treatment,
        )
