"""JSON of nebosvod compare of ephemerides, approaches or risks, as dataclasses.

Made from nebosvod/results/orbit_comparison.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.typed import Typed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Run(Typed):
    """Run.

    Parameters
    ----------
    sigma_position : in km.
    epoch : in TDB.
    until : of a risk: its last date; UTC.
    bodies : of a risk: what may be hit.
    sampling : of a risk: all bodies together, as in its summary.
    label, path, object, orbit : text.
    observer : text, or None.
    """

    label: str
    path: str
    object: str
    orbit: str
    observer: str | None
    sigma_position: Quantity
    epoch: Time
    until: Time | None
    bodies: tuple[str, ...] | None
    sampling: Mapping[str, Any] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class OrbitComparisonSummary(Typed):
    """Orbit comparison summary.

    Parameters
    ----------
    warnings : what makes these answers to different questions.
    schema_version : a whole number.
    kind : Literal["ephemeris", "approaches", "risk"].
    runs : several, each Run.
    rows : several, each Mapping[str, Any].
    """

    SCHEMA: ClassVar[str] = "results/orbit_comparison.schema.json"
    schema_version: int
    kind: Literal["ephemeris", "approaches", "risk"]
    runs: tuple[Run, ...]
    warnings: tuple[str, ...]
    rows: tuple[Mapping[str, Any], ...]
