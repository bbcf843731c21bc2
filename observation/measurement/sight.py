"""The line of sight: light time, direction and rate of a moving target from a moving telescope."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.measurement import rows
from nebosvod.observation.measurement.exposures import Exposures, own, reception_times
from nebosvod.observation.spacecraft.kinds import Spacecraft

LIGHT_TIME_TOLERANCE_S = 1e-9
NEAR_S = 0.1  # a light time this close is corrected along the velocity
MAX_ITERATIONS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """Lines of sight at n reception times; arrays have the epoch on the first axis.

    Attributes
    ----------
    t_s : (n,) reception times, TDB seconds after the trajectory's epoch.
    telescope_state : (n, 6) barycentric ICRF at reception.
    target_state : (n, 6) barycentric ICRF at emission, km and km/s.
    heliocentric_state : (n, 6) of the target at emission.
    u : (n, 3) unit vectors telescope -> target, ICRF.
    distance_km, light_time_s : (n,).
    psi : (n, 2) RA in [0, 2 pi) and Dec, astrometric (no aberration), rad.
    """

    t_s: Array
    telescope_state: Array
    target_state: Array
    heliocentric_state: Array
    u: Array
    distance_km: Array
    light_time_s: Array
    psi: Array

    def sky_partials(self) -> Array:
        """D L (n, 2, 3), rad/km: partials of (cos Dec dRA, dDec) by the target's position less the telescope's."""
        DL = np.empty((self.t_s.size, 2, 3))
        rows.sky_partials(self.target_state, self.u, self.distance_km, DL)
        return DL

    def rate(self, sky_partials: Array) -> Array:
        """Apparent motion (n, 2) in RA cos Dec and Dec, rad/s: D L (V - v_telescope)."""
        motion = np.empty((self.t_s.size, 2))
        rows.apparent_rates(sky_partials, self.target_state, self.telescope_state, motion)
        return motion


@bordered()
def sight(trajectory: Trajectory, spacecraft: Spacecraft, t_s: Array, ephemeris: Ephemeris) -> Sight:
    """Solve the light time from `trajectory` to `spacecraft` for receptions at `t_s`.

    Parameters
    ----------
    trajectory : heliocentric; must reach back the light time before the first reception.
    t_s : shape (n,), TDB seconds after `trajectory.epoch`.

    Raises
    ------
    InputError
        If `t_s` is empty or not finite, or the light time does not settle to 1e-9 s in ten iterations, which takes a
        target about as fast as light.
    CoverageError
        If an emission time lies outside the trajectory (raised by it).

    Notes
    -----
    As `lines_of_sight`.
    """
    t_s = reception_times(t_s)
    observer = spacecraft.state_km_km_s(ephemeris, trajectory.epoch, t_s)
    exposures = Exposures.at(trajectory.epoch, t_s, observer, ephemeris)
    return lines_of_sight(trajectory, exposures)


def lines_of_sight(
    trajectory: Trajectory,
    exposures: Exposures,
    *,
    near: Array | None = None,
    emitted: Callable[[Array], Array] | None = None,
) -> Sight:
    """Solve the light time of every exposure: the only place where that is done.

    Parameters
    ----------
    exposures : counted from `trajectory.epoch`.
    near : light times (n,) of a near orbit, such as those of the last iteration.
    emitted : gives the trajectory's states (n, 6) at emission times, `trajectory.state_at` by default; for a caller
        that keeps more of the last call than the states.

    Raises
    ------
    InputError, CoverageError
        As `sight`.

    Notes
    -----
    rho = r_target(t - tau) - r_telescope(t) with both vectors BARYCENTRIC, c tau = |rho|. Newton: with V the target's
    velocity, tau -> tau + (|rho| - c tau) / (c + u.V). The first step, from tau = 0, adds the fall towards the Sun, so
    that one evaluation of the trajectory usually confirms the light time. A light time that is off by less than 0.1 s
    is corrected along the velocity: even a fall of 10 m/s^2 close to the Earth then adds 5 cm. The Sun is carried from
    reception to emission by its velocity and acceleration.
    """
    emitted = emitted or trajectory.state_at
    n = len(exposures)
    distance, light_time = np.empty((2, n))
    target, u, psi = np.empty((n, 6)), np.empty((n, 3)), np.empty((n, 2))
    if near is None:
        tau = np.empty(n)
        heliocentric = own(trajectory.state_at(exposures.t_s))
        rows.first_light_times(exposures.gm_sun_km3_s2, heliocentric, exposures.sun, exposures.observer, tau)
    else:
        tau = near.copy()
    for _ in range(MAX_ITERATIONS):
        heliocentric = own(emitted(exposures.t_s - tau))
        largest = rows.lines_of_sight(
            tau, heliocentric, exposures.sun, exposures.sun_pull, exposures.observer, NEAR_S, LIGHT_TIME_TOLERANCE_S,
            target, u, distance, light_time, psi,
        )  # fmt: skip
        if largest == 0.0:
            return Sight(
                t_s=exposures.t_s,
                telescope_state=exposures.observer,
                target_state=target,
                heliocentric_state=heliocentric,
                u=u,
                distance_km=distance,
                light_time_s=light_time,
                psi=psi,
            )
    worst = int(np.argmax(np.abs(tau - light_time)))
    raise InputError(
        f"sight: light time did not settle to {LIGHT_TIME_TOLERANCE_S} s in {MAX_ITERATIONS} iterations "
        f"(last step {largest:.3g} s at t = {exposures.t_s[worst]:.3f} s); is the target's state in km and km/s?"
    )
