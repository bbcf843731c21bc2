"""JSON of nebosvod plan, as dataclasses.

Made from nebosvod/planning/plan.schema.json by tools/summaries.py: change that, then `make schema`.
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
class Prediction(Typed):
    """Prediction.

    Parameters
    ----------
    epoch : epoch, TDB; TDB.
    name, plane : text.
    """

    name: str
    plane: str
    epoch: Time


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sigma(Typed):
    """Sigma.

    Parameters
    ----------
    a : root trace of the prediction's covariance.
    d : geometric mean of its semi-axes.
    minimax : largest sigma of a component whatever the correlation of the errors.
    guaranteed : largest error of a component with every error within three sigmas.
    """

    a: float
    d: float
    minimax: float | None
    guaranteed: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Visit(Typed):
    """Visit.

    Parameters
    ----------
    epoch : epoch, TDB; TDB.
    telescope : text.
    sigma_after, reduction_percent : Sigma.
    """

    telescope: str
    epoch: Time
    sigma_after: Sigma
    reduction_percent: Sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class BestNext(Typed):
    """Best next.

    Parameters
    ----------
    a, d : Visit.
    minimax, guaranteed : Visit, or None.
    """

    a: Visit
    d: Visit
    minimax: Visit | None
    guaranteed: Visit | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Window(Typed):
    """Window.

    Parameters
    ----------
    epoch : epoch, TDB; TDB.
    window : epochs around the best with at least 90 % of its gain; TDB.
    visible : first and last candidate epoch of each time without a gap in which the object is seen; TDB.
    telescope : text.
    sigma_after, reduction_percent : Sigma.
    reduction_per_hour : a number.
    """

    telescope: str
    epoch: Time
    sigma_after: Sigma
    reduction_percent: Sigma
    window: Time
    visible: Time
    reduction_per_hour: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Step(Typed):
    """Step.

    Parameters
    ----------
    epoch : epoch, TDB; TDB.
    telescope : text.
    sigma_after : Sigma.
    """

    telescope: str
    epoch: Time
    sigma_after: Sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Greedy(Typed):
    """Greedy.

    Parameters
    ----------
    a, d : several, each Step.
    minimax, guaranteed : several, each Step, or None.
    """

    a: tuple[Step, ...]
    d: tuple[Step, ...]
    minimax: tuple[Step, ...] | None
    guaranteed: tuple[Step, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SigmaAfter(Typed):
    """Sigma after.

    Parameters
    ----------
    a : in (n,).
    d : in (n,).
    minimax : in (n,).
    guaranteed : in (n,).
    """

    a: Array
    d: Array
    minimax: Array | None
    guaranteed: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Curve(Typed):
    """Curve.

    Parameters
    ----------
    epoch_s : in (n,), s.
    epoch : in TDB.
    telescope : text.
    sigma_after : SigmaAfter.
    """

    telescope: str
    epoch_s: Quantity
    epoch: Time
    sigma_after: SigmaAfter


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PlanSummary(Typed):
    """Plan summary.

    Parameters
    ----------
    mission_sha256 : hash of the mission's text.
    unit : of every sigma.
    n_observations : measurements of the mission itself.
    n_candidates : visits that could be made.
    exposures : of each visit.
    spacing : from one exposure of a visit to the next; s.
    visit_hours : time of a visit by telescope.
    sigma_of_all_candidates : the bound of criteria minimax and guaranteed with all candidates: no choice of visits
        passes it.
    windows : the best visit of each telescope, best first.
    never_visible : telescopes that see the object at no candidate epoch.
    uniform : as many visits at even times, the telescopes in turn.
    schema_version : a whole number.
    mission, title, object, estimator : text.
    prediction : Prediction.
    criterion : Literal["a", "d", "minimax", "guaranteed"].
    sigma_now : Sigma.
    best_next : BestNext.
    greedy : Greedy.
    curves : several, each Curve.
    warnings : several, each ....
    """

    SCHEMA: ClassVar[str] = "planning/plan.schema.json"
    schema_version: int
    mission: str
    mission_sha256: str | None
    title: str
    object: str
    prediction: Prediction
    unit: Literal["km", "arcsec", "m_s"]
    estimator: str
    criterion: Literal["a", "d", "minimax", "guaranteed"]
    n_observations: int
    n_candidates: int
    exposures: int
    spacing: Quantity
    visit_hours: Mapping[str, float]
    sigma_now: Sigma
    sigma_of_all_candidates: float | None
    best_next: BestNext
    windows: tuple[Window, ...]
    never_visible: tuple[str, ...]
    greedy: Greedy
    uniform: tuple[Step, ...]
    curves: tuple[Curve, ...]
    warnings: tuple[str, ...]
