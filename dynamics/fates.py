"""What becomes of each orbit of a cloud: where and when it hits a body, or how near it comes to one.

An orbit that stays clear of every surface has been sampled every hour around the encounter of the middle of the cloud;
its closest approach is that of its two-body motion from the nearest sample, at most half an hour away.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.encounter import find_encounters, relative_state
from nebosvod.dynamics.ephemeris import Ephemeris
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
HALF_WINDOW_S = 1.5 * DAY_S
SAMPLE_S = 3600.0
CLEAR = 2.0  # a clone is followed to its closest approach by two bodies where that is farther than so many radii


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fates:
    """What becomes of each clone.

    Attributes
    ----------
    body : (k,) what it hits or comes near to; "" where it hits nothing and no encounter was asked about or found.
    impact : (k,) whether it comes down to the surface: of the Earth the ellipsoid of WGS 84, of another body a sphere.
    t_s : (k,) when it comes to the surface, or its closest approach, TDB seconds after the epoch; nan without a body.
    position_km, velocity_km_s : (k, 3) where then and how fast, from the centre of the body, ICRF.
    distance_km : (k,) how far from that centre.
    """

    body: npt.NDArray[np.str_]
    impact: npt.NDArray[np.bool_]
    t_s: Array
    position_km: Array
    velocity_km_s: Array
    distance_km: Array

    @classmethod
    def unknown(cls, count: int) -> "Fates":
        """Fates of so many clones of which nothing is known yet."""
        return cls(
            body=np.full(count, "", dtype="<U16"),
            impact=np.zeros(count, dtype=np.bool_),
            t_s=np.full(count, np.nan),
            position_km=np.full((count, 3), np.nan),
            velocity_km_s=np.full((count, 3), np.nan),
            distance_km=np.full(count, np.nan),
        )

    def set(self, k: int, body: str, impact: bool, t_s: float, state: Array) -> None:
        """Write the fate of one clone, with its state (6,) from the centre of the body."""
        self.body[k], self.impact[k], self.t_s[k] = body, impact, t_s
        self.position_km[k], self.velocity_km_s[k] = state[:3], state[3:]
        self.distance_km[k] = np.linalg.norm(state[:3])


def window_of(middle: Trajectory, body: str | None) -> Array:
    """Times (n,) an hour apart around the deepest encounter of the middle; none without a body or an encounter."""
    if body is None:
        return np.empty(0)
    events = find_encounters(middle, body)
    if not events:
        return np.empty(0)
    t = min(events, key=lambda event: event.distance_km).t_s
    first, last = middle.span_s
    low, high = max(t - HALF_WINDOW_S, first), min(t + HALF_WINDOW_S, last)
    return np.linspace(low, high, max(int((high - low) / SAMPLE_S) + 1, 3))


def passages(
    states: Array, times: Array, body: str, ephemeris: Ephemeris, epoch: Epoch, fates: Fates
) -> npt.NDArray[np.bool_]:
    """Fill in the closest approaches of clones by their heliocentric states (k, n, 6) at times (n,) of the window.

    Returns (k,) which clones this does not tell of: nearest at an end of the window, bound to the body, within two
    radii of its centre, or without states.
    """
    place = ephemeris.state_km_km_s(body, epoch, times) - ephemeris.state_km_km_s("sun", epoch, times)
    distance = np.linalg.norm(states[:, :, :3] - place[:, :3], axis=2)
    nearest = np.argmin(np.where(np.isfinite(distance), distance, np.inf), axis=1)
    x = states[np.arange(len(states)), nearest] - place[nearest]
    gm = ephemeris.gm_km3_s2[body]
    r, v = x[:, :3], x[:, 3:]
    h = np.cross(r, v)
    toward = np.cross(v, h) / gm - r / np.linalg.norm(r, axis=1)[:, None]
    e = np.linalg.norm(toward, axis=1)
    lowest = np.sum(h**2, axis=1) / gm / (1.0 + e)
    energy = np.sum(v**2, axis=1) / gm - 2.0 / np.linalg.norm(r, axis=1)
    a = 1.0 / np.where(energy > 0.0, energy, np.nan)
    sinh = np.einsum("ki,ki->k", r, v) / (e * np.sqrt(gm * a))
    late = (e * sinh - np.arcsinh(sinh)) * np.sqrt(a**3 / gm)  # after the pericentre
    told = np.isfinite(late) & (nearest > 0) & (nearest < len(times) - 1) & (lowest > CLEAR * SURFACE_KM[body])
    fates.body[told], fates.impact[told] = body, False
    fates.t_s[told], fates.distance_km[told] = (times[nearest] - late)[told], lowest[told]
    fates.position_km[told] = (toward * (lowest / e)[:, None])[told]
    fates.velocity_km_s[told] = (np.cross(h, toward) / (e * lowest)[:, None])[told]  # h = r x v, at right angles
    untold: npt.NDArray[np.bool_] = ~told
    return untold


def passage(k: int, orbit: Trajectory, body: str | None, about_s: float, offset_s: float, fates: Fates) -> None:
    """The closest approach of one clone that flew alone, nearest in time to that of the middle.

    Parameters
    ----------
    about_s, offset_s : when the middle has it, and when the orbit's own epoch is, TDB seconds after the cloud's.
    """
    events = find_encounters(orbit, body) if body is not None else ()
    if body is not None and events:
        event = min(events, key=lambda event: abs(event.t_s + offset_s - about_s))
        fates.set(k, body, False, event.t_s + offset_s, event.state)


def arrival_of(k: int, orbit: Trajectory, body: str, t_s: float, offset_s: float, fates: Fates) -> None:
    """The impact of one clone, whose orbit reaches the time of it."""
    fates.set(k, body, True, t_s + offset_s, relative_state(orbit, body)(np.array([t_s]))[0])
