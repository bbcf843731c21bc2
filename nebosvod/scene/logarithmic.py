"""Forces whose sensitivities are by the logarithms of some parameters: what a lognormal error needs.

The rest of the program sees a parameter with another name: its values are logarithms, its column of zeta is
dX/d ln p = p dX/dp, its prior is Gaussian in ln p, so a truth drawn from it is lognormal and an estimator's step leaves
it positive.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.errors import InputError
from nebosvod.mission.parameter import LOGARITHMS, MAGNITUDE

Array = npt.NDArray[np.float64]
LARGEST = 100.0  # of a logarithm: its power, and the products of such powers, stay numbers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogarithmicForces(ForceModel):
    """A force model that also knows the parameters "ln_radius", "ln_mass" and "ln_albedo" (of m, kg and 1).

    And the absolute magnitude, whose column of zeta is zero: no force feels it, but what is known of it may be joint
    with radius and albedo.
    """

    magnitude: float = 0.0

    def __post_init__(self) -> None:
        named = tuple(self.parameters)
        felt = tuple(LOGARITHMS.get(name, name) for name in named if name != MAGNITUDE)
        object.__setattr__(self, "parameters", felt)
        ForceModel.__post_init__(self)
        object.__setattr__(self, "parameters", named)

    @property
    def values(self) -> Array:
        """Current values of the parameters, shape (m,), in their order."""
        return np.array([self._value(name) for name in self.parameters], dtype=np.float64)

    def with_values(self, values: Mapping[str, float]) -> ForceModel:
        """The same model with some parameters elsewhere, e.g. {"ln_radius": 5.1}.

        Raises
        ------
        InputError
            If a logarithm is beyond any body's; a step of an iteration may be.
        """
        for name, value in values.items():
            if name in LOGARITHMS and not abs(value) <= LARGEST:
                raise InputError(f"{name}: e to the power of {value:.4g} is no size of a body (allowed -100 to 100)")
        felt = {name: value for name, value in values.items() if name != MAGNITUDE}
        physical = {LOGARITHMS.get(n, n): math.exp(v) if n in LOGARITHMS else v for n, v in felt.items()}
        moved = ForceModel.with_values(self, physical)
        if MAGNITUDE in values and isinstance(moved, LogarithmicForces):
            return replace(moved, magnitude=float(values[MAGNITUDE]))
        return moved

    def columns(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Columns that the kernel integrates, and the matrix (q, m) from them to the parameters: d/d ln p = p d/dp."""
        used, felt = ForceModel.columns(self)
        per_logarithm = [math.exp(self._value(name)) if name in LOGARITHMS else 1.0 for name in self.parameters]
        chain = np.zeros((len(used), len(self.parameters)))
        chain[:, [name != MAGNITUDE for name in self.parameters]] = felt
        return used, chain * np.array(per_logarithm)

    def _value(self, name: str) -> float:
        """One value, the logarithm where the name says so."""
        if name == MAGNITUDE:
            return self.magnitude
        physical = LOGARITHMS.get(name, name)
        owner = self.radiation if hasattr(self.radiation, physical) else self.nongrav
        value = float(getattr(owner, physical))
        return math.log(value) if name in LOGARITHMS else value
