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
    name, sha256 : what the name says.
    """

    name: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Versions(Typed):
    """Versions.

    Parameters
    ----------
    nebosvod, numpy : what the name says.
    """

    nebosvod: str
    numpy: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sample(Typed):
    """Sample.

    Parameters
    ----------
    method, n, seed : what the name says.
    """

    method: Literal["grid", "sobol", "latin"]
    n: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Vary(Typed):
    """Vary.

    Parameters
    ----------
    name, set, unit, numeric, log, n_values, least, largest, values : what the name says.
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
    before : d.
    name, of, unit, shares, n, least, median, largest, leading, title : what the name says.
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
    row, status, message : what the name says.
    """

    row: int
    status: Literal["failed", "no_answer"]
    message: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Seen(Typed):
    """Seen.

    Parameters
    ----------
    interval_95 : (2,).
    where, n, n_seen, share : what the name says.
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
    name, condition : what the name says.
    """

    name: str
    condition: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Find(Typed):
    """Find.

    Parameters
    ----------
    objective, direction, cost, where, n_feasible, found, row, values, reason : what the name says.
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
    objective, against, condition, limit, rows : what the name says.
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
    answer, at_least, at_largest : what the name says.
    """

    answer: str
    at_least: float
    at_largest: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Each(Typed):
    """Each.

    Parameters
    ----------
    name, set, unit, now, needed, floor, without, matters, verdict, no_better_below : what the name says.
    no_worse_above : what the name says.
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
    values, answer, cost, cost_equally, converged : what the name says.
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
    D0 : (6, 6).
    sigma : arcsec.
    sigma_position : km.
    n, n_needed, n_where_equal, floor, D0_names, components : what the name says.
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
    answer, wanted, limit, now, cost, evaluations, each, together, averaging : what the name says.
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
    first_order_interval_95 : (2,).
    total_interval_95 : (2,).
    name, first_order, total : what the name says.
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
    answer, n, n_left_out, indices : what the name says.
    """

    answer: str
    n: int
    n_left_out: int
    indices: tuple[Index, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PopulationSeen(Typed):
    """Population seen.

    Parameters
    ----------
    interval_95 : (2,).
    where, group, n, k, share : what the name says.
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
    before : d.
    where, answer, unit, n, n_with, p05, p25, p50, p75, p95 : what the name says.
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
    interval_95 : (2,).
    n, k, share : what the name says.
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
    interval_95 : (2,).
    value : what the name says.
    """

    value: float
    interval_95: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Warned(Typed):
    """Warned.

    Parameters
    ----------
    before : d.
    where, impactors, misses, false_per_impactor : what the name says.
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
    answer, at_least : what the name says.
    """

    answer: str
    at_least: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Population(Typed):
    """Population.

    Parameters
    ----------
    n_impactors, n_misses, draws, shared, seen, numbers, warned, warning : what the name says.
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
    schema_version, kind, study, title, mission, versions, method, sample, draws, seed : what the name says.
    vary, answers, n_points, n_rows, n_failed, n_without_answer, failures, seen, find : what the name says.
    pareto, slopes, require, sensitivity, shared_errors, n_not_determined, population : what the name says.
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
    population: Population | None
