"""How far a prediction is from linear: the orbit re-propagated from points of the error ellipsoid, and from draws.

The error of the estimate is factored as K = S S^T with the columns of S ordered by how much they move the predictions.
Along each column the orbit is propagated anew from +-sqrt(3) sigma (the chord of a Gaussian's fourth moment) and every
prediction evaluated on it: the even part is the second-order term C_i of that direction, w = w_0 + sum D_i eta_i +
1/2 C_i eta_i^2. Its mean shift is 1/2 sum C_i, exactly the trace of the second-order term; its spread, without the
cross terms, 1/2 sum C_i C_i^T. In sigmas of the linear ellipse the two make one measure. An error with a mean m of its
own adds 1/2 m^T C m to the shift, by a pair of orbits displaced by +-m.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.impact import impact
from nebosvod.engine.entry import ground_displacement
from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import M_PER_KM, SIGMAS, Quantity, known_partials, quantity
from nebosvod.errors import EventError, ImpactError, InputError, NoAnswerError
from nebosvod.estimation import Estimate
from nebosvod.estimation.accuracy import ellipse
from nebosvod.estimation.accuracy.consistency import binomial_interval
from nebosvod.scene.point import Point
from nebosvod.scene.prior import STATE_NAMES, by_density, with_mass
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
CHORD = float(np.sqrt(3.0))
MISLEADS = 0.3  # rms departure in sigmas: it adds a tenth to the variance of that direction
DECEIVED = 1.1  # a sigma of drawn orbits over the linear one, from which the linear one misleads
INTERVAL = 0.95
MOST_HALVINGS = 5  # of a chord whose ends have no such prediction: down to 0.05 sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curvature:
    """Second-order behaviour of one prediction.

    Attributes
    ----------
    shift : (d,) mean of the second-order term, in the unit of the prediction.
    spread : (d,) its standard deviation, without cross terms.
    measure : rms departure in sigmas of the linear ellipse, over all directions.
    """

    shift: Array
    spread: Array
    measure: float


def curvature(second: Array, factor: Array) -> Curvature:
    """From second-order terms C_i (r, d) of unit draws and the linear factor (d, .) of the prediction."""
    shift = 0.5 * second.sum(axis=0)
    left, lengths, _ = np.linalg.svd(np.hstack([factor, np.zeros((len(factor),) * 2)]), full_matrices=False)
    kept = lengths > 1e-12 * lengths[0]
    white = (np.vstack([shift, second]) @ left[:, kept]) / lengths[kept]
    return Curvature(
        shift=shift,
        spread=np.sqrt(0.5 * np.sum(second**2, axis=0)),
        measure=float(np.sqrt(np.sum(white[0] ** 2) + 0.5 * np.sum(white[1:] ** 2))),
    )


def ordered_factor(estimate: Estimate, names: Sequence[str], asked: Sequence[Quantity]) -> Array:
    """Factor S (k, r) of the error of the named parameters, columns ordered by their effect on the predictions."""
    S = np.asarray(estimate.factor(names))
    rows = []
    for one in asked:
        W = np.zeros((len(one.partials), len(names)))
        for column, name in enumerate(one.names):
            if name in names:
                W[:, names.index(name)] = one.partials[:, column]
        moved = W @ S
        sigma = np.linalg.norm(moved, axis=1)
        rows.append(moved[sigma > 0.0] / sigma[sigma > 0.0, None])
    _, _, turn = np.linalg.svd(np.vstack([*rows, np.zeros((1, S.shape[1]))]), full_matrices=True)
    factor: Array = S @ turn.T
    return factor


def displaced(base: Quantity, other: Quantity) -> Array | None:
    """What another orbit changes in a quantity, on the axes of the base (d,); None where that is not defined."""
    if base.request.plane == "entry":
        if base.anchor is None or base.axes is None or other.anchor is None:
            return None
        return ground_displacement(base.anchor, base.axes, other.anchor)
    if base.unit == "arcsec":
        turn = np.radians(other.facts["ra_deg"] - base.facts["ra_deg"])
        turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
        north = np.radians(base.facts["dec_deg"])
        return np.array([turn * np.cos(north), np.radians(other.facts["dec_deg"]) - north]) / ARCSEC
    if base.axes is None:
        return None if base.value is None or other.value is None else np.asarray(other.value - base.value)
    if base.value is None:
        key, scale = ("velocity_km_s", M_PER_KM) if base.unit == "m_s" else ("position_km", 1.0)
        return np.asarray(scale * base.axes @ (np.array(other.facts[key]) - np.array(base.facts[key])))
    if other.value is None or other.axes is None:
        return None
    point = other.value[0] * other.axes[0] + other.value[1] * other.axes[2]
    if base.request.plane == "mtp":  # along the other orbit's direction into the base's plane
        point = point - (base.axes[1] @ point) / (base.axes[1] @ other.axes[1]) * other.axes[1]
    return np.asarray(base.axes[[0, 2]] @ point - base.value)


def moved_quantities(scene: Scene, fit: Fit, asked: Sequence[Quantity], deviation: Mapping[str, float]) -> list[Any]:
    """Displacement (d,) of each quantity on the orbit moved by a deviation; None where it has no value there."""
    return [moved for moved, _ in moved_events(scene, fit, asked, deviation)]


def moved_events(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], deviation: Mapping[str, float]
) -> list[tuple[Array | None, bool | None]]:
    """The same, and whether that orbit hits the body of the encounter; None where there is no such orbit."""
    flown: dict[bool, Trajectory | str | None] = {False: _fly(scene, _displaced(scene, fit.point, deviation))}
    found: list[tuple[Array | None, bool | None]] = []
    for one in asked:
        # the base of an entry that only the reference orbit has is that orbit
        about_reference = one.facts.get("evaluated_on") == "reference orbit"
        if about_reference not in flown:
            flown[about_reference] = _fly(scene, _displaced(scene, _reference(scene), deviation))
        body = one.facts.get("body")
        found.append((_moved(scene, one, flown[about_reference]), _hits(flown[False], body) if body else None))
    return found


def _moved(scene: Scene, one: Quantity, orbit: Trajectory | str | None) -> Array | None:
    """Displacement (d,) of a quantity on another orbit; None where it has no value there."""
    if not isinstance(orbit, Trajectory):
        return None
    try:
        return displaced(one, quantity(scene, orbit, one.request, one.epoch))
    except (NoAnswerError, InputError):  # no encounter of this kind on that orbit
        return None


def _hits(orbit: Trajectory | str | None, body: str) -> bool | None:
    """Whether an orbit hits a body; None where it cannot be flown."""
    if not isinstance(orbit, Trajectory):
        return None if orbit is None else orbit == body
    return impact(orbit, body) is not None


def uncertain(fit: Fit) -> tuple[str, ...]:
    """State and dynamic parameters that have an error, estimated or left out."""
    known = {*fit.estimate.names, *fit.estimate.left_out}
    return tuple(name for name in (*STATE_NAMES, *fit.observation.parameter_names) if name in known)


def _displaced(scene: Scene, point: Point, deviation: Mapping[str, float]) -> Point:
    """The point moved, a mass that comes from a density with its radius."""
    moved = point.moved(deviation)
    if not by_density(scene.mission):
        return moved
    return replace(moved, parameters=with_mass(point.parameters, moved.parameters))


def _reference(scene: Scene) -> Point:
    """The reference orbit with every dynamic parameter at its nominal value."""
    values = {parameter.name: parameter.value for parameter in scene.mission.free_parameters}
    return Point(state=scene.state, parameters=values, nuisances={})


def _fly(scene: Scene, point: Point) -> Trajectory | str | None:
    """The orbit through a point; the body it hits before a date asked about; or None where it cannot be flown."""
    try:
        return scene.propagate(point.state, scene.forces.with_values(point.parameters))
    except ImpactError as error:
        return error.body
    except (EventError, InputError):  # a mass below zero, or an integration that stops
        return None


def nonlinearity(scene: Scene, fit: Fit, asked: Sequence[Quantity]) -> list[dict[str, Any]]:
    """The `nonlinearity` entry of each prediction of one estimator.

    Notes
    -----
    An entry may not exist on an orbit 1.7 sigma away: the chord of that direction is then halved until it does on both
    ends, and the entry says how short the shortest is.
    """
    estimate, names = fit.estimate, uncertain(fit)
    S, mean = ordered_factor(estimate, names, asked), estimate.mean_shift(fit.mean_errors, names)
    columns = [*S.T, *([mean / CHORD] if mean.any() else [])]
    flights: dict[tuple[int, float], list[Any]] = {}

    def ends(direction: int, index: int, chord: float) -> list[Array | None]:
        found = []
        for signed in (chord, -chord):
            if (direction, signed) not in flights:
                deviation = dict(zip(names, (signed * columns[direction]).tolist()))
                flights[direction, signed] = moved_quantities(scene, fit, asked, deviation)
            found.append(flights[direction, signed][index])
        return found

    rows = []
    for index, one in enumerate(asked):
        bends, shortest = [], CHORD
        for direction in range(len(columns)):
            bend, chord = _second_order(partial(ends, direction, index))
            bends.append(bend)
            shortest = min(shortest, chord)
        rows.append(_nonlinearity_row(one, estimate, bends, S.shape[1], shortest))
    return rows


def _second_order(ends: Callable[[float], list[Array | None]]) -> tuple[Array | None, float]:
    """C_i of one direction and the chord it was taken over; None where even the shortest has an end without a value."""
    chord = CHORD
    for _ in range(MOST_HALVINGS + 1):
        up, down = ends(chord)
        if up is not None and down is not None:
            bend: Array = (up + down) / chord**2
            return bend, chord
        chord *= 0.5
    return None, 2.0 * chord


def _nonlinearity_row(
    one: Quantity, estimate: Estimate, bends: Sequence[Array | None], count: int, shortest: float
) -> dict[str, Any]:
    """What the second-order terms of the `count` unit draws, and of a mean of the error after them, say."""
    unit = one.unit
    row: dict[str, Any] = {"method": "orbits propagated from +-sqrt(3) sigma", "orbits": 2 * len(bends)}
    if shortest < CHORD:
        row["shortest_chord_sigma"] = shortest
    found = [bend for bend in bends if bend is not None]
    if len(found) < len(bends):
        empty = (f"mean_shift_{unit}", f"second_order_sigma_{unit}", "measure", "misleads")
        return row | dict.fromkeys(empty) | {"reason": f"an orbit at {shortest:.2g} sigma has no such prediction"}
    bent = curvature(np.array(found[:count]), estimate.predict(*known_partials(one, estimate)).factor)
    return row | {
        f"mean_shift_{unit}": (bent.shift + 0.5 * CHORD**2 * np.sum(found[count:], axis=0)).tolist(),
        f"second_order_sigma_{unit}": bent.spread.tolist(),
        "measure": bent.measure,
        # where the prediction ends within 1.7 sigma the ellipse holds places that no orbit comes to
        "misleads": bent.measure > MISLEADS or shortest < CHORD,
        "reason": None,
    }


def clones(scene: Scene, fit: Fit, asked: Sequence[Quantity], runs: int, seed: int) -> tuple[list[Array], list[Array]]:
    """Displacements (runs, d) of each quantity on orbits drawn from the error of the estimate; nan where undefined.

    The second list says of each (runs,) whether the drawn orbit hits the body of the encounter: 1, 0, or nan where
    there is no such orbit. Truth is the estimate minus its error: where the error has a mean, the draws lie about the
    estimate minus that mean.
    Draw i comes from SeedSequence(seed, spawn_key=(1, i)).
    """
    names = uncertain(fit)
    S, mean = fit.estimate.factor(names), fit.estimate.mean_shift(fit.mean_errors, names)
    found = [np.full((runs, len(one.partials)), np.nan) for one in asked]
    fates = [np.full(runs, np.nan) for _ in asked]
    for i in range(runs):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1, i)))
        drawn = dict(zip(names, (S @ rng.standard_normal(S.shape[1]) - mean).tolist()))
        for points, fate, (moved, hit) in zip(found, fates, moved_events(scene, fit, asked, drawn)):
            if moved is not None:
                points[i] = moved
            fate[i] = np.nan if hit is None else float(hit)
    return found, fates


def impact_share(fate: Array) -> dict[str, Any]:
    """Share of drawn orbits that hit, with its exact binomial interval (Clopper, Pearson 1934).

    Parameters
    ----------
    fate : (runs,) 1 for a hit, 0 for none, nan for an orbit that cannot be flown.
    """
    from scipy.special import betaincinv

    valid = fate[np.isfinite(fate)]
    n, hits = len(valid), int(np.count_nonzero(valid))
    tail = 0.5 * (1.0 - INTERVAL)
    low = float(betaincinv(hits, n - hits + 1, tail)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, n - hits, 1.0 - tail)) if hits < n else 1.0
    return {"runs": n, "hits": hits, "probability": hits / n if n else None, "interval_95": [low, high]}


def spread_of(one: Quantity, points: Array, factor: Array, mean_error: Array | float = 0.0) -> dict[str, Any]:
    """What drawn orbits did, held against the linear ellipse: their mean, ellipse, and whether the linear one misleads.

    Parameters
    ----------
    factor : (d, r), K = factor factor^T is the linear covariance.
    mean_error : (d,), mean of predicted minus true; the linear ellipse lies about minus this.
    """
    valid, unit = points[np.isfinite(points).all(axis=1)], one.unit
    row: dict[str, Any] = {"runs": len(points), "undefined": len(points) - len(valid)}
    empty = (f"mean_shift_{unit}", f"sigma_{unit}", f"semi_axes_{unit}", f"max_deviation_{unit}")
    if len(valid) <= valid.shape[1]:
        return row | dict.fromkeys((*empty, "inside_linear_3_sigma", "misleads", "statement"))
    mean, sigma = valid.mean(axis=0), valid.std(axis=0, ddof=1)
    axes = np.linalg.svd((valid - mean) / np.sqrt(len(valid) - 1.0), compute_uv=False)
    linear = np.linalg.svd(factor, compute_uv=False)
    found = against_linear(valid + mean_error, factor)
    label = {"m_s": "m/s"}.get(unit, unit)
    drawn, believed = (" x ".join(f"{axis:.4g}" for axis in size) for size in (axes, linear[: len(axes)]))
    held, expected = (100.0 * found[key] for key in ("inside_linear_3_sigma", "expected_3_sigma"))
    verdict = "the linear ellipse misleads" if found["misleads"] else "the linear ellipse holds"
    return row | {
        f"mean_shift_{unit}": mean.tolist(),
        f"sigma_{unit}": sigma.tolist(),
        f"semi_axes_{unit}": axes.tolist(),
        f"max_deviation_{unit}": ellipse.maximum_deviation(mean, sigma, SIGMAS).tolist(),
        **found,
        "statement": f"{drawn} {label} drawn against {believed} {label} linear, {held:.3g} % of the orbits inside its "
        f"3-sigma limit where {expected:.3g} % belong: {verdict}",
    }


def against_linear(points: Array, factor: Array) -> dict[str, Any]:
    """Do points (N, d), deviations from the predicted value, come from N(0, factor factor^T)?

    Notes
    -----
    The second moments of whitened points have roots between 1 -+ (sqrt d + 3) / sqrt N with 98 % (Davidson and Szarek
    2001, II.13); it misleads where a root is a tenth beyond that, or the share inside 3 sigma is off by more than a
    hundredth and has a chance below 1e-3.
    """
    left, lengths, _ = np.linalg.svd(factor, full_matrices=False)
    kept = lengths > 1e-12 * lengths[0]
    white = (points @ left[:, kept]) / lengths[kept]
    n, d = white.shape
    roots = np.linalg.svd(white / np.sqrt(n), compute_uv=False)
    play = (np.sqrt(d) + 3.0) / np.sqrt(n)
    wide, narrow = roots[0] > DECEIVED * (1.0 + play), roots[-1] < (1.0 - play) / DECEIVED
    inside, expected = int(np.count_nonzero(np.sum(white**2, axis=1) <= SIGMAS**2)), ellipse.probability(SIGMAS, d)
    low, high = binomial_interval(inside, n, level=1e-3)
    off = abs(inside / n - expected) > 0.01 and not low <= expected <= high
    return {
        "inside_linear_3_sigma": inside / n,
        "expected_3_sigma": expected,
        "sigma_ratio_largest": float(roots[0]),
        "sigma_ratio_smallest": float(roots[-1]),
        "misleads": bool(wide or narrow or off),
    }
