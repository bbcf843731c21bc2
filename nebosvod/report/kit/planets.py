"""Where the planets are, for pictures: mean elements of 1800 to 2050, good to some 1e-3 of their distance.

A page is made from its folder alone, which has no ephemeris. The numbers of the report do not come from here.

References
----------
Standish and Williams, Approximate Positions of the Planets, JPL Solar System Dynamics, table 1.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.kepler import eccentric_anomaly

Array = npt.NDArray[np.float64]
J2000_JD, CENTURY_D = 2451545.0, 36525.0
# a, au; e; inclination, mean longitude, longitude of perihelion, of the node, deg; mean longitude, deg a century
ELEMENTS: Mapping[str, tuple[float, ...]] = {
    "mercury": (0.38709927, 0.20563593, 7.00497902, 252.25032350, 77.45779628, 48.33076593, 149472.67411175),
    "venus": (0.72333566, 0.00677672, 3.39467605, 181.97909950, 131.60246718, 76.67984255, 58517.81538729),
    "earth": (1.00000261, 0.01671123, -0.00001531, 100.46457166, 102.93768193, 0.0, 35999.37244981),
    "mars": (1.52371034, 0.09339410, 1.84969142, -4.55343205, -23.94362959, 49.55953891, 19140.30268499),
    "jupiter": (5.20288700, 0.04838624, 1.30439695, 34.39644051, 14.72847983, 100.47390909, 3034.74612775),
    "saturn": (9.53667594, 0.05386179, 2.48599187, 49.95424423, 92.59887831, 113.66242448, 1222.49362201),
    "uranus": (19.18916464, 0.04725744, 0.77263783, 313.23810451, 170.95427630, 74.01692503, 428.48202785),
    "neptune": (30.06992276, 0.00859048, 1.77004347, -55.12002969, 44.96476227, 131.78422574, 218.45945325),
}
WITH = {"moon": "earth"}  # what cannot be told from a planet in a picture of the Solar System


def known(body: str) -> bool:
    """Whether a body has a place in the pictures."""
    return WITH.get(body, body) in ELEMENTS


def place(body: str, jd_tdb: float) -> Array:
    """Heliocentric position (3,) in the ecliptic of J2000, au."""
    _, e, _, longitude, perihelion, _, rate = ELEMENTS[WITH.get(body, body)]
    M = np.radians(longitude + rate * (jd_tdb - J2000_JD) / CENTURY_D - perihelion)
    found: Array = _points(body, np.array([eccentric_anomaly(float(M), e)]))[0]
    return found


def orbit(body: str) -> Array:
    """Points (181, 3) of the whole orbit, as `place`."""
    return _points(body, np.linspace(0.0, 2.0 * np.pi, 181))


def _points(body: str, E: Array) -> Array:
    a, e, inclination, _, perihelion, node, _ = ELEMENTS[WITH.get(body, body)]
    i, O, w = np.radians([inclination, node, perihelion - node])
    P = np.array([
        np.cos(w) * np.cos(O) - np.sin(w) * np.sin(O) * np.cos(i),
        np.cos(w) * np.sin(O) + np.sin(w) * np.cos(O) * np.cos(i), np.sin(w) * np.sin(i),
    ])  # fmt: skip
    Q = np.array([
        -np.sin(w) * np.cos(O) - np.cos(w) * np.sin(O) * np.cos(i),
        -np.sin(w) * np.sin(O) + np.cos(w) * np.cos(O) * np.cos(i), np.cos(w) * np.sin(i),
    ])  # fmt: skip
    return np.asarray(a * (np.outer(np.cos(E) - e, P) + np.sqrt(1.0 - e * e) * np.outer(np.sin(E), Q)))
