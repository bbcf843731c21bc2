"""Spacecraft on orbits about the Earth: Kepler elements with the secular rates of J2, and Sun-synchronous ones."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.earth.constants import EARTH_J2
from nebosvod.observation.earth.earth_rotation import R_icrf_from_cirs, turned
from nebosvod.observation.spacecraft import drifting_ellipse
from nebosvod.timescale import Epoch

TROPICAL_YEAR_S = 365.2421897 * 86400.0  # mean tropical year, J2000 (Meeus 1991)
EARTH_GM_KM3_S2 = 398600.4355  # only to choose a Sun-synchronous inclination; the orbit itself uses the ephemeris


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeocentricOrbit:
    """An elliptic orbit about the Earth.

    Parameters
    ----------
    a_km, e, i_rad, node_rad, peri_rad, mean_anomaly_rad : mean elements at `elements_epoch` in the true equator of
        date (celestial intermediate frame: node from the celestial intermediate origin).
    j2 : whether node, pericentre and mean anomaly drift by the secular rates of the Earth's J2.

    Raises
    ------
    InputError
        If an element is not finite, e is outside [0, 1), or the perigee lies inside the Earth.

    Notes
    -----
    node' = -k cos i, peri' = k (2 - 5/2 sin^2 i), M' = n + k sqrt(1 - e^2) (1 - 3/2 sin^2 i), k = 3/2 J2 n (R/p)^2.
    Short-period terms (8 km in low orbit), other harmonics, Moon, Sun and drag are left out: a model of
    where a telescope is, not an ephemeris. The velocity is that of the osculating ellipse, the secular rates (1e-3 of
    it) included by their effect on the angles.

    References
    ----------
    Kaula 1966, Theory of Satellite Geodesy, eq. 3.74.
    """

    elements_epoch: Epoch
    a_km: float
    e: float = 0.0
    i_rad: float = 0.0
    node_rad: float = 0.0
    peri_rad: float = 0.0
    mean_anomaly_rad: float = 0.0
    j2: bool = True

    def __post_init__(self) -> None:
        elements = (self.a_km, self.e, self.i_rad, self.node_rad, self.peri_rad, self.mean_anomaly_rad)
        if not np.all(np.isfinite(elements)) or not 0.0 <= self.e < 1.0:
            raise InputError(f"geocentric orbit: needs finite elements and e in [0, 1) (got {elements})")
        if self.a_km * (1.0 - self.e) <= RADIUS_KM["earth"]:
            perigee_km = self.a_km * (1.0 - self.e)
            raise InputError(f"geocentric orbit: perigee {perigee_km:.1f} km from the centre, inside the Earth")

    @property
    def centre(self) -> str:
        return "earth"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        gm = ephemeris.gm_km3_s2["earth"]
        age = t_s - (self.elements_epoch - epoch)
        n = np.sqrt(gm / self.a_km**3)
        node_rate, peri_rate, mean_rate = self._rates(n)
        node, peri = self.node_rad + node_rate * age, self.peri_rad + peri_rate * age
        M = self.mean_anomaly_rad + (n + mean_rate) * age
        state = kepler_state(gm, self.a_km, self.e, self.i_rad, node, peri, M)
        r, sin_i = state[:, :3], np.sin(self.i_rad)
        # the drift of the angles moves the spacecraft too: about the pole, in the plane, and along the ellipse
        normal = np.stack(
            [
                sin_i * np.sin(node),
                -sin_i * np.cos(node),
                np.full(age.size, np.cos(self.i_rad)),
            ],
            axis=1,
        )
        spin = np.array([0.0, 0.0, node_rate]) + peri_rate * normal
        state[:, 3:] = state[:, 3:] * (1.0 + mean_rate / n) + np.cross(spin, r)
        return ephemeris.state_km_km_s("earth", epoch, t_s) + turned(R_icrf_from_cirs(epoch, t_s), state)

    @bordered()
    def transitions(self, ephemeris: Ephemeris, epoch: Epoch, start_s: float, t_s: Array) -> Array:
        """Partials (n, 6, 6) of the state at `t_s` (n,) by the state at `start_s`, ICRF, km and km/s."""
        n = np.sqrt(ephemeris.gm_km3_s2["earth"] / self.a_km**3)
        node_rate, peri_rate, mean_rate = self._rates(n)
        begun = start_s - (self.elements_epoch - epoch)

        def R_icrf_from_plane(since_s: Array) -> Array:
            age = begun + since_s
            peri, node = self.peri_rad + peri_rate * age, self.node_rad + node_rate * age
            in_orbit = turn(node, 2) @ turn(np.full(age.size, self.i_rad), 0) @ turn(peri, 2)
            return R_icrf_from_cirs(epoch, start_s + since_s) @ in_orbit

        M = self.mean_anomaly_rad + (n + mean_rate) * begun
        since_s = np.concatenate([[0.0], t_s - start_s])
        return drifting_ellipse.transitions(self.a_km, self.e, M, n + mean_rate, since_s, R_icrf_from_plane)[1:]

    def _rates(self, n: float) -> tuple[float, float, float]:
        """Secular rates of node, argument of perigee and mean anomaly (beyond n), rad/s."""
        return secular_rates(n, self.a_km, self.e, self.i_rad) if self.j2 else (0.0, 0.0, 0.0)


def turn(angle: Array, axis: int) -> Array:
    """Rotations (n, 3, 3) by angles (n,) about the axis x (0) or z (2): of vectors, counter-clockwise."""
    R = np.zeros((angle.size, 3, 3))
    one, other = ((axis + 1) % 3, (axis + 2) % 3)
    R[:, axis, axis] = 1.0
    R[:, one, one] = R[:, other, other] = np.cos(angle)
    R[:, other, one] = np.sin(angle)
    R[:, one, other] = -np.sin(angle)
    return R


def secular_rates(n: float, a_km: float, e: float, i_rad: float) -> tuple[float, float, float]:
    """J2 rates (rad/s) of node, argument of perigee and mean anomaly for mean motion n.

    References
    ----------
    Kaula 1966, Theory of Satellite Geodesy, eq. 3.74.
    """
    k = 1.5 * EARTH_J2 * n * (RADIUS_KM["earth"] / (a_km * (1.0 - e * e))) ** 2
    sin2 = np.sin(i_rad) ** 2
    return (
        float(-k * np.cos(i_rad)),
        float(k * (2.0 - 2.5 * sin2)),
        float(k * np.sqrt(1.0 - e * e) * (1.0 - 1.5 * sin2)),
    )


@bordered()
def sun_synchronous(
    *, elements_epoch: Epoch, altitude_km: float, local_time_h: float, mean_anomaly_rad: float = 0.0
) -> GeocentricOrbit:
    """A circular orbit whose node follows the mean Sun.

    Parameters
    ----------
    altitude_km : above the equatorial radius.
    local_time_h : mean solar time of the ascending node, hours (6 or 18 = dawn-dusk).

    Raises
    ------
    InputError
        If no inclination turns the node fast enough (above 5974 km), or the local time is outside [0, 24).
    """
    if not 0.0 <= local_time_h < 24.0:
        raise InputError(f"sun-synchronous orbit: local time must lie in [0, 24) h (got {local_time_h})")
    a_km = RADIUS_KM["earth"] + altitude_km
    if not altitude_km > 0.0:
        raise InputError(f"sun-synchronous orbit: altitude must be positive (got {altitude_km} km)")
    equatorial, _, _ = secular_rates(np.sqrt(EARTH_GM_KM3_S2 / a_km**3), a_km, 0.0, 0.0)
    cos_i = (2.0 * np.pi / TROPICAL_YEAR_S) / equatorial
    if abs(cos_i) > 1.0:
        raise InputError(f"sun-synchronous orbit: none exists at an altitude of {altitude_km} km (limit 5974 km)")
    # right ascension of the mean Sun = its mean longitude (Astronomical Almanac: 280.460 deg + 0.9856474 deg/d, from
    # the equinox of date); the celestial intermediate origin lies 46.1" a year west of that equinox
    days = (elements_epoch - Epoch.from_jd(2451545.0)) / 86400.0
    mean_sun = np.radians(280.460 + 0.9856474 * days) - np.radians(46.12 / 3600.0) * days / 365.25
    return GeocentricOrbit(
        elements_epoch=elements_epoch,
        a_km=a_km,
        i_rad=float(np.arccos(cos_i)),
        node_rad=float(mean_sun + (local_time_h - 12.0) * np.pi / 12.0),
        mean_anomaly_rad=mean_anomaly_rad,
    )
