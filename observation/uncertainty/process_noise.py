"""White accelerations of the target that no force model has: process noise, as constants over short intervals."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.uncertainty.nuisance import sigmas
from nebosvod.observation.uncertainty.term import Common, check_treatment

AXES = ("x", "y", "z")


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """What accelerations do to the state at the epoch: C(t), the integral of Phi(epoch, s) [0; I] from the epoch to t.

    Attributes
    ----------
    nodes_s : (k,) ascending, TDB seconds after the epoch, 0 among them.
    integral : (k, 6, 3) C at the nodes, km per km/s^2 and km/s per km/s^2; slope : (k, 6, 3) its derivative there.
    """

    nodes_s: Array
    integral: Array
    slope: Array

    @bordered()
    def at(self, t_s: Array) -> Array:
        """C (n, 6, 3) at times (n,), by cubic Hermite interpolation; constant beyond the ends."""
        t = np.clip(t_s, self.nodes_s[0], self.nodes_s[-1])
        left = np.clip(np.searchsorted(self.nodes_s, t, side="right") - 1, 0, self.nodes_s.size - 2)
        step = self.nodes_s[left + 1] - self.nodes_s[left]
        u = ((t - self.nodes_s[left]) / step)[:, None, None]
        h = step[:, None, None]
        found: Array = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * self.integral[left]
            + u**2 * (3.0 - 2.0 * u) * self.integral[left + 1]
            + h * u * (1.0 - u) ** 2 * self.slope[left]
            + h * u**2 * (u - 1.0) * self.slope[left + 1]
        )
        return found


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProcessNoise:
    """An acceleration of the target that is white in time: constant in each interval, independent from one to the next.

    Parameters
    ----------
    density_km2_s3 : of the spectrum on each axis: the variance of a velocity that it changes for a second.
    edges_s : (m + 1,) of the intervals, TDB seconds after the epoch, 0 among them where it is inside.
    reach : of the accelerations on the reference orbit; None before it is known.

    Notes
    -----
    The mean of white noise over an interval D has the variance q / D. An acceleration a over an interval acts on the
    state at t as a change B a of the state at the epoch, B = C(t) - C(start) for an interval after the epoch, t limited
    to its ends, and C(t) - C(end) for one before it: H = H_x0 B. At the edges the velocity walks as in the continuous
    case; of the position a twelfth of q D^3 is missing in each interval.
    """

    name: str
    telescopes: tuple[str, ...]
    density_km2_s3: float
    edges_s: Array
    reach: Reach | None = None
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.density_km2_s3, 1)
        if self.edges_s.size < 2 or not np.all(np.diff(self.edges_s) > 0.0):
            raise InputError(f"{self.name}: intervals need ascending edges (got {self.edges_s.size})")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, interval by interval."""
        return tuple(f"{self.name} {k + 1} {axis}" for k in range(self.edges_s.size - 1) for axis in AXES)

    @bordered()
    def moved_by(self, t_s: Array) -> Array:
        """B (n, 6, 3 m): what the accelerations do to the state at each time (n,), as a change of it at the epoch."""
        if self.reach is None:
            raise InputError(f"{self.name}: its reach on the reference orbit is not known yet")
        start, end = self.edges_s[:-1], self.edges_s[1:]
        anchor = self.reach.at(np.where(start >= 0.0, start, end))
        inside = np.clip(t_s[:, None], start, end)
        B = self.reach.at(inside.ravel()).reshape(t_s.size, start.size, 6, 3) - anchor
        return np.ascontiguousarray(B.transpose(0, 2, 1, 3)).reshape(t_s.size, 6, 3 * start.size)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H (n, 2, 3 m) of the accelerations in all intervals; they move the target, not the telescope."""
        B = self.moved_by(observation.t_s - observation.light_time_s)
        moved = None
        if len(observation.Phi_emission):  # empty where nothing will be simulated
            moved = -observation.Phi_emission @ B
        spans = np.repeat(np.diff(self.edges_s), 3)
        return Common(
            name=self.name,
            names=self.names,
            H=observation.H_x0 @ B,
            displacement=moved,
            covariance=np.diag(self.density_km2_s3 / spans),
            mean=np.zeros(spans.size),
            treatment=self.treatment,
        )
