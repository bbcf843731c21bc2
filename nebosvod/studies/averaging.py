"""Where averaging stops helping: how many measurements of the same kind do what a better telescope does.

With N measurements the error that noise alone leaves has the covariance sigma^2 / N D0^-1, D0 being what one
measurement tells on average; errors that all measurements share are not averaged, and leave the floor. So a noise that
must be better by a factor f is made up by N / f^2 measurements, as long as biases and the rest stay as they are.

References
----------
Guo, Ivashkin 2018, KIAM preprint 213, figure 1: accuracy against the number of measurements.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

from nebosvod.findings.inside import information
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.studies.point import Point
from nebosvod.studies.requirement import KNEE, Requirement, largest_factor

EQUAL = math.sqrt(2.0)  # of the floor, where noise and the rest have equal parts in the variance


def averaging(
    wanted: Requirement, found: Mapping[str, Any], number: Callable[[Mapping[str, Any]], float], point: Point
) -> dict[str, Any] | None:
    """What number of measurements brings the wanted answer, and where more bring nothing; None without a noise.

    Parameters
    ----------
    found : of `requirement.required`. number : the answer with changes. point : the mission as it is.
    """
    noise = next((one for one in wanted.each if all(path.endswith("noise.sigma") for path in one.paths)), None)
    if noise is None:
        return None
    row = next(one for one in found["each"] if one["name"] == noise.name)
    n, floor, equal = int(point.times_s.size), row["floor"], None
    if floor and row["without"] != floor:

        def at(factor: float) -> float:
            return number(noise.changes(noise.now * factor))

        equal = n / largest_factor(at, EQUAL * floor, 1.0 / noise.reach, noise.reach, KNEE) ** 2
    told = information(point.problem)
    return {
        "n": n,
        "n_needed": None if row["needed"] is None else n * (noise.now / row["needed"]) ** 2,
        "n_where_equal": equal,
        "floor": floor,
        "D0": told.D0.tolist(),
        "D0_names": list(STATE_NAMES),
        "sigma_arcsec": told.sigma_arcsec,
        "components": told.count,
        "sigma_position_km": told.sigma_position_km if math.isfinite(told.sigma_position_km) else None,
    }
