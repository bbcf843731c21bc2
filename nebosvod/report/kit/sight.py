"""Views of things in space from above and from the side, at one scale: tracks, places, cones of what is not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.scale import linear

Array = npt.NDArray[np.float64]
Entry = tuple[str, str, dict[str, Any]]
LOWEST = 46.0  # px of the view from the side
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
    for one in things:
        if isinstance(one, Marks) and one.text and up == 1:
            _beside(panel, one.points[-1], one.text)
    panel.unclip()
    panel.close()


def _beside(panel: Panel, point: Array, text: str) -> None:
    """Words beside a point, on the side that has room; none where it lies outside."""
    px, py = (float(v) for v in panel.at(point[0], point[1]))
    if not (panel.left < px < panel.right and panel.top < py < panel.bottom):
        return
    leftwards = px > 0.5 * (panel.left + panel.right)
    shift = -9.0 if leftwards else 9.0
    below = py + 12.0 if py < panel.top + 14.0 else py - 5.0
    panel.chart.text(px + shift, below, text, "end" if leftwards else "start", class_="halo")


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
