"""Figures of the pages: panels with axes, lines, dots and bars, drawn by matplotlib, put together for the page.

A figure is a list of pieces in the order of drawing. Axes and marks stand in groups that the page's script knows: a
panel says how its pixels map to values (`data-x`, `data-y`), a mark its name (`data-n`). That is all the script needs
to tell the value under the pointer. Units are pixels of the figure's viewBox, from the top left.

Panels are not matplotlib's Axes: with one mapping from values to pixels (`Scale`) the script cannot disagree with the
drawing, and a report takes a third of the time. Texts are set by the page, in its own font. `standing.figure_of` gives
the same as a figure of matplotlib with Axes.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, IdentityTransform, Transform

from nebosvod.report.kit.download import Download
from nebosvod.report.kit.drawing import pieces
from nebosvod.report.kit.gathered import gather_plate
from nebosvod.report.kit.hatch import plain
from nebosvod.report.kit.plate import GREY, INK, Plate
from nebosvod.report.kit.scale import TICK_CHARACTER, Scale
from nebosvod.report.kit.short import width_px
from nebosvod.report.kit.typography import words

Array = npt.NDArray[np.float64]
WIDTH = 440.0  # of a figure beside its caption; on a phone it keeps a size that can be read, and scrolls
WIDE = 760.0  # of a figure over the whole page, which is drawn anew for a phone: see `fitted`
NARROW = 358.0  # of a figure that may stand beside another; its texts read at 10 px or more on a phone of 390
SHEET = 1200.0  # height on which is drawn: the legend, which comes last, tells how much of it the figure takes
GRID = "#e4e4e4"
Box = tuple[float, float, float, float]  # left, top, width, height, px
Make = Callable[[Transform], Artist]  # an artist for where pixels are
CHARACTER = TICK_CHARACTER  # mean width of a character of axis text, px
PIXELS = Affine2D([[1.0, 0.0, 0.0], [0.0, -1.0, SHEET], [0.0, 0.0, 1.0]])  # matplotlib counts from the lower left
MARKERS: Mapping[str, tuple[str, float]] = {  # shape, and its size in px for marks of size 3
    "o": ("o", 3.0), "s": ("s", 2.6), "^": ("^", 4.2), "v": ("v", 4.2), "D": ("D", 3.4), "P": ("+", 5.0),
    "|": ("|", 10.0), "O": ("o", 5.0), "S": ("s", 4.4), "x": ("x", 3.4), "X": ("X", 6.0),
}  # fmt: skip
# many small dots are lines hardly longer than their caps: half as heavy, and they keep their size when enlarged; not
# quite without length, since a square cap of a line without direction is left out by PDF readers (Poppler)
CAPS = {"o": "round", "s": "projecting"}
NAME_GAP, NAME_LEAST = 5.0, 9.0  # px between the name of an axis and its ticks, and from the edge of a figure
DASH = 0.02  # px
LINE_NAMES = {"stroke": "color", "stroke_width": "linewidth", "opacity": "alpha"}
AREA_NAMES = {"stroke": "edgecolor", "stroke_width": "linewidth", "opacity": "alpha"}


class Chart:
    """A figure under construction: panels and texts are added, `plate` closes it."""

    def __init__(self, key: str, width: float = WIDTH, height: float = 260.0) -> None:
        self.key, self.width, self.height = key, width, height
        self.parts: list[str | Words | Piece] = []
        self.panels: list[Panel] = []
        self.view: Box | None = None  # beyond which nothing is drawn

    def raw(self, text: str) -> None:
        """Add markup between the pieces, such as the beginning and end of a group."""
        self.parts.append(text)

    def text(self, x: float, y: float, text: str, anchor: str = "start", turned: bool = False, **more: Any) -> None:
        """Add text with its base line at y; `anchor` is start, middle or end of it."""
        self.parts.append(Words(x, y, words(text), anchor, turned, more))

    def stroke(self, x: Any, y: Any, look: Mapping[str, Any], **more: Any) -> None:
        """Add a line or markers at pixels."""
        self._draw(lambda pixels: Line2D(x, y, transform=pixels, **look), "", None, **more)

    def markers(self, x: Array, y: Array, marker: str, look: Mapping[str, Any], **more: Any) -> None:
        """Add markers at pixels; see `CAPS`."""
        if marker not in CAPS or look.get("hollow"):
            self.stroke(x, y, marker_look(marker, **look), **more)
            return
        gap = np.full(len(x), np.nan)
        along, across = np.stack([x, x + DASH, gap], axis=1).ravel(), np.stack([y, y, gap], axis=1).ravel()
        short = marker_look(marker, **look)
        spots = {"linestyle": "none", "marker": marker, "markersize": short["linewidth"], "markeredgewidth": 0.0,
                 "color": short["color"], "alpha": short["alpha"]}  # fmt: skip
        self._draw(
            lambda pixels: Line2D(along, across, transform=pixels, **short), "",
            lambda pixels: Line2D(x, y, transform=pixels, **spots), **more,
        )  # fmt: skip

    def area(self, x: Any, y: Any, *, tip: str = "", **look: Any) -> None:
        """Add a filled outline at pixels; `fill` may be a pattern of the page, `fill_opacity` its opacity."""
        fill, opacity = str(look.pop("fill", INK)), look.pop("fill_opacity", look.pop("fill-opacity", None))
        color, corners, edge = plain(fill)[0], np.stack([x, y], axis=1), area_look(**look)
        more = {"fill": fill} if fill.startswith("url") else {}
        more |= {} if opacity is None else {"fill-opacity": opacity}
        self._draw(lambda pixels: Polygon(corners, transform=pixels, facecolor=color, **edge), tip, None, **more)

    def region(self, outlines: Sequence[Array], *, fill: str, fill_opacity: float, **look: Any) -> None:
        """Add an area of several outlines (n, 2) at pixels; one that goes the other way round is a hole."""
        whole = Path.make_compound_path(*(Path(np.vstack([one, one[:1]]), closed=True) for one in outlines))
        edge = area_look(**look)
        opacity = {"fill-opacity": fill_opacity}
        self._draw(lambda pixels: PathPatch(whole, transform=pixels, facecolor=fill, **edge), "", None, **opacity)

    def box(self, x: float, y: float, width: float, height: float, *, tip: str = "", **look: Any) -> None:
        """Add a rectangle with its upper left corner at (x, y)."""
        self.area([x, x + width, x + width, x], [y, y, y + height, y + height], tip=tip, **look)

    def _draw(self, make: Make, tip: str = "", spots: Make | None = None, **attributes: Any) -> None:
        """Add an artist, made for where pixels are; `attributes` are set on its elements, `tip` is told there."""
        self.parts.append(Piece(f"nb-{len(self.parts)}", make, tip, attributes, self.view, spots))

    def panel(self, x: Scale, y: Scale, *, top: float, bottom: float, left: float | None = None,
              right: float | None = None, title: str = "", name_at: float = 11.0) -> "Panel":  # fmt: skip
        """Add a panel between heights `top` and `bottom`; its left edge leaves room for the tick texts of y.

        `name_at` is where the name of y stands.
        """
        edge = left if left is not None else (18.0 if y.label else 4.0) + CHARACTER * y.width + 5.0
        box = (edge, top, self.width - 13.0 if right is None else right, bottom)
        return Panel(self, x, y, box, title, name_at)

    def legend(self, entries: Sequence[tuple[str, str, dict[str, Any]]], top: float, left: float = 6.0) -> float:
        """Name what is drawn, in as many lines as it takes; returns the height below the last.

        Entries are (kind, text, look): kind "line", "box" or a marker; look as for `Panel.line` and `Panel.dots`.
        """
        x, y = left, top
        for kind, text, look in entries:
            wide = 24.0 + CHARACTER * len(text) + 10.0
            if x > left and x + wide > self.width:
                x, y = left, y + 15.0
            if kind == "box":
                self.box(x + 2.0, y - 5.0, 12.0, 10.0, **look)
            elif kind == "line":
                self.stroke([x, x + 16.0], [y, y], line_look(**look))
            else:
                self.markers(np.array([x + 8.0]), np.array([y]), kind, look)
            self.text(x + 21.0, y + 3.6, text)
            x += wide
        return y + 15.0

    def plate(self, label: str, caption: Markup, data: Sequence[Download] = ()) -> Plate:
        """Close the figure: what it shows, what it says, and its numbers."""
        svg = self.svg(label)
        return gather_plate(Plate(key=self.key, svg=svg, label=label, caption=caption, data=tuple(data), chart=self))

    def svg(self, label: str) -> Markup:
        """The figure as it stands in a page; `label` says what it shows."""
        sheet = Figure(figsize=(self.width / 72.0, SHEET / 72.0), dpi=72.0)
        for part in self.parts:
            if isinstance(part, Piece):
                sheet.add_artist(part.artist(PIXELS))
        drawn = pieces(sheet, f"{self.key}-")
        body = [part if isinstance(part, str) else part.text(drawn) for part in self.parts]
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" role="img" '
            f'style="--w:{self.width:g};--h:{self.height:g}" aria-label="{escape(label)}">'
        )
        return Markup(head + "\n" + "\n".join(one for one in body if one) + "\n</svg>")


@dataclass(frozen=True, slots=True, eq=False)
class Words:
    """Text of a figure; `more` are attributes of its element."""

    x: float
    y: float
    words: str
    anchor: str
    turned: bool
    more: Mapping[str, Any]

    def text(self, _: Mapping[str, list[str]]) -> str:
        """The element."""
        place: dict[str, Any] = {"x": f"{self.x:.1f}", "y": f"{self.y:.1f}"}
        if self.turned:
            place["transform"] = f"rotate(-90 {self.x:.1f} {self.y:.1f})"
        if self.anchor != "start":
            place["text-anchor"] = self.anchor
        return f"{opened('text', {**place, **self.more})}{escape(self.words)}</text>"


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """The place of an artist among the parts of a figure, and what is added to it for the page."""

    name: str
    make: Make
    tip: str
    attributes: Mapping[str, Any]
    view: Box | None
    spots: Make | None = None  # what matplotlib draws instead, where that is another thing

    def artist(self, pixels: Transform) -> Artist:
        """The artist, whole: a page cuts it where its group is cut."""
        made = self.make(pixels)
        made.set_gid(self.name)
        made.set_clip_on(False)
        return made

    def alone(self) -> Artist:
        """The artist at pixels from the top, as a figure of matplotlib holds it: patterns and opacity of its own."""
        made = (self.spots or self.make)(IdentityTransform())
        opacity, fill = self.attributes.get("fill-opacity"), self.attributes.get("fill")
        if isinstance(made, Patch):
            red, green, blue, _ = to_rgba(plain(fill)[0] if fill else made.get_facecolor())
            made.set_facecolor((red, green, blue, 1.0 if opacity is None else float(opacity)))
            if fill and plain(fill)[1]:
                made.set_hatch(plain(fill)[1])
                made.set_edgecolor("#ffffff")
        return made

    def text(self, drawn: Mapping[str, list[str]]) -> str:
        """The elements of the artist, in a group where they are marks or tell something."""
        own = "".join(drawn.get(self.name, []))
        for key, value in self.attributes.items():
            if key in ("fill", "fill-opacity"):
                own = re.sub(rf' {key}="[^"]*"', "", own).replace("<path", f'<path {key}="{escape(value)}"', 1)
        named = {key: value for key, value in self.attributes.items() if key not in ("fill", "fill-opacity") and value}
        if not own or not (named or self.tip):
            return own
        tag = own[1:].partition(" ")[0]
        if not self.tip and own.count("<") - own.count("</") == 1:  # one element: no group around it
            return opened(tag, named)[:-1] + own[1 + len(tag) :]
        inside = f"<title>{escape(self.tip)}</title>{own}" if self.tip else own
        return f"{opened('g', named)}{inside}</g>"


class Panel:
    """Axes and what is drawn between them; values are given, pixels are drawn."""

    def __init__(
        self, chart: Chart, x: Scale, y: Scale, box: tuple[float, float, float, float], title: str = "",
        name_at: float = 11.0,
    ) -> None:  # fmt: skip
        self.chart, self.x, self.y, self.name_at = chart, x, y, name_at
        self.left, self.top, self.right, self.bottom = box
        self.title, first = title, len(chart.parts)
        self._ticks()
        self._names(title)
        self.frame = range(first, len(chart.parts))  # its axes among the parts of the figure
        chart.panels.append(self)

    def at(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Pixels of values."""
        across = self.left + (self.right - self.left) * self.x.part(np.asarray(x, dtype=np.float64))
        up = self.bottom - (self.bottom - self.top) * self.y.part(np.asarray(y, dtype=np.float64))
        return across, up

    def open(self, **attributes: Any) -> None:
        """Begin the group of marks that the script reads; `close` ends it."""
        x, y = self.x, self.y
        mapping = {
            "data_x": f"{x.kind} {self.left:.2f} {self.right:.2f} {x.low!r} {x.high!r}",
            "data_y": f"{y.kind} {self.bottom:.2f} {self.top:.2f} {y.low!r} {y.high!r}",
            "data_xn": x.label, "data_yn": y.label, "data_origin": x.origin,
        }  # fmt: skip
        self.chart.raw(opened("g", {"class": "panel", **mapping, **attributes}))

    def close(self) -> None:
        """End the group of marks."""
        self.chart.raw("</g>")

    def clip(self) -> None:
        """Begin a view that cuts what is drawn at the edges of the panel; `unclip` ends it."""
        self.chart.view = (self.left, self.top, self.right - self.left, self.bottom - self.top)
        box = f"{self.left:g} {self.top:g} {self.right - self.left:g} {self.bottom - self.top:g}"
        x, y, width, height = box.split(" ")
        self.chart.raw(f'<svg x="{x}" y="{y}" width="{width}" height="{height}" viewBox="{box}">')

    def unclip(self) -> None:
        """End the view."""
        self.chart.view = None
        self.chart.raw("</svg>")

    def line(self, x: Any, y: Any, name: str = "", **look: Any) -> None:
        """A line through points; undefined ones break it. A named one answers the pointer."""
        self.chart.stroke(*self.at(x, y), line_look(**look), **_mark(name))

    def outline(self, x: Any, y: Any, **look: Any) -> None:
        """A closed line, filled."""
        self.chart.area(*self.at(x, y), **look)

    def dots(self, x: Any, y: Any, marker: str = "o", name: str = "", **look: Any) -> None:
        """A marker at each point; `color`, `size` and `hollow` say how."""
        px, py = np.broadcast_arrays(*self.at(x, y))
        self.chart.markers(px, py, marker, look, **_mark(name))

    def marks(self, points: Sequence[tuple[float, float]], marker: str, name: str, **look: Any) -> None:
        """A marker at each of some points (x, y)."""
        x, y = np.array(points, dtype=np.float64).reshape(-1, 2).T
        self.dots(x, y, marker, name, **look)

    def sticks(self, x: Array, y: float, reach: float, name: str, **look: Any) -> None:
        """An upright stroke at each x, from y as many px up (or, below zero, down) as `reach` says."""
        px, py = self.at(x, np.full(len(x), y))
        across = np.stack([px, px, np.full(len(px), np.nan)], axis=1).ravel()
        up = np.stack([py, py - reach, np.full(len(px), np.nan)], axis=1).ravel()
        self.chart.stroke(across, up, line_look(**look), **_mark(name))

    def band(self, x: Any, low: Any, high: Any, **look: Any) -> None:
        """The area between two lines."""
        px, bottom = self.at(x, low)
        _, top = self.at(x, high)
        self.chart.area(np.concatenate([px, px[::-1]]), np.concatenate([top, bottom[::-1]]), **look)

    def bar(self, x0: float, x1: float, y: float, thick: float, tip: str = "", **look: Any) -> None:
        """A horizontal bar from x0 to x1, `thick` px high about y; `tip` is what a pointer is told."""
        px, py = self.at([x0, x1], [y, y])
        wide = max(float(px[1] - px[0]), 0.0)
        self.chart.box(float(px[0]), float(py[0]) - thick / 2.0, wide, thick, tip=tip, **look)

    def upright(self, x: float, **look: Any) -> None:
        """A vertical line across the panel."""
        self.line([x, x], [self.y.low, self.y.high], **look)

    def level(self, y: float, **look: Any) -> None:
        """A horizontal line across the panel."""
        self.line([self.x.low, self.x.high], [y, y], **look)

    def _ticks(self) -> None:
        """Grid, frame and tick texts, in the group that the script draws anew when an ellipse is enlarged."""
        chart, gap = self.chart, [np.nan]
        chart.raw('<g class="axes">')
        across = [self.at([value], [self.y.low])[0] for value, _ in self.x.ticks]
        up = [self.at([self.x.low], [value])[1] for value, _ in self.y.ticks]
        grid_x = [[*px, *px, *gap] for px in across] + [[self.left, self.right, *gap] for _ in up]
        grid_y = [[self.top, self.bottom, *gap] for _ in across] + [[*py, *py, *gap] for py in up]
        if grid_x:
            look = line_look(stroke=GRID, stroke_width=0.6)
            chart.stroke(np.concatenate(grid_x), np.concatenate(grid_y), look, **{"class": "grid"})
        corner = ([self.left, self.left, self.right], [self.top, self.bottom, self.bottom])
        chart.stroke(*corner, line_look(stroke=GREY, stroke_width=0.8), **{"class": "frame"})
        for (_, text), px in () if self.x.silent else zip(self.x.ticks, across):
            chart.text(float(px[0]), self.bottom + 12.5, text, "middle")
        rows: dict[str, Any] = {} if self.y.label else {"class": "row"}
        for (_, text), py in () if self.y.silent else zip(self.y.ticks, up):
            chart.text(self.left - 4.0, float(py[0]) + 3.6, text, "end", **rows)
        chart.raw("</g>")

    def _names(self, title: str) -> None:
        """Labels of the axes with their units, and the title."""
        if self.x.label and not self.x.silent:
            self.chart.text((self.left + self.right) / 2.0, self.bottom + 27.0, self.x.label, "middle")
        if self.y.label and not self.y.silent:
            ticks = max((width_px(text, 10.5) for _, text in self.y.ticks), default=0.0)
            at = max(min(self.name_at, self.left - 4.0 - ticks - NAME_GAP), NAME_LEAST)
            self.chart.text(at, (self.top + self.bottom) / 2.0, self.y.label, "middle", turned=True)
        if title:
            self.chart.text(self.left, self.top - 5.0, title)


def fitted(draw: Callable[[float], Chart], label: str, caption: Markup, data: Sequence[Download] = ()) -> Plate:
    """A figure over the whole page, and the same anew for a phone; `draw` makes it for a width in px."""
    plate = draw(WIDE).plate(label, caption, data)
    small = draw(NARROW)
    small.key += "-small"
    return replace(plate, narrow=small.svg(label))


def line_look(**look: Any) -> dict[str, Any]:
    """A look (stroke, stroke_width, stroke_dasharray, opacity) in matplotlib's words, for lines."""
    dashes, wide = str(look.pop("stroke_dasharray", "")), float(look.get("stroke_width", 1.5))
    style = (0.0, tuple(float(one) / wide for one in dashes.split())) if dashes else "-"  # it counts in line widths
    named = {LINE_NAMES[key]: value for key, value in look.items()}
    return {"linestyle": style, "solid_capstyle": "butt", "solid_joinstyle": "round", "marker": "", **named}


def area_look(**look: Any) -> dict[str, Any]:
    """The same for the line around an area."""
    return {"linewidth": 0.0} | {AREA_NAMES[key]: value for key, value in look.items()}


def marker_look(
    marker: str, color: str = INK, size: float = 3.0, hollow: bool = False, opacity: float | None = None
) -> dict[str, Any]:
    """The look of markers in matplotlib's words."""
    shape, base = MARKERS[marker]
    if marker in CAPS and not hollow:
        wide = base * size / 3.0
        return {"linestyle": "-", "color": color, "linewidth": wide, "solid_capstyle": CAPS[marker], "alpha": opacity}
    hollow = hollow or marker in "OS"
    edge = 1.6 if marker in "P|" else 0.9 if marker == "x" else 1.3 if hollow else 0.0
    wide = base if hollow or marker in "P|" else base * size / 3.0
    return {
        "linestyle": "none", "marker": shape, "markersize": wide, "markeredgewidth": edge, "markeredgecolor": color,
        "markerfacecolor": "#ffffff" if hollow else color, "alpha": opacity,
    }  # fmt: skip


def opened(tag: str, attributes: Mapping[str, Any]) -> str:
    """The beginning of an element; underscores in names become hyphens, a last one goes, empty values are left out."""
    said = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value != ""
    )
    return f"<{tag}{said}>"


def band_grey() -> dict[str, Any]:
    """The look of a grey band behind marks."""
    return {"fill": GREY, "fill_opacity": 0.22}


def _mark(name: str) -> dict[str, str]:
    """What makes a piece a mark that the script finds."""
    return {"class": "s", "data-n": name} if name else {}
