"""Which ranges and range rates are asked about: bound to the Sun, above the ground, of a size that there is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import EARTH_RADIUS_KM
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.photometry import apparent_magnitude
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
NEAREST_AU, FARTHEST_AU = 1e-5, 60.0
SLOPE = 0.15
LARGEST_PHASE = np.radians(150.0)
ALBEDO = 0.154
FASTEST_KM_S = 60.0  # beyond parabolic, of orbits that need not be bound


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Limits of the search.

    Attributes
    ----------
    bound : whether only orbits bound to the Sun count.
    smallest_m, largest_km : diameters at an albedo of 0.154, tried against the magnitude as it was seen; without a
        magnitude they limit nothing.
    nearest_au, farthest_au : ranges.
    """

    bound: bool = True
    smallest_m: float = 0.3
    largest_km: float = 1000.0
    nearest_au: float = NEAREST_AU
    farthest_au: float = FARTHEST_AU

    def ranges(self, tracklet: Tracklet) -> tuple[float, float]:
        """Least and largest ln(range / au) that the size leaves."""
        x = np.linspace(np.log(self.nearest_au), np.log(self.farthest_au), 400)
        H = absolute_magnitudes(tracklet, x)
        if H is None:
            return float(x[0]), float(x[-1])
        good = np.flatnonzero((magnitude_of(self.smallest_m / 1e3) >= H) & (magnitude_of(self.largest_km) <= H))
        return (float(x[good[0]]), float(x[good[-1]])) if good.size else (float(x[0]), float(x[-1]))

    def rates(self, conditional: Conditional, coordinates: Array) -> tuple[Array, Array]:
        """Least and largest range rate (m,), km/s, of the orbits allowed at coordinates (m, 6); empty: both nan.

        |v|^2 = |v_0|^2 + 2 y v_0.u + y^2 < 2 GM / r, with the velocity v_0 at range rate 0.
        """
        still = coordinates.copy()
        still[:, 1] = 0.0
        states = conditional.states(still)
        line = states[:, :3] - conditional.tracklet.place[:3]
        line = line / np.linalg.norm(line, axis=1)[:, None]
        along = np.sum(states[:, 3:] * line, axis=1)
        parabolic = 2.0 * conditional.sight.gm / np.linalg.norm(states[:, :3], axis=1)
        limit = parabolic if self.bound else (np.sqrt(parabolic) + FASTEST_KM_S) ** 2
        room = along**2 - np.sum(states[:, 3:] ** 2, axis=1) + limit
        half = np.sqrt(np.where(room > 0.0, room, np.nan))
        return -along - half, -along + half

    def holds(self, states: Array, gm_km3_s2: float) -> npt.NDArray[np.bool_]:
        """Which heliocentric states (m, 6) are bound, where only such count: far away a motion's error unbinds some."""
        energy = 0.5 * np.sum(states[:, 3:] ** 2, axis=1) - gm_km3_s2 / np.linalg.norm(states[:, :3], axis=1)
        found: npt.NDArray[np.bool_] = (energy < 0.0) | (not self.bound)
        return found

    def allows(self, above_km: Array) -> npt.NDArray[np.bool_]:
        """Which orbits (m,) stay above the Earth at the measurements."""
        allowed: npt.NDArray[np.bool_] = above_km > EARTH_RADIUS_KM
        return allowed


def absolute_magnitudes(tracklet: Tracklet, ranges: Array) -> Array | None:
    """H (m,) of an object of this brightness at ln(range / au) (m,); None without a magnitude."""
    if tracklet.magnitude is None:
        return None
    u = tracklet.axes[tracklet.reference, 2]
    rho = np.exp(ranges) * AU_KM
    return magnitudes_of(tracklet, tracklet.place[:3] + rho[:, None] * u)


def magnitudes_of(tracklet: Tracklet, places: Array) -> Array | None:
    """H (m,) of an object of this brightness at heliocentric places (m, 3), km; None without a magnitude."""
    if tracklet.magnitude is None:
        return None
    away = places - tracklet.place[:3]
    phase = angle_between(-places, -away)
    r, d = np.linalg.norm(places, axis=1), np.linalg.norm(away, axis=1)
    found: Array = tracklet.magnitude - faintness(r, d, phase)
    return found


def faintness(r_sun_km: Array, distance_km: Array, phase_rad: Array) -> Array:
    """V of H = 0. H, G is an extrapolation beyond 120 deg, and near the Sun one by tens of magnitudes: held at 150 deg.

    Without that whoever is seen beside the Sun must be larger than 1000 km unless it is far behind it.
    """
    return apparent_magnitude(0.0, SLOPE, r_sun_km, distance_km, np.minimum(phase_rad, LARGEST_PHASE))


def magnitude_of(diameter_km: float) -> float:
    """H of a diameter: D = 1329 km / sqrt(albedo) 10^(-H / 5)."""
    return float(5.0 * np.log10(1329.0 / np.sqrt(ALBEDO) / diameter_km))


def diameter_m(H: Array) -> Array:
    """Diameters, m, of absolute magnitudes."""
    found: Array = 1e3 * 1329.0 / np.sqrt(ALBEDO) * 10.0 ** (-np.asarray(H) / 5.0)
    return found
