"""summary.json of nebosvod risk, as dataclasses.

Made from nebosvod/results/risk.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.approaches import Approach, Orbit
from nebosvod.notebook.summaries.typed import Typed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Line(Typed):
    """The line of variations; None where the estimate cannot be flown.

    Parameters
    ----------
    kind : corrected to the observations, or as the covariance has it.
    from_sigmas : signed root of chi squared above the least.
    why_straight : text, or None.
    to_sigmas : a number.
    """

    kind: Literal["curved", "straight"]
    why_straight: str | None
    from_sigmas: float
    to_sigmas: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Way(Typed):
    """Way.

    Parameters
    ----------
    way : linear, line_of_variations, importance_sampling, sampling.
    probability : None where nothing hit: it is below high.
    bound : no hit: only high is known, with 95 %.
    note : what limits it.
    low, high, effective_hits : a number.
    draws, hits : a whole number.
    """

    way: str
    probability: float | None
    low: float
    high: float
    bound: bool
    draws: int
    hits: int
    effective_hits: float
    note: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Bend(Typed):
    """The second order of the line where the hits are, or at one sigma where they are nearer.

    Parameters
    ----------
    aside : by how much it moves the point of the target plane across the line; km.
    along_sigmas : by how much along it.
    matters : whether the linear answer may be off by a tenth and more for it.
    """

    aside: Quantity
    along_sigmas: float
    matters: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Level(Typed):
    """Level.

    Parameters
    ----------
    epoch : mean over the orbits that hit; UTC.
    sigma_time : in s.
    longitude : of the point amid the others, geodetic; None on other bodies than the Earth; deg.
    latitude : in deg.
    semi_major : 1 sigma ellipse on the ground, where the points form one; km.
    semi_minor : in km.
    angle_from_east : of its long axis, towards north; deg.
    no_ellipse : why there is none.
    speed : in km / s.
    below_horizon : in deg.
    """

    epoch: Time
    sigma_time: Quantity
    longitude: Quantity | None
    latitude: Quantity | None
    semi_major: Quantity | None
    semi_minor: Quantity | None
    angle_from_east: Quantity | None
    no_ellipse: str | None
    speed: Quantity
    below_horizon: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Corridor(Typed):
    """Corridor.

    Parameters
    ----------
    grazing_probability : to come below 100 km and not to the ground; not counted as a hit.
    entry_100_km, ground : Level, or None.
    """

    entry_100_km: Level | None
    ground: Level | None
    grazing_probability: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class BudgetRow(Typed):
    """Budget row.

    Parameters
    ----------
    elasticity : d ln P / d ln sigma, the estimate and its weights held.
    elasticity_error : standard error.
    elasticity_reoptimised : d ln P / d ln sigma, the weights solved anew and the selection held: the estimate
        moves; of a fit.
    elasticity_reoptimised_error : standard error.
    log_odds : d ln(P/(1 - P)) / d ln sigma, where P > 0.5.
    share : of the variance along the line, where there is one.
    source : text.
    log_odds_error : a number, or None.
    probability_if_halved, probability_if_halved_error : a number.
    """

    source: str
    elasticity: float
    elasticity_error: float
    elasticity_reoptimised: float | None
    elasticity_reoptimised_error: float | None
    log_odds: float | None
    log_odds_error: float | None
    share: float | None
    probability_if_halved: float
    probability_if_halved_error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Budget(Typed):
    """Budget.

    Parameters
    ----------
    probability : by the weights of the draws: may exceed 1 by their scatter.
    enough : whether the hits are enough for elasticities that can be trusted.
    sigmas : how far along the line the hits are.
    effective_hits : a number.
    rows : several, each BudgetRow.
    """

    probability: float
    effective_hits: float
    enough: bool
    sigmas: float | None
    rows: tuple[BudgetRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class VirtualImpactor(Typed):
    """Virtual impactor.

    Parameters
    ----------
    number : names its arrays: hits_K, xi_zeta_km_K and so on.
    epoch : in TDB.
    sigma_time : in s.
    recommended : the way to go by.
    energy_mt : mt of TNT; None for other bodies than the Earth and without a magnitude.
    sigmas : nu along the line of variations.
    stretching : of one sigma along the line, in the target plane; km.
    bend : the second order; None where the line has no encounter about the estimate.
    v_infinity : of the drawn orbits, median; km / s.
    no_budget : why there is no budget.
    approach : of the estimate itself; None where it has none there.
    body, reason : text.
    probability, palermo : a number, or None.
    low, high : a number.
    bound : true or false.
    ways : several, each Way.
    torino : a whole number, or None.
    corridor : Corridor, or None.
    budget : Budget, or None.
    """

    number: int
    body: str
    epoch: Time
    sigma_time: Quantity
    probability: float | None
    low: float
    high: float
    bound: bool
    recommended: str
    reason: str
    ways: tuple[Way, ...]
    energy_mt: float | None
    palermo: float | None
    torino: int | None
    sigmas: float | None
    stretching: Quantity | None
    bend: Bend | None
    v_infinity: Quantity | None
    corridor: Corridor | None
    budget: Budget | None
    no_budget: str | None
    approach: Approach | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Night(Typed):
    """Night.

    Parameters
    ----------
    until : in UTC.
    recommended : the way that says so.
    semi_major : 1 sigma in the target plane; km.
    semi_minor : in km.
    n_observations : a whole number.
    probability : a number, or None.
    low, high : a number.
    bound : true or false.
    """

    until: Time
    n_observations: int
    probability: float | None
    low: float
    high: float
    bound: bool
    recommended: str | None
    semi_major: Quantity | None
    semi_minor: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class RiskSummary(Typed):
    """Risk summary.

    Parameters
    ----------
    on : from when the years of the Palermo scale count; UTC.
    until : in UTC.
    coordinates : in which the uncertainty is an ellipsoid.
    line : the line of variations; None where the estimate cannot be flown.
    diameter : in km.
    density : in kg / m3.
    size_from : where diameter and density come from.
    sampling : all bodies together.
    history : after each night of the observations, where asked for.
    schema_version, seed, n_draws, n_virtual_impactors : a whole number.
    kind : Literal["risk"].
    title, object : text.
    orbit : Orbit.
    bodies, warnings : several, each ....
    virtual_impactors : several, each VirtualImpactor.
    palermo_cumulative : a number, or None.
    ended : text, or None.
    """

    SCHEMA: ClassVar[str] = "results/risk.schema.json"
    schema_version: int
    kind: Literal["risk"]
    title: str
    object: str
    orbit: Orbit
    on: Time
    until: Time
    bodies: tuple[str, ...]
    seed: int
    n_draws: int
    coordinates: Literal["cartesian", "equinoctial"] | None
    line: Line | None
    diameter: Quantity | None
    density: Quantity | None
    size_from: str | None
    n_virtual_impactors: int
    sampling: Way
    virtual_impactors: tuple[VirtualImpactor, ...]
    palermo_cumulative: float | None
    history: tuple[Night, ...] | None
    ended: str | None
    warnings: tuple[str, ...]
