"""Physical constants: name with unit, value, source. Masses and harmonics come with the ephemeris instead.

GM, the Earth's and the Sun's zonal harmonics and their reference radii belong to the ephemeris that was fitted with
them; `Ephemeris.gm_km3_s2` and `Ephemeris.scalars` hold those.
"""

import math
from types import MappingProxyType

from nebosvod.units import AU_KM as AU_KM
from nebosvod.units import DAY_S as DAY_S

SPEED_OF_LIGHT_KM_S = 299792.458  # BIPM, SI definition of the metre (exact)
# coefficients of a record, the size of the kernels' table; DE440, DE441 and their asteroids have 14 at most
MOST_ORDERS = 16
J2000_JD = 2451545.0  # 2000-01-01T12:00:00 TDB, IAU 1976 System of Astronomical Constants
SOLAR_IRRADIANCE_W_M2 = 1361.0  # total solar irradiance at 1 au; Kopp and Lean 2011 (GRL 38, L01706) give 1360.8 +- 0.5
OBLIQUITY_J2000_RAD = math.radians(84381.448 / 3600.0)  # ecliptic_j2000 of JPL; IAU 1976 (Lieske et al. 1977)

# au/d^2 -> km/s^2, for Marsden's A1, A2, A3
AU_D2_KM_S2 = AU_KM / DAY_S**2
# radiation pressure: (S0/c) (1 au)^2 in km^3/s^2 per m^2/kg of area-to-mass ratio
RADIATION_KM3_S2_PER_M2_KG = SOLAR_IRRADIANCE_W_M2 / (SPEED_OF_LIGHT_KM_S * 1e3) * 1e-3 * AU_KM**2

# The ellipsoid of WGS 84: heights, geodetic latitudes, and where a fall ends
EARTH_RADIUS_KM, EARTH_FLATTENING = 6378.137, 1.0 / 298.257223563

# Mean radii, km, of the asteroids that perturb: surfaces for impact tests (JPL Small-Body Database, half the diameters,
# rounded)
ASTEROID_RADIUS_KM = MappingProxyType(
    {
        "camilla": 105.0, "ceres": 470.0, "cybele": 119.0, "davida": 135.0, "eunomia": 116.0, "euphrosyne": 134.0,
        "europa": 152.0, "hygiea": 204.0, "interamnia": 153.0, "iris": 100.0, "juno": 123.0, "pallas": 256.0,
        "psyche": 111.0, "sylvia": 127.0, "thisbe": 116.0, "vesta": 261.0,
    }
)  # fmt: skip
# Equatorial radii, km: IAU WGCCRE 2015 (Archinal et al. 2018, CMDA 130:22); Sun: IAU 2015 resolution B3;
# Earth: DE440 (RE). Surfaces for impact tests and limbs.
RADIUS_KM = MappingProxyType(
    {
        "sun": 695700.0,
        "mercury": 2440.53,
        "venus": 6051.8,
        "earth": 6378.1366,
        "moon": 1737.4,
        "mars": 3396.19,
        "jupiter": 71492.0,
        "saturn": 60268.0,
        "uranus": 25559.0,
        "neptune": 24764.0,
        "pluto": 1188.3,
    }
)
