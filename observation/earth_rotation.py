"""Orientation of the Earth in ICRF: precession-nutation by erfa, rotation by the Earth rotation angle.

UT1 is taken equal to UTC (|UT1 - UTC| < 0.9 s by definition, so up to 0.42 km at the equator and 2.8 km on the
geostationary ring; 2020-2025 it stayed within 0.25 s, 0.12 and 0.8 km) and polar motion as zero (0.5" at most: 15 m
and 0.1 km), unless a caller gives them: no Earth-orientation data is fetched from anywhere.
"""

import erfa
import numpy as np

from nebosvod.observation.constants import EARTH_ROTATION_RAD_S
from nebosvod.observation.contracts import Array
from nebosvod.timescale import Epoch, utc_jd

# Node spacing of the precession-nutation table. The shortest nutation of note has a period of 5.5 d and 2 mas;
# six-point interpolation at 0.5 d leaves under 1e-6" (0.2 mm on the geostationary ring).
STEP_DAYS = 0.5
STENCIL = np.arange(-2, 4)
# Six-point Lagrange denominators prod_{k != j} (j - k) for the nodes -2 .. 3.
DENOMINATORS = np.array([np.prod([j - k for k in STENCIL if k != j]) for j in STENCIL], dtype=np.float64)


def R_icrf_from_cirs(epoch: Epoch, t_s: Array) -> Array:
    """Rotation (n, 3, 3) from the celestial intermediate system to ICRF at `t_s` TDB seconds after `epoch`.

    IAU 2006 precession with 2000A nutation (erfa.xys06a), evaluated at nodes half a day apart and interpolated, since
    one evaluation costs 60 us. TDB stands for TT (2 ms: nothing here).
    """
    days = epoch.fraction + t_s / 86400.0
    first, last = np.floor(days.min() / STEP_DAYS), np.floor(days.max() / STEP_DAYS)
    if last - first + 6 < days.size:
        nodes = (np.arange(first - 2, last + 4)) * STEP_DAYS
        x, y, s = _interpolate(np.stack(erfa.xys06a(epoch.day, nodes)), days / STEP_DAYS - (first - 2))
    else:
        x, y, s = erfa.xys06a(epoch.day, days)
    matrix: Array = erfa.c2ixys(x, y, s)
    return np.swapaxes(matrix, 1, 2)


def _interpolate(table: Array, where: Array) -> Array:
    """Six-point Lagrange interpolation of table rows (3, k) at fractional node numbers (n,)."""
    base = np.floor(where).astype(np.int64)
    distance = (where - base)[:, None] - STENCIL
    weights = np.empty_like(distance)
    for j in range(6):
        weights[:, j] = np.prod(np.delete(distance, j, axis=1), axis=1) / DENOMINATORS[j]
    values: Array = np.einsum("nj,qnj->qn", weights, table[:, base[:, None] + STENCIL])
    return values


def earth_rotation_angle(epoch: Epoch, t_s: Array, ut1_minus_utc_s: Array | float = 0.0) -> Array:
    """Earth rotation angle (n,), rad, at `t_s` TDB seconds after `epoch`.

    UTC - TDB costs 5 us a call (the 787 terms of dtdb), so it is taken at both ends of half-day cells and interpolated,
    to 1e-9 s; cells in which it steps (a leap second) are evaluated time by time.
    """
    days = epoch.fraction + t_s / 86400.0
    cells, which = np.unique(np.floor(days / STEP_DAYS), return_inverse=True)
    if 2 * cells.size >= t_s.size:
        day, fraction = utc_jd(epoch, t_s)
    else:
        edges = np.concatenate([cells, cells + 1.0]) * STEP_DAYS
        edge_day, edge_fraction = utc_jd(epoch, (edges - epoch.fraction) * 86400.0)
        start, end = (((edge_day - epoch.day) + edge_fraction) - edges).reshape(2, -1)
        part = days / STEP_DAYS - cells[which]
        day, fraction = np.full(t_s.size, epoch.day), days + start[which] + part * (end - start)[which]
        leap = (np.abs(end - start) * 86400.0 > 1e-4)[which]  # TDB - TT changes by 1.4e-5 s in a cell
        day[leap], fraction[leap] = utc_jd(epoch, t_s[leap])
    angle: Array = erfa.era00(day, fraction + np.asarray(ut1_minus_utc_s) / 86400.0)
    return angle


def rotating_to_icrf(position_km: Array, epoch: Epoch, t_s: Array, ut1_minus_utc_s: Array | float = 0.0) -> Array:
    """Geocentric ICRF states (n, 6) of points fixed to the rotating Earth.

    Parameters
    ----------
    position_km : shape (n, 3) or (3,), in the terrestrial intermediate system (ITRF without polar motion).
    t_s : shape (n,), TDB seconds after `epoch`.

    Notes
    -----
    The velocity is omega x r; precession and nutation would add under 1e-6 of it (0.4 mm/s on the geostationary
    ring). Left out: the TIO locator s' (47 uas a century: 2 mm on that ring) and the scale of TDB-compatible
    geocentric coordinates (1.5e-8: 0.7 m there), as everywhere in nebosvod.
    """
    angle = earth_rotation_angle(epoch, t_s, ut1_minus_utc_s)
    x, y, z = np.moveaxis(np.broadcast_to(position_km, (t_s.size, 3)), -1, 0)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)
    velocity = EARTH_ROTATION_RAD_S * np.stack([-turned[:, 1], turned[:, 0], np.zeros_like(z)], axis=1)
    R = R_icrf_from_cirs(epoch, t_s)
    return np.concatenate([(R @ turned[:, :, None])[:, :, 0], (R @ velocity[:, :, None])[:, :, 0]], axis=1)
