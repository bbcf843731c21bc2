"""What comes after a fit: approaches to the Earth and the Moon in the next 100 days, impacts in reach, H, period, MOID.

The days count from the last observation, never from the clock.
"""

from dataclasses import dataclass

import numpy as np

from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.impact import follow
from nebosvod.dynamics.moid import earth_moid_km
from nebosvod.errors import CoverageError, EventError
from nebosvod.fits.engine import OrbitFit
from nebosvod.fits.orbit import OrbitAt
from nebosvod.fits.photometry import AbsoluteMagnitude, absolute_magnitude
from nebosvod.impacts.approaches import Approach, approaches_on, sigmas_to_hit
from nebosvod.observation.contracts import Array
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import AU_KM

DAYS = 100.0
WITHIN_AU = 0.05
ALL_AU = 10.0
REACH_SIGMAS = 5.0
BODIES = ("earth", "moon")
LONGEST_KM = 0.1 * AU_KM  # of a 1 sigma ellipse: a longer one reaches everything and tells nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InReach:
    """An impact that the orbit reaches within some sigmas of its target plane."""

    approach: Approach
    sigmas: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ahead:
    """What comes.

    Attributes
    ----------
    first, last : between which times it was looked; approaches : nearer than `WITHIN_AU`.
    in_reach : impacts within `REACH_SIGMAS`, by the linear target plane.
    reason : why it was not looked, or not so far; empty otherwise.
    period_d, sigma_period_d : None where the orbit does not return.
    moid_au, sigma_moid_au : from the Earth's orbit.
    """

    first: Epoch
    last: Epoch
    approaches: tuple[Approach, ...]
    in_reach: tuple[InReach, ...]
    reason: str
    period_d: float | None
    sigma_period_d: float | None
    moid_au: float
    sigma_moid_au: float
    magnitude: AbsoluteMagnitude | None


def look_ahead(found: OrbitFit, trajectory: Trajectory, amid: OrbitAt) -> Ahead:
    """Look ahead from the last observation of a fit.

    Parameters
    ----------
    trajectory : the fitted orbit with its sensitivities, from the epoch of the fit; amid : its state there.
    """
    forces, epoch = trajectory.forces, trajectory.epoch
    ephemeris = forces.ephemeris
    begin = float(found.general.fit.observation.t_s.max())
    _, end = (limit - epoch for limit in ephemeris.coverage(asteroids=forces.asteroids))
    wanted = begin + DAYS * SECONDS_PER_DAY
    last = min(wanted, end)
    near: tuple[Approach, ...] = ()
    every: tuple[Approach, ...] = ()
    reason = "" if last == wanted else f"looked ahead to the end of the ephemeris, {(epoch + last).iso('utc', 0)[:10]}"
    try:
        flight = follow(amid.state, epoch, (min(begin, 0.0), last), begin, forces, True)
        every = approaches_on(flight, _joint(found, flight), (begin, last), ALL_AU, BODIES).found
        near = tuple(one for one in every if one.distance_km <= WITHIN_AU * AU_KM or one.hits)
    except (CoverageError, EventError) as error:
        reason = f"not looked ahead: {error}"
    if found.verdict.failed:
        near, reason = (), "the orbit is not known well enough to say what it passes in the next days"
    period, sigma_period = _period(amid)
    moid, sigma_moid = earth_moid_km(amid.state, amid.S, ephemeris, epoch)
    return Ahead(
        first=epoch + begin,
        last=epoch + last,
        approaches=near,
        in_reach=tuple(_in_reach(every)),
        reason=reason,
        period_d=period,
        sigma_period_d=sigma_period,
        moid_au=moid / AU_KM,
        sigma_moid_au=sigma_moid / AU_KM,
        magnitude=absolute_magnitude(found, ephemeris),
    )


def _joint(found: OrbitFit, flight: Trajectory) -> Array:
    """Factor (6 + m, k) of the true covariance of state and parameters; zero rows of what has no error."""
    estimate = found.general.fit.estimate
    names = (*STATE_NAMES, *flight.parameter_names)
    known = {*estimate.names, *estimate.left_out}
    rows = [k for k, name in enumerate(names) if name in known]
    factor = estimate.factor([names[k] for k in rows])
    joint = np.zeros((len(names), factor.shape[1]))
    joint[rows] = factor
    return joint


def _in_reach(found: tuple[Approach, ...]) -> list[InReach]:
    """Impacts that an orbit within five sigmas has."""
    reached = []
    for one in found:
        ellipse = one.ellipse
        if not one.hits and (ellipse is None or ellipse.semi_axes[0] > LONGEST_KM):
            continue
        sigmas = sigmas_to_hit(one, REACH_SIGMAS)
        if sigmas is not None:
            reached.append(InReach(approach=one, sigmas=sigmas))
    return reached


def _period(orbit: OrbitAt) -> tuple[float | None, float | None]:
    """Period and its sigma, d: P = 2 pi sqrt(a^3/GM), dP = 3/2 P da/a, 1/a = 2/r - v^2/GM."""
    gm = orbit.gm_sun_km3_s2
    r, v = orbit.state[:3], orbit.state[3:]
    distance = float(np.linalg.norm(r))
    inverse = 2.0 / distance - float(v @ v) / gm
    if inverse <= 0.0:
        return None, None
    a = 1.0 / inverse
    by_state = a * a * np.concatenate([2.0 * r / distance**3, 2.0 * v / gm])
    period = 2.0 * np.pi * np.sqrt(a**3 / gm) / SECONDS_PER_DAY
    return float(period), float(1.5 * period / a * np.linalg.norm(by_state @ orbit.S))
