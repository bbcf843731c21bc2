"""summary.json of nebosvod approaches, as dataclasses.

Made from nebosvod/results/approaches.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.typed import Typed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Magnitude(Typed):
    """Magnitude.

    Parameters
    ----------
    H, G : a number.
    """

    H: float
    G: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Orbit(Typed):
    """Orbit.

    Parameters
    ----------
    origin : what it was read from.
    epoch : in TDB.
    state_km_km_s : heliocentric ICRF; (6,).
    factor : lower factor of the joint covariance of state and parameters, rows by names; (n, n).
    sigma : in (n,).
    sigma_position : in km.
    names : several, each ....
    parameters : by name, a number.
    magnitude : Magnitude, or None.
    """

    origin: str
    epoch: Time
    state_km_km_s: Array
    names: tuple[str, ...]
    factor: Array
    sigma: Array
    sigma_position: Quantity
    parameters: Mapping[str, float]
    magnitude: Magnitude | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Approach(Typed):
    """Approach.

    Parameters
    ----------
    epoch : in TDB.
    sigma_time : in s.
    distance : in km.
    sigma_distance : in km.
    least_distance_3_sigma : in km.
    speed : in km / s.
    v_infinity : in km / s.
    xi : in km.
    zeta : in km.
    semi_major : in km.
    semi_minor : in km.
    angle : in deg.
    capture_radius : in km.
    no_plane : why there is no b-plane.
    longitude : in deg.
    latitude : in deg.
    body : text.
    impact : true or false.
    impact_probability_linear : a number, or None.
    """

    body: str
    impact: bool
    epoch: Time
    sigma_time: Quantity
    distance: Quantity
    sigma_distance: Quantity
    least_distance_3_sigma: Quantity
    speed: Quantity
    v_infinity: Quantity | None
    xi: Quantity | None
    zeta: Quantity | None
    semi_major: Quantity | None
    semi_minor: Quantity | None
    angle: Quantity | None
    capture_radius: Quantity | None
    impact_probability_linear: float | None
    no_plane: str | None
    longitude: Quantity | None
    latitude: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ApproachesSummary(Typed):
    """Approaches summary.

    Parameters
    ----------
    from_ : in UTC.
    to : in UTC.
    within : in au.
    ended : why the orbit ends early, if it does.
    schema_version, n_approaches : a whole number.
    kind : Literal["approaches"].
    title, object : text.
    orbit : Orbit.
    approaches : several, each Approach.
    nearest : Approach, or None.
    warnings : several, each ....
    """

    SCHEMA: ClassVar[str] = "results/approaches.schema.json"
    schema_version: int
    kind: Literal["approaches"]
    title: str
    object: str
    orbit: Orbit
    from_: Time
    to: Time
    within: Quantity
    n_approaches: int
    approaches: tuple[Approach, ...]
    nearest: Approach | None
    ended: str | None
    warnings: tuple[str, ...]
