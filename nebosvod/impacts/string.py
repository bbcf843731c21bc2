"""A string of orbits through the estimate: straight as the covariance has it, or corrected to observations.

Each point is told by its sigma, the signed root of what its chi squared is above the least one; along a straight string
that is its distance from the estimate.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline, make_interp_spline

Array = npt.NDArray[np.float64]
STRAIGHT_ENDS = 9.0  # sigmas


@dataclass(frozen=True, kw_only=True, eq=False)
class String:
    """Orbits along one direction.

    Parameters
    ----------
    direction : (n,) unit vector of whitened deviations, the weak direction.
    sigmas : (k,) rising, of the known points; the string goes smoothly through them and ends with them.
    points : (k, n) whitened deviations there.
    """

    direction: Array
    sigmas: Array
    points: Array

    @classmethod
    def straight(cls, direction: Array) -> "String":
        """The one that a covariance alone knows."""
        sigmas = np.array([-STRAIGHT_ENDS, STRAIGHT_ENDS])
        return cls(direction=direction, sigmas=sigmas, points=np.outer(sigmas, direction))

    @property
    def curved(self) -> bool:
        """Whether it was corrected to observations."""
        return len(self.sigmas) > 2

    @property
    def ends(self) -> tuple[float, float]:
        """Sigmas of its ends."""
        return float(self.sigmas[0]), float(self.sigmas[-1])

    def at(self, sigmas: Array) -> Array:
        """Whitened deviations (k, n) at sigmas (k,) between its ends."""
        found: Array = self._points(sigmas)
        return found

    def sigma_of(self, points: Array) -> Array:
        """Sigmas (k,) of the points of the string level with whitened deviations (k, n), at most those of its ends."""
        along = self.points @ self.direction
        found: Array = self._levels(np.clip(points @ self.direction, along[0], along[-1]))
        return found

    @cached_property
    def _points(self) -> BSpline:
        return make_interp_spline(self.sigmas, self.points, k=self._order)

    @cached_property
    def _levels(self) -> BSpline:
        return make_interp_spline(self.points @ self.direction, self.sigmas, k=self._order)

    @property
    def _order(self) -> int:
        return min(3, len(self.sigmas) - 1)


Corrected = Callable[[Array], String]
