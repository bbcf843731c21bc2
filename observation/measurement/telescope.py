"""A telescope: who carries it, how well it measures, and where it may point."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered, bordered_fields
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array
from nebosvod.observation.spacecraft.kinds import Spacecraft
from nebosvod.timescale import Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseTruth:
    """What the noise of a telescope really is, where that is declared beside what is assumed.

    Attributes
    ----------
    sigma_rad : (2,) of RA cos Dec and Dec; timing_sigma_s : of the time of each exposure.
    mean_rad : (2,) what it is on average, 0 being assumed.
    """

    sigma_rad: Array
    timing_sigma_s: float
    mean_rad: Array


@bordered_fields(duty="spans")
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Telescope:
    """One telescope of a mission.

    Parameters
    ----------
    name : unique within a mission.
    spacecraft : where it is.
    sigma_rad : shape (2,), standard deviations of one measurement in RA cos Dec and Dec, rad; a scalar means both.
    timing_sigma_s : standard deviation of the independent clock error of each exposure, s; tilts the noise ellipse
        along the apparent motion.
    exclusion_sun_rad : smallest allowed angle to the Sun's centre; None = no limit.
    exclusion_earth_rad, exclusion_moon_rad : smallest allowed angle to the limb; None = no limit.
    sun_altitude_rad : of a ground site, the Sun must be below this altitude, without refraction; None = no limit.
    altitude_rad : of a ground site, the target must be above this altitude; None = no limit.
    limiting_magnitude : faintest apparent V that is measured; None = no limit.
    largest_sun_rad : largest allowed angle to the Sun's centre (a field of regard is the ring between this and
        `exclusion_sun_rad`); None = no limit.
    duty : windows (first, last epoch) in which the telescope works; empty = always.
    exposure_s, fwhm_rad : length of an exposure and width of a star image: with both, a target that trails is
        fainter for the limit by `trailing_loss`.
    truth : what the noise really is; as it says when None.

    Raises
    ------
    InputError
        If a sigma is not positive, an angle is outside [0, pi], or a number is not finite.
    """

    name: str
    spacecraft: Spacecraft
    sigma_rad: Array | float
    timing_sigma_s: float = 0.0
    exclusion_sun_rad: float | None = None
    exclusion_earth_rad: float | None = None
    exclusion_moon_rad: float | None = None
    limiting_magnitude: float | None = None
    largest_sun_rad: float | None = None
    duty: tuple[tuple[Epoch, Epoch], ...] = ()
    exposure_s: float = 0.0
    fwhm_rad: float | None = None
    sun_altitude_rad: float | None = None
    altitude_rad: float | None = None
    truth: NoiseTruth | None = None

    def __post_init__(self) -> None:
        sigma = np.array(np.broadcast_to(np.asarray(self.sigma_rad, dtype=np.float64), (2,)))
        if not np.all(np.isfinite(sigma) & (sigma > 0.0)):
            raise InputError(f"telescope {self.name}: sigma must be positive and finite (got {self.sigma_rad} rad)")
        sigma.flags.writeable = False
        object.__setattr__(self, "sigma_rad", sigma)
        if not (np.isfinite(self.timing_sigma_s) and self.timing_sigma_s >= 0.0):
            raise InputError(f"telescope {self.name}: timing sigma must be >= 0 (got {self.timing_sigma_s} s)")
        for field in ("exclusion_sun_rad", "exclusion_earth_rad", "exclusion_moon_rad", "largest_sun_rad"):
            angle = getattr(self, field)
            if angle is not None and not 0.0 <= angle <= np.pi:
                raise InputError(f"telescope {self.name}: {field} must lie in [0, pi] rad (got {angle})")
        for field in ("sun_altitude_rad", "altitude_rad"):
            angle = getattr(self, field)
            if angle is not None and not abs(angle) <= np.pi / 2.0:
                raise InputError(f"telescope {self.name}: {field} must lie in [-pi/2, pi/2] rad (got {angle})")
        if self.limiting_magnitude is not None and not np.isfinite(self.limiting_magnitude):
            raise InputError(
                f"telescope {self.name}: limiting magnitude must be finite (got {self.limiting_magnitude})"
            )

        if any(not first <= last for first, last in self.duty):
            raise InputError(f"telescope {self.name}: a duty window ends before it starts")
        if not (np.isfinite(self.exposure_s) and self.exposure_s >= 0.0):
            raise InputError(f"telescope {self.name}: exposure must be >= 0 (got {self.exposure_s} s)")
        if self.fwhm_rad is not None and not 0.0 < self.fwhm_rad < 0.1:
            raise InputError(f"telescope {self.name}: image width must lie in (0, 0.1) rad (got {self.fwhm_rad})")

    @bordered()
    def works(self, epoch: Epoch, t_s: Array) -> npt.NDArray[np.bool_]:
        """Whether each time (n,), TDB seconds after `epoch`, lies in a duty window."""
        inside = np.full(t_s.shape, not self.duty)
        for first, last in self.duty:
            inside |= (t_s >= first - epoch) & (t_s <= last - epoch)
        return inside

    @bordered()
    def noise(self, rate_rad_s: Array) -> Array:
        """Covariance R (n, 2, 2), rad^2, of the measurement noise at apparent rates (n, 2), RA cos Dec and Dec.

        R = diag(sigma^2) + sigma_t^2 rate rate^T: a clock error moves the measurement along the track.
        """
        tilt: Array = self.timing_sigma_s**2 * rate_rad_s[:, :, None] * rate_rad_s[:, None, :]
        return tilt + np.diag(np.asarray(self.sigma_rad) ** 2)
