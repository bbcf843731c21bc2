"""Orientation of the Earth in ICRF: precession-nutation by erfa, rotation by the Earth rotation angle.

What is costly in it changes slowly, and is evaluated at nodes or cells of time that many epochs share. UT1 and the
pole as observed are in `earth_orientation`.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import erfa
import numpy as np

from nebosvod.dynamics.compilation import allocating_kernel, kernel
from nebosvod.observation.contracts import Array
from nebosvod.observation.earth.constants import EARTH_ROTATION_RAD_S
from nebosvod.timescale import Epoch, utc_jd

# Node spacing of the precession-nutation table. The shortest nutation of note has a period of 5.5 d and 2 mas;
# six-point interpolation at 0.5 d leaves under 1e-6" (0.2 mm on the geostationary ring).
STEP_DAYS = 0.5
BLOCK = 16  # nodes computed, and kept, together
AGAIN = 4  # nodes worth computing per cell asked for: an orbit is improved by asking for the same times again
# Cells in which nutation 2000A less 2000B is taken as constant, to 0.03 mas: 1 mm on the ground, 6 mm on that ring
CELL_DAYS = 0.25
MJD_0 = 2400000.5
MOST_KEPT = 100_000  # columns of a function that is kept: 20 MB
# Six-point Lagrange denominators prod_{k != j} (j - k) for nodes a unit apart.
DENOMINATORS = (-120.0, 24.0, -12.0, 12.0, -24.0, 120.0)


def R_icrf_from_cirs(epoch: Epoch, t_s: Array) -> Array:
    """Rotation (n, 3, 3) from the celestial intermediate system to ICRF at `t_s` TDB seconds after `epoch`.

    IAU 2006 precession with 2000A nutation (erfa.xys06a). One evaluation costs 60 us: times that lie close are
    interpolated between nodes half a day apart; nights strewn over decades are evaluated once a quarter of a day, and
    follow the short series 2000B (3 us) in it. TDB stands for TT (2 ms: nothing here).
    """
    days = epoch.fraction + t_s / 86400.0
    first, last = np.floor(days.min() / STEP_DAYS), np.floor(days.max() / STEP_DAYS)
    cells, cell = np.unique(np.floor(days / CELL_DAYS), return_inverse=True)
    xys = np.empty((3, days.size))
    if last - first + 6 < AGAIN * cells.size:
        low, high = int(first - 2) // BLOCK, int(last + 3) // BLOCK
        table = np.concatenate([_nodes(epoch.day, block) for block in range(low, high + 1)], axis=1)
        _interpolate(table, days / STEP_DAYS - low * BLOCK, xys)
    elif 2 * cells.size > days.size:
        xys[...] = erfa.xys06a(epoch.day, days)
    else:
        slow = _slow(_numbers(epoch, cells, CELL_DAYS))
        xys[...] = np.stack(erfa.xys00b(epoch.day, days)) + slow[:, cell]
    R = np.empty((days.size, 3, 3))
    _orient(xys, R)
    return R


class _Kept:
    """Columns of a costly function of whole numbers, such as those of cells of time, each computed once in a process.

    Surveys see hundreds of objects in the same nights. What a column is does not depend on what was asked before.
    """

    def __init__(self, function: Callable[[Array], Array]) -> None:
        self.function = function
        self.known: dict[float, Array] = {}

    def __call__(self, numbers: Array) -> Array:
        """Columns (k, n) at numbers (n,)."""
        asked = numbers.tolist()
        if len(self.known) > MOST_KEPT:
            self.known.clear()
        missing = [number for number in asked if number not in self.known]
        if missing:
            self.known.update(zip(missing, self.function(np.array(missing)).T.copy()))
        return np.array([self.known[number] for number in asked]).T


def _numbers(epoch: Epoch, cells: Array, length_days: float) -> Array:
    """Numbers of cells counted from the day of an epoch, counted from MJD 0."""
    return cells + round((epoch.day - MJD_0) / length_days)


def _jd(numbers: Array, length_days: float) -> tuple[Array, Array]:
    """Where cells of so many days begin, as two parts of a Julian date."""
    days = np.floor(numbers * length_days)
    return MJD_0 + days, numbers * length_days - days


@_Kept
def _slow(numbers: Array) -> Array:
    """Nutation 2000A less 2000B in X, Y and s (3, n), rad, amid cells."""
    middle = _jd(numbers + 0.5, CELL_DAYS)
    return np.asarray(np.stack(erfa.xys06a(*middle)) - np.stack(erfa.xys00b(*middle)))


@lru_cache(maxsize=1024)
def _nodes(day: float, block: int) -> Array:
    """X, Y and s (3, BLOCK), rad, at the nodes of a block; node 0 is at the beginning of the `day`."""
    nodes = np.arange(block * BLOCK, (block + 1) * BLOCK) * STEP_DAYS
    return np.stack(erfa.xys06a(day, nodes))


@allocating_kernel
def _interpolate(table: Array, where: Array, values: Array) -> None:
    """Six-point Lagrange interpolation of table rows (3, k) at fractional node numbers (n,), into values (3, n)."""
    weights = np.empty(6)
    for e in range(where.shape[0]):
        base = math.floor(where[e])
        s = where[e] - base
        for j in range(6):
            product = 1.0
            for k in range(6):
                if k != j:
                    product *= s - (k - 2)
            weights[j] = product / DENOMINATORS[j]
        for q in range(3):
            total = 0.0
            for j in range(6):
                total += weights[j] * table[q, base + j - 2]
            values[q, e] = total


@kernel
def _orient(xys: Array, R: Array) -> None:
    """R_icrf_from_cirs (n, 3, 3) of the pole's X, Y and the origin's s (3, n): IERS Conventions 2010, eq. 5.10."""
    for e in range(R.shape[0]):
        X, Y, s = xys[0, e], xys[1, e], xys[2, e]
        Z = math.sqrt(1.0 - X * X - Y * Y)
        a = 1.0 / (1.0 + Z)
        cos, sin = math.cos(s), math.sin(s)
        # columns of Q(X, Y), turned by s about the pole: M = Q R3(s)
        xx, xy, yy = 1.0 - a * X * X, -a * X * Y, 1.0 - a * Y * Y
        R[e, 0, 0], R[e, 0, 1], R[e, 0, 2] = xx * cos - xy * sin, xx * sin + xy * cos, X
        R[e, 1, 0], R[e, 1, 1], R[e, 1, 2] = xy * cos - yy * sin, xy * sin + yy * cos, Y
        R[e, 2, 0], R[e, 2, 1], R[e, 2, 2] = -X * cos + Y * sin, -X * sin - Y * cos, Z


def turned(R: Array, states: Array) -> Array:
    """States (n, 6) with positions and velocities turned by matrices R (n, 3, 3)."""
    out = np.empty((len(states), 6))
    _turn(R, np.require(states, dtype=np.float64, requirements=("C", "W")), out)
    return out


@kernel
def _turn(R: Array, states: Array, out: Array) -> None:
    for e in range(out.shape[0]):
        for i in range(3):
            for half in (0, 3):
                out[e, half + i] = (
                    R[e, i, 0] * states[e, half] + R[e, i, 1] * states[e, half + 1] + R[e, i, 2] * states[e, half + 2]
                )


def earth_rotation_angle(epoch: Epoch, t_s: Array) -> Array:
    """Earth rotation angle (n,), rad, at `t_s` TDB seconds after `epoch`, with UTC for UT1 and without any table.

    |UT1 - UTC| < 0.9 s by definition, so up to 0.42 km at the equator and 2.8 km on the geostationary ring; from 2020
    to 2025 it stayed within 0.25 s, 0.12 and 0.8 km.
    """

    def utc_minus_tdb(days: Array) -> Array:
        day, fraction = utc_jd(epoch, (days - epoch.fraction) * 86400.0)
        return np.asarray(((day - epoch.day) + fraction) - days)

    days = epoch.fraction + t_s / 86400.0
    angle: Array = erfa.era00(epoch.day, days + _by_cells(utc_minus_tdb, days))
    return angle


def tt_days(epoch: Epoch, t_s: Array) -> Array:
    """TT in days (n,) after the 0h TT of the day of `epoch`, at `t_s` TDB seconds after `epoch`."""

    def tt_minus_tdb(days: Array) -> Array:
        return np.asarray(-erfa.dtdb(epoch.day, days, 0.0, 0.0, 0.0, 0.0) / 86400.0)

    days = epoch.fraction + t_s / 86400.0
    return days + _by_cells(tt_minus_tdb, days, lambda edges: _tt_minus_tdb(_numbers(epoch, edges, STEP_DAYS))[0])


@_Kept
def _tt_minus_tdb(numbers: Array) -> Array:
    """TT - TDB at the edges of cells (1, n), days."""
    return np.asarray(-erfa.dtdb(*_jd(numbers, STEP_DAYS), 0.0, 0.0, 0.0, 0.0) / 86400.0)[None]


def _by_cells(offset: Callable[[Array], Array], days: Array, of_edges: Callable[[Array], Array] | None = None) -> Array:
    """A clock's offset from TDB (n,), days, at TDB `days` (n,) after some 0h.

    It costs 5 us a time (the 787 terms of dtdb), so it is taken at both ends of the half-day cells that hold any, and
    interpolated, to 1e-9 s; cells in which it steps (a leap second) are evaluated time by time.

    Parameters
    ----------
    of_edges : the same at whole numbers of half days, where they are kept.
    """
    cell = np.floor(days / STEP_DAYS)
    edges = np.unique(np.concatenate([cell, cell + 1.0]))
    if edges.size >= days.size:
        return offset(days)
    at_edges = offset(edges * STEP_DAYS) if of_edges is None else of_edges(edges)
    which = np.searchsorted(edges, cell)
    change = at_edges[which + 1] - at_edges[which]
    value: Array = at_edges[which] + (days / STEP_DAYS - cell) * change
    leap = np.abs(change) * 86400.0 > 1e-4  # TDB - TT changes by 1.4e-5 s in a cell
    if np.any(leap):
        value[leap] = offset(days[leap])
    return value


def rotating_to_icrf(position_km: Array, angle_rad: Array, epoch: Epoch, t_s: Array) -> Array:
    """Geocentric ICRF states (n, 6) of points fixed to the rotating Earth.

    Parameters
    ----------
    position_km : shape (n, 3) or (3,), in the terrestrial intermediate system (ITRF without polar motion).
    angle_rad : shape (n,), Earth rotation angle.
    t_s : shape (n,), TDB seconds after `epoch`.

    Notes
    -----
    The velocity is omega x r; precession and nutation would add under 1e-6 of it (0.4 mm/s on the geostationary
    ring). Left out as everywhere in nebosvod: the scale of TDB-compatible geocentric coordinates (1.5e-8: 10 cm on the
    ground, 0.7 m on that ring).
    """
    x, y, z = np.moveaxis(np.broadcast_to(position_km, (t_s.size, 3)), -1, 0)
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    states = np.zeros((t_s.size, 6))
    states[:, 0], states[:, 1], states[:, 2] = cos * x - sin * y, sin * x + cos * y, z
    states[:, 3], states[:, 4] = -EARTH_ROTATION_RAD_S * states[:, 1], EARTH_ROTATION_RAD_S * states[:, 0]
    return turned(R_icrf_from_cirs(epoch, t_s), states)
