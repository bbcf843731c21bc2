"""nebosvod study result, as dataclasses.

Made from nebosvod/studies/study.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from astropy.units import Quantity

from nebosvod.notebook.summaries.typed import Typed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Mission(Typed):
    """Mission.

    Parameters
    ----------
    name, sha256 : text.
    """

    name: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Versions(Typed):
    """Versions.

    Parameters
    ----------
    nebosvod, numpy : text.
    """

    nebosvod: str
    numpy: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sample(Typed):
    """Sample.

    Parameters
    ----------
    method : Literal["grid", "sobol", "latin"].
    n, seed : a whole number.
    """

    method: Literal["grid", "sobol", "latin"]
    n: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Vary(Typed):
    """Vary.

    Parameters
    ----------
    name, unit : text.
    set : several, each ....
    numeric, log : true or false.
    n_values : a whole number.
    least, largest : a number, or None.
    values : several, each str | float | None, or None.
    """

    name: str
    set: tuple[str, ...]
    unit: str
    numeric: bool
    log: bool
    n_values: int
    least: float | None
    largest: float | None
    values: tuple[str | float | None, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Answer(Typed):
    """Answer.

    Parameters
    ----------
    before : in d.
    name, of, unit : text.
    shares : true or false.
    n : a whole number, or None.
    least, median, largest : a number, or None.
    leading : by name, a whole number, or None.
    title : text, or None.
    """

    name: str
    of: str
    unit: str
    shares: bool
    n: int | None
    least: float | None
    median: float | None
    largest: float | None
    leading: Mapping[str, int] | None
    title: str | None
    before: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Failure(Typed):
    """Failure.

    Parameters
    ----------
    row : a whole number.
    status : Literal["failed", "no_answer"].
    message : text.
    """

    row: int
    status: Literal["failed", "no_answer"]
    message: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Seen(Typed):
    """Seen.

    Parameters
    ----------
    interval_95 : in (2,).
    where : by name, str | float | None.
    n, n_seen : a whole number.
    share : a number.
    """

    where: Mapping[str, str | float | None]
    n: int
    n_seen: int
    share: float
    interval_95: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Where(Typed):
    """Where.

    Parameters
    ----------
    name, condition : text.
    """

    name: str
    condition: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Find(Typed):
    """Find.

    Parameters
    ----------
    objective : text.
    direction : Literal["minimise", "maximise"].
    cost, reason : text, or None.
    where : several, each Where.
    n_feasible : a whole number.
    found : true or false.
    row : a whole number, or None.
    values : by name, str | float | None, or None.
    """

    objective: str
    direction: Literal["minimise", "maximise"]
    cost: str | None
    where: tuple[Where, ...]
    n_feasible: int
    found: bool
    row: int | None
    values: Mapping[str, str | float | None] | None
    reason: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Pareto(Typed):
    """Pareto.

    Parameters
    ----------
    objective, against, condition : text.
    limit : a number.
    rows : several, each a whole number.
    """

    objective: str
    against: str
    condition: str
    limit: float
    rows: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Slope(Typed):
    """Slope.

    Parameters
    ----------
    answer : text.
    at_least, at_largest : a number.
    """

    answer: str
    at_least: float
    at_largest: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Each(Typed):
    """Each.

    Parameters
    ----------
    name, unit, verdict : text.
    set : several, each ....
    now : a number.
    needed, floor, without, no_better_below, no_worse_above : a number, or None.
    matters : true or false.
    """

    name: str
    set: tuple[str, ...]
    unit: str
    now: float
    needed: float | None
    floor: float | None
    without: float | None
    matters: bool
    verdict: str
    no_better_below: float | None
    no_worse_above: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Together(Typed):
    """Together.

    Parameters
    ----------
    values : by name, a number.
    answer : a number, or None.
    cost, cost_equally : a number.
    converged : true or false.
    """

    values: Mapping[str, float]
    answer: float | None
    cost: float
    cost_equally: float
    converged: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Averaging(Typed):
    """Averaging.

    Parameters
    ----------
    D0 : in (6, 6).
    sigma : in arcsec.
    sigma_position : in km.
    n, components : a whole number.
    n_needed, n_where_equal, floor : a number, or None.
    D0_names : several, each ....
    """

    n: int
    n_needed: float | None
    n_where_equal: float | None
    floor: float | None
    D0: Array
    D0_names: tuple[str, ...]
    sigma: Quantity
    components: int
    sigma_position: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Require(Typed):
    """Require.

    Parameters
    ----------
    answer, wanted : text.
    limit : a number.
    now : a number, or None.
    cost : text, or None.
    evaluations : a whole number.
    each : several, each Each.
    together : Together, or None.
    averaging : Averaging, or None.
    """

    answer: str
    wanted: str
    limit: float
    now: float | None
    cost: str | None
    evaluations: int
    each: tuple[Each, ...]
    together: Together | None
    averaging: Averaging | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Index(Typed):
    """Index.

    Parameters
    ----------
    first_order_interval_95 : in (2,).
    total_interval_95 : in (2,).
    name : text.
    first_order, total : a number.
    """

    name: str
    first_order: float
    first_order_interval_95: Array
    total: float
    total_interval_95: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sensitivity(Typed):
    """Sensitivity.

    Parameters
    ----------
    answer : text.
    n, n_left_out : a whole number.
    indices : several, each Index.
    """

    answer: str
    n: int
    n_left_out: int
    indices: tuple[Index, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Paired(Typed):
    """Paired.

    Parameters
    ----------
    interval_95 : in (2,).
    where, than : by name, Any.
    n, only_first, only_here : a whole number.
    difference, p : a number.
    """

    where: Mapping[str, Any]
    than: Mapping[str, Any]
    n: int
    only_first: int
    only_here: int
    difference: float
    interval_95: Array
    p: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PopulationSeen(Typed):
    """Population seen.

    Parameters
    ----------
    interval_95 : in (2,).
    where : by name, Any.
    group : text.
    n, k : a whole number.
    share : a number, or None.
    """

    where: Mapping[str, Any]
    group: str
    n: int
    k: int
    share: float | None
    interval_95: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Number(Typed):
    """Number.

    Parameters
    ----------
    before : in d.
    where : by name, Any.
    answer, unit : text.
    n, n_with : a whole number.
    p05, p25, p50, p75, p95 : a number, or None.
    """

    where: Mapping[str, Any]
    answer: str
    unit: str
    before: Quantity | None
    n: int
    n_with: int
    p05: float | None
    p25: float | None
    p50: float | None
    p75: float | None
    p95: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Impactors(Typed):
    """Impactors.

    Parameters
    ----------
    interval_95 : in (2,).
    n, k : a whole number.
    share : a number, or None.
    """

    n: int
    k: int
    share: float | None
    interval_95: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FalsePerImpactor(Typed):
    """False per impactor.

    Parameters
    ----------
    interval_95 : in (2,).
    value : a number.
    """

    value: float
    interval_95: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Warned(Typed):
    """Warned.

    Parameters
    ----------
    before : in d.
    where : by name, Any.
    impactors : Impactors.
    misses : Impactors, or None.
    false_per_impactor : FalsePerImpactor, or None.
    """

    where: Mapping[str, Any]
    before: Quantity | None
    impactors: Impactors
    misses: Impactors | None
    false_per_impactor: FalsePerImpactor | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PopulationWarning(Typed):
    """Population warning.

    Parameters
    ----------
    answer : text.
    at_least : a number.
    """

    answer: str
    at_least: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Population(Typed):
    """Population.

    Parameters
    ----------
    n_impactors, n_misses, draws : a whole number.
    shared : true or false.
    seen : several, each PopulationSeen.
    numbers : several, each Number.
    warned : several, each Warned.
    warning : PopulationWarning, or None.
    """

    n_impactors: int
    n_misses: int
    draws: int
    shared: bool
    seen: tuple[PopulationSeen, ...]
    numbers: tuple[Number, ...]
    warned: tuple[Warned, ...]
    warning: PopulationWarning | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StudySummary(Typed):
    """Study summary.

    Parameters
    ----------
    schema_version, draws, seed, n_points, n_rows, n_failed, n_without_answer : a whole number.
    kind : Literal["study"].
    study, title, method : text.
    mission : Mission.
    versions : Versions.
    sample : Sample.
    vary : several, each Vary.
    answers : several, each Answer.
    failures : several, each Failure.
    seen : several, each Seen.
    find : Find, or None.
    pareto : Pareto, or None.
    slopes : several, each Slope.
    require : Require, or None.
    sensitivity : several, each Sensitivity.
    shared_errors : true or false, or None.
    n_not_determined : a whole number, or None.
    paired : several, each Paired, or None.
    population : Population, or None.
    """

    SCHEMA: ClassVar[str] = "studies/study.schema.json"
    schema_version: int
    kind: Literal["study"]
    study: str
    title: str
    mission: Mission
    versions: Versions
    method: str
    sample: Sample
    draws: int
    seed: int
    vary: tuple[Vary, ...]
    answers: tuple[Answer, ...]
    n_points: int
    n_rows: int
    n_failed: int
    n_without_answer: int
    failures: tuple[Failure, ...]
    seen: tuple[Seen, ...]
    find: Find | None
    pareto: Pareto | None
    slopes: tuple[Slope, ...]
    require: Require | None
    sensitivity: tuple[Sensitivity, ...]
    shared_errors: bool | None
    n_not_determined: int | None
    paired: tuple[Paired, ...] | None
    population: Population | None
