"""In which coordinates the confidence region of an orbit is an ellipsoid: draws are straight there.

Cartesian at the epoch, or equinoctial elements at the epoch. To first order they are the same; where draws in the two
give other probabilities, the covariance says too little about the orbit.
"""

from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.elements import state_to_equinoctial
from nebosvod.errors import GeometryError
from nebosvod.orbits.uncertain import UncertainOrbit

Array = npt.NDArray[np.float64]
Coordinates = Literal["cartesian", "equinoctial"]
NEWTON = 60


def starts(orbit: UncertainOrbit, deviations: Array, coordinates: Coordinates, gm_sun: float) -> tuple[Array, Array]:
    """States (n, 6) and parameters (n, m) of deviations (n, 6 + m), which are straight in some coordinates."""
    values = np.array([orbit.parameters[name] for name in orbit.parameter_names]) + deviations[:, 6:]
    if coordinates == "equinoctial":
        try:
            elements, jacobian = state_to_equinoctial(orbit.state, gm_sun)
        except GeometryError:  # not an ellipse
            return orbit.state + deviations[:, :6], values
        moved = elements + deviations[:, :6] @ jacobian.T
        ellipse = (moved[:, 0] > 0.0) & (np.sum(moved[:, 1:3] ** 2, axis=1) < 1.0)
        states = orbit.state + deviations[:, :6]
        states[ellipse] = _states(moved[ellipse], gm_sun)
        return states, values
    return orbit.state + deviations[:, :6], values


def _states(elements: Array, gm: float) -> Array:
    """States (n, 6) of equinoctial elements (n, 6): a, h, k, p, q, mean longitude.

    References
    ----------
    Broucke, Cefola 1972, Celestial Mechanics 5, 303.
    """
    a, h, k, p, q, longitude = elements.T
    F = longitude.copy()
    for _ in range(NEWTON):
        change = (F + h * np.cos(F) - k * np.sin(F) - longitude) / (1.0 - h * np.sin(F) - k * np.cos(F))
        F = F - np.clip(change, -0.5, 0.5)
        if np.abs(change).max(initial=0.0) < 1e-15:
            break
    b, c, s = 1.0 / (1.0 + np.sqrt(1.0 - h * h - k * k)), np.cos(F), np.sin(F)
    r = a * (1.0 - h * s - k * c)
    rate = np.sqrt(gm * a) / r
    x = a * ((1.0 - h * h * b) * c + h * k * b * s - k), a * ((1.0 - k * k * b) * s + h * k * b * c - h)
    v = rate * (h * k * b * c - (1.0 - h * h * b) * s), rate * ((1.0 - k * k * b) * c - h * k * b * s)
    norm = 1.0 + p * p + q * q
    f = np.array([1.0 - p * p + q * q, 2.0 * p * q, -2.0 * p]) / norm
    g = np.array([2.0 * p * q, 1.0 + p * p - q * q, 2.0 * q]) / norm
    states: Array = np.concatenate([x[0] * f + x[1] * g, v[0] * f + v[1] * g]).T
    return states
