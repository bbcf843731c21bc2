"""A finished figure, and the palette of all figures."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from nebosvod.report.kit.download import Download

if TYPE_CHECKING:
    from nebosvod.report.kit.chart import Chart

# Okabe and Ito (2008): told apart with every common colour blindness; the order keeps them apart in grey too
INK, BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, GREY = (
    "#1a1a1a", "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#767676",
)  # fmt: skip
SERIES = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (PURPLE, "D"), (ORANGE, "v"), (SKY, "P"))
POINTS = 1500  # at most so many markers a panel: more cannot be seen and only make the page heavy


@dataclass(frozen=True, slots=True, kw_only=True)
class Plate:
    """One figure: inline SVG, what it shows (for who cannot see it), its caption, its numbers as files.

    `narrow` is the same drawn anew for a phone, where the other would be too small to read; `chart` are its parts.
    """

    key: str
    svg: Markup
    label: str
    caption: Markup
    data: tuple[Download, ...] = ()
    narrow: Markup | None = None
    chart: "Chart | None" = None


def thin(n: int, most: int = POINTS) -> slice:
    """Every k-th of n points, at most `most` of them."""
    return slice(None, None, max(1, math.ceil(n / most)))
