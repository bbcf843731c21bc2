"""UncertainOrbit: a state and dynamic parameters at an epoch with the factor of their joint covariance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, RadiationPressure
from nebosvod.dynamics import nongrav as nongrav_module
from nebosvod.dynamics import radiation as radiation_module
from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.reweighed import Response
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
STATE_NAMES = ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
PARAMETERS = (*radiation_module.PARAMETERS, *nongrav_module.PARAMETERS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UncertainOrbit:
    """An orbit with a covariance.

    Parameters
    ----------
    name : of the object.
    epoch : of the state.
    state : shape (6,), heliocentric ICRF position and velocity, km and km/s.
    factor : shape (6 + m, 6 + m), lower triangular with a positive diagonal: the joint covariance of state and
        parameters is factor factor^T.
    parameter_names : m uncertain parameters of the force model: radius_m, mass_kg, albedo, thermal_emission, a1_au_d2,
        a2_au_d2, a3_au_d2; their values are those of `radiation` and `nongrav`.
    radiation, nongrav : forces of the object's own, or None.
    settings : further keywords of `ForceModel`: relativity, asteroids, ...
    sources : covariance by source of error where known: name -> factor (6 + m, k); they sum to the covariance.
    shared : errors of telescopes that the measurements behind this orbit have in common and coming ones will have, by
        name: rows (6 + m + k,) of the joint lower factor, over the unit draws of `factor` and then of all k of these.
    responses : how the estimate behind this orbit answers to the size of a source by name, its weights solved anew, in
        units of `factor`; of a fit alone.
    magnitude : H and G, or None.
    last_observation : when it was last seen, where that is known.
    origin : what it was read from, in words.
    notices : what a reader must know before using it.

    Raises
    ------
    InputError
        If shapes, numbers or names cannot be used.
    """

    name: str
    epoch: Epoch
    state: Array
    factor: Array
    parameter_names: tuple[str, ...] = ()
    radiation: RadiationPressure | None = None
    nongrav: Nongrav | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, Array] = field(default_factory=dict)
    shared: Mapping[str, Array] = field(default_factory=dict)
    responses: Mapping[str, Response] = field(default_factory=dict)
    magnitude: tuple[float, float] | None = None
    last_observation: Epoch | None = None
    origin: str = ""
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        state = np.array(self.state, dtype=np.float64)
        factor = np.array(self.factor, dtype=np.float64)
        size = 6 + len(self.parameter_names)
        if state.shape != (6,) or not np.isfinite(state).all():
            raise InputError(f"{self._said}state: needs six finite numbers (km, km/s), got {state}")
        strangers = [name for name in self.parameter_names if name not in PARAMETERS]
        if strangers or len(set(self.parameter_names)) != len(self.parameter_names):
            known = ", ".join(PARAMETERS)
            raise InputError(f"{self._said}parameters {', '.join(self.parameter_names)}: each of {known}, once at most")
        if factor.shape != (size, size) or not np.isfinite(factor).all():
            raise InputError(f"{self._said}factor: needs shape ({size}, {size}) and finite numbers, got {factor.shape}")
        if np.triu(factor, 1).any() or not (np.diag(factor) > 0.0).all():
            raise InputError(f"{self._said}factor: needs to be lower triangular with a positive diagonal")
        for array in (state, factor):
            array.setflags(write=False)
        object.__setattr__(self, "state", state)
        object.__setattr__(self, "factor", factor)

    @property
    def _said(self) -> str:
        return f"{self.origin}: " if self.origin else ""

    @property
    def names(self) -> tuple[str, ...]:
        """Rows of the factor: the six of the state, then the parameters."""
        return (*STATE_NAMES, *self.parameter_names)

    @property
    def covariance(self) -> Array:
        """Joint covariance (6 + m, 6 + m); for use by factors take `factor`."""
        formed: Array = self.factor @ self.factor.T
        return formed

    @property
    def sigma(self) -> Array:
        """Standard deviations (6 + m,), in the order of `names`."""
        return np.asarray(np.sqrt(np.sum(self.factor**2, axis=1)))

    @property
    def sigma_position_km(self) -> float:
        """Root of the trace of the covariance of position."""
        return float(np.linalg.norm(self.factor[:3]))

    @property
    def parameters(self) -> dict[str, float]:
        """Values of every parameter of its own forces, uncertain or not, by the names of the force model."""
        sphere = {} if self.radiation is None else {n: getattr(self.radiation, n) for n in radiation_module.PARAMETERS}
        own = {} if self.nongrav is None else {n: getattr(self.nongrav, n) for n in nongrav_module.PARAMETERS}
        return {**sphere, **{name: value for name, value in own.items() if value or name in self.parameter_names}}

    def forces(self, ephemeris: Ephemeris) -> ForceModel:
        """The forces that act on it, with its uncertain parameters as the columns of zeta."""
        return ForceModel(
            ephemeris=ephemeris,
            radiation=self.radiation,
            nongrav=self.nongrav,
            parameters=self.parameter_names,
            **self.settings,
        )
