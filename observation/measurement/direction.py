"""Directions on the sky: right ascension and declination, differences of directions.

Everywhere psi = (RA in [0, 2 pi), Dec) in rad, and a difference of directions is (dRA cos Dec, dDec) with the
declination of the computed direction frozen.
"""

import numpy as np

from nebosvod.borders.quantities import bordered
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array
from nebosvod.observation.measurement.rows import TURN, directions


@bordered()
def ra_dec(u: Array) -> Array:
    """Right ascension in [0, 2 pi) and declination (n, 2), rad, of vectors u (n, 3) of any length, ICRF.

    The declination comes from atan2(z, sqrt(x^2 + y^2)), which keeps full precision at the poles where asin loses
    half the digits. At a pole itself the right ascension is 0.
    """
    psi = np.empty((len(u), 2))
    directions(np.require(u, dtype=np.float64, requirements=("C", "W")), psi)
    return psi


def unit_vector(psi: Array) -> Array:
    """Unit vectors (n, 3), ICRF, of directions psi (n, 2)."""
    cos_dec = np.cos(psi[:, 1])
    return np.stack([cos_dec * np.cos(psi[:, 0]), cos_dec * np.sin(psi[:, 0]), np.sin(psi[:, 1])], axis=1)


def wrap(angle: Array) -> Array:
    """The angle brought to [-pi, pi)."""
    return np.mod(angle + np.pi, TURN) - np.pi


@bordered(observed="rad", computed="rad")
def residual(observed: Array, computed: Array) -> Array:
    """Observed minus computed directions as (dRA cos Dec, dDec), rad.

    Parameters
    ----------
    observed, computed : shape (n, 2), RA and Dec in rad; the cosine is that of the computed declination.

    Raises
    ------
    InputError
        If the shapes differ.

    Notes
    -----
    Within about a residual of a pole RA cos Dec is not a small-angle coordinate any more: the second-order error is
    |v|^2 tan(Dec) / 2.
    """
    if observed.shape != computed.shape or observed.ndim != 2 or observed.shape[1] != 2:
        raise InputError(
            f"residual: observed {observed.shape} and computed {computed.shape} directions must both be (n, 2)"
        )
    difference = np.empty_like(computed)
    difference[:, 0] = wrap(observed[:, 0] - computed[:, 0]) * np.cos(computed[:, 1])
    difference[:, 1] = observed[:, 1] - computed[:, 1]
    return difference


def offset(computed: Array, difference: Array) -> Array:
    """Directions psi (n, 2) that lie `difference` = (dRA cos Dec, dDec) from `computed`: the inverse of `residual`.

    Raises
    ------
    InputError
        If a shifted declination passes a pole, where RA cos Dec is no coordinate.
    """
    dec = computed[:, 1] + difference[:, 1]
    if np.any(np.abs(dec) > np.pi / 2):
        raise InputError("offset: the shifted direction passes a pole; RA cos Dec is no coordinate there")
    ra = np.mod(computed[:, 0] + difference[:, 0] / np.cos(computed[:, 1]), TURN)
    ra[ra >= TURN] = 0.0
    return np.stack([ra, dec], axis=1)


def angle_between(a: Array, b: Array) -> Array:
    """Angle in [0, pi] between vectors a and b (n, 3), rad, precise for small and for straight angles (Kahan)."""
    a_hat = a / np.linalg.norm(a, axis=1, keepdims=True)
    b_hat = b / np.linalg.norm(b, axis=1, keepdims=True)
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(a_hat - b_hat, axis=1), np.linalg.norm(a_hat + b_hat, axis=1))
    return angle
