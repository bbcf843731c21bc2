"""How bright an asteroid looks: the H, G system."""

import numpy as np

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array

G_RANGE = (-0.5, 1.0)
# Phi_i = exp(-A_i tan(phase/2)^B_i), the two basis functions of H, G (Bowell et al. 1989, Asteroids II, appendix)
A_1, B_1 = 3.33, 0.63
A_2, B_2 = 1.87, 1.22


@bordered()
def apparent_magnitude(H: float, G: float, r_sun_km: Array, distance_km: Array, phase_rad: Array) -> Array:
    """Apparent V magnitude (n,) in the H, G system.

    Parameters
    ----------
    H, G : absolute magnitude and slope parameter; G in [-0.5, 1].
    r_sun_km, distance_km : shape (n,), distances of the asteroid from the Sun and from the telescope.
    phase_rad : shape (n,), angle Sun - asteroid - telescope in [0, pi].

    Raises
    ------
    InputError
        If H is not finite or G is out of range.

    Notes
    -----
    V = H + 5 lg(r d) - 2.5 lg((1 - G) Phi_1 + G Phi_2), r and d in au, the law of MPC and Horizons. It is fitted to
    phase angles below 120 deg; beyond them it is an extrapolation. Where the sum is not positive the magnitude is
    infinite.
    """
    if not (np.isfinite(H) and G_RANGE[0] <= G <= G_RANGE[1]):
        raise InputError(f"magnitude: needs a finite H and G in [{G_RANGE[0]}, {G_RANGE[1]}] (got H = {H}, G = {G})")
    tangent = np.tan(np.minimum(phase_rad, np.pi) / 2.0)
    x_1, x_2 = A_1 * tangent**B_1, A_2 * tangent**B_2
    # factor out the slower decay, so that the sum does not underflow near phase 180 deg
    slow = np.minimum(x_1, x_2)
    bright = (1.0 - G) * np.exp(slow - x_1) + G * np.exp(slow - x_2)
    lost = bright <= 0.0
    phase_term = (slow - np.log(np.where(lost, 1.0, bright))) * 2.5 / np.log(10.0)
    magnitude = H + 5.0 * np.log10(r_sun_km * distance_km / AU_KM**2) + phase_term
    return np.where(lost, np.inf, magnitude)


def trailing_loss(rate_rad_s: Array, exposure_s: float, fwhm_rad: float) -> Array:
    """Magnitudes (n,) lost by a target that moves during the exposure.

    Parameters
    ----------
    rate_rad_s : shape (n,), apparent speed; exposure_s, fwhm_rad : length of the exposure, width of a star image.

    Notes
    -----
    1.25 lg(1 + 0.67 x^2 / (1 + 1.16 x)) with x = trail length / width: the loss in signal to noise for an optimal,
    trail-shaped aperture (Jones et al. 2018, Icarus 303, 181, eq. 1).
    """
    x = rate_rad_s * exposure_s / fwhm_rad
    return np.asarray(1.25 * np.log10(1.0 + 0.67 * x * x / (1.0 + 1.16 * x)))
