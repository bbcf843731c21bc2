"""What each observation weighs: its standard deviations, and where they come from.

In this order: a user's table, the rms the record states, the table of Veres et al. 2017 (`weight_rules`). Then

- a floor: a stated rms is that of the image on the detector, without the telescope's clock and the field's stars; below
  `FLOOR_ARCSEC` it is raised to it. Occultations, and whatever a user's table says, are left alone;
- the last digit: no sigma is below q / sqrt(12), with q the step of the last digit that was written;
- the night: errors of one station in one night are alike. More than four observations of an object then weigh together
  as four, sigma sqrt(N / 4) (Veres et al. 2017). It holds for stated rms as well, in which those errors are not (stars,
  clock, field); not for occultations, where each star brings its own error. The night ends at local noon, of a
  spacecraft at 0h UTC.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Flags, Rows, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.reduction.weight_rules import Rule, applies, default_rules, detector_modes, read_rules
from nebosvod.units import ARCSEC

FLOOR_ARCSEC = 0.05
NIGHT_LIMIT = 4
TDB_MINUS_UTC_S = 64.0  # to half a minute since 1950: days need no better


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Weights:
    """Standard deviations of n observations.

    Attributes
    ----------
    sigma_rad : (n, 2) of RA cos Dec and of Dec, rad.
    correlation : (n,) of the two.
    rule : (n,) where the number came from, in words.
    night, night_count : (n,) number of the night of the station, and its observations of the object.
    thinning : (n,) the factor in sigma for that.
    notices : what a user should know, one sentence each.
    """

    sigma_rad: Array
    correlation: Array
    rule: Texts
    night: Rows
    night_count: Rows
    thinning: Array
    notices: tuple[str, ...] = field(default=())


def weigh(
    astrometry: Astrometry,
    rules: tuple[Rule, ...] | str | Path | None = None,
    *,
    stated: bool = True,
    floor_arcsec: float = FLOOR_ARCSEC,
    night_limit: int | Callable[[str], int | None] | None = NIGHT_LIMIT,
) -> Weights:
    """Weigh observations.

    Parameters
    ----------
    rules : a table of the user's, which comes before everything (`weight_rules`), or its file.
    stated : whether an rms that the record states comes before the general table.
    floor_arcsec : the least sigma that a stated rms may have.
    night_limit : how many observations of a night weigh as independent; None = all; or a function of the station.

    Raises
    ------
    InputError
        If the table cannot be used (file, line, column), the floor is negative or the limit below one.

    References
    ----------
    Veres, Farnocchia, Chesley, Chamberlin 2017, Icarus 296, 139.
    """
    if not (np.isfinite(floor_arcsec) and floor_arcsec >= 0.0):
        raise InputError(f"weights: the floor must be a finite angle >= 0 (got {floor_arcsec} arcsec)")
    limit = _limits(astrometry, night_limit)
    own = read_rules(rules) if isinstance(rules, str | Path) else rules or ()
    mjd = (astrometry.epoch.day - 2400000.5) + astrometry.epoch.fraction + (astrometry.t_s - TDB_MINUS_UTC_S) / 86400.0
    mode, space = detector_modes(astrometry, mjd), (astrometry.centre != "") & ~astrometry.roving
    sigma, rule = np.empty((len(astrometry), 2)), np.empty(len(astrometry), dtype=object)
    _apply(default_rules(), astrometry, mjd, mode, space, sigma, rule)
    correlation, notices = np.zeros(len(astrometry)), []
    if stated:
        notices += _state(astrometry, mode, floor_arcsec, sigma, correlation, rule)
    by_user = _apply(own, astrometry, mjd, mode, space, sigma, rule)
    correlation[by_user] = 0.0
    coarse = np.nan_to_num(astrometry.precision_rad) / np.sqrt(12.0)
    rounded = (coarse > sigma).any(axis=1) & ~by_user
    sigma[rounded] = np.maximum(sigma, coarse)[rounded]
    rule[rounded] += ", raised to the last digit"
    group, night = _nights(astrometry, mjd, space)
    thinned = (night > limit) & (mode != "OCC")
    thinning = np.where(thinned, np.sqrt(night / limit), 1.0)
    sigma *= thinning[:, None]
    told = [f", sqrt({count}/{most:.0f})" for count, most in zip(night[thinned], limit[thinned])]
    rule[thinned] += np.array(told, dtype=object)
    return Weights(
        sigma_rad=sigma, correlation=correlation, rule=rule.astype(np.str_), night=group, night_count=night,
        thinning=thinning, notices=tuple(notices),
    )  # fmt: skip


def _limits(astrometry: Astrometry, said: int | Callable[[str], int | None] | None) -> Array:
    """How many observations of its night weigh as independent, of each record (n,); inf for all."""
    if isinstance(said, int) and said < 1:
        raise InputError(f"weights: the limit of observations in a night must be at least 1 (got {said})")
    by_station = {code: said(code) if callable(said) else said for code in astrometry.stations}
    return np.array([by_station[code] or np.inf for code in astrometry.station.tolist()])


def noise_covariance(weights: Weights, timing_sigma_s: Array, rate_rad_s: Array) -> Array:
    """Covariances R (n, 2, 2), rad^2, of (RA cos Dec, Dec).

    Parameters
    ----------
    timing_sigma_s : (n,) standard deviations of the clock; nan counts as none.
    rate_rad_s : (n, 2) apparent motion in RA cos Dec and Dec: R gains sigma_t^2 rate rate^T, along the motion.
    """
    cross = weights.correlation * weights.sigma_rad[:, 0] * weights.sigma_rad[:, 1]
    R = weights.sigma_rad[:, :, None] ** 2 * np.eye(2) + cross[:, None, None] * (1.0 - np.eye(2))
    along = np.nan_to_num(timing_sigma_s)[:, None] * rate_rad_s
    total: Array = R + along[:, :, None] * along[:, None, :]
    return total


def _apply(
    rules: tuple[Rule, ...],
    astrometry: Astrometry,
    mjd: Array,
    mode: Texts,
    space: Flags,
    sigma: Array,
    rule: np.ndarray,
) -> Flags:
    """Write what the rules say into sigma and rule; which records (n,) they spoke of."""
    spoken = np.zeros(len(astrometry), dtype=np.bool_)
    for one in rules:
        mine = applies(one, astrometry, mjd, mode, space)
        if mine.any():
            sigma[mine] = np.array(one.sigma_arcsec) * ARCSEC
            rule[mine] = one.text
            spoken |= mine
    return spoken


def _state(
    astrometry: Astrometry, mode: Texts, floor_arcsec: float, sigma: Array, correlation: Array, rule: np.ndarray
) -> list[str]:
    """Write what the records state into sigma, correlation and rule; notices."""
    mine = np.isfinite(astrometry.sigma_rad).all(axis=1)
    floor = np.where(mode == "OCC", 0.0, floor_arcsec * ARCSEC)[:, None]
    raised = mine & (astrometry.sigma_rad < floor).any(axis=1)
    sigma[mine] = np.maximum(astrometry.sigma_rad, floor)[mine]
    correlation[mine] = astrometry.correlation[mine]
    rule[mine] = "stated rms"
    rule[raised] = f'stated rms, raised to {floor_arcsec:g}"'
    if raised.any():
        return [f'{int(raised.sum())} stated rms below {floor_arcsec:g}" were raised to it']
    return []


def _nights(astrometry: Astrometry, mjd: Array, space: Flags) -> tuple[Rows, Rows]:
    """Number (n,) of the night of one station and object, and how many observations it holds."""
    station, which = np.unique(astrometry.station, return_inverse=True)
    turn = np.array([_longitude_turn(code) for code in station.tolist()])[which]
    rover = astrometry.roving
    turn[rover] = np.arctan2(astrometry.position_km[rover, 1], astrometry.position_km[rover, 0]) / (2.0 * np.pi)
    night = np.floor(np.where(space, mjd, mjd + turn - 0.5)).astype(np.int64)
    _, body = np.unique(astrometry.designation, return_inverse=True)
    place = np.where(rover, np.round(turn * 1e6), 0).astype(np.int64)  # rovers 40 m apart are different observers
    _, group, count = np.unique(
        np.stack([which, night, body, place], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    number: Rows = group.ravel()
    return number, count[number]


def _longitude_turn(code: str) -> float:
    """East longitude of a station in turns, from -0.5 to 0.5; 0 for one without."""
    longitude = obscodes.codes().get(code, {}).get("Longitude")
    return 0.0 if longitude is None else (float(longitude) / 360.0 + 0.5) % 1.0 - 0.5
