"""JSON of nebosvod plan --decide, as dataclasses.

Made from nebosvod/planning/decision.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.typed import Typed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Visit(Typed):
    """Visit.

    Parameters
    ----------
    epoch : in TDB.
    quantiles : of the probability after this visit, by level.
    bound : below which (95 %) a quantile of 0 lies: of these no orbit that agrees with the visit hits; None where
        there are none.
    effective_median : orbits that agree with a simulated visit, median over truths.
    redrawn : part of the truths for which orbits were drawn anew.
    telescope : text.
    chance_below, chance_above : a number.
    """

    telescope: str
    epoch: Time
    quantiles: Mapping[str, float]
    bound: float | None
    chance_below: float
    chance_above: float
    effective_median: float
    redrawn: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DecisionSummary(Typed):
    """Decision summary.

    Parameters
    ----------
    orbit : where the orbit and its covariance come from.
    until : last date of an impact; UTC.
    probability : now: hits over drawn orbits.
    n_draws : orbits of the cloud.
    n_truths : simulated truths of each visit.
    exposures : of each visit.
    spacing : from one exposure of a visit to the next; s.
    below : threshold that clears.
    above : threshold that confirms.
    best : number of the visit most likely to pass a threshold.
    map_error : of the cloud's own map to the target plane, parts of the hits; None where every orbit was flown.
    schema_version, n_hits, seed : a whole number.
    kind : Literal["decision"].
    title, object : text.
    bodies, never_visible, warnings : several, each ....
    visits : several, each Visit.
    """

    SCHEMA: ClassVar[str] = "planning/decision.schema.json"
    schema_version: int
    kind: Literal["decision"]
    title: str
    object: str
    orbit: str
    until: Time
    bodies: tuple[str, ...]
    probability: float
    n_draws: int
    n_hits: int
    n_truths: int
    seed: int
    exposures: int
    spacing: Quantity
    below: float
    above: float
    visits: tuple[Visit, ...]
    best: int
    never_visible: tuple[str, ...]
    map_error: float | None
    warnings: tuple[str, ...]
