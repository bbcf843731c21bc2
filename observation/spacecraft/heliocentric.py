"""Spacecraft on their own orbits about the Sun."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.dynamics.constants import OBLIQUITY_J2000_RAD
from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.timescale import Epoch


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeliocentricOrbit:
    """An elliptic orbit about the Sun; with the defaults, circular in the ecliptic at `a_km`.

    Parameters
    ----------
    a_km, e, i_rad, node_rad, peri_rad, mean_anomaly_rad : elements at `elements_epoch`, J2000 ecliptic.

    Raises
    ------
    InputError
        If an element is not finite, a <= 0, or e is outside [0, 1).

    Notes
    -----
    Two-body motion; the planets would move a spacecraft at 0.7 au by some 1e5 km in a year. A survey is judged by its
    geometry, which this keeps; a flown orbit belongs into a table or file.
    """

    elements_epoch: Epoch
    a_km: float
    e: float = 0.0
    i_rad: float = 0.0
    node_rad: float = 0.0
    peri_rad: float = 0.0
    mean_anomaly_rad: float = 0.0

    def __post_init__(self) -> None:
        elements = (self.a_km, self.e, self.i_rad, self.node_rad, self.peri_rad, self.mean_anomaly_rad)
        if not np.all(np.isfinite(elements)) or not 0.0 <= self.e < 1.0 or self.a_km <= 0.0:
            raise InputError(f"heliocentric orbit: needs finite elements, a > 0 and e in [0, 1) (got {elements})")

    @property
    def centre(self) -> str:
        return "sun"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        gm = ephemeris.gm_km3_s2["sun"]
        M = self.mean_anomaly_rad + np.sqrt(gm / self.a_km**3) * (t_s - (self.elements_epoch - epoch))
        node, peri = np.full(t_s.size, self.node_rad), np.full(t_s.size, self.peri_rad)
        state = kepler_state(gm, self.a_km, self.e, self.i_rad, node, peri, M)
        return ephemeris.state_km_km_s("sun", epoch, t_s) + icrf_from_ecliptic(state)


def icrf_from_ecliptic(state: Array) -> Array:
    """Turn states (n, 6) from the J2000 ecliptic to ICRF axes."""
    cos, sin = np.cos(OBLIQUITY_J2000_RAD), np.sin(OBLIQUITY_J2000_RAD)
    R = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    turned: Array = (state.reshape(-1, 3) @ R.T).reshape(-1, 6)
    return turned
