"""Which scheduled epochs each telescope saw, and why the others were lost."""

import csv as reader
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.borders.stored import read_bytes
from nebosvod.errors import InputError
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, PURPLE, SERIES, SKY, VERMILION, Plate, thin
from nebosvod.report.kit.scale import calendar, linear, named
from nebosvod.report.kit.wording import NBSP, REMOVED, join
from nebosvod.results.folder import RunFolder
from nebosvod.timescale import SECONDS_PER_DAY

COLOURS: Mapping[str, str] = {
    "-": BLUE, "sun": ORANGE, "earth": GREEN, "moon": GREY, "magnitude": PURPLE,
    "faint": PURPLE, "limiting_magnitude": PURPLE,
    "phase": SKY, "twilight": SKY, "altitude": GREEN,
}  # fmt: skip
MOST = 4000  # ticks of one telescope: more cannot be told apart

Columns = Mapping[str, Sequence[str]]


def read_visibility(folder: Path) -> Columns | None:
    """The columns of tables/visibility.ecsv as text; None where the folder has no such table."""
    path = folder / "tables" / "visibility.ecsv"
    try:
        text = read_bytes(path).decode("utf-8")
    except FileNotFoundError:
        return None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    lines = (line for line in StringIO(text, newline="") if not line.startswith("#"))
    try:
        rows = list(reader.reader(lines, delimiter=" "))
    except reader.Error as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    if len(rows) < 2:
        return None
    if any(len(row) != len(rows[0]) for row in rows):
        raise InputError(f"{path}: cannot be read (a row has not {len(rows[0])} columns)")
    return dict(zip(rows[0], zip(*rows[1:])))


def timeline(run: RunFolder, columns: Columns | None) -> Plate | None:
    """A line of ticks for each telescope: seen, or lost and why; below, the magnitude."""
    if columns is None or not {"t", "telescope", "reason"} <= set(columns):
        return None
    t = np.array(columns["t"], dtype=np.float64)
    if np.ptp(t) == 0.0:
        return None
    who, why = np.array(columns["telescope"]), np.array(columns["reason"])
    names = list(dict.fromkeys(columns["telescope"]))
    reasons = sorted(set(why.tolist()) - {"-"})
    magnitude = np.array(columns.get("magnitude", ["nan"] * len(t)), dtype=np.float64)
    bright = bool(np.any(np.isfinite(magnitude)))
    dates = calendar(run.epoch, t)
    high = 24.0 * len(names)
    chart = Chart("visibility", height=0.0)
    left = max(58.0, 9.0 + 5.7 * max(len(n) for n in names))
    panel = chart.panel(dates.silenced() if bright else dates, named(names), top=8.0, bottom=8.0 + high, left=left)
    panel.open()
    for reason in ("-", *reasons):
        for i, name in enumerate(names):
            mine = np.flatnonzero((who == name) & (why == reason))
            mine = mine[thin(len(mine), MOST)]
            reach = -8.0 if reason == "-" else 8.0
            if len(mine):
                look = {"stroke": _colour(reason), "stroke_width": 1.0}
                panel.sticks(t[mine] / SECONDS_PER_DAY, -float(i), reach, _why(reason), **look)
    panel.close()
    below = 8.0 + high
    if bright:
        scale = linear(magnitude[np.isfinite(magnitude)], "V, mag", most=4).reversed()
        lower = chart.panel(dates, scale, top=below + 12.0, bottom=below + 92.0, left=left)
        _brightness(run, lower, names, t, who, magnitude)
        below += 92.0
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("box", _why(reason), {"fill": _colour(reason)}) for reason in ("-", *reasons)
    ]
    chart.height = chart.legend(entries, below + 44.0)
    few = thin(len(t), MOST)
    data = csv("visibility", {
        "epoch_tdb": list(columns["epoch_tdb"])[few], "telescope": who[few].tolist(),
        "seen_or_lost": [_why(r) for r in why[few].tolist()], "magnitude_v": magnitude[few].tolist(),
    })  # fmt: skip
    return chart.plate("Scheduled epochs of each telescope: seen, or lost and why", _caption(names, who, why), [data])


def _brightness(run: RunFolder, panel: Any, names: Sequence[str], t: Any, who: Any, magnitude: Any) -> None:
    """Magnitude of every scheduled exposure, bright above."""
    panel.open()
    order = {name: i for i, name in enumerate(run.telescopes)}
    for name in names:
        mine = np.flatnonzero(who == name)
        mine = mine[thin(len(mine), 300)]
        i = order.get(name, 0)
        colour, marker = SERIES[i % len(SERIES)]
        panel.dots(t[mine] / SECONDS_PER_DAY, magnitude[mine], marker, name, color=colour, size=4.0 if i == 0 else 2.0)
    panel.close()


def _why(reason: str) -> str:
    """What happened to an epoch, in words."""
    return "seen" if reason == "-" else REMOVED.get(reason, reason.replace("_", " "))


def _colour(reason: str) -> str:
    """The colour of a reason."""
    return COLOURS.get(reason, VERMILION)


def _caption(names: Sequence[str], who: Any, why: Any) -> Markup:
    """How many each telescope saw, and what cost it most."""
    parts = []
    for name in names:
        mine = why[who == name]
        seen = int(np.count_nonzero(mine == "-"))
        lost = {reason: int(np.count_nonzero(mine == reason)) for reason in set(mine.tolist()) - {"-"}}
        text = Markup("<b>{}</b> saw {} of {}").format(name, seen, len(mine))
        if lost:
            text += Markup(" (lost: {})").format(
                join(f"{n} {_why(r)}" for r, n in sorted(lost.items(), key=lambda x: -x[1]))
            )
        parts.append(text)
    every = int(np.count_nonzero(why == "-"))
    return Markup(
        "Of {} scheduled epochs {} were seen ({}{}%). {}. Seen epochs stand below the line of a telescope, lost ones "
        "above it, by the first limit that removes them."
    ).format(
        len(why), every, round(100 * every / len(why)), NBSP, Markup("; ").join(parts))  # fmt: skip
