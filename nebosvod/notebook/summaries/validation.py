"""validation.json of a nebosvod validation, as dataclasses.

Made from nebosvod/studies/validation.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from astropy.time import Time

from nebosvod.notebook.summaries.typed import Typed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Nees(Typed):
    """Mean normalised squared error of the state over 6.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    """

    value: float
    p: float
    rejected: bool
    interval: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Coverage(Typed):
    """Coverage.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    value_interval_99 : in (2,).
    fraction : a number.
    """

    value: float
    p: float
    rejected: bool
    interval: Array
    fraction: float
    value_interval_99: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Whitened(Typed):
    """Whitened.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    component : a whole number.
    """

    value: float
    p: float
    rejected: bool
    interval: Array
    component: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Direction(Typed):
    """Direction.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    group : position, velocity, parameter or the name of a prediction.
    sigma_sample : root mean square error of the runs.
    optimism_percent : sample sigma over claimed sigma, less one; positive: the claim is too small.
    name, unit : text.
    sigma_claimed, mean_error : a number.
    """

    value: float
    p: float
    rejected: bool
    interval: Array
    group: str
    name: str
    unit: str
    sigma_claimed: float
    sigma_sample: float
    mean_error: float
    optimism_percent: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Prediction(Typed):
    """Prediction.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    group : text.
    """

    value: float
    p: float
    rejected: bool
    interval: Array
    group: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Nis(Typed):
    """Nis.

    Parameters
    ----------
    value : 1 when the claim is right: a mean normalised square, or a fraction of runs.
    p : probability of so unlikely a value when the claim is right.
    rejected : by Holm's rule at the family level.
    interval : where the value lies when the claim is right, at Bonferroni's level; (2,).
    telescope : text.
    """

    value: float
    p: float
    rejected: bool
    interval: Array
    telescope: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class NeesQuantiles(Typed):
    """For a figure: NEES of the runs against chi-square.

    Parameters
    ----------
    probability : in (n,).
    sample : in (n,).
    chi_square : in (n,).
    """

    probability: Array
    sample: Array
    chi_square: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Judgement(Typed):
    """Judgement.

    Parameters
    ----------
    claimed : whether the estimator says this covariance is its accuracy; a claim that fails fails the campaign.
    resolution_percent : a sigma wrong by so much is seen in every second campaign.
    nees : mean normalised squared error of the state over 6.
    cramer_von_mises : NEES against chi-square.
    whitened : variance of each whitened component of the state on radial, transverse, normal axes, position first.
    predictions : predictions of several components as a whole.
    nis : normalised innovations squared of each telescope, over their components.
    nees_quantiles : for a figure: NEES of the runs against chi-square.
    consistent : true or false.
    verdict : text.
    family_level : a number.
    n_tests, n_rejected : a whole number.
    coverage : several, each Coverage.
    directions : several, each Direction.
    """

    claimed: bool
    consistent: bool
    verdict: str
    family_level: float
    n_tests: int
    n_rejected: int
    resolution_percent: float
    nees: Nees
    cramer_von_mises: Nees
    coverage: tuple[Coverage, ...]
    whitened: tuple[Whitened, ...]
    directions: tuple[Direction, ...]
    predictions: tuple[Prediction, ...]
    nis: tuple[Nis, ...]
    nees_quantiles: NeesQuantiles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Judged(Typed):
    """Judged.

    Parameters
    ----------
    true, formal : Judgement, or None.
    """

    true: Judgement | None
    formal: Judgement | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Estimator(Typed):
    """Estimator.

    Parameters
    ----------
    left_out : sources considered or ignored.
    reason : why it did not pass.
    n_failed : runs without an estimate.
    check_sigma : largest difference, in sigmas, between one factorisation for all runs and the estimator's own
        method; None in full mode.
    name, method, status : text.
    claims_formal, passed : true or false.
    judged : Judged.
    """

    name: str
    method: str
    status: str
    left_out: tuple[str, ...]
    claims_formal: bool
    passed: bool
    reason: str
    n_failed: int
    check_sigma: float | None
    judged: Judged


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ValidationSummary(Typed):
    """Validation summary.

    Parameters
    ----------
    reference_epoch : in TDB.
    second_order_sigma : what one linear step leaves out, in sigmas of the estimate; None where it leads to no
        orbit. From 0.05 on estimates are iterated.
    schema_version, n_observations, seed, n_runs : a whole number.
    mission, title, object, mission_sha256, method, verdict : text.
    telescopes : several, each ....
    versions : by name, text.
    mode : Literal["linear", "full"].
    family_level : a number.
    passed : true or false.
    estimators : several, each Estimator.
    """

    SCHEMA: ClassVar[str] = "studies/validation.schema.json"
    schema_version: int
    mission: str
    title: str
    object: str
    reference_epoch: Time
    n_observations: int
    telescopes: tuple[str, ...]
    versions: Mapping[str, str]
    mission_sha256: str
    seed: int
    n_runs: int
    mode: Literal["linear", "full"]
    method: str
    second_order_sigma: float | None
    family_level: float
    passed: bool
    verdict: str
    estimators: tuple[Estimator, ...]
