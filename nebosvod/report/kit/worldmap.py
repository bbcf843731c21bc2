"""Maps of where an object may come down: the world, and the neighbourhood of what is small on it.

Equirectangular, with graticule and named axes. The sheet is turned where what it shows lies across the date line, so
that nothing is torn. Longitude and latitude are geodetic.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.dynamics.constants import EARTH_RADIUS_KM
from nebosvod.report.kit.chart import CHARACTER, NARROW, Chart, Panel
from nebosvod.report.kit.coastlines import SOURCE, Window, land, shore
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.ground import continued, middle
from nebosvod.report.kit.plate import BLUE, INK, VERMILION, Plate, thin
from nebosvod.report.kit.scale import Scale, round_step, tick_text
from nebosvod.report.kit.wording import NBSP, number

Array = npt.NDArray[np.float64]
LEFT, RIGHT = 53.0, 21.0  # px
LAND, SHORE = "#a8a290", "#8b8675"
EDGE_DEG = 20.0  # nearer than this to the edge of the sheet, what is shown moves to its middle
SMALL_DEG = 40.0  # what is smaller than this on the map of the world is shown enlarged as well
SMALLEST_KM = 0.1  # half of the smallest map
COARSE_DEG = 1.0  # a map narrower than this shows no shores: they are not known so well
KM_PER_DEG = math.radians(1.0) * EARTH_RADIUS_KM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corridor:
    """Where something may come down.

    Attributes
    ----------
    name : for the legend.
    points : (n, 2) longitude and latitude of drawn orbits, deg; may be empty.
    nominal : longitude and latitude of the orbit itself; None where it does not come down.
    outlines : closed lines (m, 2) around the ellipses, outermost last, with their name and look.
    look : marker and colour of the points.
    """

    name: str
    points: Array
    nominal: tuple[float, float] | None = None
    outlines: Sequence[Array] = ()
    outlines_name: str = ""
    outline_look: Mapping[str, Any] = field(default_factory=lambda: {"stroke": BLUE, "stroke_width": 1.6})
    marker: str = "o"
    color: str = VERMILION


def maps(key: str, corridors: Sequence[Corridor], title: str, caption: Markup) -> list[Plate]:
    """The map of the world, and an enlarged one where what it shows is small; none where there is nothing to show."""
    everything = _everything(corridors)
    if not len(everything):
        return []
    centre = _centre(everything[:, 0])
    world = (centre - 180.0, -90.0, centre + 180.0, 90.0)
    plates = [_map(key, world, corridors, f"{title} on a map of the world", caption, _data(key, corridors))]
    x = continued(everything[:, 0], middle(everything[:, 0]))
    size = max(float(np.ptp(x)), float(np.ptp(everything[:, 1])))
    if size < SMALL_DEG:
        near = _neighbourhood(x, everything[:, 1])
        told = Markup("The same, enlarged; one scale of kilometres for both axes.")
        if near[2] - near[0] < COARSE_DEG:
            told += Markup(" No shores: the map does not know them this well.")
        plates.append(_map(f"{key}-near", near, corridors, f"{title}, enlarged", told, ()))
    return plates


def _everything(corridors: Sequence[Corridor]) -> Array:
    """All places shown (n, 2)."""
    parts = [np.empty((0, 2))]
    for one in corridors:
        parts += [np.asarray(one.points).reshape(-1, 2), *one.outlines]
        if one.nominal is not None:
            parts.append(np.array([one.nominal]))
    every = np.concatenate(parts)
    return np.asarray(every[np.isfinite(every).all(axis=1)])


def _centre(longitude_deg: Array) -> float:
    """The central meridian: Greenwich, or one of the graticule about which everything lies."""

    def reach(centre: float) -> float:
        return float(np.abs(continued(longitude_deg, centre) - centre).max())

    turned = 60.0 * round(middle(longitude_deg) / 60.0)
    return turned if reach(0.0) > 180.0 - EDGE_DEG and reach(turned) < reach(0.0) else 0.0


def _neighbourhood(x: Array, y: Array) -> Window:
    """A window about places, as wide as high in kilometres or wider."""
    cx, cy = 0.5 * float(x.min() + x.max()), 0.5 * float(y.min() + y.max())
    shrink = max(math.cos(math.radians(cy)), 0.05)
    half = 0.6 * max(float(np.ptp(x)) * shrink, float(np.ptp(y)), SMALLEST_KM / KM_PER_DEG)
    tall = max(0.6 * float(np.ptp(y)), 0.55 * half)
    tall = min(tall, 90.0 - abs(cy) if abs(cy) < 60.0 else tall)
    return cx - half / shrink, max(cy - tall, -90.0), cx + half / shrink, min(cy + tall, 90.0)


def _map(
    key: str, window: Window, corridors: Sequence[Corridor], label: str, caption: Markup, data: Sequence[Any]
) -> Plate:
    """One map."""
    west, south, east, north = window
    shrink = 1.0 if east - west >= 360.0 else math.cos(math.radians(0.5 * (south + north)))
    x, y = _axis(west, east, "EW", "longitude, deg"), _axis(south, north, "NS", "latitude, deg")
    left = max(LEFT, 23.0 + CHARACTER * y.width)
    height = (NARROW - RIGHT - left) * (north - south) / ((east - west) * max(shrink, 0.05))
    chart = Chart(key, width=NARROW, height=height + 90.0)
    panel = chart.panel(x, y, top=8.0, bottom=8.0 + height, left=left, right=NARROW - RIGHT)
    panel.open()
    panel.clip()
    if east - west >= COARSE_DEG:
        _land(panel, window)
    centre = 0.5 * (west + east)
    for one in corridors:
        _corridor(panel, one, centre)
    panel.unclip()
    panel.close()
    if east - west < 360.0:
        _bar(panel, (east - west) * shrink * KM_PER_DEG)
    chart.height = chart.legend(_entries(corridors), height + 52.0, LEFT - 30.0) - 4.0
    source = f" {SOURCE[:1].upper()}{SOURCE[1:]}." if east - west >= COARSE_DEG else ""
    return chart.plate(label, caption + source, data)


def _land(panel: Panel, window: Window) -> None:
    """Land as an area, shores as lines."""
    deg_per_px = (window[2] - window[0]) / (panel.right - panel.left)
    found = land(window, 0.5 * deg_per_px)
    if not found:
        return
    lines = [shore(one, window) for one in found]
    for whole in (True, False):  # shores all around: one path draws area and line
        mine = [
            np.round(panel.at(*one.T), 1).T for one, line in zip(found, lines) if bool(np.isfinite(line).all()) is whole
        ]
        if mine:
            look: dict[str, Any] = {"stroke": SHORE, "stroke_width": 0.5} if whole else {}
            panel.chart.region(mine, fill=LAND, fill_opacity=0.45, **look)
    broken = [np.vstack([line, [[np.nan, np.nan]]]) for line in lines if not np.isfinite(line).all()]
    if broken:
        panel.line(*np.concatenate(broken).T, stroke=SHORE, stroke_width=0.5)


def _corridor(panel: Panel, one: Corridor, centre: float) -> None:
    """Ellipses, points and the nominal place of one corridor."""
    for outline in one.outlines:
        x, y = _unbroken(outline, centre)
        panel.line(x, y, **one.outline_look)
    points = np.asarray(one.points).reshape(-1, 2)[thin(len(one.points))]
    if len(points):
        panel.dots(
            continued(points[:, 0], centre), points[:, 1], one.marker, one.name, color=one.color, size=2.2, opacity=0.7
        )
    if one.nominal is not None:
        panel.dots(continued(np.array([one.nominal[0]]), centre), [one.nominal[1]], "P", "nominal orbit", color=INK)


def _unbroken(outline: Array, centre: float) -> tuple[Array, Array]:
    """A line, broken where it leaves the sheet on one side and comes back on the other."""
    x, y = continued(outline[:, 0], centre), outline[:, 1]
    jumps = np.flatnonzero(np.abs(np.diff(x)) > 180.0) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)


def _axis(low: float, high: float, letters: str, label: str) -> Scale:
    """Degrees with their side of the Earth."""
    step = {360.0: 60.0, 180.0: 30.0}.get(high - low) or round_step((high - low) / 5.0)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    values = [k * step for k in range(first, last + 1) if letters == "EW" or abs(k * step) < 90.0]
    ticks = tuple((value, _side(value, step, letters)) for value in values)
    return Scale(kind="linear", low=low, high=high, label=label, ticks=ticks)


def _side(value: float, step: float, letters: str) -> str:
    """`60° W`, `0°`, `180°`."""
    if letters == "EW":
        value = (value + 180.0) % 360.0 - 180.0
    text = f"{tick_text(abs(value), step)}°"
    if abs(value) < 1e-9 * step or (letters == "EW" and abs(abs(value) - 180.0) < 1e-9 * step):
        return text
    return f"{text}{NBSP}{letters[0] if value > 0.0 else letters[1]}"


def _bar(panel: Panel, width_km: float) -> None:
    """A bar of so many kilometres in the lower left corner."""
    length = round_step(width_km / 6.0)
    wide = (panel.right - panel.left) * length / width_km
    x, y = panel.left + 8.0, panel.bottom - 8.0
    panel.chart.stroke([x, x + wide], [y, y], {"color": INK, "linewidth": 2.0, "solid_capstyle": "butt"})
    text = f"{number(length, 1)} km" if length >= 1.0 else f"{1e3 * length:g} m"
    panel.chart.text(x + wide + 5.0, y + 3.6, text, class_="halo")


def _entries(corridors: Sequence[Corridor]) -> list[tuple[str, str, dict[str, Any]]]:
    """The legend."""
    found: list[tuple[str, str, dict[str, Any]]] = []
    for one in corridors:
        if len(one.points):
            found.append((one.marker, one.name, {"color": one.color, "size": 3.0}))
    looks = {one.outlines_name: dict(one.outline_look) for one in corridors if len(one.outlines)}
    found += [("line", name, look) for name, look in looks.items()]
    if any(one.nominal is not None for one in corridors):
        found.append(("P", "nominal orbit", {"color": INK}))
    return found


def _data(key: str, corridors: Sequence[Corridor]) -> list[Any]:
    """Points and outlines as files."""
    files = []
    shown = [one for one in corridors if len(one.points)]
    if shown:
        every = [(one.name, *row) for one in shown for row in np.asarray(one.points)[thin(len(one.points))].tolist()]
        columns = dict(zip(("corridor", "longitude_deg", "latitude_deg"), map(list, zip(*every))))
        files.append(csv(f"{key}-points", columns))
    lines = [(one.name, k, *row) for one in corridors for k, line in enumerate(one.outlines) for row in line.tolist()]
    if lines:
        names = ("corridor", "outline", "longitude_deg", "latitude_deg")
        files.append(csv(f"{key}-ellipse", dict(zip(names, map(list, zip(*lines))))))
    return files
