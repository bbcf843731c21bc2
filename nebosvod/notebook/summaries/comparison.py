"""JSON of nebosvod compare, as dataclasses.

Made from nebosvod/results/comparison.schema.json by tools/summaries.py: change that, then `make schema`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from astropy.time import Time
from astropy.units import Quantity

from nebosvod.notebook.summaries.typed import Typed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Run(Typed):
    """Run.

    Parameters
    ----------
    reference_epoch : epoch, TDB; TDB.
    label, path, nebosvod, estimator, mission, title, object : text.
    n_observations : a whole number.
    telescopes : several, each ....
    """

    label: str
    path: str
    nebosvod: str
    estimator: str
    mission: str
    title: str
    object: str
    reference_epoch: Time
    n_observations: int
    telescopes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ByRun(Typed):
    """By run.

    Parameters
    ----------
    sigma_position : in km.
    sigma_velocity : in m / s.
    sigma_formal_position : in km.
    method, status : text.
    """

    method: str
    status: str
    sigma_position: Quantity | None
    sigma_velocity: Quantity | None
    sigma_formal_position: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Estimator(Typed):
    """Estimator.

    Parameters
    ----------
    ratio_position : to the first run that has it; (n,).
    name : text.
    by_run : several, each ByRun | None.
    """

    name: str
    by_run: tuple[ByRun | None, ...]
    ratio_position: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PredictionByRun(Typed):
    """Prediction by run.

    Parameters
    ----------
    epoch : epoch, TDB; TDB.
    sigma : in (n,).
    sigma_total : root trace.
    semi_axes : in (n,).
    angle : in deg.
    mean : in (n,).
    covariance : in (n, n).
    factor : in (n, n).
    estimator : text.
    unit : Literal["km", "arcsec", "m_s"].
    sigma_formal_total : a number.
    """

    estimator: str
    epoch: Time
    unit: Literal["km", "arcsec", "m_s"]
    sigma: Array
    sigma_total: float
    sigma_formal_total: float
    semi_axes: Array
    angle: Quantity | None
    mean: Array
    covariance: Array | None
    factor: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Budget(Typed):
    """Budget.

    Parameters
    ----------
    share : of the variance, by run; (n,).
    source : text.
    """

    source: str
    share: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Prediction(Typed):
    """Prediction.

    Parameters
    ----------
    ratio : to the first run that has it; (n,).
    name, warning : text.
    plane, unit : text, or None.
    dimension : a whole number.
    comparable : true or false.
    by_run : several, each PredictionByRun | None.
    budget : several, each Budget.
    """

    name: str
    plane: str | None
    unit: str | None
    dimension: int
    comparable: bool
    warning: str
    by_run: tuple[PredictionByRun | None, ...]
    ratio: Array
    budget: tuple[Budget, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class EllipseByRun(Typed):
    """Ellipse by run.

    Parameters
    ----------
    mean : in (n,).
    covariance : in (n, n).
    semi_axes : in (n,).
    angle : in deg.
    factor : in (n, n).
    """

    mean: Array
    covariance: Array | None
    semi_axes: Array
    angle: Quantity | None
    factor: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ellipse(Typed):
    """Ellipse.

    Parameters
    ----------
    by_run : in (n,).
    name : text.
    plane, unit : text, or None.
    sigma_level : a number.
    """

    name: str
    plane: str | None
    unit: str | None
    sigma_level: float
    by_run: tuple[EllipseByRun | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ComparisonSummary(Typed):
    """Comparison summary.

    Parameters
    ----------
    warnings : what makes numbers of these runs answers to different questions.
    budget : of the position at the reference epoch, by the first estimator of each run.
    schema_version : a whole number.
    runs : several, each Run.
    estimators : several, each Estimator.
    predictions : several, each Prediction.
    ellipses : several, each Ellipse.
    """

    SCHEMA: ClassVar[str] = "results/comparison.schema.json"
    schema_version: int
    runs: tuple[Run, ...]
    warnings: tuple[str, ...]
    estimators: tuple[Estimator, ...]
    predictions: tuple[Prediction, ...]
    budget: tuple[Budget, ...]
    ellipses: tuple[Ellipse, ...]
