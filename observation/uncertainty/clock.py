"""Errors of a telescope's clock. Jitter from exposure to exposure belongs to the noise (`Telescope.timing_sigma_s`)."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.observation.contracts import Ephemeris
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.uncertainty.nuisance import sigmas
from nebosvod.observation.uncertainty.term import Common, check_treatment


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimingOffset:
    """A clock that is wrong by the same time in all exposures.

    Parameters
    ----------
    sigma_s : standard deviation of the offset; mean_s : its assumed mean. Positive: exposed later than recorded.

    Notes
    -----
    H = the apparent rate, which carries the telescope's own motion at the true time with it.
    """

    name: str
    telescopes: tuple[str, ...]
    sigma_s: float
    mean_s: float = 0.0
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        sigmas(self.name, self.sigma_s, 1)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common:
        """H (n, 2, 1) = rate on the rows of the telescopes."""
        rows = observation.rows(self.telescopes)
        H = np.zeros((observation.t_s.size, 2, 1))
        H[rows, :, 0] = observation.rate[rows]
        return Common(
            name=self.name,
            names=(self.name,),
            H=H,
            displacement=None,
            covariance=np.array([[self.sigma_s**2]]),
            mean=np.array([self.mean_s]),
            treatment=self.treatment,
        )
