"""The photocentre of a partly lit asteroid lies off its centre of mass, towards the Sun."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.uncertainty.nuisance import sigmas
from nebosvod.observation.uncertainty.term import Common, check_treatment


def lambert_offset(phase_rad: Array) -> Array:
    """Offset (n,) of the photocentre of a Lambert sphere towards the Sun on the sky, in units of its radius.

    Notes
    -----
    (3 pi / 16) sin a (1 + cos a) / (sin a + (pi - a) cos a), the first moment of mu mu0 over the lit visible part;
    0 at full phase, 3 pi / 16 = 0.59 at half phase, 9 pi / 32 = 0.88 for the thinnest crescent.
    """
    a = phase_rad
    weight = np.sin(a) + (np.pi - a) * np.cos(a)
    # near 180 deg weight = (pi - a)^3 / 3 is all cancellation: the quotient tends to 3/2 as 1 + O((pi - a)^2)
    thin = np.pi - a < 1e-3
    shape = 3.0 * np.pi / 16.0 * np.sin(a) * (1.0 + np.cos(a)) / np.where(thin, 1.0, weight)
    return np.where(thin, 9.0 * np.pi / 32.0, shape)


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photocentre:
    """An offset of the measured light from the centre of mass.

    Parameters
    ----------
    radius_km : radius of the asteroid.
    sigma_amplitude : standard deviation of the amplitude, 1 being a Lambert sphere of that radius;
        mean_amplitude : its assumed mean. The computed directions are those of the centre of mass.

    Notes
    -----
    The amplitude is common to all exposures; the offset follows `lambert_offset` of the phase angle towards the Sun.
    """

    name: str
    telescopes: tuple[str, ...]
    radius_km: float
    sigma_amplitude: float
    mean_amplitude: float = 0.0
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_amplitude, 1)
        if not (np.isfinite(self.radius_km) and self.radius_km > 0.0):
            raise InputError(f"{self.name}: radius must be positive (got {self.radius_km} km)")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H = -H_z d: the light moves by d exactly as if the telescope moved by -d."""
        rows = observation.rows(self.telescopes)
        emission_s = observation.t_s[rows] - observation.light_time_s[rows]
        sun = ephemeris.position_km("sun", observation.epoch, emission_s)
        to_sun = sun - observation.target_state[rows, :3]
        to_sun /= np.linalg.norm(to_sun, axis=1, keepdims=True)
        u = observation.u[rows]
        # the part of the unit vector to the Sun that lies on the sky has length sin(phase)
        sky = to_sun - u * np.einsum("ni,ni->n", to_sun, u)[:, None]
        length = np.linalg.norm(sky, axis=1)
        size = self.radius_km * lambert_offset(angle_between(to_sun, -u)) / np.maximum(length, 1e-300)
        displacement = np.zeros((observation.t_s.size, 3, 1))
        displacement[rows, :, 0] = -size[:, None] * sky
        return Common(
            name=self.name,
            names=(f"{self.name} amplitude",),
            H=observation.H_z @ displacement,
            displacement=displacement,
            covariance=np.array([[self.sigma_amplitude**2]]),
            mean=np.array([self.mean_amplitude]),
            treatment=self.treatment,
        )
