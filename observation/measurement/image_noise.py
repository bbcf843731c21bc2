"""How well an image is measured: noise of a direction by brightness, by the trail of a moving target, by its size."""

from typing import Literal

import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array

FWHM = 2.0 * np.sqrt(2.0 * np.log(2.0))  # of a Gaussian, in its standard deviations
Limit = Literal["background", "photons"]


def image_covariance(
    V: Array,
    rate_rad_s: Array,
    angular_radius_rad: Array,
    *,
    exposure_s: float,
    fwhm_rad: float,
    magnitude: float,
    snr: float,
    limited_by: Limit = "background",
) -> Array:
    """Covariance (n, 2, 2) of RA cos Dec and Dec, rad^2, of the place of an image.

    Parameters
    ----------
    V : shape (n,), apparent magnitude.
    rate_rad_s : shape (n, 2), apparent motion in RA cos Dec and Dec.
    angular_radius_rad : shape (n,), of the body's disc; 0 of a point.
    exposure_s, fwhm_rad : length of the exposure and width of a star image.
    magnitude, snr : the magnitude at which a star has this ratio of signal to noise.
    limited_by : the sky and the detector, or the photons of the target.

    Raises
    ------
    InputError
        If a magnitude is not finite: the target has no brightness there.

    Notes
    -----
    The image is a Gaussian of variance s^2 = (fwhm / 2.355)^2 + theta^2 / 4 (a disc of radius theta), drawn out over
    the trail L = rate exposure. Against a background the bounds of Cramer and Rao are those of a fitted template,
    var = (int h^2 / int h'^2) / SNR^2 on each axis: 2 s^2 across, and along, with e = exp(-L^2 / 4 s^2),
    sqrt(pi) s (L erf(L / 2 s) - 2 s (1 - e) / sqrt(pi)) / (1 - e), which is 2 s^2 for L = 0 and sqrt(pi) s L of a long
    trail; SNR^2 = snr^2 10^(-0.8 (V - magnitude)) int h^2 / int h_star^2. Of photons it is the error of their mean,
    s^2 across and s^2 + L^2 / 12 along over SNR^2 = snr^2 10^(-0.4 (V - magnitude)).

    References
    ----------
    Lindegren 1978, in IAU Colloquium 48, 197 (limits of the location of images).
    """
    if not np.all(np.isfinite(V)):
        raise InputError("image noise: the target has no brightness at some exposures (needs a finite magnitude)")
    from scipy.special import erf

    star = (fwhm_rad / FWHM) ** 2
    across = star + np.asarray(angular_radius_rad) ** 2 / 4.0
    s = np.sqrt(across)
    speed = np.linalg.norm(rate_rad_s, axis=1)
    L = speed * exposure_s
    fainter = V - magnitude
    if limited_by == "photons":
        power = snr**2 * 10.0 ** (-0.4 * fainter)
        var_across, var_along = across / power, (across + L**2 / 12.0) / power
    else:
        x = L / (2.0 * s)
        short = x < 1e-3  # where the differences below lose their digits
        safe = np.where(short, 1.0, x)
        faded = -np.expm1(-(safe**2))
        inner = safe * np.sqrt(np.pi) * erf(safe) - faded  # (sqrt(pi) / 2 s) (L erf - 2 s (1 - e) / sqrt(pi))
        width = np.where(short, 2.0, 2.0 * inner / faded)  # int h^2 / int h'^2 in units of s^2
        peak = np.where(short, 1.0, inner / safe**2)  # int h^2 over that without a trail
        power = snr**2 * 10.0 ** (-0.8 * fainter) * peak * star / across
        var_across, var_along = 2.0 * across / power, width * across / power
    along = rate_rad_s / np.where(speed > 0.0, speed, 1.0)[:, None]
    outer = along[:, :, None] * along[:, None, :]
    found: Array = var_across[:, None, None] * np.eye(2) + (var_along - var_across)[:, None, None] * outer
    return found
