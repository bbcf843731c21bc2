"""A prediction with its error: ellipse, largest deviation, chance of impact, budget; or why there is none."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.facts import Disc, Facts
from nebosvod.engine.fitting import Fit
from nebosvod.engine.mean_errors import NONE, MeanErrors
from nebosvod.engine.quantity import SIGMAS, Quantity, known_columns, known_partials
from nebosvod.estimation import Estimate
from nebosvod.estimation.accuracy import ellipse
from nebosvod.estimation.accuracy.inside import inside_disc
from nebosvod.findings.blame import QuantityShare, Worlds, quantity_shares
from nebosvod.findings.drawn import DrawnSpread, HitShare
from nebosvod.findings.foretold import Missing
from nebosvod.findings.nonlinearity import Nonlinearity
from nebosvod.mission.request import Prediction as Request
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
INSIDE = (0.5, 0.9, 0.99)  # probabilities of the ellipses beside those of 1, 2 and 3 sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Level:
    """An ellipsoid by its size in sigmas, and the probability inside."""

    sigma: float
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answered:
    """A prediction that exists, d components in the unit of its quantity, as one estimator knows it.

    Attributes
    ----------
    semi_axes : (d,) of the 1 sigma ellipsoid, largest first; angle_deg : in a plane, of the long one from the first
        axis to the second; None otherwise.
    sigma, sigma_formal : (d,) in truth, and as the estimator believes.
    mean_error : (d,) mean of predicted minus true value.
    max_deviation : (d,) |mean| + 3 sigma, with the mean shift of the second order.
    factor, factor_formal : (d, d) lower triangular, of the true covariance and of the one believed.
    sigma_time_s, sigma_longitude_deg, sigma_latitude_deg : of an encounter or an entry; None where there is none.
    impact_probability : linear; None where the prediction is about no encounter with a b-plane.
    drawn, drawn_impacts : what orbits drawn from the error do; None where none were drawn.
    """

    quantity: Quantity
    estimator: str
    semi_axes: Array
    angle_deg: float | None
    sigma: Array
    sigma_formal: Array
    mean_error: Array
    max_deviation: Array
    factor: Array
    factor_formal: Array
    nonlinearity: Nonlinearity
    budget: tuple[QuantityShare, ...]
    sigma_time_s: float | None
    sigma_longitude_deg: float | None
    sigma_latitude_deg: float | None
    impact_probability: float | None
    drawn: DrawnSpread | None = None
    drawn_impacts: HitShare | None = None

    @property
    def request(self) -> Request:
        """What was asked."""
        return self.quantity.request

    @property
    def facts(self) -> Facts | None:
        """What is known of it beside its error."""
        return self.quantity.facts

    @property
    def levels(self) -> tuple[Level, ...]:
        """Ellipsoids of 1, 2, 3 sigma, and those that hold INSIDE."""
        size = len(self.sigma)
        wanted = (1.0, 2.0, 3.0, *(ellipse.level_of(inside, size) for inside in INSIDE))
        return tuple(Level(sigma=sigma, probability=ellipse.probability(sigma, size)) for sigma in wanted)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unanswered:
    """A prediction that does not exist for the orbit of one estimator; its chance of impact where that is known."""

    missing: Missing
    estimator: str
    impact_probability: float | None

    @property
    def request(self) -> Request:
        """What was asked."""
        return self.missing.request

    @property
    def facts(self) -> Facts | None:
        """What is known all the same."""
        return self.missing.facts


Prediction = Answered | Unanswered


def answered(
    asked: Quantity,
    estimate: Estimate,
    estimator: str,
    budget: Sequence[QuantityShare],
    curved: Nonlinearity,
    mean_errors: MeanErrors = NONE,
) -> Answered:
    """The error of a quantity: true and formal covariance, ellipse, chance of impact.

    Parameters
    ----------
    mean_errors : what is off on average from what the estimator assumes.

    Notes
    -----
    |M(w)| + 3 sigma bounds the deviation. With the error e of the estimate, w(x) = w(x + e) - W e + 1/2 e^T C e:
    predicted minus true is on average W M(e) less the shift of the second order.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (3.5).
    """
    W, names = known_partials(asked, estimate)
    off = W @ mean_errors.shift(estimate, names)
    shift = off if curved.mean_shift is None else off - curved.mean_shift
    found = estimate.predict(W, names)
    semi_axes, angle_deg = _shape(found.factor)
    longitude, latitude = (None, None) if asked.ground_partials is None else asked.ground_partials
    return Answered(
        quantity=asked,
        estimator=estimator,
        semi_axes=semi_axes,
        angle_deg=angle_deg,
        sigma=found.sigma,
        sigma_formal=found.sigma_formal,
        mean_error=off,
        max_deviation=ellipse.maximum_deviation(shift, found.sigma, SIGMAS),
        factor=found.factor,
        factor_formal=found.factor_formal,
        nonlinearity=curved,
        budget=tuple(budget),
        sigma_time_s=_sigma(asked, asked.time_partials, estimate),
        sigma_longitude_deg=_sigma(asked, longitude, estimate),
        sigma_latitude_deg=_sigma(asked, latitude, estimate),
        impact_probability=_impact_probability(asked, found.factor, off, estimate, mean_errors),
    )


def unanswered(
    missing: Missing, estimate: Estimate | None, estimator: str, mean_errors: MeanErrors = NONE
) -> Unanswered:
    """What does not exist for the orbit of an estimator; `estimate` is None where there is no orbit at all."""
    chance = None
    if missing.disc is not None and estimate is not None:
        chance = chance_of(missing.disc, missing.names, estimate, mean_errors)
    return Unanswered(missing=missing, estimator=estimator, impact_probability=chance)


def of_fit(
    scene: Scene,
    fit: Fit,
    worlds: Worlds | None,
    found: Sequence[Quantity],
    missing: Sequence[Missing],
    curved: Sequence[Nonlinearity],
) -> list[Prediction]:
    """Every prediction of one estimator, in the order in which the mission asks for them.

    Parameters
    ----------
    worlds : of its estimate; None where that has no solution, and `found` is empty.
    curved : of each of those found.
    """
    name, estimate = fit.estimator.name, None if worlds is None else fit.estimate
    rows: list[Prediction] = [unanswered(one, estimate, name, fit.mean_errors) for one in missing]
    if worlds is not None:
        rows += [
            answered(asked, fit.estimate, name, quantity_shares(scene, worlds, asked), bend, fit.mean_errors)
            for asked, bend in zip(found, curved)
        ]
    return in_order(rows, scene.mission.predictions)


def existing(rows: Iterable[Prediction]) -> list[Answered]:
    """Those that exist."""
    return [row for row in rows if isinstance(row, Answered)]


def in_order(rows: Sequence[Prediction], requests: Sequence[Request]) -> list[Prediction]:
    """Those of one estimator in the order in which a mission asks for them."""
    place = {request.name: index for index, request in enumerate(requests)}
    return sorted(rows, key=lambda row: place[row.request.name])


def chance_of(disc: Disc, names: Sequence[str], estimate: Estimate, mean_errors: MeanErrors) -> float:
    """Chance of impact: a normal distribution on the b-plane, over the disc whose orbits hit the body."""
    W, known = known_columns(disc.partials, names, estimate)
    centre = disc.value - W @ mean_errors.shift(estimate, known)
    return inside_disc(centre, estimate.predict(W, known).factor, disc.radius_km)


def _impact_probability(
    asked: Quantity, factor: Array, off: Array, estimate: Estimate, mean_errors: MeanErrors
) -> float | None:
    """Linear: a normal distribution on the plane, over the disc whose orbits hit.

    Of another plane than the b-plane only where there is no b-plane: near a body the crossing of it is not normal.
    """
    radius_km = None if asked.encounter is None else asked.encounter.capture_radius_km
    own = asked.request.plane == "b_plane" or asked.disc is None
    if asked.value is not None and radius_km is not None and own:
        return inside_disc(asked.value - off, factor, radius_km)
    return None if asked.disc is None else chance_of(asked.disc, asked.names, estimate, mean_errors)


def _sigma(asked: Quantity, partials: Array | None, estimate: Estimate) -> float | None:
    """1 sigma of a further number with partials (k,) by the names of a quantity."""
    if partials is None:
        return None
    return float(estimate.predict(*known_columns(partials[None], asked.names, estimate)).sigma[0])


def _shape(factor: Array) -> tuple[Array, float | None]:
    """Semi-axes, largest first, and in a plane the angle of the long one from the first axis to the second, deg."""
    if factor.shape[0] == 2:
        plane = ellipse.Ellipse.of_factor(factor)
        return np.array(plane.semi_axes), float(np.degrees(plane.angle_rad))
    return np.asarray(np.linalg.svd(factor, compute_uv=False)), None
