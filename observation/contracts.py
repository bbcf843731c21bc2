"""What observation asks of the stage before it: a trajectory that answers at any time, and an ephemeris.

Structural types, so that a closed-form orbit can stand in for an integrated one in a test.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import numpy.typing as npt

from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Texts = npt.NDArray[np.str_]
Rows = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


class Ephemeris(Protocol):
    """Positions of the Sun, planets and Moon (`nebosvod.dynamics.Ephemeris`)."""

    @property
    def gm_km3_s2(self) -> Mapping[str, float]:
        """Gravitational parameters by body name."""

    def position_km(self, body: str, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF positions (n, 3), km, at `t_s` TDB seconds after `epoch`."""

    def state_km_km_s(self, body: str, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6), km and km/s."""


class Trajectory(Protocol):
    """A heliocentric ICRF orbit with its partials (`nebosvod.dynamics.Trajectory`)."""

    @property
    def epoch(self) -> Epoch:
        """The epoch from which times and partials count."""

    @property
    def state(self) -> Array:
        """Heliocentric states (n, 6), km and km/s."""

    @property
    def Phi(self) -> Array:
        """Partials of the state by the state at `epoch` (n, 6, 6)."""

    @property
    def zeta(self) -> Array:
        """Partials of the state by the dynamic parameters (n, 6, m)."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of zeta."""

    def at(self, t_s: Array) -> "Trajectory":
        """The same orbit at other times inside its span."""

    def state_at(self, t_s: Array) -> Array:
        """Heliocentric states (n, 6) alone, at any times inside the span."""
