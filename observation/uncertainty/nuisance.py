"""A source of uncertainty about the telescopes: what every kind has in common.

Each kind (`bias`, `position_error`, `orbit_error`, `clock`, `photocentre`) is a small frozen description; its
`term(observation, ephemeris)` turns it into the arrays of `term` for the measurements at hand. One description feeds
the estimators, simulation and Monte Carlo alike. A kind with several `telescopes` is ONE source that acts on all of
them: the same draw.
"""

from typing import Literal, Protocol, get_args

import numpy as np

from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Rows
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.spacecraft.kinds import rtn_axes
from nebosvod.observation.uncertainty.term import Term

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


def piecewise(number: Rows) -> Array:
    """Whether each row (r,) continues the piece of the row before it (1.0) or begins a new one (0.0).

    Parameters
    ----------
    number : shape (r,), the piece (arc, renewal interval) each row belongs to.
    """
    return np.concatenate([[0.0], number[1:] == number[:-1]])


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
