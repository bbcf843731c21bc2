"""The absolute magnitude H that the magnitudes of records give.

Each becomes V by the Minor Planet Center's table of bands (minorplanetcenter.net/iau/info/BandConversion.txt), then H
at G = 0.15. The median is robust against wrong ones; light curves and catalogues differ by some 0.3 mag, so that the
scatter says more than its root-n part.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.fits.engine import OrbitFit
from nebosvod.observation.contracts import Array
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.photometry import apparent_magnitude

SLOPE = 0.15
MAD = 1.4826
TO_V: Mapping[str, float] = MappingProxyType(
    {
        "": -0.8, "U": -1.3, "B": -0.8, "g": -0.35, "V": 0.0, "v": 0.0, "r": 0.14, "R": 0.4, "C": 0.4, "W": 0.4,
        "i": 0.32, "z": 0.26, "I": 0.8, "J": 1.2, "w": -0.13, "y": 0.32, "L": 0.2, "H": 1.4, "K": 1.7, "Y": 0.7,
        "G": 0.28, "c": -0.05, "o": 0.33, "u": 2.5,
    }
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class AbsoluteMagnitude:
    """H at G = 0.15: the median of `count` magnitudes, and their scatter by the median of deviations, mag."""

    H: float
    scatter: float
    count: int


def absolute_magnitude(found: OrbitFit, ephemeris: Ephemeris) -> AbsoluteMagnitude | None:
    """H of the magnitudes of the selected records; None where there is none of a known band."""
    records, general = found.material.astrometry, found.general
    correction = np.array([TO_V.get(str(band)[-1:], np.nan) for band in records.band])
    apparent = np.asarray(records.magnitude, dtype=np.float64) + correction
    used = np.isfinite(apparent) & general.selected
    if not used.any():
        return None
    seen = general.seen
    left = records.t_s + (records.epoch - found.epoch) - seen.light_time_s
    from_sun: Array = seen.target_state[:, :3] - ephemeris.position_km("sun", found.epoch, left)
    phase = angle_between(-from_sun, -seen.u)
    reduced = apparent - apparent_magnitude(0.0, SLOPE, np.linalg.norm(from_sun, axis=1), seen.distance_km, phase)
    values = reduced[used & np.isfinite(reduced)]
    if not len(values):
        return None
    H = float(np.median(values))
    return AbsoluteMagnitude(H=H, scatter=float(MAD * np.median(np.abs(values - H))), count=len(values))
