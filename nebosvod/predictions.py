"""Predicted quantities: what a mission asks to be foretold, with partials by the state and the dynamic parameters.

A quantity is evaluated on one trajectory; its error is the estimator's business (`Estimate.predict`), so every
source of the budget reaches it through the same factors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.errors import CoverageError, NoAnswerError
from nebosvod.estimation import Estimate, ellipse
from nebosvod.estimation.inside import inside_disc
from nebosvod.fitting import Fit
from nebosvod.impact import BELOW_S, what_it_hits
from nebosvod.mission.request import EncounterPrediction, Prediction, SkyPrediction, StatePrediction
from nebosvod.observation import observe
from nebosvod.outlook import ANSWERED
from nebosvod.prior import STATE_NAMES
from nebosvod.scene import Scene
from nebosvod.timescale import Epoch, Scale

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / (180.0 * 3600.0)
M_PER_KM = 1000.0
SIGMAS = 3.0
INSIDE = (0.5, 0.9, 0.99)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quantity:
    """A predicted quantity at its nominal value.

    Attributes
    ----------
    request : what was asked.
    epoch : when it happens (for an encounter: the closest approach).
    unit : of value and partials: "km", "arcsec" or "m_s".
    value : (d,), or None where only the error means anything (sky offsets, RTN axes).
    partials : (d, k) by `names`.
    facts : further numbers for the summary, units in the key names.
    axes : (3, 3) ICRF, rows the axes of a target plane (xi, normal, zeta) or of position and velocity; of an entry
        (2, 3), fixed to the ground; None otherwise.
    anchor : (3,) the point of entry, km, on the axes fixed to the ground; None otherwise.
    further : partials (k,) of further numbers by `names`, under the name of their sigma, unit included.
    disc : where the orbit crosses the b-plane of its encounter, and the disc whose orbits hit the body; None if there
        is no encounter, or no such plane.
    """

    request: Prediction
    epoch: Epoch
    unit: str
    value: Array | None
    partials: Array
    names: tuple[str, ...]
    facts: Mapping[str, Any]
    axes: Array | None = None
    anchor: Array | None = None
    further: Mapping[str, Array] = field(default_factory=dict)
    disc: "Disc | None" = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Disc:
    """The disc of a b-plane whose orbits hit: value (2,) and radius, km; partials (2, k) by the quantity's names."""

    value: Array
    partials: Array
    radius_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unanswered:
    """A prediction that does not exist for this orbit.

    Attributes
    ----------
    request, status, reason : what was asked, one word, and the sentence that says why.
    facts : what is known all the same, units in the key names.
    disc, names : of its encounter, as of `Quantity`.
    """

    request: Prediction
    status: str
    reason: str
    facts: Mapping[str, Any]
    disc: Disc | None = None
    names: tuple[str, ...] = ()


class Foretold(NamedTuple):
    """The predictions that exist for an orbit and can be believed, and the others."""

    found: list[Quantity]
    missing: list[Unanswered]


def predicted(scene: Scene, trajectory: Trajectory, requests: Sequence[Prediction]) -> Foretold:
    """The predictions that exist for an orbit, and those that do not."""
    found, missing = [], []
    for request in requests:
        try:
            found.append(quantity(scene, trajectory, request))
        except NoAnswerError as error:
            missing.append(unanswered(request, error, trajectory))
    return Foretold(found, missing)


def foretell(scene: Scene, fit: Fit, trajectory: Trajectory | None = None) -> Foretold:
    """All predictions of a mission on the orbit one estimator found.

    Parameters
    ----------
    trajectory : that orbit over everything that is asked for; by default as it was estimated.
    """
    requests, orbit = scene.mission.predictions, fit.trajectory if trajectory is None else trajectory
    if fit.estimate.solution is None:
        reason = f"the measurements do not determine the orbit: {fit.message}"
        return Foretold(found=[], missing=[unknown_orbit(request, reason) for request in requests])
    found, missing = predicted(scene, orbit, requests)
    return believable(found, missing, fit.estimate)


def unknown_orbit(request: Prediction, reason: str) -> Unanswered:
    """What is said of a prediction when no orbit is known."""
    return Unanswered(request=request, status="orbit_unknown", reason=reason, facts={})


def unanswered(request: Prediction, error: NoAnswerError, trajectory: Trajectory | None = None) -> Unanswered:
    """What an error says of a prediction."""
    facts = dict(error.facts)
    disc = facts.pop("disc", None)
    names = (*STATE_NAMES, *trajectory.parameter_names) if trajectory is not None else ()
    return Unanswered(request=request, status=error.status, reason=str(error), facts=facts, disc=disc, names=names)


def time_scale(request: Prediction) -> Scale:
    """The scale its times are told in: that of the time asked about; UTC for what happens on the Earth's ground."""
    return "utc" if request.plane == "entry" and request.body == "earth" else request.when.scale


def quantity(scene: Scene, trajectory: Trajectory, request: Prediction, about: Epoch | None = None) -> Quantity:
    """Evaluate a requested prediction on a trajectory.

    Parameters
    ----------
    about : where a near orbit has the encounter, which is then taken however far it is from the time asked about.

    Raises
    ------
    NoAnswerError
        If it does not exist for this orbit; says why.
    """
    from nebosvod.approach import encounter_quantity

    try:
        if isinstance(request, EncounterPrediction):
            _require_covered(scene, trajectory, request)
            return encounter_quantity(scene, trajectory, request, about)
        _require_alive(scene, trajectory, request)
        _require_covered(scene, trajectory, request)
        if isinstance(request, SkyPrediction):
            return _sky(scene, trajectory, request)
        return _state(scene, trajectory, request)
    except CoverageError as error:
        raise NoAnswerError(str(error), status="not_covered") from None


def _require_covered(scene: Scene, trajectory: Trajectory, request: Prediction) -> None:
    """Refuse a time outside the ephemeris."""
    first, last = scene.ephemeris.coverage(asteroids=trajectory.forces.asteroids)
    if not first <= request.when <= last:
        scale = request.when.scale
        raise NoAnswerError(
            f"{request.when.iso(scale, 0)} is outside the ephemeris, {first.iso(scale, 0)} to {last.iso(scale, 0)}",
            status="not_covered",
        )


def _require_alive(scene: Scene, trajectory: Trajectory, request: SkyPrediction | StatePrediction) -> None:
    """Refuse a time after the impact that ends the orbit."""
    if request.at - scene.epoch <= trajectory.span_s[1]:
        hit = None if request.at - scene.epoch < trajectory.span_s[1] - 2.0 * BELOW_S else what_it_hits(trajectory)
    else:
        hit = what_it_hits(trajectory)
    if hit is not None and request.at - hit.epoch >= 0.0:
        raise NoAnswerError(
            f"the orbit hits {hit.body} on {hit.epoch.iso(request.at.scale, 0)} and ends there, before "
            f"{request.at.iso(request.at.scale, 0)}",
            status="after_impact",
            facts={"body": hit.body, "impact": True, "closest_approach_tdb": hit.epoch.iso()},
        )


def make_quantity(
    request: Prediction,
    epoch: Epoch,
    unit: str,
    value: Array | None,
    by_state: Array,
    by_parameters: Array,
    trajectory: Trajectory,
    facts: Mapping[str, Any],
    axes: Array | None = None,
    **more: Any,
) -> Quantity:
    """A quantity whose partials are those by the state and by the parameters."""
    return Quantity(
        request=request,
        epoch=epoch,
        unit=unit,
        value=value,
        partials=np.hstack([np.atleast_2d(by_state), np.atleast_2d(by_parameters)]),
        names=(*STATE_NAMES, *trajectory.parameter_names),
        facts=facts,
        axes=axes,
        **more,
    )


def _sky(scene: Scene, trajectory: Trajectory, request: SkyPrediction) -> Quantity:
    """Offsets in RA* and Dec, arcsec, as a telescope sees them (astrometric)."""
    telescope = next(t for t in scene.telescopes if t.name == request.telescope)
    seen = observe(trajectory, telescope, np.array([request.at - scene.epoch]), scene.ephemeris)
    facts = {
        "telescope": telescope.name,
        "ra_deg": float(np.degrees(seen.psi[0, 0])),
        "dec_deg": float(np.degrees(seen.psi[0, 1])),
        "distance_km": float(seen.distance_km[0]),
    }
    return make_quantity(
        request, request.at, "arcsec", None, seen.H_x0[0] / ARCSEC, seen.H_c[0] / ARCSEC, trajectory, facts
    )


def _state(scene: Scene, trajectory: Trajectory, request: StatePrediction) -> Quantity:
    """Heliocentric position on ICRF or RTN axes, km, or velocity on RTN axes, m/s."""
    at = trajectory.at(np.array([request.at - scene.epoch]))
    x, Phi, zeta = at.state[0], at.Phi[0], at.zeta[0]
    rows = slice(3, 6) if request.plane == "rtn_velocity" else slice(0, 3)
    axes = np.eye(3)
    if request.plane != "position":
        radial = x[:3] / np.linalg.norm(x[:3])
        normal = np.cross(x[:3], x[3:])
        normal /= np.linalg.norm(normal)
        axes = np.stack([radial, np.cross(normal, radial), normal])
    scale, unit = (M_PER_KM, "m_s") if request.plane == "rtn_velocity" else (1.0, "km")
    facts = {"position_km": x[:3].tolist(), "velocity_km_s": x[3:].tolist()}
    return make_quantity(
        request, request.at, unit, None, scale * axes @ Phi[rows], scale * axes @ zeta[rows], trajectory, facts, axes
    )


def known_partials(asked: Quantity, estimate: Estimate) -> tuple[Array, tuple[str, ...]]:
    """Partials (d, k) of a quantity by the k of its parameters that have an error in this estimate."""
    return _known(asked.partials, asked.names, estimate)


def prediction_row(
    asked: Quantity,
    estimate: Estimate,
    estimator: str,
    budget: Sequence[Mapping[str, Any]],
    curved: Mapping[str, Any],
    mean_errors: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """One entry of `predictions` in summary.json: true and formal covariance, ellipse, chance of impact.

    Parameters
    ----------
    budget, curved : its budget, and its nonlinearity with the mean shift, which adds to the largest deviation.
    mean_errors : mean of truth minus assumed value of parameters left out, by name.

    Notes
    -----
    Guo, Ivashkin 2018, (3.5): |M(w)| + 3 sigma. With the error e of the estimate, w(x) = w(x + e) - W e + 1/2 e^T C e:
    predicted minus true is on average W M(e) less the shift of the second order.
    """
    W, names = known_partials(asked, estimate)
    off = W @ estimate.mean_shift(mean_errors or {}, names)
    shift = off - np.array(curved[f"mean_shift_{asked.unit}"] or np.zeros(len(asked.partials)))
    found = estimate.predict(W, names)
    unit, size = asked.unit, asked.partials.shape[0]
    row: dict[str, Any] = {
        "name": asked.request.name,
        "estimator": estimator,
        "status": ANSWERED,
        "reason": None,
        "epoch_tdb": asked.epoch.iso(),
        "epoch_utc": asked.epoch.iso("utc"),
        "time_scale": time_scale(asked.request),
        "plane": asked.request.plane,
        **asked.facts,
        **_shape(found.factor, unit),
        f"sigma_{unit}": found.sigma.tolist(),
        f"sigma_formal_{unit}": found.sigma_formal.tolist(),
        f"mean_error_{unit}": off.tolist(),
        f"max_deviation_{unit}": ellipse.maximum_deviation(shift, found.sigma, SIGMAS).tolist(),
        f"covariance_{unit}2": found.covariance.tolist(),
        f"covariance_formal_{unit}2": found.covariance_formal.tolist(),
        "probability": ellipse.probability(1.0, size),
        "ellipse_levels": [_level(sigma, size) for sigma in (1.0, 2.0, 3.0)]
        + [_level(ellipse.level_of(inside, size), size) for inside in INSIDE],
        "nonlinearity": dict(curved),
        "budget": budget,
    }
    for name, partials in asked.further.items():
        row[f"sigma_{name}"] = float(estimate.predict(*_known(partials[None], asked.names, estimate)).sigma[0])
    if asked.value is not None:
        row[f"mean_{unit}"] = asked.value.tolist()
        if "capture_radius_km" in asked.facts:
            # linear: a normal distribution on the plane, over the disc whose orbits hit the body
            centre = asked.value - off
            row["impact_probability_linear"] = inside_disc(centre, found.factor, asked.facts["capture_radius_km"])
            return row
    return row | _chance(asked.disc, asked.names, estimate, mean_errors)


def unanswered_row(
    missing: Unanswered, estimate: Estimate | None, estimator: str, mean_errors: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """One entry of `predictions` for what does not exist for this orbit: status and reason instead of numbers."""
    request = missing.request
    row: dict[str, Any] = {
        "name": request.name,
        "estimator": estimator,
        "status": missing.status,
        "reason": missing.reason,
        "asked_tdb": request.when.iso(),
        "asked_utc": request.when.iso("utc"),
        "time_scale": time_scale(request),
        "plane": request.plane,
        **missing.facts,
    }
    if missing.disc is not None and estimate is not None:
        row |= _chance(missing.disc, missing.names, estimate, mean_errors)
    return row


def in_order(rows: Sequence[dict[str, Any]], requests: Sequence[Prediction]) -> list[dict[str, Any]]:
    """Rows of one estimator in the order in which a mission asks for them."""
    place = {request.name: index for index, request in enumerate(requests)}
    return sorted(rows, key=lambda row: place[row["name"]])


def _chance(
    disc: Disc | None, names: Sequence[str], estimate: Estimate, mean_errors: Mapping[str, float] | None
) -> dict[str, float]:
    """Chance of impact: a normal distribution on the b-plane, over the disc whose orbits hit the body."""
    if disc is None:
        return {}
    W, known = _known(disc.partials, names, estimate)
    centre = disc.value - W @ estimate.mean_shift(mean_errors or {}, known)
    return {"impact_probability_linear": inside_disc(centre, estimate.predict(W, known).factor, disc.radius_km)}


def _known(partials: Array, names: Sequence[str], estimate: Estimate) -> tuple[Array, tuple[str, ...]]:
    """Partials (d, k) by the k of some parameters that have an error in this estimate."""
    known = set(estimate.names) | set(estimate.left_out)
    keep = [index for index, name in enumerate(names) if name in known]
    return partials[:, keep], tuple(names[index] for index in keep)


def believable(found: Sequence[Quantity], missing: Sequence[Unanswered], estimate: Estimate) -> Foretold:
    """The same without those whose 1 sigma ellipse is larger than the body, or the sky, it lies on."""
    kept, without = [], list(missing)
    for one in found:
        said = _too_large(one, estimate)
        if said is None:
            kept.append(one)
        else:
            without.append(
                Unanswered(
                    request=one.request, status="too_uncertain", reason=said, facts=one.facts, disc=one.disc,
                    names=one.names,
                )
            )  # fmt: skip
    return Foretold(kept, without)


def _too_large(one: Quantity, estimate: Estimate) -> str | None:
    """Why an ellipse is no answer, or None."""
    sky, ground = one.unit == "arcsec", one.request.plane == "entry"
    if not (sky or ground):
        return None
    sigma = estimate.predict(*known_partials(one, estimate)).factor
    axes = np.linalg.svd(sigma, compute_uv=False)
    radius = 1.0 / ARCSEC if sky else SURFACE_KM[one.facts["body"]] + one.facts["altitude_km"]
    if axes[0] < radius:
        return None
    size = " x ".join(f"{axis * ARCSEC / np.radians(1.0) if sky else axis:.4g}" for axis in axes)
    what = "deg, larger than the sky" if sky else f"km, larger than {one.facts['body']} at that altitude"
    return f"the 1 sigma ellipse would be {size} {what}: this orbit does not tell where; ask for b_plane" + (
        " or rtn" if sky else ""
    )


def _level(sigma: float, size: int) -> dict[str, float]:
    """An ellipsoid by its size in sigmas, and the probability inside."""
    return {"sigma_level": sigma, "probability": ellipse.probability(sigma, size)}


def _shape(factor: Array, unit: str) -> dict[str, Any]:
    """Semi-axes, largest first, and in a plane the angle of the long one from the first axis to the second."""
    if factor.shape[0] == 2:
        plane = ellipse.Ellipse.of_factor(factor)
        return {
            f"semi_axes_{unit}": [float(a) for a in plane.semi_axes],
            "angle_deg": float(np.degrees(plane.angle_rad)),
        }
    axes = np.linalg.svd(factor, compute_uv=False)
    return {f"semi_axes_{unit}": [float(a) for a in axes], "angle_deg": None}
