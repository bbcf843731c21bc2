"""Figures drawn straight as SVG: panels with axes, lines, dots, bars, each mark knowing its value.

A figure is a list of elements in the units of its viewBox; the page's style sheet and font dress it. Lines and dots are
one path each with absolute `M x y` at every point, and a panel says how its pixels map to values (`data-x`, `data-y`):
that is all the script needs to tell the value under the pointer. matplotlib drew these figures before: it cost 0.3 s of
import and 40 ms a figure, and its marks do not know what they stand for.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

from nebosvod.report.download import Download
from nebosvod.report.plate import GREY, INK, Plate
from nebosvod.report.scale import Scale

Array = npt.NDArray[np.float64]
WIDTH = 440.0  # of a figure over the whole column; 10.5 px text then reads at 8.5 px on a phone and 15 px on a laptop
CHARACTER = 6.1  # mean width of a character of axis text, px
MARKERS = {  # after the move to a point: shape, and whether it is filled by its stroke alone
    "o": "h0", "s": "h0", "^": "m0-2.3l2.1 3.9h-4.2z", "D": "m0-2.4l2.4 2.4-2.4 2.4-2.4-2.4z",
    "v": "m0 2.3l2.1-3.9h-4.2z", "P": "m-2.4 0h4.8m-2.4-2.4v4.8",
    "O": "m-2.5 0a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0z", "S": "m-2.2-2.2h4.4v4.4h-4.4z", "|": "m0-5v10",
}  # fmt: skip


class Chart:
    """A figure under construction: panels and texts are added, `plate` closes it."""

    def __init__(self, key: str, width: float = WIDTH, height: float = 260.0) -> None:
        self.key, self.width, self.height = key, width, height
        self.parts: list[str] = []

    def add(self, tag: str, content: str = "", **attributes: Any) -> None:
        """Add one element; underscores in attribute names become hyphens, a trailing one is dropped."""
        self.parts.append(element(tag, content, **attributes))

    def text(self, x: float, y: float, text: str, **attributes: Any) -> None:
        """Add text; `anchor` is start, middle or end."""
        anchor = attributes.pop("anchor", "start")
        more = {} if anchor == "start" else {"text_anchor": anchor}
        self.add("text", str(escape(text)), x=round(x, 1), y=round(y, 1), **more, **attributes)

    def panel(self, x: Scale, y: Scale, *, top: float, bottom: float, left: float | None = None,
              right: float | None = None, title: str = "") -> "Panel":  # fmt: skip
        """Add a panel between heights `top` and `bottom`; its left edge leaves room for the tick texts of y."""
        edge = left if left is not None else (18.0 if y.label else 4.0) + CHARACTER * y.width + 5.0
        return Panel(self, x, y, (edge, top, self.width - 13.0 if right is None else right, bottom), title)

    def legend(self, entries: Sequence[tuple[str, str, dict[str, Any]]], top: float, left: float = 6.0) -> float:
        """Name what is drawn, in as many lines as it takes; returns the height below the last.

        Entries are (kind, text, look): kind "line", "box" or a marker; look as for `Panel.line` and `Panel.dots`.
        """
        x, y = left, top
        for kind, text, look in entries:
            wide = 24.0 + CHARACTER * len(text) + 10.0
            if x > left and x + wide > self.width:
                x, y = left, y + 15.0
            self._swatch(kind, x, y, look)
            self.text(x + 21.0, y + 3.6, text)
            x += wide
        return y + 15.0

    def _swatch(self, kind: str, x: float, y: float, look: dict[str, Any]) -> None:
        """The sample beside a name."""
        if kind == "line":
            self.add("path", d=f"M{x:.1f} {y:.1f}h16", fill="none", **look)
        elif kind == "box":
            self.add("rect", x=round(x + 2, 1), y=round(y - 5, 1), width=12, height=10, **look)
        else:
            self.add("path", d=f"M{x + 8:.1f} {y:.1f}{MARKERS[kind]}", **marker_look(kind, **look))

    def plate(self, label: str, caption: Markup, data: Sequence[Download] = ()) -> Plate:
        """Close the figure: what it shows, what it says, and its numbers."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" role="img" '
            f'aria-label="{escape(label)}">'
        )
        return Plate(
            key=self.key, svg=Markup(head + "\n" + "\n".join(self.parts) + "\n</svg>"), label=label, caption=caption,
            data=tuple(data),
        )  # fmt: skip


class Panel:
    """Axes and what is drawn between them; values are given, pixels are written."""

    def __init__(
        self, chart: Chart, x: Scale, y: Scale, box: tuple[float, float, float, float], title: str = ""
    ) -> None:
        self.chart, self.x, self.y = chart, x, y
        self.left, self.top, self.right, self.bottom = box
        self._axes(title)

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
            "data_xn": x.label, "data_yn": y.label,
        }  # fmt: skip
        start = {"data_origin": x.origin} if x.origin else {}
        self.chart.parts.append(element("g", None, class_="panel", **mapping, **start, **attributes))

    def close(self) -> None:
        """End the group of marks."""
        self.chart.parts.append("</g>")

    def line(self, x: Any, y: Any, name: str = "", **look: Any) -> None:
        """A line through points; undefined ones break it."""
        px, py = self.at(x, y)
        good = np.isfinite(px) & np.isfinite(py)
        parts, pen = [], "M"
        for a, b, ok in zip(px.tolist(), py.tolist(), good.tolist()):
            if ok:
                parts.append(f"{pen}{a:.2f} {b:.2f}")
            pen = "L" if ok else "M"
        self._path("".join(parts), name, fill="none", **look)

    def dots(self, x: Any, y: Any, marker: str = "o", name: str = "", **look: Any) -> None:
        """A marker at each point; `color`, `size` and `hollow` say how."""
        px, py = self.at(x, y)
        good = np.isfinite(px) & np.isfinite(py)
        shape = MARKERS[marker]
        text = "".join(f"M{a:.2f} {b:.2f}{shape}" for a, b in zip(px[good].tolist(), py[good].tolist()))
        self._path(text, name, **marker_look(marker, **look))

    def marks(self, points: Sequence[tuple[float, float]], marker: str, name: str, **look: Any) -> None:
        """A marker at each of some points (x, y)."""
        x, y = np.array(points, dtype=np.float64).reshape(-1, 2).T
        self.dots(x, y, marker, name, **look)

    def band(self, x: Any, low: Any, high: Any, **look: Any) -> None:
        """The area between two lines."""
        px, bottom = self.at(x, low)
        _, top = self.at(x, high)
        points = [*zip(px, top), *zip(px[::-1], bottom[::-1])]
        self.chart.add("path", d="M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in points) + "z", **look)

    def bar(self, x0: float, x1: float, y: float, thick: float, tip: str = "", **look: Any) -> None:
        """A horizontal bar from x0 to x1, `thick` px high about y; `tip` is what a pointer is told."""
        px, py = self.at([x0, x1], [y, y])
        inside = element("title", str(escape(tip))) if tip else ""
        wide = max(float(px[1] - px[0]), 0.0)
        self.chart.add("rect", inside, x=f"{px[0]:.2f}", y=f"{py[0] - thick / 2:.2f}", width=f"{wide:.2f}",
                       height=f"{thick:g}", **look)  # fmt: skip

    def upright(self, x: float, **look: Any) -> None:
        """A vertical line across the panel."""
        px, _ = self.at([x], [self.y.low])
        self.chart.add("path", d=f"M{px[0]:.1f} {self.top:.1f}V{self.bottom:.1f}", fill="none", **look)

    def level(self, y: float, **look: Any) -> None:
        """A horizontal line across the panel."""
        _, py = self.at([self.x.low], [y])
        self.chart.add("path", d=f"M{self.left:.1f} {py[0]:.1f}H{self.right:.1f}", fill="none", **look)

    def _path(self, d: str, name: str, **look: Any) -> None:
        """One path of marks; a named one answers the pointer."""
        if d:
            more = {"class_": "s", "data_n": name} if name else {}
            self.chart.add("path", d=d, **more, **look)

    def _axes(self, title: str) -> None:
        """Grid, ticks, labels."""
        chart, rows = self.chart, not self.y.label
        grid = []
        for value, _ in self.x.ticks:
            grid.append(f"M{self.at([value], [self.y.low])[0][0]:.1f} {self.top:.1f}V{self.bottom:.1f}")
        for value, _ in self.y.ticks:
            grid.append(f"M{self.left:.1f} {self.at([self.x.low], [value])[1][0]:.1f}H{self.right:.1f}")
        chart.parts.append('<g class="axes">')
        chart.add("path", d="".join(grid), class_="grid")
        chart.add("path", d=f"M{self.left:.1f} {self.top:.1f}V{self.bottom:.1f}H{self.right:.1f}", class_="frame")
        for value, text in () if self.x.silent else self.x.ticks:
            chart.text(self.at([value], [self.y.low])[0][0], self.bottom + 12.5, text, anchor="middle")
        for value, text in () if self.y.silent else self.y.ticks:
            chart.text(self.left - 4.0, self.at([self.x.low], [value])[1][0] + 3.6, text, anchor="end",
                       **({"class_": "row"} if rows else {}))  # fmt: skip
        chart.parts.append("</g>")
        if self.x.label and not self.x.silent:
            chart.text((self.left + self.right) / 2, self.bottom + 27.0, self.x.label, anchor="middle", class_="name")
        if self.y.label and not self.y.silent:
            middle = (self.top + self.bottom) / 2
            place = f"rotate(-90 11 {middle:.1f})"
            chart.text(11.0, middle, self.y.label, anchor="middle", class_="name", transform=place)
        if title:
            chart.text(self.left, self.top - 5.0, title, class_="name")


def marker_look(marker: str, color: str = INK, size: float = 3.0, hollow: bool = False, **more: Any) -> dict[str, Any]:
    """Attributes of a path of markers; small round and square ones (o, s) are the caps of lines without length."""
    if marker in "os":
        cap = "round" if marker == "o" else "square"
        wide = size if marker == "o" else 0.88 * size
        return {"stroke": color, "stroke_width": round(wide, 2), "stroke_linecap": cap, "fill": "none", **more}
    hollow = hollow or marker in "OS"
    if marker in "P|":
        return {"stroke": color, "stroke_width": 1.6, "fill": "none", **more}
    if hollow:
        return {"stroke": color, "stroke_width": 1.3, "fill": "var(--paper)", **more}
    return {"fill": color, "stroke": color, "stroke_width": max(0.3, round(0.3 * size - 0.6, 2)), **more}


def element(tag: str, content: str | None = "", **attributes: Any) -> str:
    """One element as text, attribute values escaped; `content` None leaves it open, "" closes it at once."""
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value != ""
    )
    if content is None:
        return f"<{tag}{written}>"
    return f"<{tag}{written}/>" if content == "" else f"<{tag}{written}>{content}</{tag}>"


def band_grey() -> dict[str, Any]:
    """The look of a grey band behind marks."""
    return {"fill": GREY, "fill_opacity": 0.22}
