"""Constants of observing from or near the Earth: name with unit, value, source."""

EARTH_ROTATION_RAD_S = 7.292115146706979e-5  # rate of the Earth rotation angle, IAU 2000 resolution B1.8
EARTH_J2 = 1.0826359e-3  # IERS Conventions 2010, table 1.1 (zero tide)
