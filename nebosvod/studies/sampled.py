"""What a point says of an impact where linear does not do: orbits drawn from its covariance and flown.

Six pairs of orbits at +-sqrt(3) sigma along the axes of the error of the state tell how far the map to the target
plane is from linear (`findings.nonlinearity`); only where it misleads are orbits drawn. The corridor is always that of
drawn orbits, unless the ellipse of the entry is so small that the ground is flat under it.

The parameters of the object's forces are taken at their values: over the weeks before a fall their error is none.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import DAY_S
from nebosvod.errors import NebosvodError
from nebosvod.findings.nonlinearity import CHORD, MISLEADS, curvature
from nebosvod.impacts.cloud import Cloud
from nebosvod.impacts.corridor import flattened
from nebosvod.impacts.flight import Course
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.studies.point import Point

Array = npt.NDArray[np.float64]
DRAWS, SEED = 300, 20300215
AFTER_S = 2.0 * DAY_S
FLAT_KM = 200.0  # 1 sigma of an entry, below which its corridor is that of the ellipse
HELD, TAIL = 3.29, 0.05  # the middle 90 % of a normal distribution, and what is left out at each end
FEWEST = 10  # drawn orbits that come down, for a corridor
SMALL_KM = 300.0  # 1 sigma on the target plane: bent by less than a tenth of the Earth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fall:
    """What drawn orbits do.

    Attributes
    ----------
    bend : rms departure from linear on the target plane in sigmas; inf where an orbit 1.7 sigma away has no such plane.
    probability : share of the drawn orbits that hit; None where none were drawn.
    corridor_km : length on the ground of the middle 90 % of those that come down; None where too few do.
    """

    bend: float
    probability: float | None
    corridor_km: float | None


def impact_probability(point: Point, name: str) -> float | None:
    """Of a prediction: linear, or where that misleads the share of drawn orbits that hit."""
    linear = point.chance(name)
    if linear is None:
        return None
    found = fall(point, name, corridor=False)
    return linear if found is None or found.probability is None else found.probability


def corridor_km(point: Point, name: str) -> float | None:
    """Length on the ground of what holds 90 % of the orbits that come down."""
    small = point.prediction(name)
    if small is not None and small.semi_axes[0] < FLAT_KM:
        return float(HELD * small.semi_axes[0])
    found = fall(point, name, corridor=True)
    return None if found is None else found.corridor_km


def fall(point: Point, name: str, *, corridor: bool) -> Fall | None:
    """What orbits about the estimate do near the encounter of a prediction; None where they cannot be flown."""
    request = next(one for one in point.scene.mission.predictions if one.name == name)
    try:
        S = _state_factor(point)
        course = Course(
            orbit=UncertainOrbit(
                name=name, epoch=point.scene.epoch, state=_state(point), factor=_lower(S),
                radiation=point.scene.forces.radiation, nongrav=point.scene.forces.nongrav,
                settings=point.scene.forces.settings,
            ),
            ephemeris=point.scene.ephemeris, last=request.when + AFTER_S, bodies=("earth",),
        )  # fmt: skip
        bend = _bend(point, course, S)
        if bend <= MISLEADS and not corridor:
            return Fall(bend=bend, probability=None, corridor_km=None)
        draws = np.random.default_rng(SEED).standard_normal((DRAWS, S.shape[1]))
        off = point.mean_errors.shift(point.estimate, STATE_NAMES)
        cloud = course.fly(draws @ S.T - off)
    except (NebosvodError, ArithmeticError, ValueError, IndexError):
        return None
    chance = float(np.mean(cloud.body == "earth"))
    return Fall(bend=bend, probability=chance, corridor_km=_length(cloud))


def _state(point: Point) -> Array:
    """Of the estimate at the reference epoch."""
    found: Array = point.trajectory.state_at(np.zeros(1))[0]
    return found


def _state_factor(point: Point) -> Array:
    """S (6, 6) of the error of the state, the weakest direction first."""
    left, size, _ = np.linalg.svd(_scaled(point), full_matrices=False)
    found: Array = (left * size) * _unit(point)[:, None]
    return found


def _unit(point: Point) -> Array:
    arc = max(float(np.ptp(point.times_s)), DAY_S)
    return np.array([1.0, 1.0, 1.0, 1.0 / arc, 1.0 / arc, 1.0 / arc])


def _scaled(point: Point) -> Array:
    return np.asarray(point.estimate.factor(STATE_NAMES)) / _unit(point)[:, None]


def _lower(S: Array) -> Array:
    """Lower factor with a positive diagonal of the same covariance."""
    R: Array = np.asarray(np.linalg.qr(S.T, mode="r")).T
    return R * np.where(np.diag(R) < 0.0, -1.0, 1.0)


def _bend(point: Point, course: Course, S: Array) -> float:
    """Rms departure from linear on the target plane, in sigmas."""
    moves = np.concatenate([np.zeros((1, 6)), CHORD * S.T, -CHORD * S.T])
    cloud = course.fly(moves)
    about = point.falls_s
    near = min(cloud.passages, key=lambda one: abs((one.epoch - cloud.epoch) - about), default=None)
    if near is None or not np.isfinite(near.xi_zeta_km).all():
        return float("inf")
    w = near.xi_zeta_km
    up, down = w[1:7] - w[0], w[7:] - w[0]
    factor = (up - down).T / (2.0 * CHORD)
    if float(np.linalg.norm(factor, 2)) < SMALL_KM:
        return 0.0
    return curvature((up + down) / CHORD**2, factor).measure


def _length(cloud: Cloud) -> float | None:
    """The middle 90 % of the members that come down, along their longest direction on the ground."""
    down = np.flatnonzero(np.isfinite(cloud.entry.longitude_deg) & (cloud.body == "earth"))
    if len(down) < FEWEST:
        return None
    weights = np.full(len(down), 1.0 / len(down))
    _, flat = flattened(cloud.entry.longitude_deg[down], cloud.entry.latitude_deg[down], weights)
    centred = flat - np.median(flat, axis=0)
    low, high = np.quantile(centred @ np.linalg.svd(centred, full_matrices=False)[2][0], [TAIL, 1.0 - TAIL])
    return float(high - low)
