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
    utc : in UTC.
    station, file : text.
    line : a whole number.
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
    probability : None where no drawn orbit hits.
    low : 95 % interval.
    bound : no drawn orbit hits, or too few for a value: the probability is below high.
    high : a number.
    hits : a whole number.
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
    uniform, cartesian : Chance.
    jeffreys : Chance, or None.
    """

    uniform: Chance
    cartesian: Chance
    jeffreys: Chance | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Spread(Typed):
    """Spread.

    Parameters
    ----------
    q025 : in the unit of the key that holds it.
    q16 : in the unit of the key that holds it.
    median : in the unit of the key that holds it.
    q84 : in the unit of the key that holds it.
    q975 : in the unit of the key that holds it.
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
    epoch : in UTC.
    half_68 : in s.
    longitude : in deg.
    latitude : in deg.
    end : lowest and highest end of the points: drawn, uniform; (2,), km.
    entry : in km.
    speed : in km / s.
    elevation : in deg.
    contours : in deg.
    body : text.
    n_points : a whole number.
    """

    body: str
    epoch: Time
    half_68: Quantity
    longitude: Spread
    latitude: Spread
    end: Quantity
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
    near_earth, main_belt, distant, hyperbolic, earth_satellite, other : a number.
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
    range : in au.
    rate : in km / s.
    a : in au.
    i : in deg.
    q : in au.
    diameter : in m.
    e : Spread.
    H : Spread, or None.
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
    range : in (2,), au.
    rate : in (2,), km / s.
    """

    range: Quantity
    rate: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Effective(Typed):
    """Effective.

    Parameters
    ----------
    uniform, cartesian : a number.
    jeffreys : a number, or None.
    """

    uniform: float
    cartesian: float
    jeffreys: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Grid(Typed):
    """Grid.

    Parameters
    ----------
    n_nodes : a whole number.
    effective : Effective.
    chi2, sigma_log_range : a number.
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
    n, flown, seed : a whole number.
    effective : a number.
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
    y : in (n,).
    H : in (n, n).
    R : in (n, n).
    """

    y: Array
    H: Array
    R: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Field(Typed):
    """Field.

    Parameters
    ----------
    epoch : in UTC.
    ra : in deg.
    dec : in deg.
    semi_major : in arcsec.
    semi_minor : in arcsec.
    altitude : of the middle above the horizon of a site, without refraction; None of other observers; deg.
    sun_altitude : likewise of the Sun's centre; deg.
    elongation : of the middle from the Sun; deg.
    visible : whether the telescope can see the middle; None of the Earth's centre.
    not_seen : every reason why not.
    contours : in deg.
    telescope : text.
    V : a number, or None.
    fallen : a number.
    """

    telescope: str
    epoch: Time
    ra: Quantity
    dec: Quantity
    semi_major: Quantity
    semi_minor: Quantity
    V: float | None
    fallen: float
    altitude: Quantity | None
    sun_altitude: Quantity | None
    elongation: Quantity | None
    visible: bool | None
    not_seen: str | None
    contours: Mapping[str, tuple[Quantity, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Next(Typed):
    """Next.

    Parameters
    ----------
    epoch : in UTC.
    telescope : text.
    """

    telescope: str
    epoch: Time


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Corridor(Typed):
    """Corridor.

    Parameters
    ----------
    longitude : in deg.
    latitude : in deg.
    end : lowest and highest end of the points: drawn, uniform; (2,), km.
    entry : in km.
    speed : in km / s.
    elevation : in deg.
    contours : in deg.
    n_points : a whole number.
    """

    longitude: Spread
    latitude: Spread
    end: Quantity
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
    epoch : in UTC.
    range : in au.
    n_observations : a whole number.
    effective_nodes, sigma_log_range : a number.
    chances : ByPrior.
    corridor : Corridor, or None.
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
    threshold, chance : a number.
    """

    threshold: float
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Decision(Typed):
    """Decision.

    Parameters
    ----------
    epoch : in UTC.
    sigma : in arcsec.
    visible : what cannot be observed is left out; None of the Earth's centre.
    telescope : text.
    n_truths : a whole number.
    quantiles : Spread.
    falls_below, rises_above : Crossing.
    settles, settles_low, settles_high : a number.
    """

    telescope: str
    epoch: Time
    sigma: Quantity
    n_truths: int
    quantiles: Spread
    falls_below: Crossing
    rises_above: Crossing
    settles: float
    settles_low: float
    settles_high: float
    visible: bool | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Truth(Typed):
    """Truth.

    Parameters
    ----------
    range : in au.
    rate : in km / s.
    """

    range: Quantity
    rate: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AlertSummary(Typed):
    """Alert summary.

    Parameters
    ----------
    first : in UTC.
    last : in UTC.
    arc : in h.
    reference_epoch : in TDB.
    within : in d.
    smallest : in m.
    probability : None where no drawn orbit hits.
    low : 95 % interval.
    bound : no drawn orbit hits, or too few for a value: the probability is below high.
    scores : shares of the posterior; no probabilities.
    equivalent : linear measurement y = H x + v, v of covariance R, of x = ln(range/au), range rate km/s, offsets
        rad, rates rad/s at the reference epoch.
    next_visible : where no field can be seen: who can look first after the last observation, and when.
    truth : of a simulated mission.
    schema_version, n_observations, hits : a whole number.
    kind : Literal["alert"].
    title, object, message : text.
    rejected : several, each Rejected.
    stations, warnings : several, each ....
    status : Literal["answered", "few_nodes"].
    orbit_status : Literal["observable", "not_observable"].
    bound_to_the_sun : true or false.
    V : a number, or None.
    headline : Literal["uniform"].
    high : a number.
    by_prior : ByPrior.
    moon : Chance, or None.
    impact : Impact, or None.
    quantities : Quantities.
    regions : by name, Regions.
    grid : Grid.
    draws : Draws.
    fields : several, each Field.
    history : several, each History.
    decisions : several, each Decision.
    ended : None.
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
    next_visible: Next | None
    history: tuple[History, ...]
    decisions: tuple[Decision, ...]
    truth: Truth | None
    ended: None
    warnings: tuple[str, ...]
