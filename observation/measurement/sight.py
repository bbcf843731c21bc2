"""The line of sight: light time, direction and rate of a moving target from a moving telescope."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.measurement import rows
from nebosvod.observation.spacecraft.kinds import Spacecraft

LIGHT_TIME_TOLERANCE_S = 1e-9
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
def sight(
    trajectory: Trajectory,
    spacecraft: Spacecraft,
    t_s: Array,
    ephemeris: Ephemeris,
    emitted: Callable[[Array], Array] | None = None,
) -> Sight:
    """Solve the light time from `trajectory` to `spacecraft` for receptions at `t_s`.

    Parameters
    ----------
    trajectory : heliocentric; must reach back the light time before the first reception.
    t_s : shape (n,), TDB seconds after `trajectory.epoch`.
    emitted : gives the trajectory's states (n, 6) at emission times, `trajectory.state_at` by default; for a caller
        that keeps more of the last call than the states.

    Raises
    ------
    InputError
        If `t_s` is empty or not finite, or the light time does not settle to 1e-9 s in ten iterations, which takes a
        target about as fast as light.
    CoverageError
        If an emission time lies outside the trajectory (raised by it).

    Notes
    -----
    rho = r_target(t - tau) - r_telescope(t) with both vectors BARYCENTRIC, c tau = |rho|. Newton: with V the target's
    velocity, tau -> tau + (|rho| - c tau) / (c + u.V). The first step, from tau = 0, adds the fall towards the Sun, so
    that the second evaluation of the trajectory usually confirms the light time.
    """
    t_s = reception_times(t_s)
    epoch, emitted = trajectory.epoch, emitted or trajectory.state_at
    telescope = _own(spacecraft.state_km_km_s(ephemeris, epoch, t_s))
    tau, step, distance, light_time = np.empty((4, t_s.size))
    target, u, psi = np.empty((t_s.size, 6)), np.empty((t_s.size, 3)), np.empty((t_s.size, 2))
    heliocentric, sun = _own(trajectory.state_at(t_s)), _own(ephemeris.state_km_km_s("sun", epoch, t_s))
    rows.first_light_times(ephemeris.gm_km3_s2["sun"], heliocentric, sun, telescope, tau)
    for _ in range(MAX_ITERATIONS):
        emission = t_s - tau
        heliocentric, sun = _own(emitted(emission)), _own(ephemeris.state_km_km_s("sun", epoch, emission))
        largest = rows.lines_of_sight(tau, heliocentric, sun, telescope, step, target, u, distance, light_time, psi)
        if largest <= LIGHT_TIME_TOLERANCE_S:
            return Sight(
                t_s=t_s,
                telescope_state=telescope,
                target_state=target,
                heliocentric_state=heliocentric,
                u=u,
                distance_km=distance,
                light_time_s=light_time,
                psi=psi,
            )
        tau += step
    raise InputError(
        f"sight: light time did not settle to {LIGHT_TIME_TOLERANCE_S} s in {MAX_ITERATIONS} iterations "
        f"(last step {np.max(np.abs(step)):.3g} s at t = {t_s[np.argmax(np.abs(step))]:.3f} s); "
        "is the target's state in km and km/s?"
    )


def reception_times(t_s: npt.ArrayLike) -> Array:
    """A copy of the times as a contiguous vector (n,).

    Raises
    ------
    InputError
        If they are no vector, empty, or not finite.
    """
    times = np.array(t_s, dtype=np.float64)
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)):
        raise InputError(f"sight: reception times must be a non-empty vector of finite numbers (shape {times.shape})")
    return times


def _own(states: Array) -> Array:
    """States as the compiled loops want them, C-contiguous and writable: copied only if they are not."""
    return np.require(states, dtype=np.float64, requirements=("C", "W"))
