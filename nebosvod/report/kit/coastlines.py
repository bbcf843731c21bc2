"""The land of the Earth, and what of it lies in a window of longitude and latitude.

The data (coastlines.json beside this file, made by tools/make_coastlines.py) is Natural Earth's at 1:110 000 000: good
for a map of the world, coarse where a map shows less than some 500 km.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Window = tuple[float, float, float, float]  # west, south, east, north, deg; west may lie below -180, east above 180
SOURCE = "coastlines: Natural Earth"


@cache
def rings() -> tuple[Array, ...]:
    """Rings (n, 2) of longitude and latitude, deg, closed; land to the right of each, of a lake to the left."""
    held = json.loads(Path(__file__).with_name("coastlines.json").read_text("utf-8"))
    return tuple(np.cumsum(np.reshape(steps, (-1, 2)), axis=0) / held["steps_per_deg"] for steps in held["rings"])


def land(window: Window, least_deg: float = 0.0) -> list[Array]:
    """Closed outlines (n, 2) of the land inside a window, cut at its edges.

    Parameters
    ----------
    least_deg : points nearer than this to the one before are left out, and rings smaller than this.
    """
    west, _, east, _ = window
    found = []
    for ring in rings():
        low, high = float(ring[:, 0].min()), float(ring[:, 0].max())
        for turn in range(int((west - high) // 360.0) + 1, int((east - low) // 360.0) + 1):
            cut = _cut(_thinned(ring, least_deg) + np.array([360.0 * turn, 0.0]), window)
            if len(cut) > 2 and float(np.ptp(cut, axis=0).max()) > least_deg:
                found.append(cut)
    return found


def shore(outline: Array, window: Window) -> Array:
    """An outline of `land` as lines, broken (nan) where it is no shore: along the window, the date line, the pole."""
    closed = np.vstack([outline, outline[:1]])
    west, south, east, north = window
    x, y = closed.T
    at_edge = np.zeros(len(closed) - 1, dtype=bool)
    for values, places in ((x, (west, east, -180.0, 180.0, 540.0, -540.0)), (y, (south, north, -90.0))):
        for place in places:
            on = np.abs(values - place) < 1e-9
            at_edge |= on[:-1] & on[1:]
    gaps = np.flatnonzero(at_edge) + 1
    return np.insert(closed, gaps, np.nan, axis=0)


def on_land(longitude_deg: Array, latitude_deg: Array) -> npt.NDArray[np.bool_]:
    """Which of n points lie on land: those with an odd number of shores to their east."""
    x, y = (np.asarray(values, dtype=np.float64)[:, None] for values in (longitude_deg, latitude_deg))
    x, y = (x + 180.0) % 360.0 - 180.0, np.maximum(y, -89.999)  # the pole itself is the edge of its ring
    odd = np.zeros(len(x), dtype=bool)
    for ring in rings():
        near = np.flatnonzero((y[:, 0] > ring[:, 1].min()) & (y[:, 0] <= ring[:, 1].max()))
        (x0, y0), (x1, y1) = ring[:-1].T, ring[1:].T
        reaches = (y0 > y[near]) != (y1 > y[near])
        part = (y[near] - y0) / np.where(y1 == y0, 1.0, y1 - y0)
        for turn in (-360.0, 0.0, 360.0):  # longitudes of a ring may run on over the date line
            crossed = reaches & (x0 + part * (x1 - x0) + turn > x[near])
            odd[near] ^= np.count_nonzero(crossed, axis=1) % 2 == 1
    return odd


def _thinned(ring: Array, least_deg: float) -> Array:
    """A ring without points that lie within `least_deg` of the last one kept."""
    if least_deg <= 0.0:
        return ring
    kept = [0]
    for k in range(1, len(ring) - 1):
        if max(abs(ring[k, 0] - ring[kept[-1], 0]), abs(ring[k, 1] - ring[kept[-1], 1])) >= least_deg:
            kept.append(k)
    return np.asarray(ring[[*kept, len(ring) - 1]])


def _cut(ring: Array, window: Window) -> Array:
    """A closed outline cut to a window, edge by edge (Sutherland, Hodgman 1974, Communications of the ACM 17, 32)."""
    west, south, east, north = window
    points = ring[:-1]
    for axis, edge, sign in ((0, west, 1.0), (0, east, -1.0), (1, south, 1.0), (1, north, -1.0)):
        if not len(points):
            break
        inside = sign * (points[:, axis] - edge) >= 0.0
        if inside.all():
            continue
        points = _cut_by(points, inside, axis, edge)
    return points


def _cut_by(points: Array, inside: npt.NDArray[np.bool_], axis: int, edge: float) -> Array:
    """What of a closed outline lies inside one edge, closed along it."""
    following = np.roll(points, -1, axis=0)
    crosses = inside != np.roll(inside, -1)
    step = following[:, axis] - points[:, axis]
    part = (edge - points[:, axis]) / np.where(crosses, step, 1.0)
    meeting = points + part[:, None] * (following - points)
    meeting[:, axis] = edge
    pairs = np.stack([points, meeting], axis=1).reshape(-1, 2)
    return np.asarray(pairs[np.stack([inside, crosses], axis=1).ravel()])
