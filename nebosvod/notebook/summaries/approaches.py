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
    H, G : what the name says.
    """

    H: float
    G: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Orbit(Typed):
    """Orbit.

    Parameters
    ----------
    origin : what it was read from.
    epoch : TDB.
    state_km_km_s : heliocentric ICRF; (6,).
    factor : lower factor of the joint covariance of state and parameters, rows by names; (n, n).
    sigma : (n,).
    sigma_position : km.
    names, parameters, magnitude : what the name says.
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
    epoch : TDB.
    sigma_time : s.
    distance : km.
    sigma_distance : km.
    least_distance_3_sigma : km.
    speed : km / s.
    v_infinity : km / s.
    xi : km.
    zeta : km.
    semi_major : km.
    semi_minor : km.
    angle : deg.
    capture_radius : km.
    no_plane : why there is no b-plane.
    longitude : deg.
    latitude : deg.
    body, impact, impact_probability_linear : what the name says.
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
    from_ : UTC.
    to : UTC.
    within : au.
    ended : why the orbit ends early, if it does.
    schema_version, kind, title, object, orbit, n_approaches, approaches, nearest : what the name says.
    warnings : what the name says.
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
