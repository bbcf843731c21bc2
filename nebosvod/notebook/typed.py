"""The summary of a run or a fit as dataclasses: names instead of keys, quantities with units, moments as Time."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from astropy import units as u
from astropy.time import Time
from astropy.units import Quantity

from nebosvod.borders.quantities import ENDINGS
from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.results.outlook import unit_of

Item = Mapping[str, Any]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Share:
    """What one source contributes to a variance.

    Parameters
    ----------
    share : part of the variance, 0 to 1; sigma : root of its part.
    if_vanished, if_halved : the whole sigma that would remain, the estimator being told of it; None where not known.
    """

    source: str
    share: float
    sigma: Quantity
    if_vanished: Quantity | None
    if_halved: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predicted:
    """One prediction of one estimator.

    Parameters
    ----------
    status : "answered", or why there is none, told by `reason`; numbers are None then.
    epoch : of the prediction; for an encounter its time.
    sigma, sigma_formal : (d,) of each axis, true and as the estimator reports; semi_axes : (d,) of the 1 sigma ellipse.
    angle : of the long axis, from the first axis to the second.
    mean : (d,) of the quantity itself, where it has one; covariance : (d, d), true.
    probability : linear, that it hits; probability_drawn : by drawn orbits.
    budget : largest share first.
    """

    name: str
    estimator: str
    plane: str
    status: str
    reason: str | None
    epoch: Time | None
    semi_axes: Quantity | None
    angle: Quantity | None
    sigma: Quantity | None
    sigma_formal: Quantity | None
    mean: Quantity | None
    covariance: Quantity | None
    probability: float | None
    probability_drawn: float | None
    budget: tuple[Share, ...]

    def __repr__(self) -> str:
        size = "" if self.semi_axes is None else f": {short(self.semi_axes)}"
        return f"<Predicted {self.name}, {self.plane}, by {self.estimator}{size or ': ' + self.status}>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """A parameter beside the state: its estimate with sigma, and the sigma it had before; None where there is none."""

    name: str
    estimate: Quantity | None
    sigma: Quantity | None
    prior_sigma: Quantity | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitEstimate:
    """The orbit that one estimator found, at the reference epoch.

    Parameters
    ----------
    position, velocity : (3,) heliocentric, ICRF; None where there is no solution.
    covariance : (6, 6) in km and km/s, true; covariance_formal : as the estimator reports.
    sigma_position, sigma_velocity : root traces, true; sigma_formal_position : as it reports.
    budget : of the position, largest share first.
    """

    name: str
    method: str
    status: str
    message: str
    iterations: int | None
    chi2: float | None
    dof: int | None
    position: Quantity | None
    velocity: Quantity | None
    covariance: Array | None
    covariance_formal: Array | None
    sigma_position: Quantity | None
    sigma_velocity: Quantity | None
    sigma_formal_position: Quantity | None
    parameters: tuple[Known, ...]
    budget: tuple[Share, ...]

    def __repr__(self) -> str:
        size = "" if self.sigma_position is None else f", position to {short(self.sigma_position)}"
        return f"<OrbitEstimate {self.name}: {self.status}{size}>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Summary:
    """What a run or a fit found; `summary.json` with types.

    Parameters
    ----------
    estimates : in the mission's order; predictions : of all of them.
    warnings : sentences on what is doubtful.
    """

    mission: str
    object: str
    reference_epoch: Time
    n_observations: int
    telescopes: tuple[str, ...]
    estimates: tuple[OrbitEstimate, ...]
    predictions: tuple[Predicted, ...]
    warnings: tuple[str, ...]

    def prediction(self, name: str, estimator: str | None = None) -> Predicted:
        """The prediction of a name, of the first estimator that has it unless one is named.

        Raises
        ------
        KeyError
            If there is none; says which there are.
        """
        for one in self.predictions:
            if one.name == name and estimator in (None, one.estimator):
                return one
        names = dict.fromkeys(one.name for one in self.predictions)
        raise KeyError(f"no prediction {name!r}; there are: {', '.join(names) or 'none'}")

    def __repr__(self) -> str:
        shown = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in ("warnings",)}
        return f"Summary({', '.join(f'{name}={value!r}' for name, value in shown.items())})"


def summary_of(summary: Item) -> Summary:
    """The summary of a run or a fit with types."""
    thing = summary["object"]
    budget = list(summary.get("budget") or ())
    return Summary(
        mission=summary["mission"],
        object=str(thing["name"] if isinstance(thing, Mapping) else thing),
        reference_epoch=moment_of(summary["reference_epoch_tdb"]),
        n_observations=summary["n_observations"],
        telescopes=tuple(t if isinstance(t, str) else str(t["name"]) for t in summary["telescopes"]),
        estimates=tuple(_estimate(row, budget) for row in summary["estimators"]),
        predictions=tuple(_prediction(row) for row in summary.get("predictions") or ()),
        warnings=tuple(summary.get("warnings") or ()),
    )


def short(value: Quantity) -> str:
    """`1870 x 115 km` of a vector, `16.88 km` of a number."""
    unit = value.unit.to_string()
    return f"{' x '.join(f'{one:.4g}' for one in np.atleast_1d(value.value).tolist())} {unit}".rstrip()


def moment_of(text: str) -> Time:
    """A moment of a summary, `2029-04-13T21:46:10.000 TDB`."""
    day, _, scale = text.partition(" ")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # erfa calls every UTC date to come dubious
        return Time(day, format="isot", scale=(scale or "tdb").lower())


def _quantity(row: Item, key: str, unit: str) -> Quantity | None:
    """`key` of a row in the unit its name ends with; None where it has none."""
    value = row.get(f"{key}_{unit}")
    return None if value is None else u.Quantity(value, ENDINGS.get(unit, unit))


def _remaining(then: Item | None, key: str, unit: str) -> Quantity | None:
    """The whole sigma after a remedy, the gain being made anew."""
    value = (then or {}).get(f"{key}_{unit}_new_gain")
    return None if value is None else u.Quantity(value, ENDINGS.get(unit, unit))


def _shares(rows: Iterable[Item], part: str, key: str, unit: str) -> tuple[Share, ...]:
    """A budget, largest share first."""
    made = [
        Share(
            source=row["source"],
            share=row[part],
            sigma=u.Quantity(row[f"{key}_{unit}"], ENDINGS.get(unit, unit)),
            if_vanished=_remaining(row.get("if_vanished"), key, unit),
            if_halved=_remaining(row.get("if_halved"), key, unit),
        )
        for row in rows
        if row.get(f"{key}_{unit}") is not None
    ]
    return tuple(sorted(made, key=lambda one: (-one.share, one.source)))


def _prediction(row: Item) -> Predicted:
    """One row of `predictions`."""
    unit = unit_of(row)
    covariance = matrix_of(row, f"covariance_{unit}2", f"factor_{unit}")
    drawn = row.get("impact_probability_monte_carlo") or {}
    angle = row.get("angle_deg")
    return Predicted(
        name=row["name"],
        estimator=row["estimator"],
        plane=row["plane"],
        status=row.get("status", "answered"),
        reason=row.get("reason"),
        epoch=None if row.get("epoch_tdb") is None else moment_of(row["epoch_tdb"]),
        semi_axes=_quantity(row, "semi_axes", unit),
        angle=None if angle is None else u.Quantity(angle, "deg"),
        sigma=_quantity(row, "sigma", unit),
        sigma_formal=_quantity(row, "sigma_formal", unit),
        mean=_quantity(row, "mean", unit),
        covariance=None if covariance is None else u.Quantity(covariance, u.Unit(ENDINGS.get(unit, unit)) ** 2),
        probability=row.get("impact_probability_linear"),
        probability_drawn=drawn.get("probability"),
        budget=_shares(row.get("budget") or (), "share_total", "sigma_total", unit),
    )


def _known(name: str, row: Item) -> Known:
    """One entry of `parameters`, whose name ends with its unit."""
    ending = next((end for end in sorted(ENDINGS, key=len, reverse=True) if name.endswith(f"_{end}")), "")
    values = {key: row.get(key) for key in ("estimate", "sigma", "prior_sigma")}
    unit = ENDINGS.get(ending, "")
    made = {key: None if value is None else u.Quantity(value, unit) for key, value in values.items()}
    return Known(name=name.removesuffix(f"_{ending}"), **made)


def _estimate(row: Item, budget: Iterable[Item]) -> OrbitEstimate:
    """One row of `estimators`."""
    state = row.get("state_km_km_s")
    mine = [one for one in budget if one["estimator"] == row["name"]]
    return OrbitEstimate(
        name=row["name"],
        method=row["method"],
        status=row["status"],
        message=row.get("message", ""),
        iterations=row.get("iterations"),
        chi2=row.get("chi2"),
        dof=row.get("dof"),
        position=None if state is None else u.Quantity(state[:3], "km"),
        velocity=None if state is None else u.Quantity(state[3:6], "km/s"),
        covariance=matrix_of(row, "covariance_km_km_s", "factor_km_km_s"),
        covariance_formal=matrix_of(row, "covariance_formal_km_km_s", "factor_formal_km_km_s"),
        sigma_position=_quantity(row, "sigma_position", "km"),
        sigma_velocity=_quantity(row, "sigma_velocity", "m_s"),
        sigma_formal_position=_quantity(row, "sigma_formal_position", "km"),
        parameters=tuple(_known(name, one) for name, one in (row.get("parameters") or {}).items()),
        budget=_shares(mine, "share_position", "sigma_position", "km"),
    )
