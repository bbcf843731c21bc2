"""Spacecraft that go round the Earth against the sense of its own motion, outside the reach of its gravity."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.dynamics.constants import AU_KM
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.timescale import Epoch

SMALLEST_KM, LARGEST_KM = 3.0e6, 1.5e7  # where the model is good to a twentieth of the size
POLE: Array = R_icrf_from_ecliptic[:, 2]


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DistantRetrograde:
    """A distant retrograde orbit about the Earth-Moon barycentre in the ecliptic.

    Parameters
    ----------
    size_km : largest excursion along the line from the Sun, 3e6 to 1.5e7 km; across it is twice that and a little more.
    phase_rad : at `elements_epoch`; 0 is on the line, outside of the Earth's orbit, 90 deg behind the Earth.

    Raises
    ------
    InputError
        If the size is out of range or the phase is not finite.

    Notes
    -----
    In coordinates that turn with the Earth, x outwards and y along its orbit as an arc, x = A cos(w t + phi) and
    y = -B sin(w t + phi). Far from the Earth w = n and B = 2 A: the epicycle of an orbit about the Sun with
    e = A / (1 au), whose terms in e^2 are taken as well. The Earth's pull, averaged over the ellipse, adds (first
    harmonic of Hill's equations) w^2 - n^2 - C_x - C_y = C_y (3 n^2 - C_x) / w^2 and B = 2 n w A / (w^2 - C_y), with
    C_x, C_y the means of 2 mu cos^2 / r^3 and 2 mu sin^2 / r^3: w = 1.24 n at 3e6 km, 1.007 n at 1e7 km. The Earth
    moves as in the ephemeris. All forces allow an orbit that stays within a twentieth of A of this for a year. It is
    where a telescope would be; an orbit flown belongs into a table or file.

    References
    ----------
    Henon M., 1969. A&A 1, 223 (family f of Hill's problem); Stramacchia M., Colombo C., Bernelli-Zazzera F., 2016.
    Advances in Space Research 58, 967 (such orbits for watching near-Earth objects).
    """

    elements_epoch: Epoch
    size_km: float
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        if not SMALLEST_KM <= self.size_km <= LARGEST_KM:
            allowed = f"{SMALLEST_KM:.2g} km to {LARGEST_KM:.2g} km"
            raise InputError(f"distant retrograde orbit: the size must be {allowed} (got {self.size_km} km)")
        if not np.isfinite(self.phase_rad):
            raise InputError(f"distant retrograde orbit: the phase must be a finite angle (got {self.phase_rad} rad)")

    @property
    def centre(self) -> str:
        return "sun"

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        gm = ephemeris.gm_km3_s2
        mass = gm["earth"] + gm["moon"]
        rate, across_km = first_harmonic(self.size_km, mass, float(np.sqrt((gm["sun"] + mass) / AU_KM**3)))
        theta = (rate * (t_s - (self.elements_epoch - epoch)) + self.phase_rad)[:, None]
        e, cos, sin, cos2, sin2 = (
            self.size_km / AU_KM,
            np.cos(theta),
            np.sin(theta),
            np.cos(2 * theta),
            np.sin(2 * theta),
        )
        out, out_rate = self.size_km * (cos + 0.5 * e * (1.0 - cos2)), self.size_km * rate * (e * sin2 - sin)
        ahead = 1.25 * e**2 * sin2 - across_km / AU_KM * sin
        ahead_rate = rate * (2.5 * e**2 * cos2 - across_km / AU_KM * cos)
        sun = ephemeris.state_km_km_s("sun", epoch, t_s)
        earth = ephemeris.state_km_km_s("emb", epoch, t_s) - sun
        r, v = earth[:, :3], earth[:, 3:]
        distance = np.linalg.norm(r, axis=1, keepdims=True)
        line = r / distance
        line_rate = (v - line * np.sum(line * v, axis=1, keepdims=True)) / distance
        # out along the line from the Sun, then turned ahead about the pole of the ecliptic
        place = _turned(r + out * line, ahead)
        velocity = _turned(v + out_rate * line + out * line_rate, ahead) + ahead_rate * np.cross(POLE, place)
        state: Array = sun + np.hstack([place, velocity])
        return state


def _turned(vectors: Array, angle: Array) -> Array:
    """Vectors (n, 3) turned by angles (n, 1) about the pole of the ecliptic (Rodrigues)."""
    along = (vectors @ POLE)[:, None] * POLE
    found: Array = along + np.cos(angle) * (vectors - along) + np.sin(angle) * np.cross(POLE, vectors)
    return found


def first_harmonic(size_km: float, gm: float, mean_motion: float) -> tuple[float, float]:
    """Rate w, rad/s, and excursion B across, km, of the retrograde orbit in Hill's problem; gm in km^3/s^2."""
    angle = (np.arange(64) + 0.5) * (2.0 * np.pi / 64)
    cos2, sin2 = np.cos(angle) ** 2, np.sin(angle) ** 2
    n2, rate, across_km = mean_motion**2, mean_motion, 2.0 * size_km
    for _ in range(60):
        cube = (size_km**2 * cos2 + across_km**2 * sin2) ** 1.5
        pull_out, pull_across = 2.0 * gm * np.mean(cos2 / cube), 2.0 * gm * np.mean(sin2 / cube)
        middle = n2 + pull_out + pull_across
        square = 0.5 * (middle + np.sqrt(middle**2 + 4.0 * pull_across * (3.0 * n2 - pull_out)))
        rate = float(np.sqrt(square))
        across_km = float(2.0 * mean_motion * rate * size_km / (square - pull_across))
    return rate, across_km
