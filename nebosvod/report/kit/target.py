"""The target plane of an encounter at one scale: the disc of the body, what it captures, ellipses, drawn orbits.

Where the ellipse is far larger or smaller than the body, a second picture shows what the first cannot: the surroundings
of the body, or those of the ellipse; a frame in the first says where it lies.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.report.kit.chart import CHARACTER, NARROW, WIDE, Chart, Panel, fitted
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.edge import at_edge, off_axes
from nebosvod.report.kit.outline import ANGLES, outline
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, VERMILION, Plate, thin
from nebosvod.report.kit.scale import Scale, linear, round_step, tick_text
from nebosvod.report.kit.wording import count
from nebosvod.results.ahead_words import CALLED

Array = npt.NDArray[np.float64]
Box = tuple[float, float, float, float]  # low and high of x, low and high of y, km
LEFT, RIGHT, TALLEST = 62.0, 13.0, 380.0  # px
FAR = 6.0  # an ellipse (3 sigma) so many times larger or smaller than the disc needs a second figure
FEW = 20  # drawn orbits off a picture that are shown at its edge; more of them are counted in words alone
FEWEST_PX = 2.0  # a capture circle smaller than this is a dot
DISC, RING = "#cfd8e3", "#4a5a6a"
LEVELS = (1.0, 3.0)
# fate of a drawn orbit -> marker, colour, words; each has a shape of its own
FATES: Mapping[str, tuple[str, str, str]] = {
    "hit": ("o", VERMILION, "drawn, hits"),
    "miss": ("x", BLUE, "drawn, misses"),
    "graze": ("^", ORANGE, "drawn, below 100 km and away"),
    "other": ("D", PURPLE, "drawn, hits another body"),
    "unknown": ("s", GREY, "drawn"),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetView:
    """What is shown in a target plane; all coordinates (xi, zeta) in km from the centre of the body.

    Attributes
    ----------
    body : its name; radius_km of its disc, capture_km of the circle within which orbits of this speed hit it.
    centre, covariance : (2,) and (2, 2) of the ellipse; None where there is none.
    formal : (2, 2), drawn dashed; None.
    points, fates : (n, 2) drawn orbits, and (n,) keys of `FATES`.
    line : (m, 2) along the line of variations; None.
    names : of the two axes.
    """

    body: str
    radius_km: float
    capture_km: float
    centre: Array | None
    covariance: Array | None
    formal: Array | None = None
    points: Array
    fates: npt.NDArray[np.str_]
    line: Array | None = None
    names: tuple[str, str] = ("ξ", "ζ")


def target_plates(key: str, view: TargetView, label: str, caption: Markup) -> list[Plate]:
    """The figure of a target plane: the whole of it, and beside it what is too small there."""
    whole = _whole(view)
    near = _part(view, whole)
    hidden = _outside(view, whole)
    told = caption if not hidden else caption + Markup(" {} outside the picture.").format(count(hidden, "drawn orbit"))
    if near is None:
        return [target_chart(key, view, NARROW).plate(label, told, _data(key, view))]
    told += Markup(" The second picture shows the frame in the first, {}, enlarged.").format(near[1])
    return [fitted(lambda width: target_chart(key, view, width), label, told, _data(key, view))]


def target_chart(key: str, view: TargetView, width: float = WIDE) -> Chart:
    """Draw a target plane, each picture with one scale for both axes.

    Parameters
    ----------
    width : px; from 600 on the enlarged picture stands beside the whole, else below it.
    """
    whole = _whole(view)
    near = _part(view, whole)
    chart = Chart(key, width=width, height=0.0)
    beside = near is not None and width > 600.0
    side = (width / 2.0 if beside else width) - LEFT - RIGHT
    first, below = _picture(chart, view, whole, None if near is None else near[0], (0.0, 8.0, side))
    shown = {text: (kind, text, look) for kind, text, look in first}
    if near is not None:
        corner = (width / 2.0, 8.0) if beside else (0.0, below + 12.0)
        more, end = _picture(chart, view, near[0], None, (*corner, side))
        shown |= {text: (kind, text, look) for kind, text, look in more}
        below = max(below, end)
    chart.height = chart.legend([*shown.values()], below + 10.0, 4.0) - 4.0
    return chart


def _extent(view: TargetView) -> Array | None:
    """Corners (2, 2) of the 3 sigma ellipse or, without one, of the middle 98 % of the drawn orbits; None."""
    if view.centre is not None and view.covariance is not None:
        reach = 3.0 * np.sqrt(np.maximum(np.diag(view.covariance), 0.0))
        return np.stack([view.centre - reach, view.centre + reach])
    points = view.points if len(view.points) else view.line
    if points is None or not len(points):
        return None
    return np.asarray(np.percentile(points, [1.0, 99.0], axis=0))


def _whole(view: TargetView) -> Box:
    """The disc and what is shown beside it, with room."""
    r = 1.15 * view.capture_km
    corners = [np.array([[-r, -r], [r, r]])]
    found = _extent(view)
    if found is not None:
        corners.append(found)
        if len(view.points):  # of a bent cloud the ellipse is not all
            corners.append(np.percentile(view.points, [2.0, 98.0], axis=0))
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    return _framed(low, high)


def _framed(low: Array, high: Array) -> Box:
    """A box about corners with room, not more than three times as long as wide."""
    middle, half = 0.5 * (low + high), 0.54 * (high - low)
    half = np.maximum(half, half.max() / 3.0)
    return (
        float(middle[0] - half[0]), float(middle[0] + half[0]), float(middle[1] - half[1]), float(middle[1] + half[1]),
    )  # fmt: skip


def _part(view: TargetView, whole: Box) -> tuple[Box, str] | None:
    """What the whole picture shows too small, and in words what it is; None."""
    found = _extent(view)
    if found is None:
        return None
    size, width = float((found[1] - found[0]).max()), max(whole[1] - whole[0], whole[3] - whole[2])
    r = 1.3 * view.capture_km
    if size > FAR * 2.0 * view.capture_km:
        return (-r, r, -r, r), f"near {_the(view.body)}"
    if 0.0 < size < width / FAR:
        return _framed(*found), "about the ellipse" if view.covariance is not None else "about the drawn orbits"
    return None


def _the(body: str) -> str:
    return CALLED.get(body, body.capitalize())


def _outside(view: TargetView, box: Box) -> int:
    """How many drawn orbits a box does not hold."""
    if not len(view.points):
        return 0
    x, y = view.points.T
    return int(np.count_nonzero((x < box[0]) | (x > box[1]) | (y < box[2]) | (y > box[3])))


def _picture(
    chart: Chart, view: TargetView, box: Box, frame: Box | None, corner: tuple[float, float, float]
) -> tuple[list["Entry"], float]:
    """One picture with its upper left corner at (x, y), as wide as there is room; what it shows, and where it ends."""
    width, height = box[1] - box[0], box[3] - box[2]
    factor, unit = (1e-3, "10³ km") if width > 3e5 else (1.0, "km") if width > 3.0 else (1e3, "m")
    y = linear([factor * box[2], factor * box[3]], f"{view.names[1]}, {unit}", pad=0.0)
    across, top, side = corner
    edge = max(LEFT, 23.0 + CHARACTER * y.width)
    room = side + LEFT - edge
    scale = min(room / width, TALLEST / height)
    wide, tall = scale * width, scale * height
    x = linear([factor * box[0], factor * box[1]], f"{view.names[0]}, {unit}", pad=0.0, most=4)
    left = across + edge
    panel = chart.panel(_roomy(x, wide, room + RIGHT - 1.0), y, top=top, bottom=top + tall, left=left,
                        right=left + wide, name_at=across + 11.0)  # fmt: skip
    panel.open()
    panel.clip()
    shown = _body(panel, view, factor, box)
    parts = [_line, _ellipses, _drawn] if _thin_ellipse(view, scale) else [_line, _drawn, _ellipses]
    for part in [*parts, _nominal]:
        shown += part(panel, view, factor, box)
    if frame is not None:
        _frame(panel, frame, factor, width)
    panel.unclip()
    panel.close()
    _beyond(panel, view, factor)
    return shown, top + tall + 34.0


def _beyond(panel: Panel, view: TargetView, factor: float) -> None:
    """The nominal orbit where it lies off the picture, and a few drawn orbits: at the edge, with their values."""
    unit = panel.x.label.rpartition(", ")[2]

    fine = round_step(0.01 * (panel.x.high - panel.x.low))  # a part of the picture: four digits may not tell it

    def at(points: Array) -> list[str]:
        return [f"{tick_text(factor * x, fine)}, {tick_text(factor * y, fine)} {unit}" for x, y in points]

    few = view.points[off_axes(panel, *(factor * view.points.T))] if len(view.points) else np.empty((0, 2))
    if 0 < len(few) <= FEW:
        at_edge(panel, factor * few[:, 0], factor * few[:, 1], at(few), GREY, most=3)
    if view.centre is not None:
        x, y = factor * view.centre[:, None]
        at_edge(panel, x, y, [f"nominal orbit: {at(view.centre[None])[0]}"])


Entry = tuple[str, str, dict[str, Any]]


def _roomy(x: Scale, wide: float, room: float) -> Scale:
    """An axis without the ticks whose texts would be cut at the edge of the figure."""
    part = room / wide
    kept = [(v, text) for v, text in x.ticks if float(x.part(np.array(v))) + 0.5 * CHARACTER * len(text) / wide <= part]
    return replace(x, ticks=tuple(kept))


def _thin_ellipse(view: TargetView, scale: float) -> bool:
    """Whether the ellipse is no wider than the drawn orbits, and would hide them."""
    if view.covariance is None:
        return False
    return float(np.sqrt(max(np.linalg.eigvalsh(view.covariance)[0], 0.0))) * scale < 2.0


def _body(panel: Panel, view: TargetView, factor: float, box: Box) -> list[Entry]:
    """Disc and capture circle, where the box shows some of them."""
    circle = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    near = np.array([min(max(0.0, box[0]), box[1]), min(max(0.0, box[2]), box[3])])
    if np.hypot(*near) > view.capture_km:
        return []
    per_km = abs(float(np.diff(panel.at([0.0, factor], [0.0, 0.0])[0])[0]))
    if view.capture_km * per_km < FEWEST_PX:
        panel.dots([0.0], [0.0], "o", view.body, color=RING, size=5.0)
        return [("o", f"{_the(view.body)} (a dot at this scale)", {"color": RING, "size": 5.0})]
    disc: dict[str, Any] = {"fill": DISC, "stroke": RING, "stroke_width": 0.8}
    ring: dict[str, Any] = {"stroke": RING, "stroke_width": 1.2, "stroke_dasharray": "4 3"}
    panel.outline(*(factor * view.radius_km * circle), **disc)
    panel.line(*(factor * view.capture_km * circle), **ring)
    return [("box", f"disc of {_the(view.body)}", disc), ("line", "capture circle: inside it hits", ring)]


def _drawn(panel: Panel, view: TargetView, factor: float, box: Box) -> list[Entry]:
    """Drawn orbits by fate; hits last, on top."""
    entries: list[Entry] = []
    if not len(view.points):
        return entries
    x, y = view.points.T
    inside = (x > box[0]) & (x < box[1]) & (y > box[2]) & (y < box[3])
    points, fates = view.points[inside], np.asarray(view.fates)[inside]
    few = thin(len(points))
    points, fates = points[few], fates[few]
    for fate in reversed([*FATES]):
        marker, color, words = FATES[fate]
        mine = factor * points[fates == fate]
        if len(mine):
            panel.dots(mine[:, 0], mine[:, 1], marker, words, color=color, size=2.4, opacity=0.75)
            entries.append((marker, words, {"color": color, "size": 3.0}))
    return entries


def _line(panel: Panel, view: TargetView, factor: float, box: Box) -> list[Entry]:
    """The line of variations."""
    if view.line is None or len(view.line) < 2:
        return []
    look: dict[str, Any] = {"stroke": GREEN, "stroke_width": 1.4, "stroke_dasharray": "7 3"}
    x, y = factor * view.line.T
    panel.line(x, y, "line of variations", **look)
    return [("line", "line of variations", look)]


def _ellipses(panel: Panel, view: TargetView, factor: float, box: Box) -> list[Entry]:
    """Ellipses, true and formal."""
    entries: list[Entry] = []
    if view.centre is None or view.covariance is None:
        return entries
    true: dict[str, Any] = {"stroke": INK, "stroke_width": 1.4}
    for level in LEVELS:
        rim = factor * (view.centre + outline(view.covariance, level))
        panel.line(*rim.T, **true)
        _level(panel, rim, f"{level:g}σ")
    entries.append(("line", "1 and 3σ, linear", true))
    if view.formal is not None:
        dashed: dict[str, Any] = {"stroke": VERMILION, "stroke_width": 1.1, "stroke_dasharray": "3 5"}
        for level in LEVELS:
            panel.line(*(factor * (view.centre + outline(view.formal, level)).T), **dashed)
        entries.append(("line", "reported by the estimator", dashed))
    return entries


def _level(panel: Panel, rim: Array, text: str) -> None:
    """The level beside the top of an ellipse that is large enough in the picture to have one."""
    px, py = panel.at(*rim.T)
    top = int(np.argmin(py))
    if min(float(np.ptp(px)), float(np.ptp(py))) > 24.0 and panel.top < py[top] and panel.left < px[top] < panel.right:
        panel.chart.text(float(px[top]), float(py[top]) + 11.0, text, "middle", class_="halo")


def _nominal(panel: Panel, view: TargetView, factor: float, box: Box) -> list[Entry]:
    """The estimate itself, on top of all."""
    if view.centre is None:
        return []
    panel.dots([factor * view.centre[0]], [factor * view.centre[1]], "P", "nominal orbit", color=INK)
    return [("P", "nominal orbit", {"color": INK})]


def _frame(panel: Panel, frame: Box, factor: float, width: float) -> None:
    """Where the enlarged part lies; one that would be a dot is drawn as a square of some pixels."""
    least = width / 30.0
    cx, cy = 0.5 * (frame[0] + frame[1]), 0.5 * (frame[2] + frame[3])
    a, b = max(0.5 * (frame[1] - frame[0]), least), max(0.5 * (frame[3] - frame[2]), least)
    x, y = np.array([-a, a, a, -a, -a]) + cx, np.array([-b, -b, b, b, -b]) + cy
    panel.line(factor * x, factor * y, stroke=INK, stroke_width=0.8)


def _data(key: str, view: TargetView) -> list[Download]:
    """Drawn orbits, the line, and the ellipses."""
    names = [f"{name}_km" for name in ("xi", "zeta")]
    files = []
    if len(view.points):
        few = thin(len(view.points))
        columns: dict[str, Any] = dict(zip(names, view.points[few].T.tolist()))
        files.append(csv(f"{key}-drawn", columns | {"fate": np.asarray(view.fates)[few].tolist()}))
    if view.line is not None:
        files.append(csv(f"{key}-line", dict(zip(names, view.line.T.tolist()))))
    if view.centre is not None and view.covariance is not None:
        lines = {
            f"{name}_{level:g}sigma": (view.centre + outline(view.covariance, level))[::2, k].tolist()
            for level in LEVELS for k, name in enumerate(names)
        }  # fmt: skip
        files.append(csv(f"{key}-ellipse", lines))
    return files
