"""An error of a telescope's plate scale: it moves an object away from the centre of the field, or towards it."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.uncertainty.nuisance import sigmas
from nebosvod.observation.uncertainty.term import Common, check_treatment

PLASTIC = 1.32471795724474602596  # root of x^3 = x + 1
WIDEST_RAD = 0.2  # beyond, a field is no plane


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlateScale:
    """A relative error of the plate scale, common to all exposures of a telescope.

    Parameters
    ----------
    sigma : standard deviation of the relative error s; its mean is zero.
    field_rad : side of the square field, whose axes are RA* and Dec; at most 0.2 rad.

    Raises
    ------
    InputError
        If sigma is negative, or the side is not above 0 and at most 0.2 rad.

    Notes
    -----
    The error of a direction is s (xi, eta), where (xi, eta) is the place of the object in the field, known from its
    pixel. The telescope is taken to be dithered: exposures put the object all over the field, evenly (`places`). So the
    error averages out as noise of s field / sqrt(12) on each axis would, but is one number that can be estimated.
    Were the object always at one place, this would be a constant bias: say it as one.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma: float
    field_rad: float
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma, 1)
        if not 0.0 < self.field_rad <= WIDEST_RAD:
            raise InputError(f"{self.name}: field must be in (0, {WIDEST_RAD}] rad (got {self.field_rad})")

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H (n, 2, 1) = place in the field, rad, on the rows of the telescopes."""
        H = np.zeros((observation.t_s.size, 2, 1))
        for telescope in self.telescopes:
            rows = observation.rows((telescope,))
            H[rows, :, 0] = places(rows.size, self.field_rad)
        return Common(
            name=self.name,
            names=(self.name,),
            H=H,
            displacement=None,
            covariance=np.array([[self.sigma**2]]),
            mean=np.zeros(1),
            treatment=self.treatment,
        )


def places(count: int, field_rad: float) -> Array:
    """Places (count, 2) of the object in successive exposures, rad from the centre along RA* and Dec.

    Notes
    -----
    The additive recurrence on 1/p and 1/p^2, p the plastic number: every run of exposures fills the square evenly, and
    the same exposures have the same places in truth, estimator and every repetition.

    References
    ----------
    Niederreiter H., 1992. Random Number Generation and Quasi-Monte Carlo Methods, SIAM, ch. 3 (additive recurrences).
    """
    k = np.arange(1, count + 1)[:, None]
    found: Array = field_rad * ((k / PLASTIC ** np.array([1.0, 2.0])) % 1.0 - 0.5)
    return found
