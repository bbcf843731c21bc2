"""A figure of the report: palette, axes, and SVG with nothing in it that the page does not need.

matplotlib's Figure is used without pyplot (0.7 s of import) and without mathtext (its parser costs 0.1 s), text stays
text, so that the page's own font sets it and a reader can search and copy it.
"""

import io
import math
import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from nebosvod.report.download import Download
from nebosvod.report.folder import Array
from nebosvod.report.wording import SUPERSCRIPT, number
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

# Okabe and Ito (2008): told apart with every common colour blindness; the order keeps them apart in grey too
INK, BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, GREY = (
    "#1a1a1a", "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#767676",
)  # fmt: skip
SERIES = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (PURPLE, "D"), (ORANGE, "v"), (SKY, "P"))
POINTS = 1500  # at most so many markers a panel: more cannot be seen and only make the page heavy

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "nebosvod", "font.family": "DejaVu Sans", "font.size": 9.0,
    "axes.titlesize": 9.0, "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5, "ytick.labelsize": 8.5, "legend.fontsize": 8.5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": GREY, "axes.labelcolor": INK,
    "axes.linewidth": 0.7, "xtick.color": GREY, "ytick.color": GREY, "xtick.labelcolor": INK, "ytick.labelcolor": INK,
    "xtick.major.width": 0.7, "ytick.major.width": 0.7, "axes.grid": True,
    "grid.color": "#e4e4e4", "grid.linewidth": 0.6,
    "axes.axisbelow": True, "legend.frameon": False, "lines.linewidth": 1.6, "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False, "text.parse_math": False, "figure.constrained_layout.use": False,
    "path.simplify": True, "hatch.linewidth": 0.6,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Plate:
    """One figure: inline SVG, what it shows (for who cannot see it), its caption, its numbers as files."""

    key: str
    svg: Markup
    label: str
    caption: Markup
    data: tuple[Download, ...] = ()


def figure(width_in: float, height_in: float, *, rows: int = 1, gap_in: float = 0.15, bottom_in: float = 0.5) -> Figure:
    """An empty figure in the report's style; draw and write it inside `style()`.

    Margins are fixed, in inches (room for seven characters left of the axes): matplotlib's layout engines measure every
    label three times and take a third of the time of a report.
    """
    canvas = FigureCanvasSVG(Figure(figsize=(width_in, height_in)))
    found: Figure = canvas.figure
    top_in = gap_in if rows > 1 else 0.12
    row_in = (height_in - bottom_in - top_in - (rows - 1) * gap_in) / rows
    found.subplots_adjust(
        left=0.68 / width_in, right=1.0 - 0.12 / width_in, bottom=bottom_in / height_in, top=1.0 - top_in / height_in,
        wspace=0.08, hspace=gap_in / row_in,
    )  # fmt: skip
    return found


def style() -> Any:
    """The context in which the report's figures are drawn, whatever a user's matplotlibrc says."""
    settings: dict[Any, Any] = {
        key: value for key, value in mpl.rcParamsDefault.items() if not str(key).startswith(("backend", "interactive"))
    }
    return mpl.rc_context({**settings, **STYLE, "axes.prop_cycle": cycler(color=[c for c, _ in SERIES])})


def plate(fig: Figure, key: str, label: str, caption: Markup) -> Plate:
    """Write a figure as an inline SVG element that scales with the page."""
    stream = io.StringIO()
    fig.savefig(
        stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
    )
    return Plate(key=key, svg=Markup(clean_svg(stream.getvalue(), key, label)), label=label, caption=caption)


def clean_svg(text: str, key: str, label: str) -> str:
    """Strip prologue, unused ids and fixed fonts; make ids unique on the page; name the picture."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'<style type="text/css">.*?</style>', "", text, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    text = re.sub(r' id="([^"]+)"', lambda m: f' id="{key}-{m[1]}"' if m[1] in used else "", text)
    text = re.sub(r'(href="#|url\(#)', rf"\g<1>{key}-", text)
    text = re.sub(r"font-family: [^;\"]+;? ?", "", text)
    text = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font-size: \1", text)
    text = re.sub(r' transform="rotate\(-?0 [^"]*\)"', "", text)
    text = re.sub(r"\s*\n\s*", "\n", re.sub(r"(\d\.\d\d)\d+", r"\1", text))
    head = re.search(r'viewBox="[^"]+"', text)
    box = head[0] if head else ""
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {box}'
    opening += f' role="img" aria-label="{Markup.escape(label)}">'
    return re.sub(r"<svg[^>]*>", lambda _: opening, text, count=1).strip()


def power_text(value: float, _: object = None) -> str:
    """A decade of a log axis: 0.01, 1, 1000, 10⁴."""
    exponent = round(math.log10(value)) if value > 0 else 0
    return number(value, 1) if -3 <= exponent <= 3 else f"10{str(exponent).translate(SUPERSCRIPT)}"


def log_axis(axes: Any) -> None:
    """A logarithmic y axis that labels decades in plain text, and 2 and 5 as well where there are few."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(power_text))
    low, high = axes.get_ylim()
    few = math.log10(high / low) < 2.0
    axes.yaxis.set_minor_formatter(
        FuncFormatter(lambda v, _: number(v, 1) if _lead(v) in (2, 5) else "") if few else NullFormatter()
    )


def _lead(value: float) -> int:
    """Leading digit."""
    return round(value / 10.0 ** math.floor(math.log10(value) + 1e-9))


def time_axis(axes: Any, epoch: Epoch, t_s: Array, right: float = 0.03) -> None:
    """Label an x axis, which counts days after `epoch`, with calendar dates (TDB).

    The last part `right` of the axis stays without a date, which would be cut.
    """
    low, high = float(np.min(t_s)) / SECONDS_PER_DAY, float(np.max(t_s)) / SECONDS_PER_DAY
    pad = 0.02 * (high - low) or 0.5
    axes.set_xlim(low - pad, high + pad)
    origin = datetime.fromisoformat(epoch.iso(digits=0).removesuffix(" TDB"))
    marks, pattern = _dates(origin + timedelta(days=low - pad), origin + timedelta(days=high + pad))
    if pattern != "%Y":
        end = high + pad - right * (high - low)
        marks = [m for m in marks if (m - origin).total_seconds() / SECONDS_PER_DAY < end]
    axes.xaxis.set_major_locator(FixedLocator([(m - origin).total_seconds() / SECONDS_PER_DAY for m in marks]))
    texts = [m.strftime(pattern) for m in marks]
    axes.xaxis.set_major_formatter(FuncFormatter(lambda _, i: texts[i] if i is not None and i < len(texts) else ""))
    axes.set_xlabel("date, TDB")


def _dates(start: datetime, end: datetime) -> tuple[list[datetime], str]:
    """About five round dates between two moments, and how to write them."""
    days = (end - start).total_seconds() / SECONDS_PER_DAY
    if days > 75:
        step = next(s for s in (1, 2, 3, 6, 12, 24, 60, 120, 240, 600, 1200) if days / 30.44 / s <= 6.0)
        first = start.year * 12 + start.month
        months = [m for m in range(first, end.year * 12 + end.month) if m % step == 0]
        return [datetime(m // 12, m % 12 + 1, 1) for m in months], "%Y-%m" if step < 12 else "%Y"
    hours = next(h for h in (1, 3, 6, 12, 24, 48, 120, 240, 360) if days * 24 / h <= 5.5)
    origin = datetime(start.year, 1, 1)
    k = math.ceil((start - origin).total_seconds() / 3600 / hours)
    marks = []
    while origin + timedelta(hours=k * hours) <= end:
        marks.append(origin + timedelta(hours=k * hours))
        k += 1
    return marks, "%Y-%m-%d" if hours >= 24 else "%m-%d %H:%M"


def thin(n: int, most: int = POINTS) -> slice:
    """Every k-th of n points, at most `most` of them."""
    return slice(None, None, max(1, math.ceil(n / most)))
