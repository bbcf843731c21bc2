"""From elements or a state with a covariance, in the units of a file, to an `UncertainOrbit`.

A covariance is factored where it was printed, as a correlation matrix, and from then on the factor alone is mapped: a
covariance in km and km/s that double precision cannot hold does no harm.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Nongrav, RadiationPressure
from nebosvod.dynamics.elements import (
    cometary_to_state,
    equinoctial_to_state,
    keplerian_to_state,
    state_to_cometary,
    state_to_equinoctial,
    state_to_keplerian,
)
from nebosvod.dynamics.frames import R_ecliptic_from_icrf, R_icrf_from_ecliptic
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.mission.covariance import checked
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Elements = Literal["cometary", "keplerian", "equinoctial", "state"]
Frame = Literal["ecliptic_j2000", "icrf"]
TO_STATE = {"cometary": cometary_to_state, "keplerian": keplerian_to_state, "equinoctial": equinoctial_to_state}
FROM_STATE = {"cometary": state_to_cometary, "keplerian": state_to_keplerian, "equinoctial": state_to_equinoctial}
# what others take into account besides point masses; of their further terms see docs/orbits.md
SETTINGS_OF_OTHERS: Mapping[str, Any] = {"relativity": "eih"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Given:
    """What a file says of an orbit, in internal units but on its own axes and in its own elements.

    Parameters
    ----------
    kind, values : which elements, shape (6,), in the order of `nebosvod.dynamics.elements`; or a state.
    factor : shape (6 + m, k), a factor of the joint covariance of elements and parameters.
    frame : axes of the elements or the state.
    gm_km3_s2 : of the Sun, with which the file's elements were made.
    """

    name: str
    epoch: Epoch
    kind: Elements
    values: Array
    factor: Array
    gm_km3_s2: float
    frame: Frame = "ecliptic_j2000"
    parameter_names: tuple[str, ...] = ()
    radiation: RadiationPressure | None = None
    nongrav: Nongrav | None = None
    magnitude: tuple[float, float] | None = None
    last_observation: Epoch | None = None
    settings: Mapping[str, Any] = field(default_factory=lambda: SETTINGS_OF_OTHERS)
    notices: tuple[str, ...] = ()


def uncertain(given: Given, origin: str) -> UncertainOrbit:
    """The orbit that a file gives, as a heliocentric ICRF state.

    Raises
    ------
    InputError
        If the elements are no orbit; the message begins with `origin`.
    """
    try:
        state, jacobian = given.values, np.eye(6)
        if given.kind != "state":
            state, jacobian = TO_STATE[given.kind](given.values, given.gm_km3_s2)
    except (GeometryError, InputError) as error:
        raise InputError(f"{origin}: {error}") from None
    if given.frame == "ecliptic_j2000":
        state, jacobian = rotated(R_icrf_from_ecliptic, state), rotated(R_icrf_from_ecliptic, jacobian)
    wide = np.vstack([jacobian @ given.factor[:6], given.factor[6:]])
    return UncertainOrbit(
        name=given.name,
        epoch=given.epoch,
        state=state,
        factor=balanced_factor(wide),
        parameter_names=given.parameter_names,
        radiation=given.radiation,
        nongrav=given.nongrav,
        settings=given.settings,
        magnitude=given.magnitude,
        last_observation=given.last_observation,
        origin=origin,
        notices=given.notices,
    )


def elements_of(
    orbit: UncertainOrbit, kind: Elements, gm_km3_s2: float, frame: Frame = "ecliptic_j2000"
) -> tuple[Array, Array]:
    """Elements (6,) of an orbit and the lower factor (6 + m, 6 + m) of their covariance with the parameters.

    Raises
    ------
    GeometryError
        If an element is undefined there (see `nebosvod.dynamics.elements`).
    """
    state, jacobian = orbit.state, np.eye(6)
    if frame == "ecliptic_j2000":
        state, jacobian = rotated(R_ecliptic_from_icrf, state), rotated(R_ecliptic_from_icrf, jacobian)
    values = state
    if kind != "state":
        values, by_state = FROM_STATE[kind](state, gm_km3_s2)
        jacobian = by_state @ jacobian
    return values, balanced_factor(np.vstack([jacobian @ orbit.factor[:6], orbit.factor[6:]]))


def rotated(rotation: Array, columns: Array) -> Array:
    """A state (6,), or the columns (6, k) of its partials, on other axes."""
    turned: Array = np.concatenate([rotation @ columns[:3], rotation @ columns[3:]])
    return turned


def balanced_factor(wide: Array) -> Array:
    """The square lower factor of wide (n, k), whose rows may differ by many orders of magnitude."""
    scale = np.linalg.norm(wide, axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    factor: Array = lower_factor(wide / scale[:, None]) * scale[:, None]
    return factor


def factor_of(covariance: Array, where: str) -> tuple[Array, tuple[str, ...]]:
    """Lower factor of a covariance as a file prints it, and what is to be said about it.

    One that is singular to the digits it is printed with is taken as it is: an eigenvalue that rounding alone decides
    is as large as that rounding.

    Raises
    ------
    InputError
        If it is not symmetric or not positive definite; begins with `where`, names the smallest eigenvalue.
    """
    try:
        matrix = checked(covariance)
    except InputError as error:
        rounded = _rounded(covariance)
        if rounded is None:
            raise InputError(f"{where}: the covariance {error}") from None
        said = "is singular to the digits it is printed with; one direction is known no better than their rounding"
        return rounded, (f"{where}: the covariance {said}",)
    sigma = np.sqrt(np.diag(matrix))
    return sigma[:, None] * np.linalg.cholesky(matrix / sigma[:, None] / sigma), ()


def _rounded(covariance: Array) -> Array | None:
    """A factor of a covariance whose correlations are singular to rounding; None where more is wrong with it."""
    variance = np.diag(covariance)
    if not np.isfinite(covariance).all() or not (variance > 0.0).all():
        return None
    sigma = np.sqrt(variance)
    correlation = covariance / sigma[:, None] / sigma
    grain = len(sigma) * float(np.finfo(np.float64).eps)
    if np.abs(correlation - correlation.T).max() > grain:
        return None
    values, vectors = np.linalg.eigh(correlation)
    if values[0] < -grain or values[0] > grain:
        return None
    return balanced_factor(sigma[:, None] * vectors * np.sqrt(np.maximum(values, grain)))


def factor_of_normal(normal: Array, where: str) -> Array:
    """Lower factor of the inverse of a normal matrix (the weight of the elements).

    Raises
    ------
    InputError
        As `factor_of`.
    """
    try:
        matrix = checked(normal)
    except InputError as error:
        raise InputError(f"{where}: the normal matrix {error}") from None
    scale = np.sqrt(np.diag(matrix))
    L = np.linalg.cholesky(matrix / scale[:, None] / scale)
    wide = np.linalg.solve(L, np.eye(len(L))).T / scale[:, None]
    return balanced_factor(wide)


def full(triangle: Array, size: int) -> Array:
    """A symmetric matrix from its upper triangle, row by row."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = triangle
    whole: Array = matrix + np.triu(matrix, 1).T
    return whole


def sphere_of(area_to_mass_m2_kg: float) -> RadiationPressure:
    """A black sphere with an area-to-mass ratio; `thermal_emission` then is the relative deviation of that ratio."""
    return RadiationPressure(radius_m=float(np.sqrt(area_to_mass_m2_kg / np.pi)), mass_kg=1.0, albedo=0.0)
