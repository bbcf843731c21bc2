"""The line of sight: light time, direction and rate of a moving target from a moving telescope."""

from dataclasses import dataclass

import numpy as np

from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.direction import ra_dec, tangent_axes
from nebosvod.observation.spacecraft import Spacecraft

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

    def light_time_factor(self) -> Array:
        """L (n, 3, 3) = I - V u^T / (c + u.V): how rho moves with the target (at emission) less the telescope."""
        V = self.target_state[:, 3:]
        scale = SPEED_OF_LIGHT_KM_S + np.einsum("ni,ni->n", self.u, V)
        L: Array = np.eye(3) - V[:, :, None] * (self.u / scale[:, None])[:, None, :]
        return L

    def sky_partials(self) -> Array:
        """D L (n, 2, 3), rad/km: partials of (cos Dec dRA, dDec) by the target's position less the telescope's."""
        D = tangent_axes(self.psi) / self.distance_km[:, None, None]
        partials: Array = D @ self.light_time_factor()
        return partials

    def rate(self, sky_partials: Array) -> Array:
        """Apparent motion (n, 2) in RA cos Dec and Dec, rad/s: D L (V - v_telescope)."""
        velocity = self.target_state[:, 3:] - self.telescope_state[:, 3:]
        motion: Array = (sky_partials @ velocity[:, :, None])[:, :, 0]
        return motion


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
    rho = r_target(t - tau) - r_telescope(t) with both vectors BARYCENTRIC, c tau = |rho|. Newton: with V the target's
    velocity, tau -> tau + (|rho| - c tau) / (c + u.V). The first step, from tau = 0, adds the fall towards the Sun, so
    that the second evaluation of the trajectory usually confirms the light time.
    """
    t_s = np.asarray(t_s, dtype=np.float64)
    if t_s.ndim != 1 or t_s.size == 0 or not np.all(np.isfinite(t_s)):
        raise InputError(f"sight: reception times must be a non-empty vector of finite numbers (shape {t_s.shape})")
    telescope = spacecraft.state_km_km_s(ephemeris, trajectory.epoch, t_s)
    tau = _first_light_time(trajectory, telescope, t_s, ephemeris)
    for _ in range(MAX_ITERATIONS):
        heliocentric = trajectory.state_at(t_s - tau)
        target = heliocentric + ephemeris.state_km_km_s("sun", trajectory.epoch, t_s - tau)
        rho = target[:, :3] - telescope[:, :3]
        distance = np.linalg.norm(rho, axis=1)
        u = rho / distance[:, None]
        speed = np.einsum("ni,ni->n", u, target[:, 3:])
        step = (distance - SPEED_OF_LIGHT_KM_S * tau) / (SPEED_OF_LIGHT_KM_S + speed)
        if np.all(np.abs(step) <= LIGHT_TIME_TOLERANCE_S):
            return Sight(
                t_s=t_s,
                telescope_state=telescope,
                target_state=target,
                heliocentric_state=heliocentric,
                u=u,
                distance_km=distance,
                light_time_s=distance / SPEED_OF_LIGHT_KM_S,
                psi=ra_dec(rho),
            )
        tau = tau + step
    raise InputError(
        f"sight: light time did not settle to {LIGHT_TIME_TOLERANCE_S} s in {MAX_ITERATIONS} iterations "
        f"(last step {np.max(np.abs(step)):.3g} s at t = {t_s[np.argmax(np.abs(step))]:.3f} s); "
        "is the target's state in km and km/s?"
    )


def _first_light_time(trajectory: Trajectory, telescope: Array, t_s: Array, ephemeris: Ephemeris) -> Array:
    """Light time (n,) from the state at reception: r - V tau + a tau^2 / 2 with the Sun's pull."""
    heliocentric = trajectory.state_at(t_s)
    target = heliocentric + ephemeris.state_km_km_s("sun", trajectory.epoch, t_s)
    r = heliocentric[:, :3]
    a = r * (-ephemeris.gm_km3_s2["sun"] / np.sum(r * r, axis=1) ** 1.5)[:, None]
    start = target[:, :3] - telescope[:, :3]
    tau = np.zeros_like(t_s)
    for _ in range(3):  # each gains a factor V/c
        back = start + (a * (tau / 2.0)[:, None] - target[:, 3:]) * tau[:, None]
        tau = np.linalg.norm(back, axis=1) / SPEED_OF_LIGHT_KM_S
    return tau
