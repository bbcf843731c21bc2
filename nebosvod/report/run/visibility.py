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
from nebosvod.report.kit.chart import Panel
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, thin
from nebosvod.report.kit.wording import NBSP, REMOVED, join
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


def sticks(panel: Panel, names: Sequence[str], t_s: Any, who: Any, reason: Any, reasons: Sequence[str]) -> None:
    """A line of strokes for each telescope: seen below it, lost above it."""
    for one in reasons:
        for i, name in enumerate(names):
            mine = np.flatnonzero((who == name) & (reason == one))
            mine = mine[thin(len(mine), MOST)]
            reach = -8.0 if one == "-" else 8.0
            if len(mine):
                look = {"stroke": colour_of(one), "stroke_width": 1.0}
                panel.sticks(t_s[mine] / SECONDS_PER_DAY, -float(i), reach, why(one), **look)


def why(reason: str) -> str:
    """What happened to an epoch, in words."""
    return "seen" if reason == "-" else REMOVED.get(reason, reason.replace("_", " "))


def colour_of(reason: str) -> str:
    """The colour of a reason."""
    return COLOURS.get(reason, VERMILION)


def seen_caption(columns: Columns) -> Markup:
    """How many each telescope saw, and what cost it most."""
    who, reason = np.array(columns["telescope"]), np.array(columns["reason"])
    parts = []
    for name in dict.fromkeys(columns["telescope"]):
        mine = reason[who == name]
        seen = int(np.count_nonzero(mine == "-"))
        lost = {one: int(np.count_nonzero(mine == one)) for one in set(mine.tolist()) - {"-"}}
        text = Markup("<b>{}</b> saw {} of {}").format(name, seen, len(mine))
        if lost:
            text += Markup(" (lost: {})").format(
                join(f"{n} {why(r)}" for r, n in sorted(lost.items(), key=lambda x: -x[1]))
            )
        parts.append(text)
    every = int(np.count_nonzero(reason == "-"))
    return Markup(
        "Of {} scheduled epochs {} were seen ({}{}%). {}. Seen epochs stand below the line of a telescope, lost ones "
        "above it, by the first limit that removes them."
    ).format(
        len(reason), every, round(100 * every / len(reason)), NBSP, Markup("; ").join(parts))  # fmt: skip
