"""Axes: the ecliptic of J2000 as JPL defines it, and ICRF."""

import math

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import OBLIQUITY_J2000_RAD

Array = npt.NDArray[np.float64]

# Rotation about x by the IAU 1976 obliquity, 84381.448 arcsec: the frame of JPL's, ESA's and the MPC's elements
R_icrf_from_ecliptic: Array = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, math.cos(OBLIQUITY_J2000_RAD), -math.sin(OBLIQUITY_J2000_RAD)],
        [0.0, math.sin(OBLIQUITY_J2000_RAD), math.cos(OBLIQUITY_J2000_RAD)],
    ]
)
R_ecliptic_from_icrf: Array = np.ascontiguousarray(R_icrf_from_ecliptic.T)
