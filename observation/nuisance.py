"""What is uncertain about the telescopes, and how it is correlated.

Each kind is a small frozen description; `term(observation, ephemeris)` turns it into the arrays of `term` for the
measurements at hand. One description feeds the estimators, simulation and Monte Carlo alike. A kind with several
`telescopes` is ONE source that acts on all of them: the same draw.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.astrometry import Observation
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.spacecraft import rtn_axes
from nebosvod.observation.term import Common, Markov, Rows, Term, Treatment, White, check_treatment

Frame = Literal["icrf", "rtn"]
AXES = {"icrf": ("x", "y", "z"), "rtn": ("radial", "transverse", "normal")}


class Nuisance(Protocol):
    """One source of uncertainty."""

    @property
    def name(self) -> str:
        """The source's name in the error budget."""

    @property
    def treatment(self) -> Treatment:
        """What the estimators do with it."""

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Term:
        """Its partials, covariance and draws for these measurements."""


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


def position_axes(observation: Observation, rows: Rows, frame: Frame, ephemeris: Ephemeris) -> Array:
    """R_icrf_from_frame (r, 3, 3) of the telescope behind each row; RTN is about the spacecraft's central body."""
    axes = np.broadcast_to(np.eye(3), (rows.size, 3, 3)).copy()
    if frame == "icrf":
        return axes
    for number, telescope in enumerate(observation.telescopes):
        mine = observation.telescope_index[rows] == number
        if np.any(mine):
            t_s = observation.t_s[rows[mine]]
            centre = ephemeris.state_km_km_s(telescope.spacecraft.centre, observation.epoch, t_s)
            axes[mine] = rtn_axes(observation.telescope_state[rows[mine]] - centre)
    return axes


def diagonal(values: Array) -> Array:
    """Diagonal matrices (r, q, q) from their diagonals (r, q)."""
    return values[:, :, None] * np.eye(values.shape[1])


def sigmas(name: str, sigma: Array | float, size: int) -> Array:
    """Standard deviations (size,), checked to be finite and not negative.

    Raises
    ------
    InputError
        Otherwise, or if the shape is neither () nor (size,).
    """
    value = np.asarray(sigma, dtype=np.float64)
    if value.shape not in ((), (size,)) or not np.all(np.isfinite(value) & (value >= 0.0)):
        raise InputError(f"{name}: needs one or {size} finite numbers >= 0 (got {sigma})")
    return np.array(np.broadcast_to(value, (size,)))


def check_frame(name: str, frame: str) -> None:
    """Raise InputError unless `frame` is known."""
    if frame not in get_args(Frame):
        raise InputError(f"{name}: frame must be one of {', '.join(get_args(Frame))} (got {frame})")
