"""Where a virtual impactor comes down, at 100 km and on the ground: an ellipse where it is one; grazers apart."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import EARTH_RADIUS_KM
from nebosvod.estimation.accuracy.ellipse import Ellipse
from nebosvod.impacts.cloud import Crossing
from nebosvod.impacts.risk import VirtualImpactor
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
STRAIGHT_KM = 600.0  # of a 1 sigma ellipse: a longer one is bent over the ground
KURTOSIS = 1.0  # beyond a normal distribution's: cut or bent points are no ellipse
FEWEST = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Level:
    """The members that come down through a level.

    Attributes
    ----------
    share : of the hits, by weight. epoch, sigma_time_s : mean and spread.
    longitude_deg, latitude_deg : of the middle one, geodetic; nan on other bodies than the Earth.
    ellipse : km, about it, its angle from east towards north; None where the points form none, `no_ellipse` says why.
    speed_km_s, elevation_deg : means.
    """

    epoch: Epoch
    sigma_time_s: float
    longitude_deg: float
    latitude_deg: float
    ellipse: Ellipse | None
    no_ellipse: str
    speed_km_s: float
    elevation_deg: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corridor:
    """Entry at 100 km and on the ground, of orbits that reach the ground; and of how many that only graze.

    Attributes
    ----------
    entry, ground : None where no member has it.
    grazing : probability to come below 100 km and not to the ground.
    """

    entry: Level | None
    ground: Level | None
    grazing: float


def corridor_of(one: VirtualImpactor) -> Corridor:
    """The corridor of one virtual impactor, by its drawn orbits."""
    cloud, hits = one.cloud, one.passage.hits
    return Corridor(
        entry=_level(cloud.entry, hits, cloud.weights, cloud.epoch),
        ground=_level(cloud.ground, hits, cloud.weights, cloud.epoch),
        grazing=cloud.probability(cloud.grazes & np.isfinite(one.passage.t_s)),
    )


def _level(at: Crossing, which: npt.NDArray[np.bool_], weights: Array, epoch: Epoch) -> Level | None:
    here = which & np.isfinite(at.t_s)
    if not here.any():
        return None
    w = weights[here] / weights[here].sum()
    t, longitude, latitude = at.t_s[here], at.longitude_deg[here], at.latitude_deg[here]
    mean = float(w @ t)
    ellipse, why, middle = None, "of the Earth alone", int(np.argmin(np.abs(t - mean)))
    if np.isfinite(longitude).all():
        middle, flat = flattened(longitude, latitude, w)
        ellipse, why = _ellipse(flat, w)
    return Level(
        epoch=epoch + mean, sigma_time_s=float(np.sqrt(w @ (t - mean) ** 2)), longitude_deg=float(longitude[middle]),
        latitude_deg=float(latitude[middle]), ellipse=ellipse, no_ellipse=why,
        speed_km_s=float(w @ at.speed_km_s[here]), elevation_deg=float(w @ at.elevation_deg[here]),
    )  # fmt: skip


def flattened(longitude: Array, latitude: Array, w: Array) -> tuple[int, Array]:
    """Which point is amid the others, and all in km east and north of it (n, 2).

    Azimuthal equidistant about that point, which keeps the distances from it.
    """
    lon, lat = np.radians(longitude), np.radians(latitude)
    unit = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    middle = int(np.argmax(unit @ (w @ unit)))
    a, b = lon[middle], lat[middle]
    east = np.array([-np.sin(a), np.cos(a), 0.0])
    north = np.array([-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)])
    angle = np.arccos(np.clip(unit @ unit[middle], -1.0, 1.0))
    flat = np.stack([unit @ east, unit @ north], axis=1)
    scale = EARTH_RADIUS_KM * angle / np.maximum(np.linalg.norm(flat, axis=1), 1e-300)
    return middle, flat * np.where(angle > 0.0, scale, 0.0)[:, None]


def _ellipse(flat: Array, w: Array) -> tuple[Ellipse | None, str]:
    """The 1 sigma ellipse of points that form one."""
    if len(flat) < FEWEST:
        return None, f"{len(flat)} drawn orbits are too few for an ellipse"
    centred = (flat - w @ flat) * np.sqrt(w)[:, None]
    ellipse = Ellipse.of_factor(centred.T)
    if ellipse.semi_axes[0] > STRAIGHT_KM:
        return None, f"{ellipse.semi_axes[0]:.0f} km long (1 sigma), bent over the ground: the drawn points tell"
    along = (flat - w @ flat) @ np.array([np.cos(ellipse.angle_rad), np.sin(ellipse.angle_rad)]) / ellipse.semi_axes[0]
    excess = float(w @ along**4) - 3.0
    if abs(excess) > KURTOSIS:
        return None, "the points are cut off or bent, no ellipse: the drawn points tell"
    return ellipse, ""
