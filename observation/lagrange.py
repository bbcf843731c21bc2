"""Spacecraft about the collinear libration points of the Sun and the Earth-Moon system."""

from dataclasses import dataclass

import numpy as np

from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.timescale import Epoch

VELOCITY_STEP_S = 1800.0  # of the differences for the velocity: truncation 1e-9 km/s, round-off 2e-11


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LibrationOrbit:
    """A halo-like orbit about L1 or L2.

    Parameters
    ----------
    point : "L1" (sunward) or "L2".
    amplitude_km : largest excursion across the Sun-Earth line in the ecliptic (0 = at the point itself).
    amplitude_z_km : largest excursion out of the ecliptic plane.
    phase_rad, phase_z_rad : phases at `elements_epoch`.

    Raises
    ------
    InputError
        If the point is unknown or a number is not finite.

    Notes
    -----
    The model: the point sits on the line from the Sun through the Earth-Moon barycentre at gamma times their momentary
    distance, gamma the root of the circular restricted problem's quintic; about it the linear periodic solution
    xi = -A/kappa cos(w t + phi) along the line, A sin(w t + phi) across, Az cos(w t + phi_z) out of plane, with the
    in-plane frequency for both (a halo's, not a Lissajous figure's). A flown halo differs by its third-order terms,
    some 1e4 km at A = 7e5 km: this is where a telescope would be, not an ephemeris.
    """

    point: str
    elements_epoch: Epoch
    amplitude_km: float = 0.0
    amplitude_z_km: float = 0.0
    phase_rad: float = 0.0
    phase_z_rad: float = 0.0

    def __post_init__(self) -> None:
        if self.point not in ("L1", "L2"):
            raise InputError(f'libration orbit: the point must be "L1" or "L2" (got "{self.point}")')
        numbers = (self.amplitude_km, self.amplitude_z_km, self.phase_rad, self.phase_z_rad)
        if not np.all(np.isfinite(numbers)):
            raise InputError(f"libration orbit: amplitudes and phases must be finite (got {numbers})")

    @property
    def centre(self) -> str:
        return "sun"

    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6); the velocity by differences, since the frame turns with the Earth."""
        h = VELOCITY_STEP_S
        place = self._position(ephemeris, epoch, np.concatenate([t_s, t_s - 2 * h, t_s - h, t_s + h, t_s + 2 * h]))
        here, far_back, back, ahead, far_ahead = place.reshape(5, -1, 3)
        return np.concatenate([here, (8.0 * (ahead - back) - (far_ahead - far_back)) / (12.0 * h)], axis=1)

    def _position(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric positions (n, 3)."""
        earth, moon = ephemeris.gm_km3_s2["earth"], ephemeris.gm_km3_s2["moon"]
        sun = ephemeris.state_km_km_s("sun", epoch, t_s)
        pair = (
            earth * ephemeris.state_km_km_s("earth", epoch, t_s) + moon * ephemeris.state_km_km_s("moon", epoch, t_s)
        ) / (earth + moon)
        line, velocity = pair[:, :3] - sun[:, :3], pair[:, 3:] - sun[:, 3:]
        distance = np.linalg.norm(line, axis=1, keepdims=True)
        x = line / distance
        z = np.cross(line, velocity)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        total = ephemeris.gm_km3_s2["sun"] + earth + moon
        gamma, frequency, kappa = linear_motion((earth + moon) / total, self.point)
        mean_motion = np.sqrt(total / AU_KM**3)
        angle = frequency * mean_motion * (t_s - (self.elements_epoch - epoch))
        along = -self.amplitude_km / kappa * np.cos(angle + self.phase_rad)
        across = self.amplitude_km * np.sin(angle + self.phase_rad)
        out = self.amplitude_z_km * np.cos(angle + self.phase_z_rad)
        side = -1.0 if self.point == "L1" else 1.0
        base = pair[:, :3] + side * gamma * distance * x
        place: Array = base + along[:, None] * x + across[:, None] * np.cross(z, x) + out[:, None] * z
        return place


def linear_motion(mu: float, point: str) -> tuple[float, float, float]:
    """Distance ratio gamma, in-plane frequency (in mean motions) and axis ratio kappa at L1 or L2.

    Richardson 1980, Celestial Mechanics 22, 241: the quintic of the collinear points, c2, lambda and k.
    """
    side = -1.0 if point == "L1" else 1.0
    gamma = (mu / 3.0) ** (1.0 / 3.0)
    for _ in range(50):  # Newton on the balance of forces at x = 1 - mu + side gamma
        pull = (1.0 - mu) / (1.0 + side * gamma) ** 2 + side * mu / gamma**2 - (1.0 - mu + side * gamma)
        slope = -2.0 * side * (1.0 - mu) / (1.0 + side * gamma) ** 3 - 2.0 * side * mu / gamma**3 - side
        gamma -= pull / slope
    c2 = (mu + (1.0 - mu) * gamma**3 / (1.0 + side * gamma) ** 3) / gamma**3
    frequency = np.sqrt((2.0 - c2 + np.sqrt(9.0 * c2 * c2 - 8.0 * c2)) / 2.0)
    return float(gamma), float(frequency), float((frequency**2 + 1.0 + 2.0 * c2) / (2.0 * frequency))
