"""summary.json of nebosvod alert, as dataclasses.

Made from nebosvod/results/alert.schema.json by tools/summaries.py: change that, then `make schema`.
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
class Rejected(Typed):
    """Rejected.

    Parameters
    ----------
    utc : UTC.
    station, file, line : what the name says.
    """

    utc: Time
    station: str
    file: str
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Chance(Typed):
    """Chance.

    Parameters
    ----------
    probability : none where no drawn orbit hits.
    low : 95 % interval.
    bound : no drawn orbit hits, or too few for a value: the probability is below high.
    high, hits : what the name says.
    """

    probability: float | None
    low: float
    high: float
    bound: bool
    hits: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ByPrior(Typed):
    """By prior.

    Parameters
    ----------
    uniform, cartesian, jeffreys : what the name says.
    """

    uniform: Chance
    cartesian: Chance
    jeffreys: Chance | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Spread(Typed):
    """Spread.

    Parameters
    ----------
    q025 : the unit of the key that holds it.
    q16 : the unit of the key that holds it.
    median : the unit of the key that holds it.
    q84 : the unit of the key that holds it.
    q975 : the unit of the key that holds it.
    """

    q025: Quantity | float
    q16: Quantity | float
    median: Quantity | float
    q84: Quantity | float
    q975: Quantity | float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Impact(Typed):
    """Impact.

    Parameters
    ----------
    epoch : UTC.
    half_68 : s.
    longitude : deg.
    latitude : deg.
    entry : km.
    speed : km / s.
    elevation : deg.
    contours : deg.
    body, n_points : what the name says.
    """

    body: str
    epoch: Time
    half_68: Quantity
    longitude: Spread
    latitude: Spread
    entry: Quantity
    speed: Spread
    elevation: Spread
    n_points: int
    contours: Mapping[str, tuple[Quantity, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Scores(Typed):
    """Shares of the posterior; no probabilities.

    Parameters
    ----------
    near_earth, main_belt, distant, hyperbolic, earth_satellite, other : what the name says.
    """

    near_earth: float
    main_belt: float
    distant: float
    hyperbolic: float
    earth_satellite: float
    other: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Quantities(Typed):
    """Quantities.

    Parameters
    ----------
    range : au.
    rate : km / s.
    a : au.
    i : deg.
    q : au.
    diameter : m.
    e, H : what the name says.
    """

    range: Spread
    rate: Spread
    a: Spread
    e: Spread
    i: Spread
    q: Spread
    H: Spread | None
    diameter: Spread | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Regions(Typed):
    """Regions.

    Parameters
    ----------
    range : (2,), au.
    rate : (2,), km / s.
    """

    range: Quantity
    rate: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Effective(Typed):
    """Effective.

    Parameters
    ----------
    uniform, cartesian, jeffreys : what the name says.
    """

    uniform: float
    cartesian: float
    jeffreys: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Grid(Typed):
    """Grid.

    Parameters
    ----------
    n_nodes, effective, chi2, sigma_log_range : what the name says.
    """

    n_nodes: int
    effective: Effective
    chi2: float
    sigma_log_range: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Draws(Typed):
    """Draws.

    Parameters
    ----------
    n, effective, flown, seed : what the name says.
    """

    n: int
    effective: float
    flown: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Equivalent(Typed):
    """Linear measurement y = H x + v, v of covariance R, of x = ln(range/au), range rate km/s, offsets rad, rates
    rad/s at the reference epoch.

    Parameters
    ----------
    y : (n,).
    H : (n, n).
    R : (n, n).
    """

    y: Array
    H: Array
    R: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Field(Typed):
    """Field.

    Parameters
    ----------
    epoch : UTC.
    ra : deg.
    dec : deg.
    semi_major : arcsec.
    semi_minor : arcsec.
    contours : deg.
    telescope, V, fallen : what the name says.
    """

    telescope: str
    epoch: Time
    ra: Quantity
    dec: Quantity
    semi_major: Quantity
    semi_minor: Quantity
    V: float | None
    fallen: float
    contours: Mapping[str, tuple[Quantity, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Corridor(Typed):
    """Corridor.

    Parameters
    ----------
    longitude : deg.
    latitude : deg.
    entry : km.
    speed : km / s.
    elevation : deg.
    contours : deg.
    n_points : what the name says.
    """

    longitude: Spread
    latitude: Spread
    entry: Quantity
    speed: Spread
    elevation: Spread
    n_points: int
    contours: Mapping[str, tuple[Quantity, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class History(Typed):
    """History.

    Parameters
    ----------
    epoch : UTC.
    range : au.
    n_observations, effective_nodes, sigma_log_range, chances, corridor : what the name says.
    """

    n_observations: int
    epoch: Time
    effective_nodes: float
    sigma_log_range: float
    range: Quantity
    chances: ByPrior
    corridor: Corridor | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Crossing(Typed):
    """Crossing.

    Parameters
    ----------
    threshold, chance : what the name says.
    """

    threshold: float
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Decision(Typed):
    """Decision.

    Parameters
    ----------
    epoch : UTC.
    sigma : arcsec.
    telescope, n_truths, quantiles, falls_below, rises_above, settles : what the name says.
    """

    telescope: str
    epoch: Time
    sigma: Quantity
    n_truths: int
    quantiles: Spread
    falls_below: Crossing
    rises_above: Crossing
    settles: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Truth(Typed):
    """Truth.

    Parameters
    ----------
    range : au.
    rate : km / s.
    """

    range: Quantity
    rate: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AlertSummary(Typed):
    """Alert summary.

    Parameters
    ----------
    first : UTC.
    last : UTC.
    arc : h.
    reference_epoch : TDB.
    within : d.
    smallest : m.
    probability : none where no drawn orbit hits.
    low : 95 % interval.
    bound : no drawn orbit hits, or too few for a value: the probability is below high.
    scores : shares of the posterior; no probabilities.
    equivalent : linear measurement y = H x + v, v of covariance R, of x = ln(range/au), range rate km/s, offsets
        rad, rates rad/s at the reference epoch.
    truth : of a simulated mission.
    schema_version, kind, title, object, n_observations, rejected, stations, status : what the name says.
    orbit_status, message, bound_to_the_sun, V, headline, high, hits, by_prior, moon : what the name says.
    impact, quantities, regions, grid, draws, fields, history, decisions, ended, warnings : what the name says.
    """

    SCHEMA: ClassVar[str] = "results/alert.schema.json"
    schema_version: int
    kind: Literal["alert"]
    title: str
    object: str
    n_observations: int
    rejected: tuple[Rejected, ...]
    stations: tuple[str, ...]
    first: Time
    last: Time
    arc: Quantity
    status: Literal["answered", "few_nodes"]
    orbit_status: Literal["observable", "not_observable"]
    message: str
    reference_epoch: Time
    within: Quantity
    bound_to_the_sun: bool
    smallest: Quantity
    V: float | None
    headline: Literal["uniform"]
    probability: float | None
    low: float
    high: float
    bound: bool
    hits: int
    by_prior: ByPrior
    moon: Chance | None
    impact: Impact | None
    scores: Scores
    quantities: Quantities
    regions: Mapping[str, Regions]
    grid: Grid
    draws: Draws
    equivalent: Equivalent
    fields: tuple[Field, ...]
    history: tuple[History, ...]
    decisions: tuple[Decision, ...]
    truth: Truth | None
    ended: None
    warnings: tuple[str, ...]
