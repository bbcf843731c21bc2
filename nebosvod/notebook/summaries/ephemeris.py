"""summary.json of nebosvod ephemeris, as dataclasses.

Made from nebosvod/results/ephemeris.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.approaches import Orbit
from nebosvod.notebook.summaries.typed import Typed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Row(Typed):
    """Row.

    Parameters
    ----------
    epoch : in UTC.
    ra : in deg.
    dec : in deg.
    rate_ra : in RA cos Dec; arcsec / h.
    rate_dec : in arcsec / h.
    sigma_ra : in RA cos Dec; arcsec.
    sigma_dec : in arcsec.
    semi_major : in arcsec.
    semi_minor : in arcsec.
    position_angle : of the long axis, from north to east; deg.
    distance : in au.
    sigma_distance : in km.
    r : in au.
    phase : in deg.
    elongation : in deg.
    altitude : in deg.
    sun_altitude : in deg.
    not_seen : which limit of a mission's telescope keeps it from being seen.
    V : a number, or None.
    twilight : Any, or None.
    """

    epoch: Time
    ra: Quantity
    dec: Quantity
    rate_ra: Quantity
    rate_dec: Quantity
    sigma_ra: Quantity
    sigma_dec: Quantity
    semi_major: Quantity
    semi_minor: Quantity
    position_angle: Quantity
    distance: Quantity
    sigma_distance: Quantity
    r: Quantity
    phase: Quantity
    elongation: Quantity
    V: float | None
    altitude: Quantity | None
    sun_altitude: Quantity | None
    twilight: Any | None
    not_seen: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class EphemerisSummary(Typed):
    """Ephemeris summary.

    Parameters
    ----------
    from_ : in UTC.
    step : in d.
    ended : why the orbit ends early, if it does.
    schema_version, n_times : a whole number.
    kind : Literal["ephemeris"].
    title, object, observer : text.
    orbit : Orbit.
    rows : several, each Row.
    warnings : several, each ....
    """

    SCHEMA: ClassVar[str] = "results/ephemeris.schema.json"
    schema_version: int
    kind: Literal["ephemeris"]
    title: str
    object: str
    orbit: Orbit
    observer: str
    from_: Time
    step: Quantity
    n_times: int
    rows: tuple[Row, ...]
    ended: str | None
    warnings: tuple[str, ...]
