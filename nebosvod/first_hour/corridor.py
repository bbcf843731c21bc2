"""Where on the Earth the orbits that hit come down: on the ground, and where they pass 100 km."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.surface import height_km
from nebosvod.dynamics.twobody_many import fly
from nebosvod.engine.entry import place_of
from nebosvod.first_hour.contour import contours
from nebosvod.first_hour.falls import Falls
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.earth.ground import R_itrf_from_icrf
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ENTRY_KM = 100.0
MOST = 300  # orbits of which the place is told
STEPS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corridor:
    """Points of fall of m orbits, each with its weight among those that hit.

    Attributes
    ----------
    epoch : of the times. weight : (m,) normalised.
    t_s, entry_t_s : (m,) on the ground and at 100 km, TDB seconds after the epoch.
    place_deg, entry_deg : (m, 2) geodetic longitude and latitude there.
    speed_km_s, elevation_deg : (m,) at 100 km: relative to the Earth's centre, and the angle below the horizon.
    """

    epoch: Epoch
    weight: Array
    t_s: Array
    entry_t_s: Array
    place_deg: Array
    entry_deg: Array
    speed_km_s: Array
    elevation_deg: Array

    @property
    def contours_deg(self) -> dict[str, list[Array]]:
        """Closed lines around what holds 68 and 95 % of the points on the ground; longitudes run on across 180."""
        return contours(np.column_stack([self.longitude_deg, self.place_deg[:, 1]]), self.weight)

    @property
    def longitude_deg(self) -> Array:
        """(m,) on the ground, within half a turn of their middle."""
        turned = np.degrees(np.angle(np.exp(1j * np.radians(self.place_deg[:, 0])).sum()))
        return np.asarray(turned + (self.place_deg[:, 0] - turned + 180.0) % 360.0 - 180.0)


def corridor(tracklet: Tracklet, falls: Falls, rng: np.random.Generator) -> Corridor | None:
    """The points of fall on the Earth; None where no orbit hits it.

    Notes
    -----
    Of many orbits those shown are drawn by their weights. From the ground to 100 km the path is that of two bodies.
    """
    w = np.where(falls.hits(), falls.draws.weight(), 0.0)
    if not w.sum() > 0.0:
        return None
    w = w / w.sum()
    rows = np.flatnonzero(w)
    if len(rows) > MOST:
        rows, share = rng.choice(len(w), MOST, p=w), np.full(MOST, 1.0 / MOST)
    else:
        share = w[rows]
    ground = np.hstack([falls.position_km[rows], falls.velocity_km_s[rows]])
    gm, t_s = tracklet.forces.ephemeris.gm_km3_s2["earth"], falls.t_s[rows]
    before = _up_to(ground, t_s, tracklet.epoch, gm)
    entry = fly(ground, before, gm)
    up = entry[:, :3] / np.linalg.norm(entry[:, :3], axis=1)[:, None]
    speed = np.linalg.norm(entry[:, 3:], axis=1)
    return Corridor(
        epoch=tracklet.epoch, weight=share, t_s=t_s, entry_t_s=t_s + before,
        place_deg=_places(ground, t_s, tracklet.epoch), entry_deg=_places(entry, t_s + before, tracklet.epoch),
        speed_km_s=speed, elevation_deg=np.degrees(-np.arcsin(np.sum(up * entry[:, 3:], axis=1) / speed)),
    )  # fmt: skip


def _up_to(ground: Array, t_s: Array, epoch: Epoch, gm: float) -> Array:
    """How long before the ground (m,), s, negative, each orbit passed 100 km."""
    dt = np.full(len(ground), -1.0)
    for _ in range(STEPS):
        state = fly(ground, dt, gm)
        up = state[:, :3] / np.linalg.norm(state[:, :3], axis=1)[:, None]
        climb = np.minimum(np.sum(up * state[:, 3:], axis=1), -0.05)
        dt = dt - np.clip((height_km("earth", state[:, :3], epoch, t_s) - ENTRY_KM) / climb, -60.0, 60.0)
    return dt


def _places(states: Array, t_s: Array, epoch: Epoch) -> Array:
    """Geodetic longitude and latitude (m, 2), deg."""
    found = np.empty((len(states), 2))
    for k, (r, t) in enumerate(zip(states[:, :3], t_s.tolist(), strict=True)):
        place = place_of(R_itrf_from_icrf(epoch + t) @ r)
        found[k] = np.degrees([place.longitude_rad, place.latitude_rad])
    return found
