"""A figure of a page as a figure of matplotlib that stands by itself: its panels are Axes, its marks hold values.

The page and this draw the same parts of one `Chart`, so that a figure has one maker and cannot say two things.
"""

import io
from datetime import datetime
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Transform

from nebosvod.report.kit.chart import Chart, Panel, Piece, Words
from nebosvod.report.kit.plate import GREY, Plate
from nebosvod.report.kit.scale import Scale

Array = npt.NDArray[np.float64]
TEXT, DPI = (
    9.0,
    110.0,
)  # points, where the page has 10.5 px: matplotlib's letters are wider; dots per inch in a notebook
LETTER, SMALLEST = 0.55, 6.5  # mean width of a letter, in its size; points
ROOM = 10.0  # px at the right edge, for the last tick text
PICTURE: dict[Any, Any] = {"svg.fonttype": "none", "hatch.color": "#ffffff", "hatch.linewidth": 0.9}
# units of a page that matplotlib's letters lack, or write too wide
PLAIN = str.maketrans({"\N{NARROW NO-BREAK SPACE}": " ", "\N{NO-BREAK SPACE}": " "})


class PageFigure(Figure):
    """A figure of matplotlib that a notebook shows without pyplot.

    `label` says what is seen, `caption` what it says.
    """

    label: str = ""
    caption: str = ""

    def png(self, dpi: float = DPI) -> bytes:
        """The picture as PNG."""
        data = io.BytesIO()
        with rc_context(PICTURE):
            self.savefig(data, format="png", dpi=dpi)
        return data.getvalue()

    def _repr_png_(self) -> bytes:
        return self.png()


def figure_of(plate: Plate) -> PageFigure:
    """The figure of a plate, each panel as Axes with its own limits, ticks and labels.

    Raises
    ------
    ValueError
        If the plate was not drawn as a chart.
    """
    chart = plate.chart
    if chart is None:
        raise ValueError(f"{plate.key} was not drawn as a chart")
    figure = PageFigure(figsize=((chart.width + ROOM) / 72.0, chart.height / 72.0), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    figure.label, figure.caption = plate.label, plate.caption.striptags()
    axes = [_axes(figure, chart, panel) for panel in chart.panels]
    pixels = Affine2D().scale(1.0, -1.0).translate(0.0, chart.height).scale(1.0 / 72.0) + figure.dpi_scale_trans
    frames = {k for panel in chart.panels for k in panel.frame}
    for k, part in enumerate(chart.parts):
        if not isinstance(part, str) and k not in frames:
            owner = _owner(chart, part)
            where = axes[owner] if owner is not None else None
            panel = chart.panels[owner] if owner is not None else None
            _place(figure, where, panel, part, pixels)
    return figure


def _axes(figure: Figure, chart: Chart, panel: Panel) -> Axes:
    """The Axes of a panel, at its place."""
    wide, high = panel.right - panel.left, panel.bottom - panel.top
    width = chart.width + ROOM
    box = (panel.left / width, 1.0 - panel.bottom / chart.height, wide / width, high / chart.height)
    axes = figure.add_axes(box)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(color=GREY, linewidth=0.8)
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TEXT, length=0.0, pad=4.0)
    _scaled(axes, "x", panel.x, wide)
    _scaled(axes, "y", panel.y, high)
    if panel.title:
        axes.set_title(panel.title, loc="left", fontsize=TEXT, pad=3.0)
    return axes


def _scaled(axes: Axes, which: Literal["x", "y"], scale: Scale, room: float) -> None:
    """Limits, ticks and label of one axis; a label longer than its axis is written smaller, and covers no tick."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axes.set(**{f"{which}scale": "log" if scale.kind == "log" else "linear"})
    axes.set(**{f"{which}lim": (value_of(scale, scale.low), value_of(scale, scale.high))})
    axes.tick_params(axis="both", which="minor", length=0.0)
    axis.set_ticks([value_of(scale, value) for value, _ in scale.ticks], [t.translate(PLAIN) for _, t in scale.ticks])
    axis.set_minor_formatter("")
    if scale.silent:
        axes.tick_params(axis=which, labelbottom=False, labelleft=False)
    elif scale.label:
        size = min(TEXT, room / (LETTER * len(scale.label)))
        axis.set_label_text(scale.label.translate(PLAIN), fontsize=max(SMALLEST, size))


def value_of(scale: Scale, value: Any) -> Any:
    """Values of a scale as those of an axis of matplotlib: dates count from its epoch."""
    if scale.kind != "time":
        return value
    start: float = date2num(datetime.fromisoformat(scale.origin))  # type: ignore[no-untyped-call]
    return value + start


def _values(scale: Scale, part: Array) -> Array:
    """What lies at parts of a scale, 0 at its low end and 1 at its high end."""
    if scale.kind == "log":
        return np.asarray(scale.low * (scale.high / scale.low) ** part)
    return np.asarray(value_of(scale, scale.low + (scale.high - scale.low) * part))


def _at(panel: Panel, points: Array) -> Array:
    """Pixels (n, 2), counted down from the top of the sheet, as values of a panel."""
    across = (points[:, 0] - panel.left) / (panel.right - panel.left)
    up = (panel.bottom - points[:, 1]) / (panel.bottom - panel.top)
    return np.stack([_values(panel.x, across), _values(panel.y, up)], axis=1)


def _pixels(part: Words | Piece) -> Array:
    """Where a part lies, pixels (n, 2)."""
    if isinstance(part, Words):
        return np.array([[part.x, part.y]])
    return np.asarray(_path(part.alone()).vertices, dtype=np.float64)


def _path(artist: Artist) -> Path:
    """The path of a line or patch in pixels from the top."""
    if isinstance(artist, Line2D):
        return Path(np.stack([artist.get_xdata(orig=True), artist.get_ydata(orig=True)], axis=1).astype(np.float64))
    if isinstance(artist, Patch):
        return artist.get_path()
    raise ValueError(f"a {type(artist).__name__} is no part of a chart")


def _owner(chart: Chart, part: Words | Piece) -> int | None:
    """The panel a part lies in, the one it covers most of; None for what stands beside all."""
    points = _pixels(part)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    best, most = None, -1.0
    for k, panel in enumerate(chart.panels):
        width = min(high[0], panel.right) - max(low[0], panel.left)
        height = min(high[1], panel.bottom) - max(low[1], panel.top)
        if width >= -1.0 and height >= -1.0 and (size := max(width, 0.5) * max(height, 0.5)) > most:
            best, most = k, size
    return best


def _place(figure: Figure, axes: Axes | None, panel: Panel | None, part: Words | Piece, pixels: Transform) -> None:
    """Put a part on its Axes by values, or on the figure by pixels."""
    points = _pixels(part)
    transform: Transform = pixels
    if axes is not None and panel is not None:
        points, transform = _at(panel, points), axes.transData
    if isinstance(part, Words):
        look: dict[str, Any] = {"fontsize": TEXT, "ha": {"middle": "center", "end": "right"}.get(part.anchor, "left"),
                                "va": "baseline", "rotation": 90 if part.turned else 0}  # fmt: skip
        x, y = points[0].tolist()
        text = (axes or figure).text(x, y, part.words.translate(PLAIN), transform=transform, **look)
        text.set_clip_on(False)
        return
    artist = _alike(part.alone(), points)
    artist.set_transform(transform)
    artist.set_zorder(2.0)  # in the order of drawing
    if axes is None:
        figure.add_artist(artist)
    else:
        axes.add_artist(artist)
    artist.set_clip_on(axes is not None and part.view is not None)


def _alike(drawn: Artist, points: Array) -> Artist:
    """A line or patch of the same look at other points."""
    if isinstance(drawn, Line2D):
        line = Line2D(*points.T)
        line.update_from(drawn)
        return line
    patch = PathPatch(Path(points, _path(drawn).codes))
    patch.update_from(drawn)
    return patch
