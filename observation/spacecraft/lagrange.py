"""Spacecraft about the collinear libration points of the Sun and the Earth-Moon system."""

import math
from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.dynamics.compilation import allocating_kernel, kernel
from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.timescale import Epoch

TILT_STEP_S = 3600.0  # of the difference for the tilt of the orbit of the Earth: truncation 1e-5 of 1e-12 rad/s


@bordered_fields()
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

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6)."""
        moments = np.concatenate([t_s, t_s - TILT_STEP_S, t_s + TILT_STEP_S])
        sun = ephemeris.state_km_km_s("sun", epoch, moments).reshape(3, -1, 6)
        pair = ephemeris.state_km_km_s("emb", epoch, moments).reshape(3, -1, 6)
        gm = ephemeris.gm_km3_s2
        mass = gm["earth"] + gm["moon"]
        total = gm["sun"] + mass
        gamma, frequency, kappa = linear_motion(mass / total, self.point)
        rate = frequency * np.sqrt(total / AU_KM**3)
        angle = rate * (t_s - (self.elements_epoch - epoch))
        scale = gamma if self.point == "L2" else -gamma
        swing = np.array([self.amplitude_km, self.amplitude_km / kappa, self.phase_rad])
        tilt = np.array([self.amplitude_z_km, self.phase_z_rad])
        states = np.empty((t_s.size, 6))
        _halo(sun, pair, scale, rate, angle, swing, tilt, states)
        return states


@allocating_kernel
def _halo(
    sun: Array, pair: Array, scale: float, rate: float, angle: Array, swing: Array, tilt: Array, states: Array
) -> None:
    """States (n, 6) on the periodic solution, in axes that turn with the line from the Sun to the pair.

    sun, pair (3, n, 6) are barycentric at the times, a step before and a step after. With h = r x v of the line,
    x = r/r, z = h/h, y = z x x the axes turn by x' = w y, y' = q z - w x, z' = -q y: w = h/r^2, and q = r a_z / h of
    the acceleration a_z out of the plane, which planets and the Moon cause: 5e-6 of w at most, so a difference will do.
    """
    r, v, x, y, z = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for e in range(states.shape[0]):
        for i in range(3):
            r[i], v[i] = pair[0, e, i] - sun[0, e, i], pair[0, e, 3 + i] - sun[0, e, 3 + i]
        distance = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        _cross(r, v, z)
        h = math.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
        pull = 0.0
        for i in range(3):
            x[i], z[i] = r[i] / distance, z[i] / h
            pull += z[i] * ((pair[2, e, 3 + i] - sun[2, e, 3 + i]) - (pair[1, e, 3 + i] - sun[1, e, 3 + i]))
        _cross(z, x, y)
        w, q = h / (distance * distance), distance / h * pull / (2.0 * TILT_STEP_S)
        sin, cos = math.sin(angle[e] + swing[2]), math.cos(angle[e] + swing[2])
        along, along_rate = -swing[1] * cos, swing[1] * rate * sin
        across, across_rate = swing[0] * sin, swing[0] * rate * cos
        out, out_rate = tilt[0] * math.cos(angle[e] + tilt[1]), -tilt[0] * rate * math.sin(angle[e] + tilt[1])
        to_x, to_y, to_z = along_rate - w * across, across_rate + w * along - q * out, out_rate + q * across
        for i in range(3):
            states[e, i] = pair[0, e, i] + scale * r[i] + along * x[i] + across * y[i] + out * z[i]
            states[e, 3 + i] = pair[0, e, 3 + i] + scale * v[i] + to_x * x[i] + to_y * y[i] + to_z * z[i]


@kernel
def _cross(a: Array, b: Array, c: Array) -> None:
    """c = a x b."""
    c[0], c[1], c[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


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
