"""Where on the Earth the orbits that hit come down, and where they pass 100 km.

An asteroid of some metres ends in a burst between 20 and 50 km, a stronger one on the ground. At a flat angle these are
a hundred kilometres apart, much more than is unknown of a well observed orbit. So the height of the end is unknown too:
it is drawn, uniform from the ground to 50 km.
"""

from dataclasses import dataclass

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import EARTH_FLATTENING, EARTH_RADIUS_KM
from nebosvod.dynamics.surface import height_km
from nebosvod.dynamics.twobody_many import fly
from nebosvod.first_hour.contour import contours
from nebosvod.first_hour.falls import Falls
from nebosvod.first_hour.tangent import Tangent, angles, directions
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.earth.ground import R_itrf_from_icrf_at
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ENTRY_KM, HIGHEST_END_KM = 100.0, 50.0
MOST = 300  # orbits of which the place is told
STEPS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corridor:
    """Points of fall of m orbits, each with its weight among those that hit.

    Attributes
    ----------
    epoch : of the times. weight : (m,) normalised.
    t_s, entry_t_s : (m,) on the ground and at 100 km, TDB seconds after the epoch.
    height_km : (m,) where it is taken to end.
    place_deg, entry_deg : (m, 2) geodetic longitude and latitude there and at 100 km.
    speed_km_s, elevation_deg : (m,) at 100 km: relative to the Earth's centre, and the angle below the horizon.
    """

    epoch: Epoch
    weight: Array
    t_s: Array
    entry_t_s: Array
    height_km: Array
    place_deg: Array
    entry_deg: Array
    speed_km_s: Array
    elevation_deg: Array

    @property
    def contours_deg(self) -> dict[str, list[Array]]:
        """Closed lines around the densest parts that hold 68 and 95 %; longitudes run on across 180."""
        u = directions(np.radians(self.place_deg))
        tangent = Tangent.about(u, self.weight)
        drawn = contours(tangent.onto(u), self.weight)
        return {share: [self._line(edge, tangent) for edge in edges] for share, edges in drawn.items()}

    def _line(self, edge: Array, tangent: Tangent) -> Array:
        """A line (k, 2), deg, of one of the plane: its longitudes run on; closed over a pole that is inside of it."""
        psi = angles(tangent.back(edge))
        found = np.degrees(np.stack([np.unwrap(psi[:, 0]), psi[:, 1]], axis=1))
        if abs(found[-1, 0] - found[0, 0]) > 180.0:
            north = tangent.onto(np.array([[0.0, 0.0, 1.0]]))[0] - edge
            turned = np.unwrap(np.arctan2(north[:, 1], north[:, 0]))
            pole = 90.0 if abs(turned[-1] - turned[0]) > np.pi else -90.0
            found = np.vstack([found, [found[-1, 0], pole], [found[0, 0], pole], found[0]])
        middle = float(self.weight @ self.longitude_deg)
        found[:, 0] -= 360.0 * np.round((found[:, 0].mean() - middle) / 360.0)
        return np.asarray(found)

    @property
    def longitude_deg(self) -> Array:
        """(m,) of the ends, within half a turn of their middle."""
        turned = np.degrees(np.angle(self.weight @ np.exp(1j * np.radians(self.place_deg[:, 0]))))
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
    share = w[rows]
    if len(rows) > MOST:  # at equal steps of the weight: one that weighs much comes several times
        at = np.searchsorted(np.cumsum(w), (np.arange(MOST) + rng.random()) / MOST)
        rows, times = np.unique(np.minimum(at, len(w) - 1), return_counts=True)
        share = times / MOST
    ground = np.hstack([falls.position_km[rows], falls.velocity_km_s[rows]])
    gm, t_s = tracklet.forces.ephemeris.gm_km3_s2["earth"], falls.t_s[rows]
    height_km = HIGHEST_END_KM * rng.random(len(rows))
    end = _up_to(ground, t_s, tracklet.epoch, gm, height_km)
    before = _up_to(ground, t_s, tracklet.epoch, gm, np.full(len(rows), ENTRY_KM))
    entry = fly(ground, before, gm)
    up = entry[:, :3] / np.linalg.norm(entry[:, :3], axis=1)[:, None]
    speed = np.linalg.norm(entry[:, 3:], axis=1)
    places = _places(fly(ground, end, gm), t_s + end, tracklet.epoch)
    return Corridor(
        epoch=tracklet.epoch, weight=share, t_s=t_s, entry_t_s=t_s + before, height_km=height_km, place_deg=places,
        entry_deg=_places(entry, t_s + before, tracklet.epoch),
        speed_km_s=speed, elevation_deg=np.degrees(-np.arcsin(np.sum(up * entry[:, 3:], axis=1) / speed)),
    )  # fmt: skip


def _up_to(ground: Array, t_s: Array, epoch: Epoch, gm: float, height: Array) -> Array:
    """How long before the ground (m,), s, negative, each orbit passed a height (m,), km."""
    dt = np.full(len(ground), -1.0)
    for _ in range(STEPS):
        state = fly(ground, dt, gm)
        up = state[:, :3] / np.linalg.norm(state[:, :3], axis=1)[:, None]
        climb = np.minimum(np.sum(up * state[:, 3:], axis=1), -0.05)
        dt = dt - np.clip((height_km("earth", state[:, :3], epoch, t_s) - height) / climb, -60.0, 60.0)
    return dt


def _places(states: Array, t_s: Array, epoch: Epoch) -> Array:
    """Geodetic longitude and latitude (m, 2), deg."""
    fixed = np.einsum("nij,nj->ni", R_itrf_from_icrf_at(epoch, t_s), states[:, :3])
    longitude, latitude, _ = erfa.gc2gde(EARTH_RADIUS_KM, EARTH_FLATTENING, fixed)
    turned = (longitude + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(np.degrees(np.stack([turned, latitude], axis=1)))
