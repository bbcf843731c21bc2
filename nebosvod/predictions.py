"""Predicted quantities: what a mission asks to be foretold, with partials by the state and the dynamic parameters.

A quantity is evaluated on one trajectory; its error is the estimator's business (`Estimate.predict`), so every
source of the budget reaches it through the same factors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Encounter, Trajectory, find_encounters, perigee_distance, target_plane
from nebosvod.errors import InputError
from nebosvod.estimation import Estimate, ellipse
from nebosvod.estimation.inside import inside_disc
from nebosvod.impact import entry_point, gate, impact, osculating_perigee
from nebosvod.mission.request import EncounterPrediction, Prediction, SkyPrediction, StatePrediction
from nebosvod.observation import observe
from nebosvod.prior import STATE_NAMES
from nebosvod.scene import Scene
from nebosvod.timescale import Epoch

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
    axes : (3, 3) ICRF, rows the axes of a target plane (xi, normal, zeta) or of position and velocity; None otherwise.
    """

    request: Prediction
    epoch: Epoch
    unit: str
    value: Array | None
    partials: Array
    names: tuple[str, ...]
    facts: Mapping[str, Any]
    axes: Array | None = None


def quantity(scene: Scene, trajectory: Trajectory, request: Prediction) -> Quantity:
    """Evaluate a requested prediction on a trajectory.

    Raises
    ------
    InputError
        If there is no encounter of the kind asked for.
    """
    if isinstance(request, SkyPrediction):
        return _sky(scene, trajectory, request)
    if isinstance(request, StatePrediction):
        return _state(scene, trajectory, request)
    return _encounter(scene, trajectory, request)


def _make(
    request: Prediction,
    epoch: Epoch,
    unit: str,
    value: Array | None,
    by_state: Array,
    by_parameters: Array,
    trajectory: Trajectory,
    facts: Mapping[str, Any],
    axes: Array | None = None,
) -> Quantity:
    return Quantity(
        request=request,
        epoch=epoch,
        unit=unit,
        value=value,
        partials=np.hstack([np.atleast_2d(by_state), np.atleast_2d(by_parameters)]),
        names=(*STATE_NAMES, *trajectory.parameter_names),
        facts=facts,
        axes=axes,
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
    return _make(request, request.at, "arcsec", None, seen.H_x0[0] / ARCSEC, seen.H_c[0] / ARCSEC, trajectory, facts)


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
    return _make(
        request, request.at, unit, None, scale * axes @ Phi[rows], scale * axes @ zeta[rows], trajectory, facts, axes
    )


def _encounter(scene: Scene, trajectory: Trajectory, request: EncounterPrediction) -> Quantity:
    """Crossing of a target plane, or the smallest distance, km."""
    event, hits = _nearest_encounter(scene, trajectory, request)
    epoch = trajectory.epoch + event.t_s
    facts: dict[str, Any] = {
        "body": request.body,
        "impact": hits,
        "closest_approach_tdb": epoch.iso(),
        "closest_distance_km": event.distance_km,
        "speed_km_s": event.speed_km_s,
    }
    if request.plane == "entry":
        return _entry(scene, trajectory, event, request)
    if request.plane == "perigee_distance":
        distance, by_state, by_parameters = (osculating_perigee if hits else perigee_distance)(trajectory, event)
        return _make(request, epoch, "km", np.array([distance]), by_state, by_parameters, trajectory, facts)
    if hits and request.plane == "mtp":
        raise InputError(
            f"predictions: {request.name}: the orbit hits {request.body} on {epoch.iso(digits=0)} and has no closest "
            "approach for mtp; use b_plane or entry"
        )
    plane = target_plane(trajectory, gate(trajectory, event) if hits else event, kind=request.plane)
    return _make(
        request,
        epoch,
        "km",
        plane.coordinates_km,
        plane.partials_state,
        plane.partials_parameters,
        trajectory,
        facts | {"capture_radius_km": plane.capture_radius_km},
        plane.axes,
    )


def _entry(scene: Scene, trajectory: Trajectory, event: Encounter, request: EncounterPrediction) -> Quantity:
    """Point of entry at an altitude: downrange and crossrange over the ground, km.

    Where a poorly known orbit passes the body by although the reference orbit enters, the reference orbit is asked.
    """
    evaluated_on = "estimated orbit"
    try:
        entry = entry_point(trajectory, event, request.altitude or 0.0)
    except InputError:
        evaluated_on, trajectory = "reference orbit", scene.trajectory
        try:
            entry = entry_point(trajectory, _nearest_encounter(scene, trajectory, request)[0], request.altitude or 0.0)
        except InputError as error:
            raise InputError(f"predictions: {request.name}: {error}") from None
    facts = {
        "body": request.body,
        "evaluated_on": evaluated_on,
        "altitude_km": request.altitude,
        "speed_km_s": entry.speed_km_s,
        "path_below_horizon_deg": float(np.degrees(entry.elevation_rad)),
    }
    if request.body == "earth":
        facts["longitude_deg"] = float(np.degrees(entry.longitude_rad))
        facts["latitude_geocentric_deg"] = float(np.degrees(entry.latitude_rad))
    by_state, by_parameters = entry.partials_state, entry.partials_parameters
    return _make(request, entry.epoch, "km", None, by_state, by_parameters, trajectory, facts)


def _nearest_encounter(scene: Scene, trajectory: Trajectory, request: EncounterPrediction) -> tuple[Encounter, bool]:
    """The closest approach nearest in time to `near`, and whether it is an impact."""
    when = request.near - scene.epoch
    events = [(event, False) for event in find_encounters(trajectory, request.body)]
    hit = impact(trajectory, request.body)
    if hit is not None:
        events.append((hit, True))
    if not events:
        raise InputError(
            f"predictions: {request.name}: the orbit has no closest approach to {request.body} between "
            f"{scene.epoch + trajectory.span_s[0]} and {scene.epoch + trajectory.span_s[1]}; change near or body"
        )
    return min(events, key=lambda event: abs(event[0].t_s - when))


def known_partials(asked: Quantity, estimate: Estimate) -> tuple[Array, tuple[str, ...]]:
    """Partials (d, k) of a quantity by the k of its parameters that have an error in this estimate."""
    known = set(estimate.names) | set(estimate.left_out)
    keep = [index for index, name in enumerate(asked.names) if name in known]
    return asked.partials[:, keep], tuple(asked.names[index] for index in keep)


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
        "epoch_tdb": asked.epoch.iso(),
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
    if asked.value is not None:
        row[f"mean_{unit}"] = asked.value.tolist()
        if "capture_radius_km" in asked.facts:
            # linear: a normal distribution on the plane, over the disc whose orbits hit the body
            centre = asked.value - off
            row["impact_probability_linear"] = inside_disc(centre, found.factor, asked.facts["capture_radius_km"])
    return row


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
