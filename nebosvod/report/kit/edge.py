"""What lies off the axes of a panel, shown at its edge: an arrowhead that points to it, and its value beside.

A mark that is cut away says that nothing is there; one moved to the edge, that it is there. An arrowhead with the
value says neither.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nebosvod.report.kit.chart import CHARACTER, Panel
from nebosvod.report.kit.plate import INK

Array = npt.NDArray[np.float64]
HEAD = 8.0  # px, length of an arrowhead
MOST = 8  # values written in one panel; an arrowhead without one tells it to the pointer
LINE = 12.0  # px between base lines of texts


def off_axes(panel: Panel, x: Array, y: Array) -> npt.NDArray[np.bool_]:
    """Which points (n,) lie off the axes of a panel."""
    across, up = panel.x.part(np.asarray(x, dtype=np.float64)), panel.y.part(np.asarray(y, dtype=np.float64))
    return (across < 0.0) | (across > 1.0) | (up < 0.0) | (up > 1.0)


def at_edge(panel: Panel, x: Array, y: Array, said: Sequence[str], color: str = INK, most: int = MOST) -> int:
    """Draw an arrowhead at the edge for every point (n,) off the axes, its words beside it; returns how many.

    Words that would lie on others, and those beyond the first `most` (the furthest from the middle come first), are
    left to the pointer.
    """
    beyond = np.flatnonzero(off_axes(panel, x, y))
    px, py = panel.at(np.asarray(x)[beyond], np.asarray(y)[beyond])
    far = np.hypot(px - 0.5 * (panel.left + panel.right), py - 0.5 * (panel.top + panel.bottom))
    taken: list[tuple[float, float, float]] = []
    for k in np.argsort(-far, kind="stable"):
        tip = np.array([np.clip(px[k], panel.left, panel.right), np.clip(py[k], panel.top, panel.bottom)])
        _arrowhead(panel, tip, np.array([px[k], py[k]]) - tip, said[int(beyond[k])], color)
        if len(taken) < most:
            _words(panel, tip, said[int(beyond[k])], taken)
    return len(beyond)


def below(panel: Panel, y: float, said: str, color: str = INK) -> None:
    """An arrowhead at the left edge in the row of y: for 0 on a logarithmic axis, which has no place for it."""
    low, high = panel.x.low, panel.x.high
    at_edge(
        panel, np.array([low * low / high if panel.x.kind == "log" else 2.0 * low - high]), np.array([y]), [said], color
    )


def _arrowhead(panel: Panel, tip: Array, outwards: Array, tell: str, color: str) -> None:
    """A filled triangle whose tip touches the edge."""
    along = outwards / np.hypot(*outwards)
    across = np.array([-along[1], along[0]])
    corners = np.stack([tip, tip - HEAD * along + 0.45 * HEAD * across, tip - HEAD * along - 0.45 * HEAD * across])
    panel.chart.area(corners[:, 0], corners[:, 1], tip=tell, fill=color)


def _words(panel: Panel, tip: Array, text: str, taken: list[tuple[float, float, float]]) -> None:
    """Write words beside an arrowhead, on the side where there is room, unless they would lie on others."""
    wide = CHARACTER * len(text)
    right = tip[0] + HEAD + 2.0 + wide <= panel.right
    left = float(tip[0] + HEAD + 2.0 if right else tip[0] - HEAD - 2.0 - wide)
    base = float(np.clip(tip[1] + 3.6, panel.top + 9.0, panel.bottom - 3.0))
    if any(abs(base - b) < LINE and left < r + 4.0 and left + wide > a - 4.0 for a, r, b in taken):
        return
    taken.append((left, left + wide, base))
    panel.chart.text(left if right else left + wide, base, text, "start" if right else "end", class_="halo")
