"""Errors of a telescope's position: fresh at each exposure, constant, or correlated in time."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.uncertainty.nuisance import AXES, Frame, check_frame, diagonal, position_axes, sigmas
from nebosvod.observation.uncertainty.term import Common, Markov, White, check_treatment


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WhitePosition:
    """A position error of one telescope drawn anew, independently, at each exposure.

    Parameters
    ----------
    sigma_km : standard deviations (3,) along the axes of `frame`, or one for all.
    """

    name: str
    telescope: str
    sigma_km: Array | float
    frame: Frame = "icrf"
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        check_frame(self.name, self.frame)
        sigmas(self.name, self.sigma_km, 3)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> White:
        """H = H_z R_icrf_from_frame; the covariance stays diagonal in its own frame."""
        rows = observation.rows((self.telescope,))
        axes = position_axes(observation, rows, self.frame, ephemeris)
        return White(
            name=self.name,
            names=tuple(f"{self.name} {axis}" for axis in AXES[self.frame]),
            rows=rows,
            H=observation.H_z[rows] @ axes,
            displacement=axes,
            Q=np.broadcast_to(np.diag(sigmas(self.name, self.sigma_km, 3) ** 2), axes.shape),
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConstantPosition:
    """A position error that is the same in all exposures, in ICRF or riding along in RTN.

    Parameters
    ----------
    sigma_km : standard deviations (3,) along the axes of `frame`, or one for all; mean_km : assumed mean (3,).
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_km: Array | float
    mean_km: Array | float = 0.0
    frame: Frame = "icrf"
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        check_frame(self.name, self.frame)
        sigmas(self.name, self.sigma_km, 3)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H = H_z R_icrf_from_frame on the rows of the telescopes."""
        rows = observation.rows(self.telescopes)
        displacement = np.zeros((observation.t_s.size, 3, 3))
        displacement[rows] = position_axes(observation, rows, self.frame, ephemeris)
        return Common(
            name=self.name,
            names=tuple(f"{self.name} {axis}" for axis in AXES[self.frame]),
            H=observation.H_z @ displacement,
            displacement=displacement,
            covariance=np.diag(sigmas(self.name, self.sigma_km, 3) ** 2),
            mean=np.array(np.broadcast_to(self.mean_km, (3,)), dtype=np.float64),
            treatment=self.treatment,
        )


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GaussMarkovPosition:
    """A position error correlated as sigma^2 exp(-|dt| / time) in each axis, stationary.

    Parameters
    ----------
    sigma_km : standard deviations (3,) along the axes of `frame`, or one for all.
    time_s : correlation times (3,), or one for all.

    Notes
    -----
    F = exp(-dt / time), Q = sigma^2 (1 - F^2); simultaneous exposures of two telescopes that share the source have
    F = I, Q = 0.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_km: Array | float
    time_s: Array | float
    frame: Frame = "icrf"
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        check_frame(self.name, self.frame)
        sigmas(self.name, self.sigma_km, 3)
        if not np.all(sigmas(f"{self.name}: correlation time", self.time_s, 3) > 0.0):
            raise InputError(f"{self.name}: correlation time must be positive (got {self.time_s} s)")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Markov:
        """H = H_z R_icrf_from_frame, with the stationary chain of first order."""
        rows = observation.rows(self.telescopes)
        axes = position_axes(observation, rows, self.frame, ephemeris)
        variance = sigmas(self.name, self.sigma_km, 3) ** 2
        steps = np.diff(observation.t_s[rows], prepend=observation.t_s[rows[:1]])
        age = steps[:, None] / sigmas(self.name, self.time_s, 3)
        return Markov(
            name=self.name,
            names=tuple(f"{self.name} {axis}" for axis in AXES[self.frame]),
            rows=rows,
            H=observation.H_z[rows] @ axes,
            displacement=axes,
            F=diagonal(np.exp(-age)),
            # expm1 keeps the tiny step noise of dense exposures
            Q=diagonal(variance * -np.expm1(-2.0 * age)),
            P0=np.diag(variance),
            treatment=self.treatment,
        )
