"""Views of things in space from above and from the side, at one scale: tracks, places, cones of what is not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.scale import linear
from nebosvod.report.kit.short import width_px

Array = npt.NDArray[np.float64]
Entry = tuple[str, str, dict[str, Any]]
Corners = tuple[float, float, float, float]  # left, top, right, bottom, px
LOWEST = 46.0  # px of the view from the side
TEXT_PX, GAP, ABOVE, BELOW = 10.5, 9.0, 9.5, 3.0  # of words: their size, how far from a mark, and about the base line
TURN = np.radians(5.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """A line through points (n, 3); `name` stands in the legend, "" in none; `look` as of `Panel.line`."""

    name: str
    points: Array
    look: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """Markers at points (n, 3), with what is written beside the last of them; `look` as of `Panel.dots`."""

    name: str
    points: Array
    marker: str
    look: dict[str, Any]
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cone:
    """All directions between two angles from an axis (3,), seen from an apex (3,): what a telescope cannot see."""

    name: str
    apex: Array
    axis: Array
    inner_rad: float
    outer_rad: float
    color: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Disc:
    """A sphere about a centre (3,), to scale."""

    name: str
    centre: Array
    radius: float
    look: dict[str, Any]


Thing = Track | Marks | Cone | Disc


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """Things in one frame, and how much of it is shown.

    Attributes
    ----------
    names : of the three axes, with their unit; the first two span the view from above.
    middle, half : (2,) and half the width of the view from above.
    low, high : of the third axis.
    """

    names: tuple[str, str, str]
    middle: Array
    half: float
    low: float
    high: float
    things: Sequence[Thing] = field(default_factory=tuple)


def draw(chart: Chart, sight: Sight, *, left: float, top: float, size: float, title: str) -> float:
    """Draw the view from above, `size` px wide and high, and below it the one from the side; returns where it ends.

    Both have one scale, so that angles and shapes are what they are.
    """
    x = linear([sight.middle[0] - sight.half, sight.middle[0] + sight.half], sight.names[0], pad=0.0, most=5)
    y = linear([sight.middle[1] - sight.half, sight.middle[1] + sight.half], sight.names[1], pad=0.0, most=5)
    per_px = 2.0 * sight.half / size
    tall = float(np.clip((sight.high - sight.low) / per_px, LOWEST, 0.75 * size))
    centre = 0.5 * (sight.low + sight.high)
    reach = 0.5 * tall * per_px
    z = linear([centre - reach, centre + reach], sight.names[2], pad=0.0, most=max(2, int(tall / 30.0)))
    above = chart.panel(x.silenced(), y, top=top, bottom=top + size, title=title, left=left, right=left + size,
                        name_at=left - 47.0)  # fmt: skip
    _fill(above, sight.things, 1)
    bottom = top + size + 8.0 + tall
    side = chart.panel(x, z, top=top + size + 8.0, bottom=bottom, left=left, right=left + size,
                       name_at=left - 47.0)  # fmt: skip
    _fill(side, sight.things, 2)
    return bottom + 34.0


def entries(things: Sequence[Thing]) -> list[Entry]:
    """The legend: each name once."""
    found: dict[str, Entry] = {}
    for one in things:
        if not one.name or one.name in found:
            continue
        if isinstance(one, Track):
            found[one.name] = ("line", one.name, one.look)
        elif isinstance(one, Marks):
            found[one.name] = (one.marker, one.name, {**one.look, "size": min(one.look.get("size", 3.0), 8.0)})
        else:
            look = _shade(one.color) if isinstance(one, Cone) else one.look
            found[one.name] = ("box", one.name, look)
    return list(found.values())


def _fill(panel: Panel, things: Sequence[Thing], up: int) -> None:
    """Everything in a panel, cones first; `up` is the axis that is shown upwards."""
    panel.open()
    panel.clip()
    for one in sorted(things, key=lambda thing: not isinstance(thing, Cone)):
        if isinstance(one, Track):
            panel.line(one.points[:, 0], one.points[:, up], one.name, **one.look)
        elif isinstance(one, Marks):
            panel.dots(one.points[:, 0], one.points[:, up], one.marker, one.name, **one.look)
        elif isinstance(one, Disc):
            turn = np.linspace(0.0, 2.0 * np.pi, 61)
            panel.outline(
                one.centre[0] + one.radius * np.cos(turn), one.centre[up] + one.radius * np.sin(turn), **one.look
            )
        else:
            _cone(panel, one, up)
    if up == 1:
        _labels(panel, things)
    panel.unclip()
    panel.close()


def _labels(panel: Panel, things: Sequence[Thing]) -> None:
    """Words beside marks, each where it covers least: no mark, no other words, as little of a line as can be."""
    told = [one for one in things if isinstance(one, Marks) and one.text]
    spots = np.vstack([np.empty((0, 2)), *(_pixels(panel, one.points) for one in things if isinstance(one, Marks))])
    paths = np.vstack([np.empty((0, 2)), *(_dense(_pixels(panel, one.points)) for one in things
                                           if isinstance(one, Track))])  # fmt: skip
    taken: list[Corners] = []
    for one in told:
        px, py = _pixels(panel, one.points[-1:])[0]
        if not (panel.left < px < panel.right and panel.top < py < panel.bottom):
            continue
        wide = width_px(one.text, TEXT_PX)
        others = spots[np.hypot(spots[:, 0] - px, spots[:, 1] - py) > 1.0]

        boxes = [(x - 2.0, y - ABOVE, x + wide + 2.0, y + BELOW) for x, y in _places(px, py, wide)]
        best = min(boxes, key=lambda box: _cost(panel, box, taken, others, paths))
        taken.append(best)
        panel.chart.text(best[0] + 2.0, best[3] - BELOW, one.text, class_="halo")


def _cost(panel: Panel, box: Corners, taken: Sequence[Corners], others: Array, paths: Array) -> float:
    """How much words in a box would cover, or stick out."""
    outside = max(panel.left - box[0], box[2] - panel.right, panel.top - box[1], box[3] - panel.bottom, 0.0)
    over = sum(box[0] < c[2] and c[0] < box[2] and box[1] < c[3] and c[1] < box[3] for c in taken)
    return 1e4 * outside + 1e3 * over + 100.0 * _inside(others, box, 5.0) + _inside(paths, box, 1.0)


def _places(px: float, py: float, wide: float) -> list[tuple[float, float]]:
    """Where words may begin beside a point, the most usual first."""
    right, left, middle = px + GAP, px - GAP - wide, px - 0.5 * wide
    places = [(right, py - 5.0), (right, py + 12.0), (left, py - 5.0), (left, py + 12.0), (right, py + 3.6),
              (left, py + 3.6), (middle, py - 11.0), (middle, py + 19.0)]  # fmt: skip
    return places + [(x, y + shift) for shift in (-16.0, 16.0, -32.0, 32.0) for x, y in places[:4]]


def _pixels(panel: Panel, points: Array) -> Array:
    """Points (n, 3) in the view from above, px (n, 2); undefined ones are left out."""
    found = np.stack(panel.at(points[:, 0], points[:, 1]), axis=1)
    return found[np.isfinite(found).all(axis=1)]


def _dense(path: Array) -> Array:
    """A path (n, 2) with a point on every few px of it."""
    if len(path) < 2:
        return path
    steps = np.hypot(*np.diff(path, axis=0).T)
    parts = np.minimum(1 + (steps / 4.0).astype(int), 400)
    return np.vstack([a + np.linspace(0.0, 1.0, n)[:, None] * (b - a) for a, b, n in zip(path, path[1:], parts)])


def _inside(points: Array, box: Corners, room: float) -> int:
    """How many points (n, 2) lie in a box, or so near to it."""
    x, y = points.T
    near = (x > box[0] - room) & (x < box[2] + room) & (y > box[1] - room) & (y < box[3] + room)
    return int(np.count_nonzero(near))


def _cone(panel: Panel, one: Cone, up: int) -> None:
    """The cut of a cone with the plane of the picture, through its axis."""
    axis = np.arctan2(one.axis[up], one.axis[0])
    far = 4.0 * (panel.x.high - panel.x.low + abs(panel.x.high) + abs(panel.x.low))
    apex = np.array([one.apex[0], one.apex[up]])
    spans = [(axis - one.outer_rad, axis + one.outer_rad)] if one.inner_rad <= 0.0 else [
        (axis + one.inner_rad, axis + one.outer_rad), (axis - one.outer_rad, axis - one.inner_rad),
    ]  # fmt: skip
    for low, high in spans:
        turn = np.linspace(low, high, 2 + int((high - low) / TURN))
        rim = apex + far * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        panel.outline(*np.vstack([apex[None], rim]).T, **_shade(one.color))


def _shade(color: str) -> dict[str, Any]:
    return {"fill": color, "fill_opacity": 0.16}
