"""Where a problem is linearised, and what is computed there."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.observation import Observation, Term
from nebosvod.scene.prior import STATE_NAMES

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """Where the problem is linearised: the state (6,) and a value for every parameter and common nuisance."""

    state: Array
    parameters: Mapping[str, float]
    nuisances: Mapping[str, float]

    def moved(self, deviation: Mapping[str, float]) -> "Point":
        """The point displaced by deviations of some of its values, by name."""
        step = np.array([deviation.get(name, 0.0) for name in STATE_NAMES])
        return Point(
            state=self.state + step,
            parameters={name: value + deviation.get(name, 0.0) for name, value in self.parameters.items()},
            nuisances={name: value + deviation.get(name, 0.0) for name, value in self.nuisances.items()},
        )

    @property
    def values(self) -> dict[str, float]:
        """Every value by name."""
        return {**dict(zip(STATE_NAMES, self.state.tolist())), **self.parameters, **self.nuisances}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """What is computed at one point: the orbit, the measurements with partials, and what the nuisances do to them."""

    point: Point
    trajectory: Trajectory
    observation: Observation
    terms: tuple[Term, ...]
